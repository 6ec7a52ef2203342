"""What a model says, in the names of the truth: its links are numbered as it found them, and may be none."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from busybot.boards.spec import LinkRef
from busybot.episodes.episode import Episode
from busybot.reason.evaluation.causes import JudgedMechanism, true_links
from busybot.reason.models.base import InferredGraph, InferredLinks
from busybot.view.figures.mechanisms import understood_figure
from busybot.view.mechanisms import MechanismView
from busybot.view.palette import CORRECT, MISSED, WRONG
from busybot.view.understood import NOT_THERE, Understanding
from tests.episodes.symbolic import library_at, make_world_episode, world_boards
from tests.view.figures.test_episode import has

Objects = Callable[[int], Path]


@pytest.fixture
def view(few_objects: Objects) -> MechanismView:
    """A board on which one object has several links, two of which decide something together."""
    folder = few_objects(0)
    for board in world_boards(folder, "gates", 12):
        found = MechanismView(aimed(make_world_episode(board, library_at(folder), steps=60)))
        panels = [node.object for node in found.nodes if node.link]
        if any(len(one.triggers) == 2 and one.triggers[0].object in panels for one in board.relations):
            return found
    raise AssertionError("no such board")


def aimed(episode: Episode) -> Episode:
    """With actions on the objects that they hold: a model knows a link's object by the pixel."""
    boxes = episode.image(0).boxes
    middles = [(int(box[[0, 2]].mean()), int(box[[1, 3]].mean())) for box in boxes]
    steps = [replace(one, pixel=middles[one.acted_object]) if one.acted_link else one for one in episode.steps]
    return replace(episode, steps=steps)


def knowing(view: MechanismView, words: dict[int, str] | None = None) -> Understanding:
    """A model that knows everything, with numbers for links from the last to the first, and one link too many."""
    links, steps, board = view.links, view.episode.steps, view.board
    numbers = {(link.object, link.link): number for number, link in enumerate(reversed(links))}
    clusters = np.array([numbers.get((step.acted_object, step.acted_link), -1) for step in steps])
    true = true_links(board, links, len(steps) - 1)
    single = np.concatenate([true[::-1], np.zeros((1, len(board.objects)))]).astype(float)
    told = InferredLinks(clusters, np.repeat(single[None], len(steps), axis=0))
    pairs = np.zeros((len(steps), len(board.objects), len(board.objects)))
    kinds = tuple("gate" if placed.role == "responder" else "" for placed in board.objects)
    said = tuple((words or {}).get(index, "") for index in range(len(board.objects)))
    return Understanding(view, InferredGraph("all", pairs, links=told, kinds=kinds, words=said), told)


def gate_of(view: MechanismView) -> tuple[int, tuple[LinkRef, ...]]:
    panels = [node.object for node in view.nodes if node.link]
    one = next(one for one in view.board.relations if len(one.triggers) == 2 and one.triggers[0].object in panels)
    return one.responder, one.triggers


def test_links_have_the_names_of_the_truth(view: MechanismView) -> None:
    _, (first, _) = gate_of(view)
    own = [link.link for link in view.links if link.object == first.object][::-1]  # as the model counts them
    other = next(i for i, placed in enumerate(view.board.objects) if placed.role == "responder")
    words = "".join(f"object {first.object} (link {number}), " for number in range(1, len(own) + 2))
    told = knowing(view, {0: f"{words}object {other}"}).words(0).split(", ")
    trigger = view.object_name(first.object)
    expected = [f"{trigger} {name}" for name in own]
    assert told == [*expected, f"{trigger} ({NOT_THERE})", view.object_name(other)]


def test_a_trigger_of_one_link_has_no_number(view: MechanismView) -> None:
    single = next(
        node.object for node in view.nodes if not node.link and view.board.objects[node.object].role == "trigger"
    )
    assert knowing(view, {0: f"follows object {single}"}).words(0) == f"follows {view.object_name(single)}"


def test_the_verdict_tells_wrong_and_missed_links_and_what_does_not_follow(view: MechanismView) -> None:
    responder, triggers = gate_of(view)
    right = JudgedMechanism(responder, "gate", True, right=True)
    understood = knowing(view)
    assert understood.verdict(right) == "right"
    assert understood.verdict(replace(right, right=False)) == "links right, not what follows from them"
    wrong = next(link for link in view.links if link not in triggers)
    for link, probability, verdict in (
        (triggers[0], 0.0, "links: 1 right, 1 missed"), (wrong, 1.0, "links: 1 right, 1 wrong, 1 missed"),
    ):  # fmt: skip
        understood.links.probabilities[:, len(view.links) - 1 - view.links.index(link), responder] = probability
        assert Understanding(view, understood.inferred, understood.links).verdict(right) == verdict


def test_a_link_that_is_not_there_is_never_right(view: MechanismView) -> None:
    responder, (first, _) = gate_of(view)
    understood = knowing(view)
    understood.links.probabilities[:, -1, responder] = 1.0
    understood.links.clusters[-1] = len(view.links)  # an action that held nothing the model believes to have held one
    assert "1 wrong" in understood.verdict(JudgedMechanism(responder, "gate", True, right=True))


def test_the_figure_shows_verdicts_in_their_colours(view: MechanismView, tmp_path: Path) -> None:
    responder, triggers = gate_of(view)
    understood = knowing(view)

    def shown(name: str) -> tuple[bool, ...]:
        fresh = Understanding(view, understood.inferred, understood.links)
        picture = cv2.imread(str(understood_figure(tmp_path / name, fresh)))[:-60]
        return tuple(has(picture, color) for color in (CORRECT, WRONG, MISSED))

    assert shown("right.png") == (True, False, False)
    understood.links.probabilities[:, len(view.links) - 1 - view.links.index(triggers[0]), responder] = 0
    assert shown("missed.png") == (True, False, True)
    wrong = next(link for link in view.links if link not in triggers)
    understood.links.probabilities[:, len(view.links) - 1 - view.links.index(wrong), responder] = 1
    assert shown("wrong.png") == (True, True, True)
