"""`busybot train bc` and `ppo`, as a user runs them, and what is practised beside what happens in the simulator."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import candidates_config, load_once
from busybot.objects.resolve import find
from busybot.plan.interfaces import Act, DecisionState, Stop, TaskContext
from busybot.plan.learning.board_graph import ExploredBoard, load_explored
from busybot.plan.learning.encoding import STOP, offer
from busybot.plan.rollout import RolloutRunner
from busybot.reason.models.lookup import Persistence
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

pytestmark = pytest.mark.usefixtures("in_process")

QUICK = ("iterations=4", "batch=4", "loop.judge=2", "net.hidden=16", "net.token=16")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)])


def training(agent: str, data: Path, out: Path, *more: object) -> list[object]:
    settings = [word for setting in QUICK for word in ("--set", setting)]
    return ["train", agent, "--data", data, "--out", out, "--workers", 1, *settings, *more]


def tasks(data: Path, split: str = "train", world: str = "paper") -> Path:
    kind = "one-to-many" if world == "paper" else "reach"
    assert run("generate", data, "--tasks", kind, "--world", world, "--boards", 1, "--split", split).exit_code == 0
    return data


def follow(data: Path, board: ExploredBoard) -> None:
    """What was explored is what happens."""
    follower, model = Follower(board), load_once("procedural")
    simulator = Simulator(find("procedural"), RenderConfig())
    player = RolloutRunner(simulator, Persistence(), model, candidates_config(model.info, {}))
    played = player.play(player.prepare(read_episode(Dataset.open(data).episode_path(0))), lambda _: follower)
    assert follower.checked > 0 and len(played.episode.steps) == follower.checked
    assert played.judged.success == pytest.approx(float(board.graph.success[follower.state]))


class Follower:
    """Does what is right on an explored board, and checks that the board is as it was explored."""

    name = "follower"

    def __init__(self, board: ExploredBoard):
        self.graph, self.state, self.checked = board.graph, 0, 0

    def start(self, briefing: TaskContext) -> None:
        pass

    def decide(self, situation: DecisionState) -> Act | Stop:
        offered, choices = offer(situation.candidates)
        assert np.allclose(situation.features, self.graph.looks[self.state], atol=1e-2)
        if not self.state:
            assert np.array_equal(offered.facts, self.graph.facts[0])
        chosen = int(np.flatnonzero(self.graph.right[self.state])[-1])
        if chosen == STOP or not np.allclose(offered.facts[chosen], self.graph.facts[self.state, chosen], atol=0.1):
            return Stop("done")
        self.state, self.checked = int(self.graph.leads[self.state, chosen]), self.checked + 1
        return Act(*choices[chosen - 1])


@pytest.mark.long
def test_from_tasks_to_an_agent_that_is_measured(tmp_path: Path) -> None:
    data, out = tasks(tmp_path / "data"), tmp_path / "bc"
    assert run("collect", data, "--policy", "scripted", "--steps", 8, "--workers", 1).exit_code == 0
    result = run(*training("bc", data, out, "--json"))
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["training"]["boards"] == 1 and told["budget"]["states_explored"] > 3
    assert told["budget"]["minutes_allowed"] == 45 and told["budget"]["rollouts"] == 16
    assert (out / "training.png").read_bytes().startswith(b"\x89PNG")
    assert run(*training("bc", data, out)).exit_code == 0  # nothing is left to do
    refused = run(*training("bc", data, out), "--seed", 1)
    assert refused.exit_code == 1 and "seed 0, now 1" in refused.stderr
    measured = run("eval", "plan", data, "--agents", f"noop,bc={out}", "--workers", 1, "--json")
    assert measured.exit_code == 0, measured.output
    values = json.loads(measured.stdout)
    assert set(values["success"]) == {"noop", "bc"} and values["provenance"]["agents"]["bc"]["sha256"]

    follow(data, load_explored(out / "boards" / "00-000000.safetensors"))


@pytest.mark.long
@pytest.mark.parametrize("world", ["gates", "lock"])
def test_in_worlds_without_a_past_boards_are_practised_on(world: str, tmp_path: Path) -> None:
    data, out = tasks(tmp_path / "data", world=world), tmp_path / "bc"
    assert run("collect", data, "--policy", "scripted", "--steps", 8, "--workers", 1).exit_code == 0
    assert run(*training("bc", data, out)).exit_code == 0
    board = load_explored(out / "boards" / "00-000000.safetensors")
    assert board.graph.success.max() > board.graph.success[0]
    follow(data, board)


def test_only_training_boards_with_tasks_are_trained_on(tmp_path: Path) -> None:
    novel = tasks(tmp_path / "novel", "novel-config")
    result = run(*training("bc", novel, tmp_path / "out", "--json"))
    assert result.exit_code == 1 and "training boards only" in json.loads(result.stdout)["error"]
    assert run("generate", tmp_path / "bare", "--boards", 1).exit_code == 0
    result = run(*training("bc", tmp_path / "bare", tmp_path / "out", "--json"))
    assert result.exit_code == 1 and "no tasks" in json.loads(result.stdout)["error"]
    result = run(*training("bc", tasks(tmp_path / "tasks"), tmp_path / "out", "--json"))
    assert result.exit_code == 1 and "collect" in json.loads(result.stdout)["hint"]
    assert not (tmp_path / "out").exists()


def test_without_the_extra_ppo_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    result = run("train", "ppo", "--data", tmp_path, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 1 and "'.[baselines]'" in json.loads(result.stdout)["hint"]
