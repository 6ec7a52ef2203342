"""All objects in the simulator: they load, every trigger link moves, effects show, and the rates are those measured."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.common.atomic_io import write_json
from busybot.episodes.camera import Rays
from busybot.objects.library import OTHER, Library
from busybot.objects.model import ObjectModel, TriggerLink
from busybot.sim.interaction import InteractionConfig, changed_pixels, permitted, pull
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.thumbnails import lone_board

FREE, STRICT = InteractionConfig(), InteractionConfig(strict=True)
POINTS = {"procedural": 2}
"""Where each link is held, by library; there are many procedural objects, and measured rates of the real ones alone."""
POINTS_OTHERWISE = 8
CANNOT_MOVE: dict[str, str] = {}
"""Links that no direction moves, or every one, with the reason: none."""


@pytest.fixture(params=["procedural", "real"])
def simulator(request: pytest.FixtureRequest) -> Simulator:
    return request.getfixturevalue(f"{request.param}_simulator")


def movable(simulator: Simulator) -> Iterator[tuple[ObjectModel, TriggerLink, int, BoardScene, int]]:
    """Every trigger link of the library, resting in each of its states, and its joint's number."""
    for model in simulator.library.objects.values():
        for place, link in enumerate(model.trigger_links):
            for state in range(link.states):
                states = [0] * len(model.trigger_links)
                states[place] = state
                yield model, link, state, simulator.board(lone_board(model, tuple(states))), place


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.long)])
def test_all_objects_load_and_are_seen(simulator: Simulator, every: int) -> None:
    for model in list(simulator.library.objects.values())[::every]:
        image = simulator.board(lone_board(model)).observe()
        assert image.segmentation is not None and image.depth is not None
        assert (image.segmentation > 0).sum() > 400, model.key
        assert image.depth.min() > 2.0, f"{model.key} is too near for the depth images"


@pytest.mark.long
def test_every_link_moves_from_every_state_and_random_actions_succeed_as_often_as_measured(
    simulator: Simulator,
) -> None:
    """Experiments on the real objects: 37 % of random pixels and directions, 76-84 % of pairs, 26-28 % strict."""
    rng, points = np.random.default_rng(0), POINTS.get(simulator.library.name, POINTS_OTHERWISE)
    single, pairs, strict = [], [], []
    for model, link, state, scene, number in movable(simulator):
        image = scene.observe()
        code = next(k + 1 for k, seen in enumerate(scene.links) if seen.name == link.name and seen.trigger)
        assert image.segmentation is not None and image.depth is not None
        rows, columns = np.nonzero(image.segmentation == code)
        assert len(rows), f"{model.key} {link.name} is not visible"
        assert len(rows) > 12 or simulator.library.name != "procedural", f"{model.key} {link.name} is hardly visible"
        rays, ever = Rays(scene.camera), np.zeros(len(DIRECTIONS), bool)
        allowed = np.array([permitted(scene, number, d, STRICT) for d in range(len(DIRECTIONS))])
        for pick in rng.integers(len(rows), size=points):
            point = rays.point(image.depth, (int(columns[pick]), int(rows[pick])))
            moved = np.array([pull(scene, number, point, d, FREE, None)[1] != state for d in DIRECTIONS])
            ever |= moved
            single.append(moved.mean())
            pairs.append((moved | moved[OPPOSITE]).mean())
            strict.append(((moved & allowed) | (moved & allowed)[OPPOSITE]).mean())
        assert ever.any() or model.key in CANNOT_MOVE, f"{model.key} {link.name} cannot leave state {state}"
        assert not ever.all() or model.key in CANNOT_MOVE, f"{model.key} {link.name} leaves state {state} in any case"
    if simulator.library.name != "procedural":
        assert np.mean(single) == pytest.approx(0.37, abs=0.05)
        assert 0.76 - 0.05 < np.mean(pairs) < 0.84 + 0.05
        assert 0.26 - 0.05 < np.mean(strict) < 0.28 + 0.05


@pytest.mark.long
def test_every_state_of_every_responder_can_be_told_from_its_picture(simulator: Simulator) -> None:
    for model in simulator.library.objects.values():
        if model.effect is None:
            continue
        scene = simulator.board(lone_board(model))
        responder = scene.responders[0]
        for stage, values in (("single", model.effect.single), ("multi", model.effect.multi)):
            if values is None:
                continue
            responder.values = values
            pictures = []
            for state in range(len(values)):
                responder.show(state)
                pictures.append(scene.observe().rgb)
            for first in range(len(pictures)):
                for second in range(first):
                    least = 300 if model.key in simulator.library.splits.get(OTHER, ()) else 500  # scenes enlarge
                    assert changed_pixels(pictures[first], pictures[second], 0.01) > least, (model.key, stage)


def test_links_drift_neither_at_rest_nor_in_their_states(simulator: Simulator) -> None:
    blind = Simulator(simulator.library, None)
    for model in simulator.library.objects.values():
        if not model.trigger_links:
            continue
        scene = blind.board(lone_board(model))
        before = scene.joint_positions()
        for _ in range(50):
            scene.scene.step()
        assert scene.joint_positions() == before, model.key


KEYS = ("Switch/slider-01", "Switch/arm-01")


@pytest.mark.parametrize(
    "inertial",
    [
        "",
        '<inertial><mass value="900"/><inertia ixx="50" ixy="0" ixz="0" iyy="50" iyz="0" izz="50"/></inertial>',
        '<inertial><origin xyz="1 0 0"/><mass value="1e-3"/>'
        '<inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial>',
    ],
    ids=["none", "heavy", "light"],
)
def test_whatever_links_of_own_switches_weigh_they_move_like_others(
    procedural_simulator: Simulator, inertial: str, tmp_path: Path
) -> None:
    """The same pulls move them, as far as one and the other URDF go."""
    moved: dict[str, list[list[bool]]] = {"as made": [], "own": []}
    for key in KEYS:
        model = procedural_simulator.library.objects[key]
        shutil.copytree(model.folder, tmp_path / key)
        urdf = tmp_path / key / "mobility.urdf"
        urdf.write_text(re.sub(r"<inertial>.*?</inertial>", inertial, urdf.read_text()))
    ids = [key.partition("/")[2] for key in KEYS]
    write_json(tmp_path / "data.json", {"Reason": {"Switch": {"train": ids, "test": []}}})
    own = Simulator(Library.load(tmp_path), procedural_simulator.render)
    for name, simulator in (("as made", procedural_simulator), ("own", own)):
        for key in KEYS:
            model = simulator.library.objects[key]
            scene = simulator.board(lone_board(model))
            image = scene.observe()
            assert image.segmentation is not None and image.depth is not None
            code = next(k + 1 for k, seen in enumerate(scene.links) if seen.trigger)
            rows, columns = np.nonzero(image.segmentation == code)
            middle = len(rows) // 2
            point = Rays(scene.camera).point(image.depth, (int(columns[middle]), int(rows[middle])))
            moved[name].append([pull(scene, 0, point, d, FREE, None)[1] != 0 for d in DIRECTIONS])
    assert moved["own"] == moved["as made"] and np.array(moved["own"]).any(1).all()
