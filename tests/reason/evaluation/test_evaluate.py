"""Evaluation of a dataset: what is compared with what, and what stands beside it."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.boards.spec import BODY, LinkRef, Relation, Rewiring
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.reason.evaluation import evaluate
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, evaluate_models, judge_episode
from busybot.reason.evaluation.ground_truth import truth_of
from busybot.reason.evaluation.summary import JudgedGraph, summarise
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.lookup import Persistence
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode, make_real_episode

# on the synthetic board switch 0 drives lamp 1 and switch 3 door 2; the toy 4 is driven by nothing
CANDIDATES = {(0, 1), (0, 2), (0, 4), (3, 1), (3, 2), (3, 4)}


def judged(episode: Episode, *edges: tuple[int, int]) -> JudgedGraph:
    """A board for which someone claims these edges."""
    probabilities = np.zeros((len(episode.steps), 5, 5))
    for edge in edges:
        probabilities[(slice(None), *edge)] = 1.0
    graph = InferredGraph("claimed", probabilities)
    return JudgedGraph(episode.board, graph, truth_of(episode), len(episode.steps), episode.policy, episode.oracle)


def test_truth_is_in_object_pairs() -> None:
    truth = truth_of(make_episode())
    assert {(int(i), int(j)) for i, j in np.argwhere(truth.candidates)} == CANDIDATES
    assert truth.kinds() == {(0, 1): ("one-to-one",), (3, 2): ("one-to-one",)}
    assert truth.edges().sum() == 2


def test_an_effect_is_shown_after_the_first_action_that_changed_the_responder() -> None:
    episode = make_episode(steps=12)
    shown = truth_of(episode).shown
    assert shown is not None
    for trigger, responder in ((0, 1), (3, 2)):
        first = next(k for k, step in enumerate(episode.steps) if step.acted_object == trigger)
        assert shown[trigger, responder] == first + 1
    assert (shown > 0).sum() == 2


def test_an_effect_on_an_object_outside_of_the_picture_is_not_shown() -> None:
    episode = make_episode(steps=12)
    episode.images[0].boxes[1] = -1
    shown = truth_of(episode).shown
    assert shown is not None and shown[0, 1] == 0 and shown[3, 2] > 0


def test_a_recording_without_states_has_no_bound() -> None:
    assert truth_of(make_real_episode()).shown is None
    result = summarise([judge_episode(make_real_episode())], 23, 0)
    assert result["edge_r_bound"] is None and result["edge_p"] is None and result["edge_r"] == 0


def test_only_the_first_images_are_used() -> None:
    episode = make_episode(steps=12)
    assert judge_episode(episode, ReasonEvaluation(images=5)).steps == 4
    longer = make_episode(steps=4)
    np.testing.assert_allclose(
        judge_episode(episode, ReasonEvaluation(images=5)).graph.probabilities,
        judge_episode(longer).graph.probabilities,
    )


def test_summary_of_claims_known_by_hand() -> None:
    """Board one: one of two right and one wrong. Board two: nothing claimed."""
    first, second = make_episode(0, steps=22), make_episode(1, steps=22)
    result = summarise([judged(first, (0, 1), (0, 2)), judged(second)], 23, 0)
    assert result["counts"] == {"hits": 1, "claimed": 2, "true": 4, "correct": 8, "pairs": 12}
    assert (result["edge_p"], result["edge_r"]) == (0.5, 0.25)
    assert result["edge_acc"] == pytest.approx(8 / 12)
    assert result["macro"] == {"precision": 0.5, "recall": 0.25, "accuracy": pytest.approx(8 / 12)}
    assert result["brier"] == pytest.approx(4 / 12)
    assert (result["boards"], result["steps"], result["edge_r_bound"]) == (2, 44, 1.0)
    assert result["pred_a"] is result["pred_a_responder"] is result["pred_a_bound"] is None
    assert result["by_board"] == {
        "edge_p": {"part": [1, 0], "whole": [2, 0]},
        "edge_r": {"part": [1, 0], "whole": [2, 2]},
        "pred_a": {"part": [0, 0], "whole": [0, 0]},
    }


def test_edges_are_those_that_hold_after_what_was_observed() -> None:
    """The second switch takes the first one's lamp with the eleventh action."""
    episode = make_episode(0, steps=22)
    old = next(one for one in episode.board.relations if one.responder == 1)
    taken = old.model_copy(update={"triggers": (old.triggers[0].model_copy(update={"object": 3}),)})
    rewirings = (Rewiring(step=10, relation=taken),)
    episode.board = episode.board.model_copy(update={"rewirings": rewirings})
    right, late = judged(episode, (3, 1), (3, 2)), judged(episode, (0, 1), (3, 2))
    for one, images, share in ((right, 23, 1.0), (late, 23, 0.5), (right, 11, 0.5), (late, 11, 1.0)):
        told = summarise([one], images, 0)
        assert told["edge_p"] == told["edge_r"] == told["by_kind"]["one-to-one"]["edge_r"] == share
        assert told["brier"] == pytest.approx((1 - share) * 4 / 6)
        assert told["by_images"][9 - 1]["edge_r"] == (1.0 if one is late else 0.5)
    short = make_episode(0, steps=5)
    short.board = episode.board
    assert summarise([judged(short, (0, 1), (3, 2))], 23, 0)["edge_r"] == 1.0, "it ended before the rewiring"


