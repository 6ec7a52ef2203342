"""Networks, their trainings, and the agents that play them."""

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
import torch
from torch import Tensor

from busybot.boards.config import BoardConfig
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.datasets.info import CollectInfo
from busybot.objects.resolve import find
from busybot.plan.agents.registry import LearnedAgent, kind_of, learned, name_of
from busybot.plan.learning.bc import BcLearner, demonstrate
from busybot.plan.learning.board_graph import ExploredBoard, PracticeRollout
from busybot.plan.learning.config import BcConfig, PpoConfig
from busybot.plan.learning.encoding import OBJECTS, STOP
from busybot.plan.learning.explore import BoardGraphConfig
from busybot.plan.learning.network import (
    REMEMBERED,
    PolicyInfo,
    PolicyNetwork,
    PolicyNetworkConfig,
    Recollection,
    as_tensors,
    load_policy,
    play,
    rows_of,
)
from busybot.plan.learning.train import PracticeSource, held_apart, make_learner, train_policy
from busybot.reason.models.lookup import Persistence
from busybot.training.checkpoint import save_model
from busybot.training.loop import Learner, LoopConfig, fit
from tests.plan.practice import ACTIONS, buttons, toys, two_buttons
from tests.plan.toy import Link, World, two_buttons_and_a_lever

if TYPE_CHECKING:
    from busybot.plan.learning.ppo import PpoLearner

ROOT = Path(__file__).resolve().parents[2]
NET = PolicyNetworkConfig(looks=4, objects=8, token=16, hidden=16, choices=8)
LOOP = LoopConfig(judge=2, report=1, patience=0)
BC = BcConfig(iterations=6, batch=4, net=NET, loop=LOOP)
ATTENTIVE = BC.model_copy(update={"net": NET.model_copy(update={"memory": "attention"})})
PPO = PpoConfig(iterations=4, envs=2, steps=30, batch=30, epochs=2, shuffle=False, net=NET, loop=LOOP)
ATTENTIVE_PPO = PPO.model_copy(update={"net": ATTENTIVE.net})


def sb3_or_skip() -> None:
    pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed: `make extras`")


def ppo_learner(config: PpoConfig, boards: list[ExploredBoard]) -> "PpoLearner":
    sb3_or_skip()
    from busybot.plan.learning.ppo import PpoLearner

    return PpoLearner(config, boards, [], 0)


def network(seed: int = 0, memory: Literal["lstm", "attention"] = "lstm") -> PolicyNetwork:
    torch.manual_seed(seed)
    return PolicyNetwork(NET.model_copy(update={"memory": memory}))


def weights(of: Learner) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in of.network.state_dict().items()}


