"""The import rules decide as a reviewer would: on objects made for each rule, on the paper's and on a real raw one."""

import math
from pathlib import Path

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.objects.importing.annotation_edits import Choices
from busybot.objects.importing.auto_annotation import FACING, POSES, STANDING, AutoAnnotation, decide
from busybot.objects.importing.importer import annotate
from busybot.objects.importing.raw import read_raw
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.objects.partnet.urdf import rotation
from tests.objects.raw_objects import DRAWER, GROUND, KNOB, LEAF, LEVER, ROCKER, STICK, Link, make_raw

DEEP = ((-0.1, -0.5, -0.6), (1.1, 0.5, 0.6))
"""A box of the same front as the plate, but as deep as it is high."""


def decided(folder: Path, given: Choices | None = None) -> tuple[AutoAnnotation, ObjectModel]:
    raw = read_raw(folder)
    decision = decide(raw, given)
    return decision, annotate(raw, decision, given)[1]


def test_a_rocker_is_a_two_state_trigger_that_is_pressed(tmp_path: Path) -> None:
    decision, model = decided(make_raw(tmp_path / "1", "Switch", ROCKER))
    assert (model.key, model.role, decision.choices.orientation) == ("Switch/1", "trigger", FACING)
    (link,) = model.trigger_links
    assert (link.name, link.kind) == ("link_0", "two-state")
    # hinge along y, upright too: it tilts in x and z
    assert set(model.directions) == {(0, 0, 1), (0, 0, -1), (1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1)}
    # a square of equal area has a side of 0.29
    assert model.scale * np.sqrt(1.2 * 1.0) == pytest.approx(0.29, rel=0.01)
    assert decision.low[2] * model.scale + model.offset_z == pytest.approx(0, abs=1e-6)


def test_a_lever_on_a_box_is_multi_directional_and_on_a_plate_is_not(tmp_path: Path) -> None:
    _, on_box = decided(make_raw(tmp_path / "1", "Switch", LEVER, body=DEEP))
    _, on_plate = decided(
        make_raw(
            tmp_path / "2",
            "Switch",
            Link("lever", LEVER.box, limits=(-1, 1)),
            body=((-0.1, -1.5, -1.6), (0.1, 1.5, 1.6)),
        )
    )
    assert [link.kind for link in on_box.trigger_links] == ["multi-direction"]
    assert [link.kind for link in on_plate.trigger_links] == ["two-state"]
    assert set(on_box.directions) == {(1, 0, 0), (-1, 0, 0)}


def test_a_knob_without_stops_turns_a_quarter(tmp_path: Path) -> None:
    _, model = decided(make_raw(tmp_path / "1", "Switch", KNOB))
    (link,) = model.trigger_links
    assert (link.lower, link.upper) == pytest.approx((0, np.pi / 2))
    assert set(model.directions) == {(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)}


def test_a_button_is_pressed_along_the_line_of_sight(tmp_path: Path) -> None:
    button = Link("button", ROCKER.box, "prismatic", (-1, 0, 0), (-0.05, 0))
    _, model = decided(make_raw(tmp_path / "1", "Switch", button))
    assert {(0, 0, 1), (0, 0, -1)} < set(model.directions) and not {(1, 0, 0), (0, 1, 0)} & set(model.directions)


def test_a_door_opens_from_its_flat_end(tmp_path: Path) -> None:
    turned = Link(LEAF.name, LEAF.box, axis=(0, 0, 1), origin=LEAF.origin, limits=(-1.5, 0.0))
    for instance, link, opened in (
        ("1", turned, -1.5),
        ("2", Link(LEAF.name, LEAF.box, axis=(0, 0, 1), origin=LEAF.origin, limits=(0, 1.2)), 1.2),
    ):
        _, model = decided(make_raw(tmp_path / instance, "Door", link))
        assert model.effect is not None and model.effect.single == ((0,), (opened,)) and model.effect.multi is None
        assert model.scale * 1.2 == pytest.approx(0.71, rel=0.01)


