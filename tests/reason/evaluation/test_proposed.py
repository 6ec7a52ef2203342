"""Reasoners without boxes: what is proposed, for what it stands, and that what is missed or made up costs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.common.errors import UsageError
from busybot.datasets.dataset import Dataset
from busybot.datasets.importing import proposals
from busybot.datasets.importing.proposals import Proposal
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.evaluation import evaluate
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, judge_episode
from busybot.reason.evaluation.graph_files import GivenGraphs, overlaps
from busybot.reason.evaluation.proposed import (
    JudgedProposals,
    Proposed,
    matched,
    propose_objects,
    summarise_proposals,
)
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph, InferredLinks
from busybot.reason.models.lookup import Persistence
from tests.reason.scenes import Patch, Scene

TINY = Path(__file__).resolve().parents[3] / "datasets" / "tiny"
IMAGES = 10
Changed = Callable[[list[Proposal]], list[Proposal]]


def evaluated(reasoner: str, boxes: str = "proposed") -> dict[str, Any]:
    return evaluate_dataset(Dataset.open(TINY), ReasonEvaluation(reasoner, IMAGES, boxes=boxes), workers=1)


def changing(monkeypatch: pytest.MonkeyPatch, change: Changed) -> None:
    """Proposals are changed before anybody sees them."""
    real = proposals.propose
    monkeypatch.setattr(proposals, "propose", lambda *given, **more: change(real(*given, **more)))


def moved(one: Proposal) -> Proposal:
    """The same box beside itself."""
    u0, v0, u1, v1 = one.box
    return replace(one, box=(max(0, u0 - (u1 - u0)), v0, u0, v1))


# what is proposed


def test_what_stands_there_is_proposed_and_what_is_acted_on_is_a_trigger() -> None:
    """A switch that moves and a lamp that follows, a door that never changed, a switch that nobody could move."""
    lever, stuck, door = Patch((20, 20, 34, 40), (200, 30, 30)), Patch((20, 80, 34, 94), (0, 90, 90)), (200, 80, 200)
    frames = [
        [replace(lever, color=(200, 30 + 150 * (k % 2), 30)), Patch((90, 20, 110, 40), (40, 40, 250 * (k % 2))),
         Patch((90, 70, 112, 100), door), stuck]
        for k in range(4)
    ]  # fmt: skip
    boxes = [(20, 20, 34, 40), (90, 20, 110, 40), (90, 70, 112, 100), (20, 80, 34, 94), (140, 100, 150, 110)]
    roles = ("trigger", "responder", "responder", "trigger", "responder")
    pixels = [(27, 30), (27, 30), (27, 86)]
    frames[3] = frames[2]
    found = propose_objects(Scene(roles, boxes, frames, pixels).observed(), 4)
    assert sorted(found.place.tolist()) == [0, 1, 2, 3] and found.judged.found == (True,) * 4 + (False,)
    assert found.observed.roles == ("trigger", "trigger", "responder", "responder")
    assert found.places == 5 and found.known.tolist() == [True] * 4 + [False]
    assert found.acted.tolist() == [0, 0, 3], "in places of true objects"
    assert np.isfinite(found.observed.positions).all()


def test_what_never_changed_is_left_out_where_people_look_at_proposals() -> None:
    scene = Scene(("responder",), [(90, 70, 112, 100)], [[Patch((90, 70, 112, 100), (1, 200, 1))]] * 2)
    frames = [scene.observed().frame(k) for k in range(2)]
    pictures, camera = [(frame.rgb, frame.depth) for frame in frames], scene.observed().camera
    assert proposals.propose(pictures, [None], camera) == []
    assert [one.role for one in proposals.propose(pictures, [None], camera, still=True)] == ["responder"]


def test_ribs_of_one_thing_are_one_object() -> None:
    ribs = [Patch((60, row, 100, row + 2), (9, 9, 9)) for row in range(40, 60, 3)]
    scene = Scene(("responder",), [(60, 40, 100, 60)], [ribs, ribs], [(-1, -1)])
    found = propose_objects(scene.observed(), 2)
    assert found.place.tolist() == [0] and found.judged.found == (True,)


def test_what_changes_all_the_time_is_a_trigger_if_actions_change_it_more_often() -> None:
    """In 8 of 20 steps without an action on it, and in 4 of 5 with one; a lamp in 2 of 4 whoever acts."""
    place = proposals._Place((0, 0, 1, 1), changed=12, own=4, acted=5)
    assert place.moves(25) and not proposals._Place(place.box, 12, 2, 4).moves(24)
    assert not proposals._Place(place.box, 3, 0, 0).moves(24) and proposals._Place(place.box, 0, 0, 1).moves(24)


def test_only_the_observed_pictures_propose() -> None:
    still, late = Patch((20, 20, 40, 40), (9, 9, 9), 0.0), Patch((20, 20, 40, 40), (250, 9, 9), 0.0)
    scene = Scene(("responder",), [(20, 20, 40, 40)], [[still], [still], [late]], [(-1, -1)] * 2)
    assert len(propose_objects(scene.observed(), 2).place) == 0
    assert len(propose_objects(scene.observed(), 3).place) > 0


def test_boxes_are_matched_one_to_one_and_by_role() -> None:
    boxes = np.array([[0, 0, 10, 10], [0, 0, 10, 9], [50, 50, 60, 60], [0, 20, 10, 40]])
    others = np.array([[0, 0, 10, 10], [50, 50, 60, 70], [50, 51, 60, 60], [-1, -1, -1, -1]])
    shared = overlaps(boxes, others)
    assert shared[0, 0] == 1 and shared[2, 1] == 0.5 and shared[1, 0] == 0.9 and shared[:, 3].max() == 0
    assert matched(shared).tolist() == [0, -1, 2, -1], "the second is a phantom"
    assert matched(np.zeros((0, 4))).tolist() == [] and matched(np.zeros((2, 0))).tolist() == [-1, -1]


# places


def placed() -> Proposed:
    """Three true objects; the first proposed one stands for object 2, the second for nothing, the third for 0."""
    observed = Scene(("trigger",) * 3, [(0, 0, 1, 1)] * 3, [[]]).observed()
    return Proposed(observed, np.array([2, 3, 0]), 3, JudgedProposals((), (), (), 3))


def test_what_is_said_of_proposed_objects_is_put_where_they_are() -> None:
    probabilities = np.zeros((2, 3, 3))
    probabilities[1, 2, 0], probabilities[1, 1, 0], probabilities[0, 2, 1] = 0.9, 0.8, 0.7
    links = InferredLinks(np.array([0, 1]), np.array([[[0.0, 0.6, 0.0]] * 2, [[0.9, 0.6, 0.0]] * 2]))
    said = InferredGraph(
        "said", probabilities, links=links, kinds=("a", "b", "c"), lags=np.array([1, 2, 3]),
        changed=np.array([[0.1, 0.2, 0.3]]), changed_at=np.array([4, 5, 6]), words=("x", "y", "z"),
    )  # fmt: skip
    found = placed()
    graph = found.placed(said)
    assert graph.probabilities[1, 0, 2] == 0.9 and graph.probabilities[1, 3, 2] == 0.8
    assert graph.kinds == ("c", "", "a", "b") and graph.lags is not None and graph.lags.tolist() == [3, -1, 1, 2]
    true = found.true_part(graph)
    assert true.probabilities.shape == (2, 3, 3) and true.probabilities.sum() == pytest.approx(0.9)
    assert true.changed is not None and true.changed[0].tolist() == [0.3, 0.0, 0.1]
    assert true.changed_at is not None and true.changed_at.tolist() == [6, -1, 4]
    told = [found.spurious(graph, steps) for steps in range(4)]
    assert told == [(0, 0), (1, 2), (1, 2), (1, 2)], "pairs, links with a phantom"


class AtSeven(Persistence):
    """Believes everything after seven actions, and nothing before and after."""

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return InferredGraph("seven", (seen.steps == 7) * np.ones((max(1, seen.steps), 1, 1)) * seen.candidates)


def test_phantoms_cost_where_they_were_believed_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluate, "reasoner_of", lambda *_: AtSeven())
    changing(monkeypatch, lambda found: [*found, moved(next(one for one in found if one.role == "trigger"))])
    episode = read_episode(Dataset.open(TINY).episode_path(0))
    told = judge_episode(episode, ReasonEvaluation("persistence", IMAGES, boxes="proposed")).causes
    assert told is not None and told.spurious is not None
    assert np.flatnonzero(told.spurious[:, 0]).tolist() == [7] == np.flatnonzero(told.claimed.any((1, 2))).tolist()


def test_phantoms_cost_nothing_where_nobody_knows_the_relations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluate, "reasoner_of", lambda *_: AtSeven())
    changing(monkeypatch, lambda found: [*found, moved(next(one for one in found if one.role == "trigger"))])
    episode = read_episode(Dataset.open(TINY).episode_path(0))
    told = {}
    for known in (True, False):
        board = episode.board.model_copy(update={"relations_known": known})
        judging = ReasonEvaluation("persistence", 8, boxes="proposed")
        told[known] = judge_episode(replace(episode, board=board), judging).counts(7)["claimed"]
    assert told[True] > 0 == told[False]


def test_places_and_numbers_lead_to_each_other() -> None:
    found = placed()
    assert found.to_places(np.array([0, 1, 2, -1])).tolist() == [2, 3, 0, -1]
    assert found.from_places(np.array([2, 3, 0, 1, -1])).tolist() == [0, 1, 2, -1, -1]


# every metric


@pytest.mark.long
@pytest.mark.parametrize("reasoner", ["count", "lookup"])
def test_who_finds_all_objects_is_judged_as_with_boxes(reasoner: str) -> None:
    given, found = evaluated(reasoner, "given"), evaluated(reasoner)
    assert (found["boxes"], found["proposal_r_boxes"]) == ("proposed", 1.0)
    assert 0.98 < found["proposal_r"] < 1, "one switch was not touched so early"
    assert given["boxes"] == "given" and given["proposal_r"] is given["proposal_p"] is None
    keys = ("edge_p", "edge_r", "parent_f1", "shd", "pred_a", "mechanism_accuracy", "what_if", "pred_a_changed")
    for key in keys:
        assert found[key] == (None if given[key] is None else pytest.approx(given[key], abs=0.05)), key
    assert found["parent_f1"] > 0.5 and (reasoner == "count" or found["pred_a"] > 0.5)


@pytest.mark.long
def test_a_responder_that_is_not_proposed_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    changing(monkeypatch, lambda found: [one for one in found if one.role == "trigger"])
    told = evaluated("lookup")
    assert (told["edge_r"], told["parent_r"], told["parent_p"], told["proposal_r_responders"]) == (0, 0, None, 0)
    assert told["proposal_r_triggers"] > 0.95 and told["proposal_p"] == 1.0
    assert (told["pred_a"], told["pred_a_responder"], told["mechanism_accuracy"], told["what_if"]) == (0, 0, 0, 0)
    assert told["shd"] == told["counts"]["true"] / told["boards"]


@pytest.mark.long
def test_a_trigger_in_the_wrong_place_is_missed_and_what_it_is_said_to_do_is_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = evaluated("count")
    changing(monkeypatch, lambda found: [moved(one) if one.role == "trigger" else one for one in found])
    told = evaluated("count")
    assert told["proposal_r_triggers"] == 0 and told["edge_r"] == 0
    assert told["counts"]["claimed"] > 0 and told["edge_p"] == told["parent_p"] == 0.0
    assert told["shd"] > right["shd"] and told["cause_intervals"]["boards"]["parent_p"][0] == 0


@pytest.mark.long
def test_a_wrong_role_is_found_by_its_box_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    changing(monkeypatch, lambda found: [replace(one, role="responder") for one in found])
    told = evaluated("count")
    assert told["proposal_r_boxes"] == 1.0 and told["proposal_r_triggers"] == 0 < told["proposal_r"] < 1
    assert told["edge_r"] == 0


def test_shares_of_proposals() -> None:
    one = JudgedProposals(("trigger", "responder"), (True, False), (True, True), 4)
    told = summarise_proposals([one, one])
    assert (told["proposal_r"], told["proposal_p"], told["proposal_r_boxes"]) == (0.5, 0.25, 1.0)
    assert (told["proposal_r_triggers"], told["proposal_r_responders"]) == (1.0, 0.0)
    assert summarise_proposals([None])["proposal_r"] is None


def test_the_truth_is_not_given_by_another_way() -> None:
    """Roles and boxes that a reasoner sees are the proposed ones, in their own order; categories it never sees."""
    observed = observe_episode(read_episode(TINY / "episodes" / "000000.mcap", "lazy"))
    found = propose_objects(observed, IMAGES)
    blind = replace(observed, roles=("responder",) * len(observed.roles), boxes=np.full_like(observed.boxes, -1))
    again = propose_objects(blind, IMAGES)
    assert found.observed.roles == again.observed.roles and (found.observed.boxes == again.observed.boxes).all()
    np.testing.assert_array_equal(found.observed.positions, again.observed.positions)


def test_what_cannot_be_asked_is_refused() -> None:
    for asked in ({"boxes": "guessed"}, {"boxes": "proposed", "given": GivenGraphs(Path("f"), {}, {})}):
        with pytest.raises(UsageError):
            evaluate_dataset(Dataset.open(TINY), ReasonEvaluation(images=IMAGES, **asked))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="decoders"):
        evaluate_dataset(Dataset.open(TINY), ReasonEvaluation(boxes="proposed"), Dataset.open(TINY))
