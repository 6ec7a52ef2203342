"""What is called out of reach is what no action moves in the simulator; nothing that comes with busybot is."""

from pathlib import Path

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.objects.importing.annotation_edits import Kind
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.objects.partnet.folder_snapshot import read_snapshot
from busybot.objects.partnet.meshes import check_meshes
from busybot.objects.partnet.reach import REACH, out_of_reach, pull_needed
from busybot.objects.partnet.urdf import link_vertices, parse_urdf
from busybot.sim.interaction import InteractionConfig, pull
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.thumbnails import lone_board
from tests.objects.raw_objects import box_link, library_of

CONFIG = InteractionConfig()
LIGHT = '<inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>'


def needed(model: ObjectModel) -> list[float]:
    """Of each link of a trigger."""
    snapshot = read_snapshot(model.folder)
    urdf = parse_urdf(snapshot)
    meshes, joints = check_meshes(snapshot, urdf.meshes), {joint.name: joint for joint in urdf.joints}
    return [pull_needed(urdf, meshes, joints[link.joint], link.states, model.scale) for link in model.trigger_links]


def trigger(folder: Path, joint: str, ends: float, kind: Kind, place: str = "0 0 0") -> Library:
    """A small knob on a plate of 0.4, half the size in its URDF."""
    knob = box_link("knob", "0.02 0.02 0.02", place).replace("<visual>", f"{LIGHT}<visual>")
    limits = f'<limit lower="{-ends}" upper="{ends}"/>'
    jointed = f'<joint name="j" type="{joint}"><origin xyz="0 0 0.05"/><parent link="base"/><child link="knob"/>'
    axis = '<axis xyz="1 0 0"/>' if joint == "prismatic" else '<axis xyz="0 0 1"/>'
    urdf = f"{box_link('base', '0.2 0.2 0.02')}{knob}{jointed}{axis}{limits}</joint>"
    return library_of(folder, urdf, category="Switch", scale=2.0, orientation=(0, 0, 0, 1), links={"knob": kind})


def moved(library: Library) -> list[bool]:
    """Whether some direction moves the middle of the knob, by the state in which it rests."""
    model = library.get("Switch/thing")
    urdf = parse_urdf(read_snapshot(model.folder))
    (link,), found = model.trigger_links, []
    for state in range(link.states):
        scene = Simulator(library, None).board(lone_board(model, (state,)))
        rest = link.lower + (link.upper - link.lower) * state / (link.states - 1)
        middle = link_vertices(urdf, {}, model.orientation, {"j": rest})["knob"].mean(axis=0)
        point = middle * model.scale + [0, 0, model.offset_z]
        found.append(any(pull(scene, 0, point, way, CONFIG, None)[1] != state for way in DIRECTIONS))
    return found


def test_an_action_reaches_as_far_as_is_said() -> None:
    assert REACH <= CONFIG.increment * CONFIG.increments <= REACH + 0.011


@pytest.mark.parametrize(("share", "moves"), [(0.95, True), (1.2, False)])
@pytest.mark.parametrize("kind", ["two-state", "multi-direction"])
def test_a_slide_moves_in_the_simulator_if_it_is_within_reach(
    tmp_path: Path, kind: Kind, share: float, moves: bool
) -> None:
    states = 2 if kind == "two-state" else 3
    library = trigger(tmp_path, "prismatic", share * REACH * (states - 1) / 2, kind)
    assert needed(library.get("Switch/thing")) == pytest.approx([share * REACH])
    assert moved(library) == [moves] * states


@pytest.mark.parametrize(("share", "moves"), [(0.9, True), (1.2, False)])
@pytest.mark.parametrize("half", [0.3, 0.7])
def test_a_hinge_moves_in_the_simulator_if_its_nearest_part_is_within_reach(
    tmp_path: Path, half: float, share: float, moves: bool
) -> None:
    radius = share * REACH / np.sin(half)
    library = trigger(tmp_path, "revolute", half, "two-state", f"{radius / 2} 0 0")
    # the knob's own half size, 0.02 board units, is nearer
    assert needed(library.get("Switch/thing")) == pytest.approx([(radius - 0.02) * np.sin(half)], abs=1e-3)
    assert moved(library) == [moves] * 2


def test_what_surrounds_its_axis_can_always_be_held_near_to_it(tmp_path: Path) -> None:
    knob = trigger(tmp_path, "revolute", 1.2, "two-state").get("Switch/thing")
    assert needed(knob) == [0.0]


def test_the_scale_that_is_named_is_within_reach(tmp_path: Path) -> None:
    model = trigger(tmp_path, "prismatic", 0.337, "two-state").get("Switch/thing")
    urdf = parse_urdf(read_snapshot(model.folder))
    found = out_of_reach(urdf, {}, urdf.joints[0], 2, model.scale)
    assert found is not None and "knob has to be pulled 0.674 board units" in found[0]
    assert found[1] == 0.59 and out_of_reach(urdf, {}, urdf.joints[0], 2, found[1]) is None


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.long)])
def test_what_comes_with_busybot_is_far_within_reach(procedural: Path, every: int) -> None:
    triggers = [model for model in Library.load(procedural).objects.values() if model.role == "trigger"][::every]
    assert max(need for model in triggers for need in needed(model)) <= 0.5 * REACH


@pytest.mark.long
def test_the_paper_objects_are_far_within_reach(partnet: Path) -> None:
    triggers = [model for model in Library.load(partnet).objects.values() if model.role == "trigger"]
    assert max(need for model in triggers for need in needed(model)) < 0.2 * REACH
