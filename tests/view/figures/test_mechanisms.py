"""The figure of a board of another world: graph, words, causes and effects; equal episodes give equal bytes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from busybot.boards.worlds import WORLDS
from busybot.episodes.episode import Episode, Link
from busybot.view.figures import parts
from busybot.view.figures.episode import _otherwise, episode_figure
from busybot.view.figures.mechanisms import LETTERS, _draw_time, _lanes, _layout, _shades, mechanism_figure
from busybot.view.label_places import label_boxes
from busybot.view.mechanisms import MechanismView, mechanism_view
from busybot.view.palette import ACTION, FACTORS, WRONG
from tests.episodes.symbolic import library_at, make_world_episode, world_boards
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.view.figures.test_episode import has
from tests.view.world_episodes import contradicted, large_episodes

Objects = Callable[[int], Path]


def episode_of(folder: Path, world: str) -> Episode:
    return make_world_episode(world_boards(folder, world, 1)[0], library_at(folder))


def drawn(path: Path, episode: Episode) -> np.ndarray:
    return cv2.imread(str(mechanism_figure(path, episode)))


@pytest.mark.long
@pytest.mark.parametrize("world", WORLDS)
def test_every_type_has_its_colour(world: str, few_objects: Objects, tmp_path: Path) -> None:
    episode = episode_of(few_objects(0), world)
    picture, view = drawn(tmp_path / "f.png", episode), MechanismView(episode)
    kinds = {factor.kind for step in view.moments for factor in view.factors(step)}
    assert {kind: has(picture, color) for kind, color in FACTORS.items()} == {kind: kind in kinds for kind in FACTORS}
    assert has(picture, WRONG) == bool(episode.board.rewirings)
    assert has(picture, ACTION) == any(change.late for change in view.changes)


@pytest.mark.long
def test_equal_episodes_give_equal_bytes(few_objects: Objects, tmp_path: Path) -> None:
    first = mechanism_figure(tmp_path / "a" / "1.png", episode_of(few_objects(0), "mixed"))
    second = mechanism_figure(tmp_path / "2.png", episode_of(few_objects(0), "mixed"))
    assert first.read_bytes() == second.read_bytes()


def test_links_of_one_object_are_named_beside_it_and_cover_no_other_name(few_objects: Objects) -> None:
    for board in world_boards(few_objects(0), "gates", 4):
        view = MechanismView(make_world_episode(board, library_at(few_objects(0))))
        layout = _layout(view, [(factor.causes, factor.effects) for factor in view.factors(0)])
        several = {node.object for node in view.nodes if node.link}
        assert layout.names[len(view.nodes) :] == [view.object_name(index) for index in sorted(several)]
        boxes = label_boxes(layout.named / LETTERS, layout.names)
        for number, node in enumerate(view.nodes):
            if node.link:
                assert layout.names[number] == node.link
                others = np.delete(boxes, number, axis=0)
                sides = np.minimum(boxes[number, 2:], others[:, 2:]) - np.maximum(boxes[number, :2], others[:, :2])
                assert not (sides > 0).all(1).any(), (board.index, node)


@pytest.mark.parametrize(("steps", "numbers"), [(4, [0, 1, 2, 3, 4]), (12, [0, 5, 10])])
def test_time_has_more_numbers_than_its_beginning(steps: int, numbers: list[int], few_objects: Objects) -> None:
    board = world_boards(few_objects(0), "gates", 1)[0]
    view = MechanismView(make_world_episode(board, library_at(few_objects(0)), steps))
    axes = parts.page(4, 3).subplots()
    _draw_time(axes, view, _lanes(view))
    assert list(axes.get_xticks()) == numbers


def test_mechanisms_of_one_type_differ_in_brightness() -> None:
    first, second, third, other = _shades(["mechanism", "mechanism", "mechanism", "lock"])
    assert (first, other) == (FACTORS["mechanism"], FACTORS["lock"])
    assert sum(second) < sum(first) < sum(third)


@pytest.mark.long
def test_names_that_look_like_formulas_are_names(few_objects: Objects, tmp_path: Path) -> None:
    """A dollar sign begins a formula in Matplotlib, which a name of a link in a file may hold."""
    episode = episode_of(few_objects(0), "gates")
    evil = {"link": "$\\undefined{$"}
    relations = tuple(
        one.model_copy(update={"triggers": tuple(ref.model_copy(update=evil) for ref in one.triggers)})
        for one in episode.board.relations
    )
    links = tuple(Link(one.object, evil["link"], one.trigger) if one.trigger else one for one in episode.links)
    board = episode.board.model_copy(update={"relations": relations})
    assert drawn(tmp_path / "f.png", replace(episode, board=board, links=links)).std() > 10


def test_recordings_that_know_little_are_drawn_too(few_objects: Objects, tmp_path: Path) -> None:
    real = make_real_episode()
    assert drawn(tmp_path / "real.png", replace(real, board=real.board.model_copy(update={"world": "gates"}))).size
    still = episode_of(few_objects(0), "lock")
    assert drawn(tmp_path / "still.png", replace(still, steps=[], frame_of=[0])).size


@pytest.mark.long
def test_a_board_of_many_links_shows_its_causes_in_its_kinds_colours(few_objects: Objects, tmp_path: Path) -> None:
    (episode,) = large_episodes(few_objects(0), "chance", 1)
    picture, view = drawn(tmp_path / "f.png", episode), MechanismView(episode)
    assert has(picture, FACTORS["chance"]) and "chance" in {factor.kind for factor in view.factors(0)}
    assert view.changes


@pytest.fixture
def caption(monkeypatch: pytest.MonkeyPatch) -> Callable[[Episode], str]:
    """What stands below the lanes of an episode's figure."""
    kept: list[Any] = []
    monkeypatch.setattr("busybot.view.figures.parts.save_png", lambda figure, path: kept.append(figure))

    def words(episode: Episode) -> str:
        mechanism_figure(Path(), episode)
        return kept.pop().axes[-1].get_xlabel()

    return words


