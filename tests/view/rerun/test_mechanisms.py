"""What the recording for Rerun holds of a board of another world: typed edges, words, causes and effects."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import truth_matrix
from busybot.view.mechanisms import MechanismView
from busybot.view.rerun.graph import factor_places
from busybot.view.rerun.series import cause_lanes, curve_names
from tests.episodes.symbolic import library_at, make_world_episode, world_boards
from tests.episodes.synthetic import make_episode
from tests.view.rerun.test_recording import entities, rows, saved
from tests.view.world_episodes import contradicted

Objects = Callable[[int], Path]


def view_of(folder: Path, world: str, index: int = 0) -> MechanismView:
    board = world_boards(folder, world, index + 1)[index]
    return MechanismView(make_world_episode(board, library_at(folder)))


def test_the_true_graph_has_typed_edges_at_every_step(few_objects: Objects, tmp_path: Path) -> None:
    view = view_of(few_objects(0), "rewired")
    path = saved(tmp_path / "e.rrd", view.episode)
    logged = {row["step"]: row for row in rows(path, "/graph/true")}
    assert sorted(logged) == list(range(31))
    for step in (0, view.moments[1]):
        labels = logged[step]["GraphNodes:labels"]
        factors = view.factors(step)
        assert labels == [node.name for node in view.nodes] + [factor.label for factor in factors]
        edges = logged[step]["GraphEdges:edges"]
        assert len(edges) == sum(len(factor.causes) + len(factor.effects) for factor in factors)


@pytest.mark.parametrize("world", ["chance", "lock", "mixed"])
def test_words_lanes_and_the_log_say_what_each_change_goes_back_to(
    world: str, few_objects: Objects, tmp_path: Path
) -> None:
    view = view_of(few_objects(0), world)
    path = saved(tmp_path / "e.rrd", view.episode)
    (words,) = rows(path, "/mechanisms")
    for who, _ in view.sentences:
        assert f"**{who.replace('_', chr(92) + '_')}**" in words["TextDocument:text"][0]
    assert len([name for name in entities(path) if name.startswith("/causes/")]) == len(cause_lanes(view))
    told = [row["TextLog:text"][0] for row in rows(path, "/log/causes")]
    assert sum("changed: " in words for words in told) == len(view.changes)
    assert not [name for name in entities(path) if name.startswith("/states/")]


def test_the_words_say_where_the_causes_are_not_known(few_objects: Objects, tmp_path: Path) -> None:
    view, said = (
        view_of(few_objects(0), "lock"),
        "What changes go back to, and when locks hold links, is not known here.",
    )
    for episode, known in ((view.episode, True), (contradicted(view.episode), False)):
        (words,) = rows(saved(tmp_path / f"{known}.rrd", episode), "/mechanisms")
        assert (said in words["TextDocument:text"][0]) == (not known)


def test_a_lane_tells_state_and_cause(few_objects: Objects) -> None:
    view = view_of(few_objects(0), "time")
    lanes = cause_lanes(view)
    for change in view.changes:
        shown = lanes[view.object_name(change.responder)][change.step]
        state = view.episode.steps[change.step - 1].responder_states_after[change.responder]
        assert shown == f"{state} ← {view.because(change)}"
    assert any(change.late for change in view.changes)
    held = cause_lanes(view_of(few_objects(0), "lock"))
    assert any("held" in value for lane in held.values() for value in lane)


def test_mechanisms_do_not_move_when_others_come_and_go(few_objects: Objects) -> None:
    view = view_of(few_objects(0), "rewired")
    assert set(factor_places(view)) == {factor.key for step in view.moments for factor in view.factors(step)}


def test_a_relation_that_comes_later_has_a_curve(few_objects: Objects) -> None:
    episode = view_of(few_objects(0), "rewired").episode
    objects = len(episode.board.objects)
    curves = set(curve_names(episode, InferredGraph("nothing", np.zeros((1, objects, objects)))))
    before, after = ({*zip(*truth_matrix(episode.board, step).nonzero(), strict=True)} for step in (0, 30))
    assert before != after and curves == before | after


def test_markup_of_a_file_is_text(few_objects: Objects, tmp_path: Path) -> None:
    view = view_of(few_objects(0), "gates")
    evil = view.board.model_copy(update={"world": "<b>[x](http://evil)</b>"})
    view.episode.board = evil
    (words,) = rows(saved(tmp_path / "e.rrd", view.episode), "/mechanisms")
    assert "<b>" not in words["TextDocument:text"][0] and "](http" not in words["TextDocument:text"][0]


def test_the_papers_world_is_shown_as_ever(tmp_path: Path) -> None:
    found = entities(saved(tmp_path / "e.rrd", make_episode()))
    assert not [name for name in found if name.startswith(("/causes", "/mechanisms"))]
    assert "/states/relation_00/effect_lamp_1" in found
