"""A board in the simulator is what its spec says."""

from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.directions import DIRECTIONS
from busybot.boards.generate import generate_boards
from busybot.boards.relations import responder_state
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays, normals, project
from busybot.objects.importing.importer import import_objects
from busybot.objects.library import Library
from busybot.sim.interaction import Grasp, InteractionConfig, interact, pull
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.sim.thumbnails import lone_board
from tests.objects.raw_objects import KNOB, make_raw


@pytest.fixture(scope="module")
def board(procedural_simulator: Simulator) -> BoardSpec:
    return next(generate_boards(BoardConfig(boards=1, relations="one-to-many"), procedural_simulator.library))


def test_responders_follow_their_triggers_and_nothing_else(procedural_simulator: Simulator, board: BoardSpec) -> None:
    scene = procedural_simulator.board(board)
    for number, joint in enumerate(scene.triggers):
        named = (joint.object, joint.link.name)
        (relation,) = (one for one in board.relations if (one.triggers[0].object, one.triggers[0].link) == named)
        for state in range(joint.link.states):
            before = scene.responder_states()
            scene.set_trigger(number, state)
            after = scene.responder_states()
            assert after[relation.responder] == responder_state(relation, state)
            others = [index for index in range(len(after)) if index != relation.responder]
            assert [after[index] for index in others] == [before[index] for index in others]
            assert joint.position() == pytest.approx(joint.rest(state))


def test_two_equal_lamps_are_painted_apart(procedural_simulator: Simulator) -> None:
    """Instances are drawn with replacement, and the simulator shares meshes between them."""
    boards = generate_boards(BoardConfig(boards=400, group_size=1, lamps=(5, 5)), procedural_simulator.library)
    spec = next(b for b in boards if len({p.key for p in b.objects}) < len(b.objects) - 1)
    scene = procedural_simulator.board(spec)
    keys = [placed.key for placed in spec.objects]
    first, second = next(
        (i, j) for i in scene.responders for j in scene.responders if i < j and keys[i] == keys[j] and "Lamp" in keys[i]
    )
    scene.responders[first].show(0)
    scene.responders[second].show(0)
    dark = scene.observe().rgb
    scene.responders[first].show(1)
    image = scene.observe()
    assert image.segmentation is not None
    owner = np.array([-1, *(link.object for link in scene.links)])[image.segmentation]
    changed = (image.rgb != dark).any(-1)
    assert changed[owner == first].sum() > 500
    assert changed[owner == second].sum() == 0


def test_depth_is_metric_and_positions_project_back(procedural_simulator: Simulator, board: BoardSpec) -> None:
    scene = procedural_simulator.board(board)
    image = scene.observe()
    assert image.depth is not None and image.segmentation is not None
    rays = Rays(scene.camera)
    points = rays.points(image.depth)
    surface = (image.segmentation == 0) & (np.abs(points[..., :2]) < 1.9).all(-1)
    assert np.abs(points[surface][:, 2]).max() < 2e-4
    pixels, depth = project(points, scene.camera)
    rows, columns = np.mgrid[0:480, 0:640]
    assert np.abs(pixels - np.stack([columns, rows], -1) - 0.5).max() < 1e-3
    assert np.abs(depth - image.depth).max() < 1e-5
    flat = surface.copy()
    flat[:2] = flat[-2:] = flat[:, :2] = flat[:, -2:] = False
    upright = normals(points)[flat][:, 2]
    assert np.median(upright) > 0.9999


def test_boxes_hold_their_objects(procedural_simulator: Simulator, board: BoardSpec) -> None:
    scene = procedural_simulator.board(board)
    image = scene.observe()
    assert image.segmentation is not None
    owner = np.array([-1, *(link.object for link in scene.links)])[image.segmentation]
    for index, (u0, v0, u1, v1) in enumerate(image.boxes):
        rows, columns = np.nonzero(owner == index)
        assert (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) == (u0, v0, u1, v1)


def test_same_board_same_picture(procedural_simulator: Simulator, board: BoardSpec) -> None:
    first, second = procedural_simulator.board(board).observe(), procedural_simulator.board(board).observe()
    assert np.array_equal(first.rgb, second.rgb) and np.array_equal(first.depth, second.depth)


def test_a_board_of_another_size_has_a_surface_of_its_own(small_simulator: Simulator) -> None:
    usual = lone_board(small_simulator.library.get("Switch/fader-01"))
    smaller = usual.model_copy(update={"size": (2.0, 2.0)})
    alone = small_simulator.board(smaller).observe()
    small_simulator.board(usual)
    assert np.array_equal(small_simulator.board(smaller).observe().rgb, alone.rgb)


