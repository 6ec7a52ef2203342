"""Judged predictions on a small board, and their summary, by hand."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from busybot.episodes.episode import Episode
from busybot.reason.evaluation.decoders import NearestState
from busybot.reason.evaluation.ground_truth import NOTHING_HELD, StateTruth, states_of, truth_of
from busybot.reason.evaluation.prediction import (
    BOUND,
    BOUND_KNOWING,
    NEAREST,
    PERSISTENCE,
    EvaluatedBoard,
    JudgedPrediction,
    judge_prediction,
)
from busybot.reason.evaluation.summary import JudgedGraph, after_images, intervals, summarise, summarise_predictions
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import BoardSequence, sequence_of
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.lookup import Persistence
from tests.episodes.synthetic import make_episode, make_real_episode

JUDGED = np.array([False, True, True, False, True])


def features_of(truth: StateTruth) -> np.ndarray:
    """Features that tell states: number 1 + state of an object is 1."""
    features = np.zeros((*truth.states.shape, 256), np.float32)
    for frame, index in np.argwhere(truth.states >= 0):
        features[frame, index, 1 + truth.states[frame, index]] = 1
    return features


def watched(episode: Episode) -> EvaluatedBoard:
    truth = states_of(episode)
    assert truth is not None
    observed = observe_episode(episode)
    sequence = sequence_of(observed, features_of(truth))
    return EvaluatedBoard(
        truth,
        observed,
        JUDGED,
        sequence,
        {NEAREST: NearestState(sequence.features, truth.states, truth.states, JUDGED)},
    )


@dataclass
class Knowing:
    """A reasoner that is told what comes, and keeps a note of what it was given."""

    truth: StateTruth
    given: list[int]
    name: str = "knowing"
    encoder: str = "embedded"

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return Persistence().graph(seen)

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        assert len(current) == len(actions) == len(acted)
        self.given.append(len(seen.features))
        return features_of(self.truth)[-len(current) :]


def test_truth_of_states_by_hand() -> None:
    episode = make_episode(steps=6)
    truth = states_of(episode)
    assert truth is not None and truth.states.shape == (7, 5)
    assert (truth.states[:, [0, 3]] == -1).all() and (truth.states[:, [1, 2, 4]] >= 0).all()
    assert truth.kinds[2] == (NOTHING_HELD,) and truth.links[2] == -1 and not truth.success[2]
    held = [step.acted_object for step in episode.steps]
    assert [episode.links[k].object if k >= 0 else -1 for k in truth.links] == held
    assert states_of(make_real_episode()) is None
    assert states_of(replace(episode, steps=[])) is None
    lost = [replace(step, responder_states_after=(-1, -1, 0, -1, 0)) for step in episode.steps]
    assert states_of(replace(episode, steps=lost)) is None, "nobody knows how the lamp stands"


def test_persistence_is_right_where_nothing_changes() -> None:
    board = watched(make_episode(steps=12))
    result = judge_prediction(board, Persistence(), 7)
    assert result.changed.shape == (6, 5)
    np.testing.assert_array_equal(result.right[NEAREST][:, JUDGED], ~result.changed[:, JUDGED])
    np.testing.assert_array_equal(result.right[PERSISTENCE], result.right[NEAREST])
    assert result.reads[NEAREST][:, JUDGED].all()


def test_who_knows_the_future_is_always_right_and_sees_only_the_first_images() -> None:
    board, given = watched(make_episode(steps=12)), []
    result = judge_prediction(board, Knowing(board.truth, given), 7, curve=(2, 5, 7, 23))
    assert sorted(given) == [2, 5, 7]
    assert result.right[NEAREST][:, JUDGED].all()
    assert set(result.by_images) == {2, 5, 7}
    assert result.by_images[2][NEAREST][:, JUDGED].all()
    assert result.by_images[2][BOUND][:, JUDGED].mean() <= result.right[BOUND][:, JUDGED].mean()


def test_without_features_the_bounds_remain() -> None:
    board = replace(watched(make_episode(steps=12)), sequence=None, judges={})
    result = judge_prediction(board, None, 7, curve=(5,))
    assert set(result.right) == {"bound", "bound_knowing"} and not result.reads
    summary = summarise_predictions([(make_episode().board, result)])
    assert summary["pred_a"] is None and summary["decoded"] is None and summary["persistence"] is None
    assert summary["pred_a_bound"] is not None


def by_hand() -> JudgedPrediction:
    """Four steps; objects 1 and 2 are judged. Right as a whole: steps 0 and 3."""
    right, changed = np.ones((4, 5), bool), np.zeros((4, 5), bool)
    changed[0, 1] = changed[1, 2] = changed[2, 1] = True
    right[1, 2] = right[2, 2] = False
    right[3, 4] = False  # not judged
    none = np.zeros((4, 5), bool)
    return JudgedPrediction(
        changed=changed,
        judged=np.array([False, True, True, False, False]),
        successful=np.array([True, True, True, False]),
        held=np.array([0, 0, 3, -1]),
        kinds=(("one-to-one",), ("one-to-one", "gate"), ("one-to-many-effects",), (NOTHING_HELD,)),
        right={NEAREST: right, BOUND: ~none, PERSISTENCE: ~changed},
        reads={NEAREST: np.ones((9, 5), bool)},
        by_images={2: {NEAREST: none, BOUND: ~none}},
    )


def test_summary_by_hand() -> None:
    result: dict[str, Any] = summarise_predictions([(make_episode().board, by_hand())])
    assert (result["predicted_boards"], result["predicted_steps"], result["failing"]) == (1, 4, 0.25)
    assert result["pred_a"] == 0.5 and result["pred_a_macro"] == 0.5
    assert result["pred_a_successful"] == pytest.approx(1 / 3)
    assert result["pred_a_responder"] == pytest.approx(6 / 8)
    assert result["pred_a_changed"] == pytest.approx(2 / 3)
    assert result["pred_a_unchanged"] == pytest.approx(4 / 5)
    assert (result["pred_a_bound"], result["persistence"]["pred_a"]) == (1.0, 0.25)
    assert result["decoder_accuracy"] == {"nearest": {"all": 1.0, "Lamp": 1.0, "Door": 1.0}, "decoded": None}
    kinds = result["pred_by_kind"]
    assert {kind: (kinds[kind]["pred_a"], kinds[kind]["steps"]) for kind in kinds} == {
        "one-to-one": (0.5, 2),
        "gate": (0.0, 1),
        "one-to-many-effects": (0.0, 1),
        NOTHING_HELD: (1.0, 1),
    }
    assert result["pred_by_category"] == {
        "Lamp": {"responders": 1.0, "changed": 1.0, "unchanged": 1.0},
        "Door": {"responders": 0.5, "changed": 0.0, "unchanged": pytest.approx(2 / 3)},
    }


def test_steps_belong_to_the_trigger_that_is_held() -> None:
    """Switch 0 is predicted in one of two steps, switch 3 in none, and what holds nothing is."""
    episode = make_episode(steps=22)
    graph = InferredGraph("claimed", np.zeros((22, 5, 5)))
    one = JudgedGraph(episode.board, graph, truth_of(episode), 22, "", False, forecast=by_hand())
    low, high = summarise([one], 23, 0)["object_intervals"]["pred_a"]
    assert (low, high) == (0.0, 1.0)
    held = replace(by_hand(), held=np.zeros(4, int))
    assert summarise([replace(one, forecast=held)] * 3, 23, 0)["object_intervals"]["pred_a"] == (0.5, 0.5)


def test_bounds_that_mean_nothing_in_other_worlds_are_null() -> None:
    """They take it that an action shows at once what it does; what was predicted counts all the same."""
    episode, graph = make_episode(steps=22), InferredGraph("claimed", np.zeros((22, 5, 5)))
    told = {}
    for world in ("paper", "time"):
        board = episode.board.model_copy(update={"world": world})
        right = {**by_hand().right, BOUND_KNOWING: by_hand().right[BOUND]}
        forecast = replace(by_hand(), right=right)
        told[world] = summarise([JudgedGraph(board, graph, truth_of(episode), 22, "", False, forecast)], 23, 0)
    paper, time = told["paper"], told["time"]
    assert paper["pred_a"] == time["pred_a"] == 0.5 and paper["persistence"] == time["persistence"] is not None
    assert paper["edge_r_bound"] == paper["pred_a_bound"] == paper["bounds"]["knowing"]["pred_a"] == 1.0
    assert time["edge_r_bound"] is time["pred_a_bound"] is time["bounds"]["knowing"] is None
    assert set(time["bounds"]["not_knowing"].values()) == {None}
    for name in ("edge_r_bound", "pred_a_bound"):
        assert any(one[name] is not None for one in paper["by_images"])
        assert all(one[name] is None for one in time["by_images"]), name
    assert {kind["pred_a_bound"] for kind in time["pred_by_kind"].values()} == {None}


def test_curve_and_intervals_use_the_same_boards() -> None:
    board, other = make_episode().board, replace(by_hand(), right={NEAREST: np.ones((4, 5), bool)})
    boards = [(board, by_hand()), (board, other)] * 6
    assert after_images(boards[:1], 2) == {"pred_a": 0.0, "pred_a_bound": 1.0}
    assert after_images(boards[:1], 3) == {"pred_a": None, "pred_a_bound": None}
    low, high = intervals(boards, 0)["pred_a"]
    assert low < 0.75 < high
    assert intervals(boards, 0) == intervals(boards, 0) != intervals(boards, 1)


def test_no_predictions_no_scores() -> None:
    result = summarise_predictions([])
    assert result["predicted_boards"] == 0 and result["pred_a"] is None and result["failing"] is None
    assert intervals([], 0)["pred_a"] is None
