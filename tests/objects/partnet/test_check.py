"""A trigger that can be read, but that nothing would ever move, is told of, with what to do."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from busybot.objects.importing.annotation_edits import Choices, Overrides
from busybot.objects.importing.auto_annotation import FACING
from busybot.objects.importing.importer import ImportOutcome, import_objects
from busybot.objects.partnet.check import Finding, check_objects
from busybot.objects.partnet.loader import load_object
from tests.objects.raw_objects import GROUND, STICK, Link, box_link, library_of, make_raw

RAIL = ((-0.05, -1.5, -0.2), (0.05, 1.5, 0.2))


def fader(ends: float) -> Link:
    """A knob on a rail of 3 to 0.4 that slides so far to either side."""
    return Link("slider", ((-0.25, -0.15, -0.15), (-0.05, 0.15, 0.15)), "prismatic", (0, 1, 0), (-ends, ends))


def imported(folder: Path, library: Path, **choices: Any) -> ImportOutcome:
    given = Overrides(None, {folder.name: Choices(**choices)} if choices else {}, {})
    (outcome,) = import_objects([folder], library, given, replace=True)
    return outcome


def change(file: Path, **values: Any) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def test_a_switch_that_no_action_can_move_is_asked_about_and_bad_until_it_is_smaller(tmp_path: Path) -> None:
    raw, library = make_raw(tmp_path / "raw" / "7", "Switch", fader(1.2), body=RAIL), tmp_path / "library"
    outcome = imported(raw, library)
    (question,) = outcome.questions
    assert "link_0 has to be pulled 0.318 board units" in question and "0.16 or less" in question
    (finding,) = check_objects(library)
    assert finding.name == "Switch/7" and finding.problem is not None and finding.hint is not None
    assert str(library / "Switch/7/object_meta_info.json: Scale: link_0 has to be pulled 0.318") in finding.problem
    assert finding.hint == "make Scale 0.16 or less, or give joint_0 less travel in mobility.urdf"
    assert imported(raw, library, scale=0.16).questions == ()
    assert check_objects(library) == [Finding("Switch/7")]


def test_less_travel_mends_it_too(tmp_path: Path) -> None:
    raw = make_raw(tmp_path / "raw" / "7", "Switch", fader(0.7), body=RAIL)
    assert imported(raw, tmp_path / "library").questions == ()
    assert check_objects(tmp_path / "library") == [Finding("Switch/7")]


def test_only_the_links_that_are_movable_count(tmp_path: Path) -> None:
    button = Link("button", ((-0.1, 1.0, -0.1), (-0.05, 1.2, 0.1)), "prismatic", (-1, 0, 0), (-0.05, 0))
    raw = make_raw(tmp_path / "raw" / "7", "Switch", fader(1.2), button, body=RAIL)
    facing: dict[str, Any] = {"orientation": FACING}
    outcome = imported(raw, tmp_path / "library", **facing, links={"link_1": "two-state"})
    assert outcome.questions == () and check_objects(tmp_path / "library") == [Finding("Switch/7")]
    (question,) = imported(raw, tmp_path / "library", **facing).questions
    assert question.startswith("link_0 has to be pulled")


def test_other_doubts_are_still_told(tmp_path: Path) -> None:
    imported(make_raw(tmp_path / "raw" / "7", "Switch", STICK, body=GROUND), tmp_path / "library")
    (finding,) = check_objects(tmp_path / "library")
    assert finding.ok and (finding.question or "").startswith("which side faces the camera?")


@pytest.mark.parametrize("value", [None, []])
def test_a_trigger_without_directions_is_bad_since_strict_mode_refuses_all(
    procedural: Path, tmp_path: Path, value: object
) -> None:
    folder = tmp_path / "slider-01"
    shutil.copytree(procedural / "Switch" / "slider-01", folder)
    assert check_objects(folder) == [Finding("slider-01")]
    change(folder / "object_meta_info.json", Direction=value)
    (finding,) = check_objects(folder)
    assert (
        finding.problem is not None and f"{folder / 'object_meta_info.json'}: Direction: names none" in finding.problem
    )
    assert "strict mode" in finding.problem and finding.hint


def test_a_responder_needs_no_directions(procedural: Path, tmp_path: Path) -> None:
    folder = tmp_path / "star-01"
    shutil.copytree(procedural / "Lamp" / "star-01", folder)
    assert check_objects(folder) == [Finding("star-01")]


def test_a_responder_whose_steps_are_equal_can_be_read_and_is_bad(procedural: Path, tmp_path: Path) -> None:
    """As those were that earlier rules imported: boards with them stay what they are."""
    folder = tmp_path / "bead-01"
    shutil.copytree(procedural / "Toy" / "bead-01", folder)
    assert check_objects(folder) == [Finding("bead-01")]
    file = folder / "object_meta_info.json"
    (entry,) = json.loads(file.read_text())["Effect"]
    change(file, Effect=[entry | {"Steps": [entry["Steps"][0], *entry["Steps"][:2]]}])
    assert load_object(folder).effect is not None
    (finding,) = check_objects(folder)
    assert finding.problem is not None and "Effect: Steps 0 and 1 are equal" in finding.problem
    assert finding.hint is not None and "--replace" in finding.hint


def test_what_is_fixed_to_a_link_may_be_held_nearer_to_its_axis(tmp_path: Path) -> None:
    far, near = box_link("arm", "0.2 0.2 0.2", "1 0 0"), box_link("hub", "0.1 0.1 0.1")
    turns = '<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>{}</joint>'
    fixed = '<joint name="f" type="fixed"><parent link="arm"/><child link="hub"/><origin xyz="0.1 0 0"/></joint>'
    limit = '<limit lower="-0.6" upper="0.6"/>'
    for more, bad in (("", True), (near + fixed, False)):
        urdf = "".join((box_link("base", "1 1 0.1"), far, turns.format(limit), more))
        library_of(tmp_path / str(bad), urdf, category="Switch", scale=1.0, links={"arm": "two-state"})
        found = [one.problem or "" for one in check_objects(tmp_path / str(bad) / "library")]
        assert ("has to be pulled" in " ".join(found)) is bad


def test_a_door_that_is_a_trigger_has_no_doubts_of_an_import_which_makes_none(procedural: Path, tmp_path: Path) -> None:
    folder = tmp_path / "Door" / "rocker-01"
    shutil.copytree(procedural / "Switch" / "rocker-01", folder)
    change(folder / "object_meta_info.json", Category="Door", Import={"overrides": []})
    assert check_objects(folder) == [Finding("rocker-01")]
