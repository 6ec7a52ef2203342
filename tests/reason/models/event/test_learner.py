"""Training the event model: what it depends on, and that a killed training ends in the same weights."""

import csv
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from busybot.common.errors import BusybotError
from busybot.reason.inputs.board_dataset import batches_of
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.event.config import EventConfig, EventNetConfig, LossConfig
from busybot.reason.models.event.data import board_graph, context_of, split
from busybot.reason.models.event.learner import EventLearner, loss_of, smallest_change
from busybot.reason.models.event.networks import EventReasoner
from busybot.training.loop import LoopConfig, fit
from tests.reason.boards import make_boards

SMALL = EventConfig(iterations=8, batch=4, net=EventNetConfig(width=8, heads=2))
LOOP = LoopConfig(judge=2, report=2, patience=0)


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def learner(config: EventConfig = SMALL, seed: int = 0, kind: type[EventLearner] = EventLearner) -> EventLearner:
    boards = [board.seen for board in make_boards(8)]
    return kind(config, boards[:6], boards[6:], seed)


def weights(of: EventLearner) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in of.network.state_dict().items()}


def equal(one: dict[str, Tensor], other: dict[str, Tensor]) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


class Killed(EventLearner):
    """Dies in its sixth iteration."""

    def iterate(self, iteration: int) -> tuple[float, float]:
        if iteration == 5:
            raise KeyboardInterrupt
        return super().iterate(iteration)


def test_killed_and_continued_it_ends_in_the_same_weights(tmp_path: Path) -> None:
    straight, continued = learner(), learner()
    figures = fit(straight, tmp_path / "straight", LOOP)
    with pytest.raises(KeyboardInterrupt):
        fit(learner(kind=Killed), tmp_path / "killed", LOOP)
    assert fit(continued, tmp_path / "killed", LOOP) == figures
    assert equal(weights(straight), weights(continued))
    for name in ("metrics.csv", "metrics.json", "metrics/event.jsonl"):
        assert (tmp_path / "straight" / name).read_bytes() == (tmp_path / "killed" / name).read_bytes(), name


def test_another_seed_gives_other_weights(tmp_path: Path) -> None:
    one, other = learner(), learner(seed=1)
    fit(one, tmp_path / "one", LOOP)
    fit(other, tmp_path / "other", LOOP)
    assert not equal(weights(one), weights(other))


