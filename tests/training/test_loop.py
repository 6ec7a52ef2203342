"""The training loop with a learner of one weight: what it writes, when it ends, and how it goes on."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from busybot.common.errors import BusybotError
from busybot.common.quiet import QUIET
from busybot.common.rng import generator
from busybot.training.checkpoint import Checkpoint, load_tensors, save_tensors, training_tensors
from busybot.training.loop import Budget, Learner, Loop, LoopConfig, cosine_rate, descend, fit, groups_apart
from busybot.training.run_folder import Metrics, Panel, begin_folder, draw, read_metrics


class Line(Learner):
    """Fits y = 2 x, and counts what it draws."""

    name = "line"

    def __init__(self, iterations: int = 8, dies_in: int | None = None, minutes: float | None = None):
        self.network = nn.Linear(1, 1, bias=False)
        nn.init.zeros_(self.network.weight)
        self.optimizer = torch.optim.AdamW(self.network.parameters(), lr=0.1)
        self.iterations, self.dies_in, self.drawn = iterations, dies_in, 0
        if minutes is not None:
            self.budget = Budget(minutes)

    def iterate(self, iteration: int) -> tuple[float, float]:
        if iteration == self.dies_in:
            raise KeyboardInterrupt
        x = torch.from_numpy(generator(0, "train", iteration, "test/line").random((4, 1), np.float32))
        self.drawn += len(x)
        loss = (self.network(x) - 2 * x).square().mean()
        descend(self.optimizer, loss, 0.1)
        return float(loss.detach()), 0.1

    def state(self) -> Checkpoint:
        return Checkpoint({}, {"drawn": self.drawn})

    def restore(self, saved: Checkpoint) -> None:
        self.drawn = saved.values["drawn"]


def loop_of(learner: Line, folder: Path) -> Loop:
    return Loop(learner, folder, 2, 3)


def test_a_killed_round_goes_on_and_leaves_the_files_of_one_that_was_not(tmp_path: Path) -> None:
    for name, deaths in (("whole", ()), ("killed", (5, 7))):
        for dies_in in (*deaths, None):
            loop = loop_of(Line(dies_in=dies_in), tmp_path / name)
            try:
                for number, (start, until) in enumerate(((0, 4), (4, 8))):
                    if loop.progress.iteration < until:
                        loop.run(f"round {number}", start, until)
            except KeyboardInterrupt:
                assert loop_of(Line(), tmp_path / name).progress.iteration == {5: 4, 7: 7}[dies_in or 0]
    files = [tmp_path / name / "checkpoints" / "line.safetensors" for name in ("whole", "killed")]
    assert files[0].read_bytes() == files[1].read_bytes()
    assert load_tensors(files[0]).values["learner"] == {"drawn": 32}
    assert [line["iteration"] for line in read_metrics(tmp_path / "killed" / "metrics" / "line.jsonl")] == [2, 4, 6, 8]


@pytest.mark.parametrize("damaged", ['{"iteration": 4, "lo', "[" * 100_000, "3", '{"loss": 0.5}', '{"iteration": "4"}'])
def test_a_damaged_line_of_metrics_is_named(tmp_path: Path, damaged: str) -> None:
    loop_of(Line(), tmp_path).run("", 0, 4)
    file = tmp_path / "metrics" / "line.jsonl"
    whole = file.read_text()
    file.write_text(f"{whole}{damaged}\n")
    with pytest.raises(BusybotError, match=r"metrics/line\.jsonl: line 3: (.|\n)*hint: remove the line"):
        loop_of(Line(), tmp_path).run("", 4, 8)
    file.write_text(whole)
    loop_of(Line(), tmp_path).run("", 4, 8)
    assert [line["iteration"] for line in read_metrics(file)] == [2, 4, 6, 8]


@pytest.mark.parametrize("values", [{"iteration": 3, "drawn": 12}, {"epoch": 1, "done": 1, "total": 3, "drawn": 12}])
def test_checkpoints_of_earlier_versions_go_on(tmp_path: Path, values: dict[str, int]) -> None:
    """Networks trained in rounds or epochs had their own values and how far they were side by side."""
    whole, begun = Line(), Line()
    loop_of(whole, tmp_path / "whole").run("", 0, 8)
    loop_of(begun, tmp_path / "unused").run("", 0, 3)
    file = tmp_path / "old" / "checkpoints" / "line.safetensors"
    save_tensors(file, training_tensors(begun.network, begun.optimizer), values)
    continued = Line()
    loop = loop_of(continued, tmp_path / "old")
    assert (loop.progress.iteration, continued.drawn) == (3, 12)
    loop.run("", 0, 8)
    assert torch.equal(continued.network.weight, whole.network.weight)


BEGUN = {"progress": {"iteration": 3}, "learner": {"drawn": 12}}


@pytest.mark.parametrize(
    "values",
    [
        [],
        {"progress": {"iteration": 3}},
        {**BEGUN, "learner": {}},
        {**BEGUN, "progress": {"iteration": "a"}},
        {**BEGUN, "progress": {"iteration": -3}},
        {"iteration": -3},
        {**BEGUN, "untold": 3},
        {"iteration": float("inf")},
    ],
)
def test_a_checkpoint_of_something_else_is_refused_by_its_file(tmp_path: Path, values: Any) -> None:
    begun = Line()
    file, tensors = loop_of(begun, tmp_path).checkpoint, training_tensors(begun.network, begun.optimizer)
    save_tensors(file, tensors, values)
    with pytest.raises(BusybotError, match=r"line\.safetensors: not where this training stands: "):
        loop_of(Line(), tmp_path)
    save_tensors(file, tensors, BEGUN)
    assert loop_of(Line(), tmp_path).progress.iteration == 3


@pytest.mark.parametrize(("name", "shape"), [("0.exp_avg", (3, 3)), ("1.exp_avg", (3, 3)), ("7.step", ()), ("a.b", ())])
def test_what_another_optimizer_learned_is_refused_by_its_file(
    tmp_path: Path, name: str, shape: tuple[int, ...]
) -> None:
    file = loop_of(Line(), tmp_path).checkpoint
    save_tensors(file, {"network.weight": torch.ones(1, 1), f"optimizer.{name}": torch.ones(shape)}, BEGUN)
    with pytest.raises(BusybotError) as refused:
        loop_of(Line(), tmp_path)
    assert f"line.safetensors: optimizer.{name} is {shape}, and its parameter" in refused.value.what


def test_a_judgement_that_is_no_number_is_never_the_best(tmp_path: Path) -> None:
    class Lost(Line):
        def judge(self) -> dict[str, float | None]:
            return {"loss": float("nan") if self.drawn > 8 else 1.0}

    learner = Lost()
    summary = fit(learner, tmp_path, LoopConfig(report=1, judge=2, patience=2))
    assert (summary["best_iteration"], summary["iterations"]) == (2, 6), "patience counts them"
    assert np.isfinite(float(learner.network.weight.detach()))


def test_a_training_of_which_no_judgement_is_a_number_leaves_no_model(tmp_path: Path) -> None:
    class Lost(Line):
        def judge(self) -> dict[str, float | None]:
            return {"loss": float("inf")}

    with pytest.raises(BusybotError, match="no loss of line on held-out boards was a number"):
        fit(Lost(), tmp_path, LoopConfig(report=1, judge=2, patience=0))


def test_a_training_whose_loss_is_no_number_ends_there(tmp_path: Path) -> None:
    class Diverging(Line):
        def iterate(self, iteration: int) -> tuple[float, float]:
            loss, rate = super().iterate(iteration)
            return (float("inf") if iteration == 4 else loss), rate

    with pytest.raises(BusybotError, match="line, iteration 5: the loss is no number"):
        fit(Diverging(), tmp_path, LoopConfig(report=1, judge=2))
    assert loop_of(Line(), tmp_path).progress.iteration == 4
    patient = Diverging()
    patient.leaves_out = True
    assert fit(patient, tmp_path, LoopConfig(report=1, judge=2, patience=0))["iterations"] == 8
    told = [line["loss"] for line in read_metrics(tmp_path / "metrics" / "line.jsonl") if "loss" in line]
    assert len(told) == 8 and [place for place, loss in enumerate(told) if loss is None] == [4]


def test_a_quiet_command_trains_without_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    loop_of(Line(), tmp_path / "loud").run("line", 0, 4)
    assert "line: 4 of 4" in capsys.readouterr().err
    monkeypatch.setenv(QUIET, "1")
    loop_of(Line(), tmp_path / "quiet").run("line", 0, 4)
    assert capsys.readouterr().err == ""


def test_time_that_is_spent_ends_a_training_for_good(tmp_path: Path) -> None:
    config = LoopConfig(judge=100, report=1)
    assert fit(Line(minutes=1e-9), tmp_path, config)["iterations"] == 1
    again = Line(minutes=1e-9)
    assert fit(again, tmp_path, config)["iterations"] == 1
    assert again.budget is not None and again.budget.seconds > 0
    assert fit(Line(minutes=10), tmp_path, config)["iterations"] == 8


def test_minutes_of_a_call_begin_where_it_goes_on(tmp_path: Path) -> None:
    config, whole = LoopConfig(judge=100, report=1), Line(minutes=10)
    whole.dies_in = 3
    with pytest.raises(KeyboardInterrupt):
        fit(whole, tmp_path, config)
    again = Line()
    again.budget = Budget(1e-9, this_call=True)
    assert fit(again, tmp_path, config)["iterations"] == 1, "one is always done"
    again.budget = Budget(10, this_call=True)
    again.budget.go_on(3600)
    assert not again.budget.spent and again.budget.seconds == 3600
    alone = Budget(10)
    alone.go_on(3600)
    assert alone.spent


def test_the_end_is_learned_once_with_the_best_weights_also_after_an_interruption(tmp_path: Path) -> None:
    """The second judgement is the best."""

    class Concluding(Line):
        best, found = 0.35, tuple[float, ...]()

        def judge(self) -> dict[str, float | None]:
            return {"loss": abs(float(self.network.weight.detach()) - self.best)}

        def conclude(self) -> None:
            self.found = (*self.found, float(self.network.weight.detach()))

    config, learner = LoopConfig(report=1, judge=2, patience=0), Concluding()
    summary = fit(learner, tmp_path, config)
    assert 0 < summary["best_iteration"] < 8 and len(learner.found) == 1
    again = Concluding()
    assert fit(again, tmp_path, config) == summary and again.found == learner.found
    assert again.found[0] == float(again.network.weight.detach()), "these are the weights that are kept"


def test_a_training_that_was_killed_at_its_first_file_goes_on(tmp_path: Path) -> None:
    left = tmp_path / ".train.json.999999999-0123456789abcdef.tmp"
    left.write_bytes(b"{")
    for _ in range(2):
        begin_folder(tmp_path, LoopConfig(), 0)
    assert [path.name for path in tmp_path.iterdir()] == ["train.json"]
    (tmp_path / "train.json").rename(tmp_path / "mine")
    with pytest.raises(BusybotError, match="it holds 'mine'"):
        begin_folder(tmp_path, LoopConfig(), 0)


def test_learning_rates() -> None:
    rising = [cosine_rate(1.0, 10, iteration, 1000) for iteration in range(10)]
    assert rising == sorted(rising) and rising[0] == pytest.approx(0.1) and rising[-1] == pytest.approx(1, abs=1e-3)
    assert cosine_rate(1.0, 10, 500, 1000) == pytest.approx(0.5) and cosine_rate(1.0, 10, 999, 1000) < 1e-5


def test_one_step_has_its_learning_rate_and_a_gradient_that_is_not_too_long() -> None:
    network = nn.Linear(2, 1)
    optimizer = torch.optim.SGD(network.parameters(), lr=1)
    before = torch.cat([value.flatten() for value in network.parameters()]).detach().clone()
    descend(optimizer, 100 * network(torch.ones(1, 2)).sum(), rate=0.5, clip=2)
    after = torch.cat([value.flatten() for value in network.parameters()]).detach()
    assert float((after - before).norm()) == pytest.approx(0.5 * 2, rel=1e-4)


@pytest.mark.parametrize(
    ("groups", "share", "held"), [(1, 0.9, 0), (2, 0.6, 1), (10, 0.25, 3), (10, 0, 0), (0, 0.5, 0)]
)
def test_one_group_stays_to_train_on(groups: int, share: float, held: int) -> None:
    assert len(groups_apart(set(range(groups)), share, 0, "test")) == held


def test_what_nobody_judged_is_neither_told_nor_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Metrics(tmp_path / "m.jsonl", "line", 0, 0, 4, 1).end(4, {})
    assert capsys.readouterr().err == ""
    loss, empty = Panel("loss", {"trained on": [(1, 0.5), (2, 0.25)]}), Panel("held out", {"held out": [(1, None)]})
    alone, both = (draw(tmp_path / f"{k}.png", rows) for k, rows in enumerate(([[loss]], [[loss], [empty]])))
    assert alone.read_bytes() == both.read_bytes()
    assert draw(tmp_path / "none.png", [[empty]]).is_file()