def test_kinds_are_those_of_edges_that_are_judged() -> None:
    """A lamp that lets a door follow is no trigger: the pair is judged as parents, not as an edge."""
    episode = make_episode(0, steps=22)
    follows = episode.board.relations[0].model_copy(
        update={"responder": 4, "triggers": (LinkRef(object=1, link=BODY),)}
    )
    episode.board = episode.board.model_copy(update={"relations": (*episode.board.relations, follows)})
    told = summarise([judged(episode, (0, 1), (3, 2))], 23, 0)
    assert told["counts"]["true"] == told["by_kind"]["one-to-one"]["relations"] == 2


def test_intervals_over_objects_are_as_wide_as_triggers_are_few() -> None:
    """Each board has the same two triggers: all is said rightly of one of them, half and wrongly of the other."""
    episode = make_episode(0, steps=22)
    keys = [placed.key for placed in episode.board.objects]
    assert keys[0] != keys[3]
    boards = [judged(episode, (0, 1), (3, 2), (3, 4))] * 20
    result = summarise(boards, 23, 0)
    assert result["edge_p"] == pytest.approx(2 / 3) and result["intervals"]["precision"] == pytest.approx(
        (2 / 3, 2 / 3)
    )
    assert result["object_intervals"]["precision"] == (0.5, 1.0)
    assert result["object_intervals"]["recall"] == pytest.approx((0.158, 1), abs=1e-3), "two triggers are two trials"
    assert result["object_intervals"]["pred_a"] is None
    assert summarise([], 23, 0)["object_intervals"] == dict.fromkeys(("precision", "recall", "accuracy", "pred_a"))


def test_edges_of_objects_that_are_not_there_are_wrong_in_intervals_too() -> None:
    spurious = np.full(23, 2)
    one = replace(judged(make_episode(0, steps=22), (0, 1), (3, 2)), spurious=spurious)
    result = summarise([one] * 30, 23, 0)
    low, high = result["object_intervals"]["precision"]
    assert low < result["edge_p"] == 0.5 < high


def test_trivial_graphs_stand_beside_the_result() -> None:
    result = summarise([judge_episode(make_episode(k, steps=22)) for k in range(8)], 23, 0)
    empty, ones, guess = (result["baselines"][name] for name in ("empty graph", "all-ones graph", "random trigger"))
    assert (empty["edge_p"], empty["edge_r"], empty["edge_acc"]) == (None, 0.0, pytest.approx(4 / 6))
    assert (ones["edge_p"], ones["edge_r"], ones["edge_acc"]) == (pytest.approx(2 / 6), 1.0, pytest.approx(2 / 6))
    assert guess["edge_p"] == pytest.approx(guess["edge_r"] * 2 / 3), "three claims for two relations"
    assert result["edge_p"] == result["edge_r"] == 1.0


def test_scores_by_kind_blame_the_kinds_of_the_wrong_trigger() -> None:
    episode = make_episode(steps=22)
    door = Relation(
        kind="one-to-many-objects",
        triggers=(LinkRef(object=3, link="link_0"),),
        responder=2,
        stage="single",
        states=(0, 1),
    )
    board = episode.board.model_copy(update={"relations": (episode.board.relations[0], door)})
    result = summarise([judged(replace(episode, board=board), (0, 1), (0, 4), (3, 2))], 23, 0)
    assert result["by_kind"] == {
        "one-to-one": {"edge_p": 0.5, "edge_r": 1.0, "relations": 1},
        "one-to-many-objects": {"edge_p": 1.0, "edge_r": 1.0, "relations": 1},
    }


def test_the_curve_grows_with_the_images_up_to_its_bound() -> None:
    result = summarise([judge_episode(make_episode(k, steps=22)) for k in range(4)], 23, 0)
    curve = result["by_images"]
    assert [point["images"] for point in curve] == list(range(2, 24))
    assert all(point["edge_r"] <= point["edge_r_bound"] for point in curve)
    assert curve[0]["edge_r"] < curve[-1]["edge_r"] == result["edge_r"]


