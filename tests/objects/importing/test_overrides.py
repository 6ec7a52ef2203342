"""The reviewable YAML: what is written can be read again; faults are named by file, line and place."""

import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.objects.importing.annotation_edits import Choices, read_overrides, write_review
from busybot.objects.importing.importer import import_objects
from tests.objects.raw_objects import DRAWER, LEAF, LEVER, ROCKER, Link, make_raw


def test_a_proposal_read_again_decides_the_same(tmp_path: Path) -> None:
    folders = [
        make_raw(tmp_path / "1", "Switch", ROCKER),
        make_raw(tmp_path / "2", "Lamp", ROCKER, LEVER),
        make_raw(tmp_path / "3", "StorageFurniture", LEAF, DRAWER),
    ]
    first = list(import_objects(folders, None))
    file = tmp_path / "review.yaml"
    write_review(
        file, {o.name: (o.choices or Choices(), o.notes, o.questions) for o in first}, {"4": "is\nbad\x1b[31m"}
    )
    text = file.read_text()
    assert "# StorageFurniture (meta.json) serves as Door" in text and "# 4 is refused: is\\nbad\\x1b[31m" in text
    again = list(import_objects(folders, None, read_overrides(file)))
    assert [outcome.choices for outcome in again] == [outcome.choices for outcome in first]


def test_a_folders_name_begins_no_line_of_its_own(tmp_path: Path) -> None:
    name = "x\nobjects:\n  '1': {use: false}\n#"
    make_raw(tmp_path / "raw" / "1", "Lamp", ROCKER, LEVER)
    make_raw(tmp_path / "raw" / name, "Lamp", ROCKER, LEVER)
    file = tmp_path / "review.yaml"
    for words in (["import", str(tmp_path / "raw"), "--review", str(file)], ["check", str(tmp_path / "raw")]):
        told = CliRunner().invoke(app, ["assets", *words])
        assert told.exit_code == 1 and r"x\nobjects:\n  '1': {use: false}\n#" in told.output
        assert "objects:" not in told.output.splitlines()
    assert read_overrides(file).choices["1"].use


FAULTS = {
    "missing scale": ("objects:\n  '1':\n    scale: large\n", "line 3: objects.1.scale"),
    "negative scale": ("objects:\n  '1':\n\n    scale: -1\n", "line 4: objects.1.scale"),
    "unknown field": ("objects:\n  '1':\n    scal: 1\n", "line 3: objects.1.scal"),
    "unknown category": ("objects:\n  '1': {category: Drone}\n", "line 2: objects.1.category"),
    "not a quaternion": ("objects:\n  '1':\n    orientation: [0, 0, 0, 2]\n", "unit quaternion"),
    "unknown kind": ("objects:\n  '1':\n    links:\n      link_0: large\n", "line 4: objects.1.links.link_0"),
    "effect of a switch": (
        "objects:\n  '1':\n    category: Switch\n    effect: {type: color, link: a, states: [[0,0,0],[1,0,0]]}\n",
        "line 2: objects.1: a Switch is a trigger",
    ),
    "states of other length": (
        "objects:\n  '1':\n    effect: {type: joint, joints: [a, b], states: [[0], [1]]}\n",
        "line 3: objects.1.effect: every state",
    ),
    "equal steps": (
        "objects:\n  '1':\n    effect: {type: joint, joints: [a, b], steps: [[0, 0], [0, 1], [0, 0]]}\n",
        "line 3: objects.1.effect: steps 0 and 2 are equal",
    ),
    "no objects": ("boxes: {}\n", "line 1"),
    "another key": ("objects: {}\nmore: 1\n", "objects"),
    "a list": ("- 1\n", "objects"),
    "nothing": ("", "objects"),
    "not YAML": ("objects: {\n  '1': [\n", "line 3"),
    "a tag": ("objects: !!python/object/apply:os.system ['true']\n", "line 1"),
    "a tag that its value belies": ("objects: {'1': {use: !!bool maybe}}\n", "not valid YAML"),
    "a tag without a value": ("objects: {'1': {scale: !!int ''}}\n", "not valid YAML"),
    "a tag of times": ("objects: {'1': {scale: !!timestamp soon}}\n", "not valid YAML"),
    "an alias": ("objects:\n  '1': &a {use: true}\n  '2': *a\n", "line 3: has an alias"),
    "twice": ("objects:\n  '1': {use: true}\n  '1': {use: false}\n", "line 3: objects.1 stands twice"),
    "nested without end": ("[" * 500_000, "line 1: nested more than"),
    "indented without end": ("".join(" " * k + "a:\n" for k in range(1400)), "nested more than"),
    "words without end": ("objects: [" + "a," * 250_000 + "]\n", "words and signs"),
    "too large": ("#" * (1 << 20) + "\n", "bytes allowed"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named_by_file_line_and_place(tmp_path: Path, name: str) -> None:
    began = time.process_time()
    text, told = FAULTS[name]
    file = tmp_path / "review.yaml"
    file.write_text(text)
    with pytest.raises(BusybotError) as caught:
        read_overrides(file)
    assert str(file) in caught.value.what and told in caught.value.what
    assert caught.value.hint and time.process_time() - began < 30


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "latin.yaml").write_bytes(b"objects: \xff")
    for file in (tmp_path / "none.yaml", tmp_path, tmp_path / "latin.yaml"):
        with pytest.raises(BusybotError):
            read_overrides(file)


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("links: {link_7: two-state}", "line 3: objects.1.links.link_7: 'link_7' is no moving link"),
        ("effect: {type: color, link: base, states: [[0,0,0],[1,0,0]]}", "objects.1.effect.link: 'base'"),
        ("effect: {type: joint, joints: [joint_9], states: [[0],[1]]}", "objects.1.effect.joints: 'joint_9'"),
    ],
)
def test_names_that_the_object_lacks_are_refused(tmp_path: Path, entry: str, told: str) -> None:
    folder = make_raw(tmp_path / "1", "Box", ROCKER)
    file = tmp_path / "review.yaml"
    file.write_text(f"objects:\n  '1':\n    {entry}\n")
    (done,) = import_objects([folder], None, read_overrides(file))
    assert done.done == "refused" and told in (done.problem or ""), done.problem
    assert done.hint and ("link_0" in done.hint or "joint_0" in done.hint)


@pytest.mark.parametrize(
    ("category", "link", "entry", "told"),
    [
        ("Door", LEAF, "links: {link_0: two-state}", "a Door, which has no links"),
        (
            "Switch",
            ROCKER,
            "effect: {type: joint, joints: [joint_0], states: [[0],[1]]}",
            "a Switch, which has no effect",
        ),
    ],
)
def test_decisions_about_the_other_role_are_not_left_aside(
    tmp_path: Path, category: str, link: Link, entry: str, told: str
) -> None:
    folder = make_raw(tmp_path / "1", category, link)
    file = tmp_path / "review.yaml"
    file.write_text(f"objects:\n  '1':\n    {entry}\n")
    (done,) = import_objects([folder], None, read_overrides(file))
    assert done.done == "refused" and told in (done.problem or "") and "category" in (done.hint or "")
    other = "Switch" if category == "Door" else "Door"
    file.write_text(f"objects:\n  '1':\n    category: {other}\n    {entry}\n")
    (done,) = import_objects([folder], None, read_overrides(file))
    assert done.done == "proposed" and done.key == f"{other}/1", done.problem