def equal(one: dict[str, Tensor], other: dict[str, Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("memory", ["lstm", "attention"])
def test_read_at_once_or_one_by_one_is_the_same_whatever_stands_beside(memory: Literal["lstm", "attention"]) -> None:
    rng, net = generator(0, "", 0, "test"), network(memory=memory)
    rows = [demonstrate(board, None, rng)[0] for board in toys(3)]
    rows[1] = {name: value[:4] for name, value in rows[1].items()}
    seen, lengths = rows_of(rows)
    together, _ = net.read(seen, lengths)
    for place, row in enumerate(rows):
        state = None
        for step in range(len(row["allowed"])):
            one, once = rows_of([{name: value[step : step + 1] for name, value in row.items()}])
            hidden, state = net.read(one, once, state)
            zero = torch.tensor([0])
            alone, beside = hidden.at(zero, zero), together.at(torch.tensor([step]), torch.tensor([place]))
            assert torch.allclose(alone, beside, atol=1e-6)


def test_what_is_no_choice_is_never_chosen() -> None:
    seen = as_tensors(PracticeRollout(toys(1)[0]).observation())
    chances = network().scores(torch.randn(16, generator=torch.Generator().manual_seed(0)), seen).softmax(dim=0)
    assert (chances[seen["allowed"] == 0] == 0).all() and (chances[seen["allowed"] == 1] > 0).all()
    assert (seen["allowed"] == 1).sum() == 7


def test_demonstrations_with_noise_hold_mistakes_and_what_would_have_been_right() -> None:
    board, rng = toys(1)[0], generator(0, "", 0, "test")
    lengths = [len(demonstrate(board, None, rng, noise)[1]) for noise in (0, 0, 0.5, 0.5, 0.5)]
    assert lengths[:2] == [4, 4] and max(lengths[2:]) > 4
    for _, right in (demonstrate(board, None, rng, 0.5) for _ in range(5)):
        assert right.any(axis=1).all()


def test_with_attention_a_choice_finds_what_the_same_action_did() -> None:
    """With weights by which what is near counts: at its place a choice reads that all changed, elsewhere nothing."""
    net = network(memory="attention")
    memory, seen = net.recollection, as_tensors(PracticeRollout(toys(1)[0]).observation())
    assert memory is not None
    with torch.no_grad():
        for layer in (memory.pairs[0], memory.pairs[2], memory.objects[0]):
            layer.weight.zero_()
            layer.bias.zero_()
        memory.pairs[0].weight[0, 3] = 100  # how far
        memory.pairs[2].weight[:, 0] = -1
        memory.objects[0].weight[0, 0] = 1  # the first head's share of change
    kept = torch.zeros(REMEMBERED, Recollection.width(NET))
    assert (found_in(net, kept, seen) == 0).all(), "there was nothing yet"
    places = seen["choices"][:, :3]
    other = int((places - places[1]).norm(dim=1)[:7].argmax())
    for row, choice, changed in ((-1, 1, 1.0), (-2, other, 0.0)):
        kept[row, :3], kept[row, 6:8] = places[choice], 1
        kept[row, 8 + OBJECTS : 8 + 2 * OBJECTS] = changed
    found = found_in(net, kept, seen)
    assert float(found[1]) == pytest.approx(1) and float(found[other]) == pytest.approx(0)


def found_in(net: PolicyNetwork, kept: Tensor, seen: dict[str, Tensor]) -> Tensor:
    """How much had changed, as every choice finds it."""
    assert net.recollection is not None
    return net.recollection(kept, seen, net.looks(seen["looks"]), net.looks(seen["goal"]))[:, 0].detach()


def test_what_is_long_ago_is_forgotten() -> None:
    net, board = network(memory="attention"), toys(1)[0]
    row = demonstrate(board, None, generator(0, "", 0, "test"))[0]
    long = {name: np.concatenate([value[:1]] * (REMEMBERED - 1) + [value]) for name, value in row.items()}
    _, state = net.read(*rows_of([long]))
    again = {name: np.concatenate([value[-1:], value]) for name, value in long.items()}
    _, other = net.read(*rows_of([again]))
    assert state[2].shape[0] == REMEMBERED and torch.equal(state[2], other[2])


def test_cards_and_trainings_without_a_choice_of_memory_are_as_they_were() -> None:
    assert "memory" not in BC.model_dump()["net"] and ATTENTIVE.model_dump()["net"]["memory"] == "attention"
    assert BcConfig.model_validate(ATTENTIVE.model_dump()) == ATTENTIVE


@pytest.mark.parametrize("memory", ["lstm", "attention"])
def test_bc_learns_to_reach_goals_and_plays_as_it_learned(memory: Literal["lstm", "attention"]) -> None:
    boards = buttons(([0, 1],))
    net = PolicyNetworkConfig(looks=8, objects=16, token=32, hidden=32, choices=32, memory=memory)
    config = BcConfig(iterations=80, batch=8, learning_rate=1e-2, shuffle=False, net=net)
    student = BcLearner(config, boards, [], 0)
    losses = [student.iterate(iteration)[0] for iteration in range(config.iterations)]
    assert np.mean(losses[-5:]) < 0.3 * np.mean(losses[:5])
    assert play(student.network, boards).tolist() == [1]
    world = two_buttons()
    acts, stop = world.play(LearnedAgent("bc", student.network.eval()), boards[0].briefing)
    assert world.states() == [0, 1] and stop is not None and "chosen with" in stop.why
    assert len(acts) == 1 and "%" in acts[0].why


@pytest.mark.parametrize(
    "config", [BC, ATTENTIVE, PPO, ATTENTIVE_PPO], ids=["bc", "bc-attention", "ppo", "ppo-attention"]
)
def test_killed_and_continued_it_ends_in_the_same_weights(tmp_path: Path, config: BcConfig | PpoConfig) -> None:
    if isinstance(config, PpoConfig):
        sb3_or_skip()
    boards = toys(4)
    whole, killed, resumed = (make_learner(config, boards[:3], boards[3:], 0) for _ in range(3))
    fit(whole, tmp_path / "whole", config.loop)
    iterate = killed.iterate

    def dies(iteration: int) -> tuple[float, float]:
        if iteration == 3:
            raise KeyboardInterrupt
        return iterate(iteration)

    killed.iterate = dies  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        fit(killed, tmp_path / "killed", config.loop)
    figures = fit(resumed, tmp_path / "killed", config.loop)
    assert figures["iterations"] == config.iterations
    assert equal(weights(whole), weights(resumed))
    assert resumed.budget.seconds > 0
    lines = (tmp_path / "killed" / "metrics" / f"{config.agent}.jsonl").read_text()
    assert lines == (tmp_path / "whole" / "metrics" / f"{config.agent}.jsonl").read_text()
    assert 0 <= json.loads(lines.splitlines()[-1])["validation"]["success"] <= 1


def test_no_more_boards_are_trained_on_than_asked_for() -> None:
    found = toys(4)
    everything, held_out = held_apart(found, LoopConfig(held_out=0.25), 0)
    some, others = held_apart(found, LoopConfig(held_out=0.25, boards=2), 0)
    assert (len(everything), len(held_out), len(some)) == (3, 1, 2)
    assert some == [everything[0], everything[1]] and others == held_out
    fewer, _ = held_apart(found * 2, LoopConfig(held_out=0.25, boards=2), 0)
    assert fewer == [everything[0], everything[0]], "one of each half, as datasets follow each other"


def test_what_cannot_be_practised_on_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    library, out = find("procedural"), tmp_path / "out"
    paper, time = BoardConfig(boards=1, tasks="one-to-one"), BoardConfig(boards=1, world="time", tasks="reach")
    large = BoardConfig(boards=1, world="gates", tasks="reach", links=(9, 12))
    told = ("paper", paper), ("time", time), ("large", large)
    data = {name: create_dataset(tmp_path / name, of, library) for name, of in told}

    def refused(name: str, problem: str, explore: dict[str, Any] | None = None) -> None:
        config = BC.model_copy(update={"explore": BoardGraphConfig.model_validate(explore or {})})
        with pytest.raises(BusybotError, match=problem):
            train_policy(out, config, PracticeSource((data[name].path,), "procedural"), 0, 1, None)  # type: ignore[arg-type]
        assert not out.exists()

    refused("time", "of the world 'time', which cannot be explored")
    refused("large", r"large: board 0 has 1\d objects\n  hint: learned agents see 10 at most")
    refused("paper", "learned.explore changes nothing where somebody else chooses", {"learned": {"explore": 0.3}})
    refused("paper", "parameter explor of the learned policy", {"learned": {"explor": 0.3}})
    for render, problem in (({"width": 320}, "render.width 320, not 640"), ({"camera": {"blur": 0.8}}, "real camera")):
        data["paper"].begin_collecting(CollectInfo(policy="random", steps=1, settings={"render": render}))
        refused("paper", problem)


def test_the_learning_rate_falls_to_zero() -> None:
    config = BcConfig(iterations=4, learning_rate=2.0)
    assert [config.rate(iteration) for iteration in range(4)] == [2, 1.5, 1, 0.5]


def test_a_training_ends_when_its_time_is_spent(tmp_path: Path) -> None:
    student = BcLearner(BC.model_copy(update={"minutes": 1e-6}), toys(2), [], 0)
    assert fit(student, tmp_path, LOOP)["iterations"] == 1


@pytest.mark.parametrize("config", [PPO, ATTENTIVE_PPO], ids=["lstm", "attention"])
def test_ppo_plays_the_same_after_its_export(tmp_path: Path, config: PpoConfig) -> None:
    student = ppo_learner(config, toys(4))
    student.iterate(0)
    save_model(tmp_path, PolicyInfo(agent="ppo", encoder="embedded", net=config.net), student.policy.state_dict())
    alone = load_policy(tmp_path, "ppo")[1]
    row = demonstrate(toys(1)[0], None, generator(0, "", 0, "test"))[0]
    seen, lengths = rows_of([row])
    every = torch.arange(len(row["allowed"]))
    scores = alone.scores(alone.read(seen, lengths)[0].at(every, torch.zeros_like(every)), as_tensors(row))
    theirs, _ = heard(student, [row], torch.ones(1))
    assert torch.allclose(scores.softmax(dim=1), theirs[0], atol=1e-6)


@pytest.mark.parametrize("config", [PPO, ATTENTIVE_PPO], ids=["lstm", "attention"])
def test_ppo_reads_on_from_what_was_kept_and_forgets_where_an_episode_starts(config: PpoConfig) -> None:
    """Whole rows at once, or cut in the middle: as RecurrentPPO collects step by step and learns from pieces."""
    student = ppo_learner(config, toys(4))
    rows = [demonstrate(board, None, generator(0, "", 0, "test"))[0] for board in toys(2)]
    end = min(len(row["allowed"]) for row in rows)
    whole, first, last = (
        [{name: value[part] for name, value in row.items()} for row in rows]
        for part in (slice(end), slice(end - 2), slice(end - 2, end))
    )
    at_once, _ = heard(student, whole, torch.ones(2))
    before, state = heard(student, first, torch.ones(2))
    after, _ = heard(student, last, torch.zeros(2), state)
    assert torch.allclose(torch.cat([before, after], dim=1), at_once, atol=1e-6)
    anew, _ = heard(student, last, torch.ones(2))
    forgotten, _ = heard(student, last, torch.ones(2), state)
    assert torch.equal(forgotten, anew) and not torch.allclose(anew, after, atol=1e-6)


def heard(
    student: "PpoLearner", rows: list[dict[str, np.ndarray]], starts: Tensor, state: tuple[Tensor, ...] | None = None
) -> tuple[Tensor, tuple[Tensor, ...]]:
    """Chances of all choices (B, L, 25) as sb3 hears them, and the state afterwards, of B rows of L observations."""
    policy, length = student._model.policy, len(rows[0]["allowed"])
    seen = as_tensors({name: np.concatenate([row[name] for row in rows]) for name in rows[0]})
    size = policy.lstm_actor.hidden_size
    state = state or (torch.zeros(1, len(rows), size), torch.zeros(1, len(rows), size))
    begins = torch.zeros(len(rows), length)
    begins[:, 0] = starts
    with torch.no_grad():
        distribution, after = policy.get_distribution(seen, state, begins.flatten())
    return distribution.distribution.probs.unflatten(0, (len(rows), length)), after


@pytest.mark.long
def test_ppo_earns_more_with_practice() -> None:
    sizes = {
        "iterations": 15,
        "envs": 8,
        "steps": 48,
        "batch": 96,
        "epochs": 4,
        "learning_rate": 1e-2,
        "shuffle": False,
    }
    boards = buttons(([1, 1],))
    student = ppo_learner(PPO.model_copy(update=sizes), boards)
    for iteration in range(15):
        student.iterate(iteration)
    assert play(student.policy, boards).tolist() == [1]


@pytest.mark.long
def test_without_sb3_ppo_says_what_is_missing_and_bc_needs_none(tmp_path: Path) -> None:
    """In a process that cannot import sb3-contrib."""
    code = f"""
import sys
sys.modules["sb3_contrib"] = sys.modules["stable_baselines3"] = None
from pathlib import Path
from busybot.common.errors import BusybotError
from busybot.plan.learning.train import PracticeSource, make_learner, train_policy
from tests.plan.test_learned_agents import BC, PPO, toys
make_learner(BC, toys(1), [], 0).iterate(0)
try:
    train_policy(Path({str(tmp_path / "out")!r}), PPO, PracticeSource((), "procedural"), 0, 1, None)
except BusybotError as error:
    print(error)
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True).stdout
    assert "sb3-contrib is not installed" in told and not (tmp_path / "out").exists()


class Watched(PolicyNetwork):
    """Remembers what it reads."""

    def __init__(self) -> None:
        super().__init__(NET)
        self.seen: list[dict[str, Tensor]] = []

    def read(self, seen, lengths, state=None):  # type: ignore[no-untyped-def]
        self.seen.append(seen)
        return super().read(seen, lengths, state)


def test_an_agent_sees_on_a_board_what_it_saw_in_training() -> None:
    torch.manual_seed(0)
    world, net = two_buttons_and_a_lever(), Watched()
    acts, _ = world.play(LearnedAgent("bc", net), world.briefing(ACTIONS, [1, 0, 2]))
    practised = PracticeRollout(toys(1)[0])
    expected = [as_tensors(practised.history())]
    choices = {
        (number, one): 1 + 2 * number + k for number in range(3) for k, one in enumerate(world.contact(number).choices)
    }
    places = [link.pixel for link in world.links]
    for act in acts:
        expected.append({name: value[None] for name, value in as_tensors(practised.observation()).items()})
        practised.act(choices[places.index(act.contact.pixel), act.direction])
    assert len(acts) > 1 and len(net.seen) >= len(expected)
    for theirs, ours in zip(net.seen, expected, strict=False):
        for name, value in ours.items():
            assert torch.allclose(theirs[name][:, 0], value, atol=2e-3), name


def test_an_agent_that_cannot_go_on_says_so() -> None:
    nothing = World([], 1, 1)
    _, stop = nothing.play(LearnedAgent("bc", network()), nothing.briefing([], []))
    assert stop is not None and "no candidate" in stop.why
    crowd = World([Link(0, 1, (10, 10))], 1, 10)
    _, stop = crowd.play(LearnedAgent("bc", network()), crowd.briefing([(0, 0)], [1]))
    assert stop is not None and "more than 10 objects" in stop.why


def test_agents_are_named_with_their_models(tmp_path: Path) -> None:
    save_model(tmp_path / "a", PolicyInfo(agent="bc", encoder="embedded", net=NET), network().state_dict())
    make = kind_of(f"bc={tmp_path / 'a'}").make
    assert make is not None and make(Persistence()).name == "bc" and name_of("bc=runs/bc") == "bc"
    for agent, problem in (
        ("bc", "none was named"),
        (f"ppo={tmp_path / 'a'}", "a policy of agent bc"),
        (f"bc={tmp_path / 'b'}", "no model of that name"),
        ("search=x", "no agent 'search=x'"),
    ):
        with pytest.raises(BusybotError, match=problem):
            kind_of(agent)


def test_a_policy_of_other_features_is_refused(tmp_path: Path) -> None:
    save_model(tmp_path, PolicyInfo(agent="bc", encoder="random", net=NET), network().state_dict())
    with pytest.raises(BusybotError, match="reads features of random"):
        learned("bc", str(tmp_path), Persistence())
    (tmp_path / "weights.safetensors").write_bytes(b"x")
    load_policy.cache_clear()
    with pytest.raises(BusybotError, match="weights.safetensors: its SHA-256 is"):
        load_policy(tmp_path, "bc")


def test_a_policy_stops_where_it_prefers_to() -> None:
    net = network()
    with torch.no_grad():
        net.stop[2].bias.fill_(1e3)
    assert play(net, toys(2)).tolist() == [float(board.graph.success[0]) for board in toys(2)]
    assert STOP == 0