def test_a_second_leaf_makes_three_stages_and_slides_in_board_units(tmp_path: Path) -> None:
    decision, model = decided(make_raw(tmp_path / "1", "StorageFurniture", LEAF, DRAWER))
    assert (model.category, model.role) == ("Door", "responder") and decision.choices.orientation == FACING
    assert model.effect is not None and model.effect.joints == ("joint_0", "joint_1")
    assert model.effect.single == ((0, 0), (0.4, 0))
    assert model.effect.multi is not None
    assert model.effect.multi[2] == pytest.approx((0, 0.5 * model.scale))


def test_a_handle_on_a_leaf_is_no_control(tmp_path: Path) -> None:
    handle = Link("knob", ROCKER.box, axis=(1, 0, 0), parent="link_0")
    assert decided(make_raw(tmp_path / "1", "Safe", LEAF, handle))[1].category == "Door"
    handle = Link("knob", ROCKER.box, axis=(1, 0, 0))
    model = decided(make_raw(tmp_path / "2", "Safe", LEAF, handle))[1]
    assert model.category == "Switch" and [link.name for link in model.trigger_links] == ["link_1"]


def test_without_names_sizes_decide(tmp_path: Path) -> None:
    for instance, link, category in (("1", ROCKER, "Switch"), ("2", LEAF, "Door")):
        folder = make_raw(tmp_path / instance, None, link)
        (folder / "semantics.txt").unlink()
        decision, model = decided(folder)
        assert model.category == category and "nothing names it" in " ".join(decision.notes)


def test_what_is_on_top_is_seen_from_above(tmp_path: Path) -> None:
    keys = [Link("key", ((x, -0.1, 0.6), (x + 0.1, 0.1, 0.65)), "prismatic", (0, 0, 1), (-0.03, 0)) for x in (-0.1, 0)]
    decision, model = decided(make_raw(tmp_path / "1", "Keyboard", *keys))
    assert decision.choices.orientation == STANDING and {(0, 0, 1), (0, 0, -1)} < set(model.directions)


def test_at_most_four_links_the_largest(tmp_path: Path) -> None:
    buttons = [
        Link("button", ((-0.2, 0.2 * k, -size), (-0.1, 0.2 * k + 0.1, size)), "prismatic", (-1, 0, 0), (0, 0.03))
        for k, size in enumerate((0.1, 0.2, 0.02, 0.3, 0.15, 0.01))
    ]
    decision, model = decided(make_raw(tmp_path / "1", "Remote", *buttons))
    assert [link.name for link in model.trigger_links] == ["link_0", "link_1", "link_3", "link_4"]
    assert any("4 largest" in note for note in decision.notes)


def test_a_lamp_paints_what_is_named_a_light_else_the_end_of_its_chain(tmp_path: Path) -> None:
    arm = Link("bar", ROCKER.box)
    shade = Link("lamp_shade", ROCKER.box, parent="link_0")
    foot = Link("foot", ROCKER.box, parent="link_1")
    _, named = decided(make_raw(tmp_path / "1", "Lamp", arm, shade, foot))
    folder = make_raw(tmp_path / "2", "Lamp", arm, shade, foot)
    for name in ("semantics.txt", "mobility_v2.json"):
        (folder / name).unlink()
    _, unnamed = decided(folder)
    assert named.effect is not None and named.effect.link == "link_1" and named.role == "responder"
    assert unnamed.effect is not None and unnamed.effect.link == "link_2"
    for effect in (named.effect, unnamed.effect):
        assert effect.single is not None and effect.multi is not None
        assert effect.single[0] == effect.multi[0] == (0, 0, 0) and len({*effect.single, *effect.multi}) == 4


def test_what_a_reviewer_gives_is_kept(tmp_path: Path) -> None:
    given = Choices(category="Switch", scale=0.5, orientation=STANDING, links={"link_0": "multi-direction"})
    decision, model = decided(make_raw(tmp_path / "1", "Door", LEAF), given)
    assert (model.key, model.scale, model.orientation) == ("Switch/1", 0.5, (1, 0, 0, 0))
    assert [link.kind for link in model.trigger_links] == ["multi-direction"]
    assert decision.choices.directions, "what is left out is decided by the rules"