@pytest.mark.parametrize("shader", ["minimal", "default"])
@pytest.mark.long
def test_other_shader_packs_see_the_same_geometry(
    procedural_simulator: Simulator, board: BoardSpec, shader: str
) -> None:
    ours = procedural_simulator.board(board).observe()
    other_simulator = Simulator(procedural_simulator.library, RenderConfig(shader=shader))
    theirs = other_simulator.board(board).observe()
    assert ours.segmentation is not None and theirs.segmentation is not None
    same = ours.segmentation == theirs.segmentation
    assert same.mean() > 0.995
    assert ours.depth is not None and theirs.depth is not None
    assert np.abs(ours.depth - theirs.depth)[same & (ours.depth > 0)].max() < 0.05
    assert theirs.rgb.mean() > 40


@pytest.mark.long
def test_without_a_renderer_the_physics_is_the_same(procedural_simulator: Simulator, board: BoardSpec) -> None:
    blind = Simulator(procedural_simulator.library, None).board(board)
    seeing = procedural_simulator.board(board)
    image = seeing.observe()
    rays = Rays(seeing.camera)
    assert image.segmentation is not None and image.depth is not None
    outcomes = []
    for code in range(1, len(seeing.links) + 1):
        rows, columns = np.nonzero(image.segmentation == code)
        number = seeing.trigger_at(code)
        if number is None or not len(rows):
            continue
        pixel = (int(columns[len(columns) // 2]), int(rows[len(rows) // 2]))
        grasp = Grasp(number, rays.point(image.depth, pixel), pixel)
        for direction in range(18):
            with_picture, after = interact(seeing, grasp, direction, InteractionConfig(), seeing.observe())
            without, none = interact(blind, grasp, direction, InteractionConfig(), None)
            assert none is None
            assert without.trigger_states_after == with_picture.trigger_states_after
            assert without.joint_positions_after == with_picture.joint_positions_after
            assert (after is not None) == with_picture.success
            outcomes.append(without.success)
    assert 0 < sum(outcomes) < len(outcomes)
    with pytest.raises(BusybotError, match="no renderer"):
        blind.observe()


def test_save_and_restore_are_exact(procedural_simulator: Simulator, board: BoardSpec) -> None:
    scene = procedural_simulator.board(board)
    rays = Rays(scene.camera)
    start, saved = scene.observe(), scene.save()
    assert start.segmentation is not None and start.depth is not None

    def rollout() -> list[object]:
        rng, image, steps = np.random.default_rng(3), start, []
        trigger_pixels = np.isin(start.segmentation, [k + 1 for k, link in enumerate(scene.links) if link.trigger])
        spots = np.argwhere(trigger_pixels)
        for _ in range(15):
            row, column = (int(value) for value in spots[rng.integers(len(spots))])
            number = scene.trigger_at(int(image.segmentation[row, column]))
            grasp = Grasp(number, rays.point(image.depth, (column, row)), (column, row))
            step, after = interact(scene, grasp, int(rng.integers(18)), InteractionConfig(), image)
            image = after or image
            steps.append(step)
        return [*steps, image.rgb.tobytes()]

    first = rollout()
    assert scene.save() != saved
    scene.restore(saved)
    assert np.array_equal(scene.observe().rgb, start.rgb)
    assert rollout() == first


def test_unknown_relation_kinds_are_refused_by_name(procedural_simulator: Simulator, board: BoardSpec) -> None:
    gate = board.relations[0].model_copy(update={"kind": "and-gate"})
    with pytest.raises(BusybotError, match="and-gate"):
        procedural_simulator.board(board.model_copy(update={"relations": (gate,)}))


def test_a_trigger_without_stops_gets_those_of_the_model(tmp_path: Path) -> None:
    """A knob of a continuous joint, a quarter turn between its two states."""
    raw = make_raw(tmp_path / "raw" / "77", "Switch", KNOB)
    list(import_objects([raw], tmp_path / "library"))
    library = Library.load(tmp_path / "library")
    model = library.get("Switch/77")
    scene = Simulator(library, None).board(lone_board(model))
    top = np.array([0.03, 0.03, model.bounds_max[2] * model.scale + model.offset_z])
    assert scene.joint_positions() == (0,)
    ends = [pull(scene, 0, top, direction, InteractionConfig(), None)[1] for direction in DIRECTIONS]
    assert 0 < sum(ends) < 18
    scene.set_trigger(0, 1)
    assert scene.joint_positions() == pytest.approx((np.pi / 2,))
