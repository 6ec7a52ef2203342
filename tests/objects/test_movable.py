"""Every trigger link of the procedural objects moves by some directions and not by others, from every state."""

from pathlib import Path

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel, TriggerLink
from busybot.objects.partnet.folder_snapshot import read_snapshot
from busybot.objects.partnet.meshes import check_meshes
from busybot.objects.partnet.urdf import link_vertices, parse_urdf
from busybot.sim.interaction import InteractionConfig, permitted, pull
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.thumbnails import lone_board


def highest_point(model: ObjectModel, link: TriggerLink, state: int) -> np.ndarray:
    """The point of the link nearest to the camera, board frame, the object at the origin."""
    snapshot = read_snapshot(model.folder)
    urdf = parse_urdf(snapshot)
    position = link.lower + (link.upper - link.lower) * state / (link.states - 1)
    vertices = link_vertices(urdf, check_meshes(snapshot, urdf.meshes), model.orientation, {link.joint: position})
    return vertices[link.name][vertices[link.name][:, 2].argmax()] * model.scale + [0, 0, model.offset_z]


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.long)])
def test_links_move_by_some_directions_and_not_by_others(procedural: Path, every: int) -> None:
    library = Library.load(procedural)
    simulator, config = Simulator(library, None), InteractionConfig()
    checked = 0
    for model in list(library.objects.values())[::every]:
        for number, link in enumerate(model.trigger_links):
            for state in range(link.states):
                states = tuple(state if k == number else 0 for k in range(len(model.trigger_links)))
                scene = simulator.board(lone_board(model, states))
                point = highest_point(model, link, state)
                moved = [pull(scene, number, point, direction, config, None)[1] != state for direction in DIRECTIONS]
                place = f"{model.key} {link.name} in state {state}"
                assert 1 <= sum(moved) <= 13, f"{place}: {sum(moved)} of 18"
                allowed = [permitted(scene, number, direction, config) for direction in range(len(DIRECTIONS))]
                assert any(np.logical_and(moved, allowed)), f"{place}: no annotated direction moves it"
                checked += 1
    assert checked >= 400 // every