@pytest.mark.parametrize("world", ["gates", "time", "chance", "lock", "rewired"])
def test_only_marks_that_are_there_are_explained(
    world: str, few_objects: Objects, caption: Callable[[Episode], str]
) -> None:
    for board in world_boards(few_objects(0), world, 2):
        view = MechanismView(make_world_episode(board, library_at(few_objects(0))))
        words, alone = caption(view.episode), [one for one in view.changes if one.cause is None]
        assert ("arrows" in words) == any(one.cause is not None for one in view.changes)
        assert ("pink" in words) == any(one.late for one in view.changes)
        assert ("diamonds" in words) == bool(alone) and ("red" in words) == any(one.rewired for one in alone)
        assert ("by itself" in words) == any(not one.rewired for one in alone)
        assert ("crosses" in words) == bool(view.held) and "not known" not in words
        assert ("green" in words) == (2 in [state for _, _, states in _lanes(view) for state in states])


def test_what_is_not_known_is_said_and_has_no_marks(few_objects: Objects, caption: Callable[[Episode], str]) -> None:
    for world, held in (("chance", ""), ("lock", ", and when locks hold links,")):
        words = caption(contradicted(episode_of(few_objects(0), world)))
        assert words.endswith(f"; what changes go back to{held} is not known here")
        assert not any(mark in words for mark in ("arrows", "diamonds", "crosses"))


@pytest.mark.long
def test_what_is_not_known_has_its_kinds_colours(few_objects: Objects, tmp_path: Path) -> None:
    assert has(drawn(tmp_path / "f.png", contradicted(episode_of(few_objects(0), "chance"))), FACTORS["chance"])


@pytest.mark.long
def test_the_strip_of_steps_says_what_came_late_or_by_itself(few_objects: Objects, tmp_path: Path) -> None:
    for world, word, count in (("time", " (step ", 4), ("chance", " (by itself)", 4), ("rewired", " (rewired)", 12)):
        boards = world_boards(few_objects(0), world, count)
        episodes = [make_world_episode(board, library_at(few_objects(0))) for board in boards]
        assert any(word in told for episode in episodes for told in _otherwise(mechanism_view(episode)).values()), world
        assert episode_figure(tmp_path / f"{world}.png", episodes[0]).stat().st_size > 10_000
    assert _otherwise(mechanism_view(make_episode())) == {}


def test_the_strip_of_steps_says_where_the_causes_are_not_known(
    few_objects: Objects, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[Any] = []
    monkeypatch.setattr("busybot.view.figures.parts.save_png", lambda figure, path: kept.append(figure))
    episode = episode_of(few_objects(0), "chance")
    for one in (episode, contradicted(episode), make_episode()):
        episode_figure(Path(), one)
    told = [figure.axes[0].get_title(loc="right") for figure in kept]
    assert ["not known" in words for words in told] == [False, True, False]