def test_metrics_are_tables(tmp_path: Path) -> None:
    figures = fit(learner(), tmp_path, LOOP)
    assert json.loads((tmp_path / "metrics.json").read_text()) == figures
    assert 0 <= figures["held_out"]["right"] <= 1 and figures["held_out"]["loss"] >= 0
    with open(tmp_path / "metrics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["iteration"] for row in rows if row["loss"]] == ["2", "4", "6", "8"]
    assert len([row for row in rows if row["held_out_right"]]) == 4


class Worsening(EventLearner):
    """Judged better and better up to iteration 4, worse from then on."""

    judged = 0

    def judge(self) -> dict[str, float]:
        self.judged += 1
        return {"loss": abs(self.judged - 2.0)}


def test_it_stops_when_held_out_boards_say_so_and_keeps_the_best_weights(tmp_path: Path) -> None:
    stopped, shorter = learner(kind=Worsening), learner()
    figures = fit(stopped, tmp_path, LoopConfig(judge=2, report=2, patience=1))
    assert (figures["iterations"], figures["best_iteration"]) == (6, 4)
    for iteration in range(4):
        shorter.iterate(iteration)
    assert equal(weights(stopped), weights(shorter))


def test_without_held_out_boards_the_last_weights_stay(tmp_path: Path) -> None:
    boards = [board.seen for board in make_boards(6)]
    alone = EventLearner(SMALL, boards, [], 0)
    figures = fit(alone, tmp_path, LOOP)
    assert figures["held_out"] == {} and figures["best_iteration"] == 8


def test_it_learns() -> None:
    config = SMALL.model_copy(update={"iterations": 60, "batch": 8})
    student = learner(config)
    before = student.judge()["loss"]
    for iteration in range(config.iterations):
        student.iterate(iteration)
    assert student.judge()["loss"] < 0.9 * before


@pytest.mark.parametrize("exclusive", [True, False])
def test_with_several_triggers_per_responder_allowed_it_learns_too(exclusive: bool) -> None:
    config = SMALL.model_copy(update={"net": EventNetConfig(width=8, heads=2, exclusive=exclusive)})
    student = learner(config)
    losses = [student.iterate(iteration)[0] for iteration in range(8)]
    assert all(np.isfinite(losses)) and min(losses) >= 0


def test_without_inference_it_learns_effects_and_claims_no_relation(tmp_path: Path) -> None:
    config = SMALL.model_copy(
        update={"net": EventNetConfig(width=8, heads=2, inference=False), "iterations": 60, "batch": 8}
    )
    student = learner(config)
    edges = {name: value for name, value in weights(student).items() if name.startswith("edges.")}
    before = student.judge()["loss"]
    fit(student, tmp_path, LOOP)
    assert student.judge()["loss"] < before and equal(edges, weights(student))
    reasoner, board = EventReasoner(student.network, "embedded"), make_boards(1, 7)[0]
    seen = board.seen.first(20)
    assert not reasoner.graph(seen).probabilities.any()
    current, after = board.seen.features[19:-1], board.seen.features[20:]
    predicted = reasoner.predict(seen, current, board.seen.actions[19:], board.seen.acted[19:])
    right = np.linalg.norm(predicted - after, axis=-1)[:, board.seen.responders] < float(student.network.scale)
    assert right.mean() > 0.9


def test_boards_of_different_lengths_are_trained_on_together() -> None:
    boards: list[BoardSequence] = [make_boards(1, 3, steps=steps)[0].seen for steps in (2, 9, 30)]
    student = EventLearner(SMALL, boards, boards, 0)
    assert all(np.isfinite(student.iterate(iteration)[0]) for iteration in range(4))
    assert np.isfinite(student.judge()["loss"])
    for images in (1, 2):
        assert EventLearner(SMALL, boards, [boards[0].first(images)], 0).judge() == {}, "no step follows another"


def test_the_smallest_change_lies_between_noise_and_change() -> None:
    boards = make_boards(20, 4, noise=0.02)
    threshold = smallest_change([board_graph(board.seen) for board in boards])
    for board in boards:
        moved = np.linalg.norm(np.diff(board.seen.features, axis=0), axis=-1)[:, board.seen.responders]
        changed = (np.diff(board.states, axis=0) != 0)[:, board.seen.responders]
        assert moved[changed].min() > threshold > moved[~changed].max()


@pytest.mark.parametrize(("steps", "failing", "message"), [(1, 0.0, "two steps"), (8, 1.0, "ever changes")])
def test_boards_that_show_nothing_are_refused(steps: int, failing: float, message: str) -> None:
    boards = [board.seen for board in make_boards(2, 5, steps=steps, failing=failing)]
    with pytest.raises(BusybotError, match=message):
        EventLearner(SMALL, boards, [], 0)


def test_edges_of_the_prior_diverge_by_nothing() -> None:
    from busybot.reason.models.event.learner import divergence

    row = torch.tensor([0, 0, 1])
    prior = LossConfig().prior
    odds = prior / (1 - prior)
    none = torch.tensor([1 / (1 + 2 * odds), 1 / (1 + odds)])
    edges = odds * none[row]
    exact = divergence(edges.log(), none.log(), row, prior, exclusive=True)
    assert exact == pytest.approx(0, abs=1e-6)
    apart = divergence(torch.full((3,), 0.2).log(), torch.tensor([0.6, 0.8]).log(), row, prior, exclusive=True)
    assert apart > 1e-4
    alone = divergence(torch.full((3,), prior).log(), torch.zeros(2), row, prior, exclusive=False)
    assert alone == pytest.approx(0, abs=1e-6)


def test_what_nobody_saw_of_a_responder_is_no_answer() -> None:
    """Its steps count neither in the loss nor in what is right; those of the others do."""
    one = learner()
    [batch] = list(batches_of([board_graph(board.seen) for board in make_boards(2)], [[0, 1]]))
    seen = context_of(batch, one.network.scale)
    shown = seen.shown.clone()
    shown[0, 10:] = False
    covered = replace(seen, shown=shown)
    real, usual = (split(each, 10, 8)[2].real for each in (covered, seen))
    assert not real[0].any() and usual[0].any() and torch.equal(real[1:], usual[1:])
    far = covered.distances.clone()
    far[0, 11:] += 5
    far[0, :, 11:] += 5
    other = replace(covered, distances=far)
    losses = [loss_of(one.network, *split(each, 10, 8), SMALL.loss)[1] for each in (covered, other, seen)]
    assert torch.equal(losses[0], losses[1]) and not torch.equal(losses[0], losses[2])