@pytest.mark.parametrize(
    ("category", "links", "reason"),
    [
        ("Switch", [], "no joint moves anything"),
        ("Table", [], "no joint moves anything"),
        ("Door", [Link("door", LEAF.box, limits=(0, 0))], "no joint moves anything"),
        ("Switch", [Link("slider", ROCKER.box, "prismatic", limits=(-math.inf, math.inf))], "no joint moves anything"),
        ("Switch", [Link("slider", ROCKER.box, "prismatic", limits=None)], "no lower limit"),
        ("Lamp", [], "single link"),
        ("Bottle", [Link("cap", ROCKER.box, "floating")], "floating"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason(
    tmp_path: Path, category: str, links: list[Link], reason: str
) -> None:
    with pytest.raises(BusybotError, match=reason) as caught:
        decided(make_raw(tmp_path / "77", category, *links))
    assert "77" in caught.value.what and caught.value.hint


def test_a_box_that_disagrees_with_the_meshes_is_noted(tmp_path: Path) -> None:
    folder = make_raw(tmp_path / "1", "Switch", ROCKER, bounding_box__json='{"min": [0, 0, 0], "max": [1, 1, 9]}')
    assert any("bounding_box.json" in note for note in decided(folder)[0].notes)


@pytest.mark.long
def test_the_paper_objects_are_annotated_as_their_authors_did(partnet: Path) -> None:
    """The result of benchmarks/studies/import_rules.py has all figures; these are the ones that must not slip."""
    for truth in Library.load(partnet).objects.values():
        decision, model = decided(truth.folder)
        assert (model.key, model.role) == (truth.key, truth.role)
        assert model.scale == pytest.approx(truth.scale, rel=0.25), truth.key
        assert model.orientation == pytest.approx(truth.orientation, abs=1e-4), truth.key
        assert [(link.name, link.kind) for link in model.trigger_links] == [
            (link.name, link.kind) for link in truth.trigger_links
        ], truth.key
        if truth.effect is not None:
            assert model.effect is not None and model.effect.link == truth.effect.link, truth.key
        if truth.category == "Door":
            assert model.effect is not None and truth.effect is not None
            assert (model.effect.joints, model.effect.single) == (truth.effect.joints, truth.effect.single), truth.key


def test_the_real_cabinet_opens_its_door_or_its_drawer(partnet_raw: Path) -> None:
    decision, model = decided(partnet_raw / "40147")
    assert model.key == "Door/40147" and decision.choices.orientation == FACING
    assert model.effect is not None and model.effect.joints == ("joint_0", "joint_1")
    assert model.effect.multi == ((0, 0), (pytest.approx(np.pi / 2), 0), (0, pytest.approx(0.6 * model.scale)))


@pytest.mark.parametrize("category", ["Switch", None, "Machine"])
def test_a_lever_that_would_be_laid_on_its_side_is_asked_about(tmp_path: Path, category: str | None) -> None:
    folder = make_raw(tmp_path / "1", category, STICK, body=GROUND)
    decision, _ = decided(folder)
    assert decision.choices.orientation == FACING
    (question,) = decision.questions
    assert question.startswith("which side faces the camera?") and "top: [0.0, 0.0, 0.0, 1.0]" in question
    answered, _ = decided(folder, Choices(orientation=STANDING))
    assert answered.questions == () and answered.choices.orientation == STANDING


def test_a_front_elsewhere_than_in_partnet_is_asked_about_and_a_plain_one_is_not(tmp_path: Path) -> None:
    box = ((-0.5, -0.5, -0.6), (0.5, 0.5, 0.6))
    asked = {}
    for side, (low, high, axis) in {
        "-x": ((-0.6, -0.1, -0.1), (-0.5, 0.1, 0.1), (-1, 0, 0)),
        "+x": ((0.5, -0.1, -0.1), (0.6, 0.1, 0.1), (1, 0, 0)),
        "+y": ((-0.1, 0.5, -0.1), (0.1, 0.6, 0.1), (0, 1, 0)),
        "top": ((-0.1, -0.1, 0.6), (0.1, 0.1, 0.7), (0, 0, 1)),
    }.items():
        button = Link("button", (low, high), "prismatic", axis, (-0.05, 0))
        asked[side] = bool(decided(make_raw(tmp_path / str(len(asked)), "Machine", button, body=box))[0].questions)
    assert asked == {"-x": False, "+x": True, "+y": True, "top": False}
    assert not decided(make_raw(tmp_path / "plate", None, ROCKER))[0].questions


def test_poses_turn_their_side_to_the_camera() -> None:
    sides = {"top": (0, 0, 1), "-x": (-1, 0, 0), "+x": (1, 0, 0), "-y": (0, -1, 0), "+y": (0, 1, 0)}
    text = (Path(__file__).resolve().parents[3] / "docs/extending/add-an-object.md").read_text()
    for side, (x, y, z, w) in POSES.items():
        assert rotation((w, x, y, z)) @ np.array(sides[side]) == pytest.approx((0, 0, 1), abs=1e-6)
        assert f"`[{x:.8g}, {y:.8g}, {z:.8g}, {w:.8g}]` |" in text


@pytest.mark.parametrize(
    ("axis", "limits", "away"),
    [
        ((0, 1, 0), (0, 0.5), False),
        ((0, -1, 0), (0, 0.5), False),
        ((-1, 0, 0), (0, 0.5), False),
        ((1, 0, 0), (0, 0.5), True),
    ],
)
def test_only_what_goes_away_from_the_camera_is_said_to(
    tmp_path: Path, axis: tuple[float, float, float], limits: tuple[float, float], away: bool
) -> None:
    slide = Link("drawer", DRAWER.box, "prismatic", axis, limits)
    decision, _ = decided(make_raw(tmp_path / "1", "Door", slide))
    assert ("opens away" in " ".join(decision.notes)) == away


HALF_TURN, QUARTER_TURN = math.pi, math.pi / 2


@pytest.mark.parametrize(
    ("joint", "limits", "steps"),
    [
        ("prismatic", (-0.3, 0.5), (0.0, -0.3, 0.5)),
        ("prismatic", (0.0, 0.8), (0.4, 0.0, 0.8)),
        ("prismatic", (-0.8, 0.0), (-0.4, -0.8, 0.0)),
        ("prismatic", (0.2, 0.8), (0.5, 0.2, 0.8)),
        ("prismatic", (-0.01, 0.8), (0.395, -0.01, 0.8)),
        ("revolute", (0.0, 1.0), (0.5, 0.0, 1.0)),
        ("continuous", None, (QUARTER_TURN / 2, 0.0, QUARTER_TURN)),
        ("revolute", (-HALF_TURN, HALF_TURN), (0.0, -HALF_TURN, QUARTER_TURN)),
        ("revolute", (-HALF_TURN, 0.0), (-HALF_TURN / 2, -HALF_TURN, 0.0)),
        ("revolute", (0.0, 7.0), (3 * QUARTER_TURN / 2, 0.0, 3 * QUARTER_TURN)),
    ],
)
def test_no_two_of_a_toys_steps_look_alike(
    tmp_path: Path, joint: str, limits: tuple[float, float] | None, steps: tuple[float, ...]
) -> None:
    bead = Link("bead", ROCKER.box, joint, (0, 1, 0), limits)
    decision, model = decided(make_raw(tmp_path / "1", "Toy", bead))
    assert model.effect is not None and model.effect.multi is not None and not decision.questions
    unit = model.scale if joint == "prismatic" else 1.0
    assert [value / unit for (value,) in model.effect.multi] == pytest.approx(steps)


def test_links_that_are_left_out_are_named(tmp_path: Path) -> None:
    buttons = [
        Link(f"button{k}", ((-0.2, 0.2 * k, -size), (-0.1, 0.2 * k + 0.1, size)), "prismatic", (-1, 0, 0), (0, 0.03))
        for k, size in enumerate((0.1, 0.2, 0.02, 0.3, 0.15))
    ]
    decision, _ = decided(make_raw(tmp_path / "1", "Remote", *buttons))
    assert any("left out" in note and "link_2 (button2)" in note and "link_0" not in note for note in decision.notes)
    free = Link("slider", ROCKER.box, "prismatic", (-1, 0, 0), (-math.inf, math.inf))
    decision, _ = decided(make_raw(tmp_path / "2", "Switch", ROCKER, free))
    assert any("left out" in note and "link_1 (slider)" in note for note in decision.notes)
    assert "left out" not in " ".join(decided(make_raw(tmp_path / "3", "Switch", ROCKER))[0].notes)
