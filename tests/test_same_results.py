"""The comparison of two checkouts finds what differs, and its commands are ones that `busybot` understands."""

import copy
import math
import shlex
from pathlib import Path
from typing import Any

import pytest

from benchmarks.reliability import same_results_cases as cases
from benchmarks.reliability.same_results import Runner, weights
from benchmarks.reliability.same_results_cases import FAILED, ROUNDING, compare, tell
from busybot.cli.main import load_command

FACTS: dict[str, Any] = {
    "eval/plan": {"success": {"search": 0.9}, "tasks": 2, "timing": {"search": 3.0}},
    "straight/reason-event": {"weights": {"net": {"largest": 2.0, "sample": [0.001, 2.0], "shape": [2]}}},
    "old model/reason-event": {"ece": 0.125},
    "other/tiny, regenerate": {"failed": {}, "ok": True},
    "straight/bc": {"weights": {"weights.safetensors": "ab"}, "budget": {"rollouts": 4}},
    "continued/bc": {"weights": {"weights.safetensors": "ab"}, "budget": {"rollouts": 6}},
}


def changed(case: str, *place: str | int, to: object) -> dict[str, Any]:
    """The facts with another value at a place."""
    facts = copy.deepcopy(FACTS)
    inner: Any = facts[case]
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = to
    return facts


def test_what_is_the_same_passes_whatever_time_it_took() -> None:
    assert compare(FACTS, changed("eval/plan", "timing", to={})) == 0
    lost = changed("old model/reason-event", "ece", to=math.nan)
    assert compare(lost, copy.deepcopy(lost)) == 0, "neither is a number"


@pytest.mark.parametrize(
    "other",
    [
        changed("eval/plan", "success", "search", to=0.9000000000000001),
        changed("eval/plan", "tasks", to=2.0),
        changed("eval/plan", "figure", to=1),
        changed("old model/reason-event", "ece", to=0.12500000001),
        changed("old model/reason-event", "ece", to=math.nan),
        changed("straight/reason-event", "weights", "net", "shape", to=[3]),
        changed(
            "straight/reason-event", "weights", "net", to={"largest": math.nan, "sample": [math.nan] * 2, "shape": [2]}
        ),
        {name: facts for name, facts in FACTS.items() if name != "eval/plan"},
        FACTS | {"eval/plan": {FAILED: "exit 1"}},
    ],
)
def test_any_difference_is_found(other: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert compare(FACTS, other) > 0 and compare(other, FACTS) > 0
    assert len(capsys.readouterr().out.splitlines()) > 2


def test_what_is_meant_to_differ_is_told_and_not_counted(capsys: pytest.CaptureFixture[str]) -> None:
    (case,) = cases.MEANT
    first, second = FACTS | {case: {"gates": []}}, FACTS | {case: {FAILED: "exit 1"}}
    assert compare(first, second) == 0 and f"{case}: differs, as it should" in capsys.readouterr().out
    assert compare(first, first) == 0 and case not in capsys.readouterr().out


def test_interrupted_work_must_end_as_uninterrupted_work(capsys: pytest.CaptureFixture[str]) -> None:
    other = changed("continued/bc", "weights", "weights.safetensors", to="cd")
    assert compare(other, other) == 2 and "continued/bc: .weights.weights.safetensors" in capsys.readouterr().out


def test_weights_of_graph_networks_may_round_relative_to_their_tensor(capsys: pytest.CaptureFixture[str]) -> None:
    case = "straight/reason-event"
    for by, wrong in ((0.9 * ROUNDING, 0), (1.1 * ROUNDING, 1)):
        other = changed(case, "weights", "net", "sample", 0, to=0.001 + 2.0 * by)
        assert tell(case, FACTS[case], other[case]) == wrong
        assert f"the most by {by:.1e}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("case", "tensor", "to", "wrong"),
    [
        ("straight/reason-event", "effects.attend.bias", {"largest": 0.5, "sample": [0.5, -0.25], "shape": [2]}, 0),
        ("continued/reason-event", "effects.attend.bias", {"largest": 0.5, "sample": [0.5, -0.25], "shape": [2]}, 0),
        ("straight/reason-event", "effects.attend.bias", {"largest": 0.5, "sample": [0.5, -0.25], "shape": [3]}, 1),
        ("straight/reason-event", "effects.attend.bias", {"largest": 0.5, "sample": [0.5], "shape": [2]}, 1),
        ("straight/reason-event", "effects.attend.weight", {"largest": 0.5, "sample": [0.5, -0.25], "shape": [2]}, 3),
        ("straight/reason-event", "other.effects.attend.bias", {"largest": 0.5, "sample": [0, 0.1], "shape": [2]}, 3),
        ("straight/reason-paper", "effects.attend.bias", {"largest": 0.5, "sample": [0.5, -0.25], "shape": [2]}, 3),
        ("old model/reason-event", "effects.attend.bias", {"largest": 0.5, "sample": [0.5, -0.25], "shape": [2]}, 3),
    ],
)
def test_only_what_a_softmax_ignores_may_be_any_number(case: str, tensor: str, to: dict[str, Any], wrong: int) -> None:
    first = {"largest": 4e-4, "sample": [4e-4, 1e-7], "shape": [2]}
    facts = [{"weights": {"weights.safetensors": {tensor: one}}} for one in (first, to)]
    assert tell(case, *facts) == wrong


def test_shipped_weights_are_hashed_or_sampled() -> None:
    folder = next(Path(cases.__file__).parents[2].glob("busybot/**/event/weights.safetensors")).parent
    assert len(weights(folder, rounded=False)["weights.safetensors"]) == 64
    sampled = weights(folder, rounded=True)["weights.safetensors"]
    assert len(sampled) > 10
    assert all(max(map(abs, one["sample"])) <= one["largest"] for one in sampled.values())


COMMANDS = [
    *(f"generate out {options}" for options in cases.BOARDS.values()),
    *(f"generate out {generate}" for generate, _ in cases.DATASETS.values()),
    *(f"collect out {collect}" for _, collect in cases.DATASETS.values()),
    *(f"eval {command}" for command in cases.EVALUATIONS.values()),
    *(command for work in cases.WORKS.values() for command in (work.command, work.judged) if command),
    *cases.OTHERS.values(),
]


def test_all_commands_exist_with_their_options() -> None:
    for text in COMMANDS:
        name, *words = shlex.split(text)
        command = load_command(name)
        if hasattr(command, "commands"):
            command, words = command.commands[words[0]], words[1:]
        command.make_context(name, [*words, "--json"])  # refuses an option that is not there


def test_datasets_are_made_where_they_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ran: list[tuple[str, ...]] = []
    monkeypatch.setattr(Runner, "busybot", lambda self, *words: ran.append(words))
    runner = Runner(tmp_path, tmp_path, Path("objects"))
    for _ in range(2):
        assert runner.words("eval plan 'data/real, tasks' {out}", out="here") == [
            "eval",
            "plan",
            "data/real, tasks",
            "here",
        ]
    assert [words[:2] for words in ran] == [("generate", "data/real, tasks"), ("collect", "data/real, tasks")]
    assert "objects" in ran[0] and ran[1][-2:] == ("--workers", "1")