@pytest.mark.long
def test_two_runs_and_two_workers_give_the_same_result(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys")
    seen: list[tuple[int, int]] = []

    def run(workers: int, seed: int = 0) -> dict[str, Any]:
        return evaluate_dataset(dataset, seed=seed, workers=workers, progress=lambda done, of: seen.append((done, of)))

    result = run(1)
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert result == run(2)
    assert result["dataset"]["board_hash"] == dataset.hashes().board
    assert (result["dataset"]["boards"], result["boards"]) == (4, 3)


def test_a_dataset_without_episodes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="none of its 4 boards has an episode\n.*busybot collect"):
        evaluate_dataset(make_dataset(tmp_path / "toys", finished=()))


def test_one_image_shows_no_action(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="at least 2"):
        evaluate_dataset(make_dataset(tmp_path / "toys"), ReasonEvaluation(images=1))


def test_who_expects_no_change_is_right_where_an_action_misses(tmp_path: Path) -> None:
    """The last of three predicted actions on each board takes hold of nothing, the others change something."""
    result = evaluate_dataset(make_dataset(tmp_path / "toys"), ReasonEvaluation("persistence", images=4), workers=1)
    assert (result["predicted_boards"], result["predicted_steps"]) == (3, 9)
    assert result["pred_a"] == result["persistence"]["pred_a"] == result["failing"] == pytest.approx(1 / 3)
    assert (result["pred_a_successful"], result["pred_a_changed"], result["pred_a_unchanged"]) == (0.0, 0.0, 1.0)
    assert result["decoder_accuracy"]["nearest"]["all"] == 1.0
    assert (result["edge_p"], result["edge_r"], result["encoder"]) == (None, 0.0, "embedded")
    assert [point["images"] for point in result["by_images"] if point["pred_a"] is not None] == [2, 4]


@pytest.mark.long
def test_looking_up_predicts_what_was_seen(tmp_path: Path) -> None:
    """It knows no more than the bound, and more than who expects no change."""
    dataset = make_dataset(tmp_path / "toys")
    result = evaluate_dataset(dataset, ReasonEvaluation("lookup", images=4), workers=1)
    assert result["bounds"]["knowing"]["pred_a_successful"] >= result["pred_a_successful"] > 0.5
    assert result == evaluate_dataset(dataset, ReasonEvaluation("lookup", images=4), workers=2)


def test_models_judged_together_are_judged_as_each_alone(tmp_path: Path) -> None:
    dataset, asked = make_dataset(tmp_path / "toys"), [ReasonEvaluation(name, 4) for name in ("count", "persistence")]
    together = evaluate_models(dataset, asked, workers=1)
    assert together == [evaluate_dataset(dataset, one, workers=1) for one in asked]
    assert [one["model"] for one in together] == ["count", "persistence"]


class Counting(Persistence):
    """Believes so much of each pair as it has seen actions, in hundredths."""

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return InferredGraph("counting", np.full((max(1, seen.steps), *seen.candidates.shape), seen.steps / 100))


def test_early_beliefs_are_those_of_who_has_seen_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """After 3, 7, 10 and 11 actions it is asked anew, after 8 it is judged; it saw all 12 when it tells the rest."""
    monkeypatch.setattr(evaluate, "reasoner_of", lambda *_: Counting())
    episode, features = make_episode(steps=12), np.zeros((13, 5, 256), np.float32)
    told = judge_episode(episode, ReasonEvaluation("persistence", images=9), features).causes
    assert told is not None
    assert (100 * told.probabilities[:, 0, 1]).round().tolist() == [0, 12, 12, 3, 12, 12, 12, 7, 8, 12, 10, 11, 12]


def test_boards_without_further_steps_or_known_states_have_no_pred_a(tmp_path: Path) -> None:
    result = evaluate_dataset(make_dataset(tmp_path / "toys"), ReasonEvaluation("persistence", images=7), workers=1)
    assert result["predicted_boards"] == 0 and result["pred_a"] is None and result["pred_a_bound"] is None
    assert judge_episode(make_real_episode(), ReasonEvaluation(images=2)).forecast is None


@pytest.mark.long
def test_decoders_come_from_the_training_boards(tiny: Path, tmp_path: Path) -> None:
    boards = Dataset.open(shutil.copytree(tiny, tmp_path / "boards"))
    result = evaluate_dataset(boards, ReasonEvaluation("persistence", images=12), boards, workers=1)
    assert result["decoder_accuracy"]["decoded"]["all"] > 0.95
    assert result["decoded"]["pred_a_unchanged"] > 0.9
    assert result["decoders"]["content_hash"] == boards.hashes().content
    name = f"{boards.info.name} ({boards.info.split})"
    assert list(result["hashes"]["data"]) == [name, f"decoders: {name}"]
