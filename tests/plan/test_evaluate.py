"""Agents on tasks of procedural objects: measured, continued, recorded; and their failures' causes."""

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardCamera, BoardSpec
from busybot.boards.task import task_of
from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.datasets.verify import verify
from busybot.episodes.episode import Episode, Image, Observation, Step
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.evaluation.folder import BOARDS, RESULT
from busybot.interact.policy.policy_factory import DEFAULT_MODEL, fingerprint, load_once
from busybot.objects.resolve import find
from busybot.plan.agents import registry
from busybot.plan.agents.paper import NoopAgent
from busybot.plan.contact_proposals import LearnedProposals
from busybot.plan.evaluate import PlanEvaluation, evaluate_agents, trained_elsewhere, unmoved_links
from busybot.plan.interfaces import Act, Contact, DecisionState, Stop, TaskContext
from busybot.plan.learning import explore
from busybot.plan.learning.network import PolicyInfo, PolicyNetwork, PolicyNetworkConfig
from busybot.plan.rollout import PlanConfig, PreparedTask, RolloutRunner, check_settings
from busybot.reason.models.base import Reasoner
from busybot.reason.models.lookup import Lookup, Persistence
from busybot.sim.builtin_policies import ScriptedFactory
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import OracleObservation
from busybot.sim.recorder import record_episode
from busybot.sim.scene.appearance import Randomise
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.training.checkpoint import save_model
from tests.reach import reachable

AGENTS = ["search", "noop", "oracle"]
MODEL = "procedural"
BOARDS_CONFIG = BoardConfig(boards=2, split="novel-object", tasks="one-to-many", seed=5)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, work_here: Callable[[], AbstractContextManager[None]]) -> Dataset:
    """Two tasks with histories of 16 scripted actions."""
    path = tmp_path_factory.mktemp("tasks") / "data"
    library = find("procedural")
    found = create_dataset(path, BOARDS_CONFIG, library)
    with work_here():
        collect(found, library, CollectConfig(policy="scripted", steps=16), workers=1)
    return found


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(find("procedural"), RenderConfig())


@pytest.fixture(scope="module")
def player(simulator: Simulator) -> RolloutRunner:
    return RolloutRunner(simulator, Lookup(), load_once(MODEL))


@pytest.fixture(scope="module")
def task(simulator: Simulator, player: RolloutRunner) -> PreparedTask:
    board = next(iter(generate_boards(BOARDS_CONFIG, simulator.library)))
    return player.prepare(record_episode(simulator, board, ScriptedFactory(), 16, InteractionConfig(), 0))


def run(
    dataset: Dataset, agents: list[str] = AGENTS, boards: int | None = None, record: Path | None = None, **more: Any
) -> dict[str, Any]:
    config, library = PlanConfig(boards=boards), find("procedural")
    return evaluate_agents(PlanEvaluation(dataset, library, agents, "lookup", MODEL, config, record=record), **more)


def without_times(result: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in result.items() if key != "timing"}


@pytest.mark.long
def test_agents_are_measured_and_a_stopped_measurement_goes_on(dataset: Dataset, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    result = run(dataset, out=tmp_path / "whole", progress=lambda *two: told.append(two))
    assert read_json(tmp_path / "whole" / RESULT) == result and told == [(1, 2), (2, 2)]
    assert result["success"]["oracle"] == 1.0 and result["success"]["noop"] < result["success"]["search"]
    assert result["agents"]["noop"]["steps"] == 0 and result["agents"]["noop"]["asked"] == 0
    assert result["oracles"] == ["oracle"] and result["provenance"]["interaction"]["model"]["sha256"]
    assert sum(told["tasks"] for told in result["by_unmoved"].values()) == 2
    lines = (tmp_path / "whole" / BOARDS).read_text().splitlines(keepends=True)
    (tmp_path / "part").mkdir()
    for name, text in (("settings.json", (tmp_path / "whole" / "settings.json").read_text()), (BOARDS, lines[0])):
        (tmp_path / "part" / name).write_text(text)
    told.clear()
    again = run(dataset, out=tmp_path / "part", progress=lambda *two: told.append(two))
    assert without_times(again) == without_times(result) and told == [(2, 2)]
    with pytest.raises(BusybotError, match="names, oracles differ|names differ"):
        run(dataset, agents=["noop"], out=tmp_path / "part")


def test_links_of_the_goal_that_never_moved_are_counted(dataset: Dataset) -> None:
    history = read_episode(dataset.episode_path(0))
    goal, start = task_of(history.board).goal, history.steps[0].trigger_states_before
    wanted = {link for link, (here, there) in enumerate(zip(start, goal, strict=True)) if here != there}
    assert wanted and unmoved_links(replace(history, steps=())) == len(wanted)
    assert 0 <= unmoved_links(history) < len(wanted), "some of them moved"
    first = next(step for step in history.steps if step.trigger_states_after != step.trigger_states_before)
    [link] = [n for n, here in enumerate(start) if first.trigger_states_after[n] != here]
    assert unmoved_links(replace(history, steps=(first,))) == len(wanted - {link})


@pytest.mark.long
def test_rollouts_can_be_recorded(dataset: Dataset, tmp_path: Path) -> None:
    result = run(dataset, agents=["search", "noop"], boards=1, record=tmp_path / "rollouts")
    for name in ("search", "noop"):
        recorded = Dataset.open(tmp_path / "rollouts" / name)
        assert recorded.finished() == {0} and verify(recorded.path).ok
        episode = read_episode(recorded.episode_path(0))
        assert len(episode.steps) == result["agents"][name]["steps"] and episode.policy == name
        assert episode.goal is not None and episode.settings["decisions"][-1].startswith("stop: ")


def test_what_cannot_be_measured_is_refused(tmp_path: Path) -> None:
    library = find("procedural")
    bare = create_dataset(tmp_path / "bare", BoardConfig(boards=1), library)
    with pytest.raises(BusybotError, match="no agent 'mcts'"):
        run(bare, agents=["mcts"])
    with pytest.raises(BusybotError, match="board 0 has no task"):
        run(bare)
    tasks = create_dataset(tmp_path / "tasks", BoardConfig(boards=1, tasks="one-to-one"), library)
    with pytest.raises(BusybotError, match="no recorded interactions"):
        run(tasks)
    with pytest.raises(ValidationError, match="greater than or equal to 1"):
        PlanConfig(boards=0)


@pytest.mark.usefixtures("in_process")
def test_a_board_that_its_camera_does_not_see_is_named(dataset: Dataset, tmp_path: Path) -> None:
    copied = Dataset.open(Path(shutil.copytree(dataset.path, tmp_path / "data")))
    history = read_episode(copied.episode_path(1))
    camera = BoardCamera(position=(0, 0, 0.5), target=(0, 0, 0), fov_deg=60)
    board = history.board.model_copy(update={"camera": camera})
    copied.replace_board(board)
    write_episode(copied.episode_path(1), replace(history, board=board))
    copied.write_tables()
    with pytest.raises(BusybotError, match=r"boards-00000\.jsonl: line 2: .*its camera: the target is 0\.5 away"):
        run(copied, agents=["noop"])


def test_a_board_that_cannot_be_explored_is_named(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*given: object) -> None:
        raise BusybotError("nothing is there", "look again")

    monkeypatch.setattr(explore, "explore", fails)
    work = explore.make_work(dataset.path, find("procedural"), MODEL, explore.BoardGraphConfig(), tmp_path, 0)
    with pytest.raises(BusybotError, match=r"boards-00000\.jsonl: line 2: nothing is there") as error:
        work(1)
    assert error.value.hint == "look again"


def test_histories_that_another_camera_saw_are_refused(tmp_path: Path) -> None:
    dataset = create_dataset(tmp_path / "tasks", BoardConfig(boards=1, tasks="one-to-one"), find("procedural"))
    usual = InteractionConfig()
    check_settings(dataset, RenderConfig(width=320), usual)  # nothing is recorded
    seen = RenderConfig.model_validate({"width": 320, "camera": {"noise": 0.01, "blur": 0.8}})
    recorded = {"camera": {"blur": 0.8, "noise": 0.01}, "width": 320, "height": 480}  # some are older than a setting
    dataset.begin_collecting(CollectInfo(policy="random", steps=1, settings={"render": recorded}))
    check_settings(dataset, seen, usual)
    for other, problem in (
        (seen.model_copy(update={"width": 640}), "render.width 320, not 640\n  hint: --set render.width=320"),
        (seen.model_copy(update={"width": 640, "height": 240}), "hint: --set render.height=480 --set render.width=320"),
        (RenderConfig(width=320), r"render.camera {.*}, not {}\n  hint: --set 'render.camera={\"blur\": 0.8, "),
        (seen.model_copy(update={"randomise": Randomise(fov=0.1)}), "hint: --set 'render.randomise={}'"),
    ):
        with pytest.raises(BusybotError, match=problem):
            check_settings(dataset, other, usual)
    with pytest.raises(BusybotError, match=r"render.camera {.*}, not {}"):
        run(dataset)


def test_histories_of_other_actions_are_refused(tmp_path: Path) -> None:
    dataset = create_dataset(tmp_path / "tasks", BoardConfig(boards=1, tasks="one-to-one"), find("procedural"))
    strict = InteractionConfig(strict=True, delta=300)
    settings = {"interaction": strict.model_dump(mode="json")}
    dataset.begin_collecting(CollectInfo(policy="random", steps=1, settings=settings))
    check_settings(dataset, RenderConfig(), strict)
    what = "interaction.delta 300, not 500; interaction.strict true, not false\n"
    with pytest.raises(BusybotError, match=what + "  hint: --set explore.interaction.delta=300 --set explore.inter"):
        check_settings(dataset, RenderConfig(), InteractionConfig(), "explore.")
    with pytest.raises(BusybotError, match="interaction.strict true, not false"):
        run(dataset)


def test_search_with_the_truth_solves_what_search_may_not(player: RolloutRunner, task: PreparedTask) -> None:
    both = player.play(task, "search-true-both")
    assert both.judged.success == 1.0 and both.episode.oracle
    again = player.play(task, "search-true-both").judged
    assert again.responders == both.judged.responders and again.stopped == both.judged.stopped


class Onlooker(NoopAgent):
    """Keeps what it is given."""

    def __init__(self, given: list[object]):
        self.given = given

    def start(self, briefing: TaskContext) -> None:
        self.given.append(briefing)

    def decide(self, situation: DecisionState) -> Act | Stop:
        self.given += [situation, situation.candidates]
        return Stop("has seen enough")


def test_nothing_that_an_agent_is_given_leads_to_the_truth(player: RolloutRunner, task: PreparedTask) -> None:
    given: list[object] = []
    played = player.play(task, lambda reasoner: Onlooker(given))
    assert not played.episode.oracle and len(given) == 3
    found = list(reachable(*given))
    assert any(isinstance(one, Observation) for one in found) and any(
        isinstance(one, LearnedProposals) for one in found
    )
    secret = Episode | BoardScene | BoardSpec | OracleObservation | Step | RolloutRunner
    assert not [type(one) for one in found if isinstance(one, secret)]
    images = [one for one in found if isinstance(one, Image)]  # of the history, as reasoners have them
    assert images and all(one.segmentation is None and not one.boxes.size for one in images)


class Stranger(NoopAgent):
    """Takes hold of something of its own."""

    def __init__(self, reasoner: Reasoner):
        pass

    def decide(self, situation: DecisionState) -> Act | Stop:
        mine = situation.candidates[0]
        return Act(Contact(**{name: getattr(mine, name) for name in mine.__dataclass_fields__}), 0)


def test_only_what_was_offered_can_be_held(player: RolloutRunner, task: PreparedTask) -> None:
    with pytest.raises(BusybotError, match="was not offered"):
        player.play(task, Stranger)


class Silent(NoopAgent):
    """Forgets to answer."""

    def __init__(self, reasoner: Reasoner):
        pass

    def decide(self, situation: DecisionState) -> Act | Stop:
        return None  # type: ignore[return-value]


def test_an_answer_that_is_none_is_refused_by_the_agents_name(player: RolloutRunner, task: PreparedTask) -> None:
    with pytest.raises(BusybotError, match="agent noop answered 'None', which is neither an Act nor a Stop"):
        player.play(task, Silent)


class Stubborn(NoopAgent):
    """Takes hold of what moves least, for the first responder that differs."""

    name = "stubborn"

    def __init__(self, reasoner: Reasoner):
        pass

    def start(self, briefing: TaskContext) -> None:
        self._briefing = briefing

    def decide(self, situation: DecisionState) -> Act | Stop:
        differing = self._briefing.differing(situation.features)
        worst = min(situation.candidates, key=lambda contact: contact.score)
        return Act(worst, worst.choices[0], "out of spite", int(differing[0]))


def test_causes_of_failures(player: RolloutRunner, task: PreparedTask) -> None:
    idle = {one.cause for one in player.play(task, "noop").judged.responders if not one.reached}
    assert idle == {"not tried"}
    spite = player.play(task, Stubborn).judged
    assert spite.steps == 8 and {one.cause for one in spite.responders if not one.reached} <= {
        "physical failure", "wrong prediction", "not tried", "no candidate",
    }  # fmt: skip


def test_an_agent_may_take_as_many_actions_as_the_measurement_says(simulator: Simulator, task: PreparedTask) -> None:
    for steps in (3, 11):
        player = RolloutRunner(simulator, Lookup(), load_once(MODEL), steps=steps)
        prepared = player.prepare(task.history)
        assert prepared.briefing.steps == steps == player.play(prepared, Stubborn).judged.steps


def test_a_missing_relation_is_told(simulator: Simulator, task: PreparedTask) -> None:
    blind = RolloutRunner(simulator, Persistence(), load_once(MODEL))
    prepared = blind.prepare(task.history)
    judged = blind.play(prepared, "busybot").judged
    assert judged.steps == 0 and "known to control" in judged.stopped
    assert {one.cause for one in judged.responders if not one.reached} == {"wrong relation"}


@pytest.mark.parametrize("agent", ["noop", "predictive"])
def test_who_reads_no_graph_does_not_fail_for_what_it_lacks(
    simulator: Simulator, task: PreparedTask, agent: str
) -> None:
    blind = RolloutRunner(simulator, Persistence(), load_once(MODEL))
    judged = blind.play(blind.prepare(task.history), agent).judged
    causes = {one.cause for one in judged.responders if not one.reached}
    assert causes and "wrong relation" not in causes


def test_an_agent_that_was_told_the_relations_misses_none(
    simulator: Simulator, task: PreparedTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(registry.AGENTS, "idle", registry.AgentSpec(lambda _: NoopAgent(), relations=True))
    blind = RolloutRunner(simulator, Persistence(), load_once(MODEL))
    judged = blind.play(blind.prepare(task.history), "idle").judged
    assert {one.cause for one in judged.responders if not one.reached} == {"not tried"}


def test_an_agent_that_learned_among_other_candidates_is_told_of(tmp_path: Path) -> None:
    here = fingerprint(DEFAULT_MODEL)
    for name, known in (("same", here), ("other", here | {"name": "mine", "sha256": {"x": "0" * 64}}), ("old", None)):
        told = {} if known is None else {"model": known}
        card = PolicyInfo(agent="bc", encoder="embedded", net=PolicyNetworkConfig(), training=told)
        save_model(tmp_path / name, card, PolicyNetwork(card.net).state_dict())
        agents = ("noop", f"bc={tmp_path / name}")
        evaluation = PlanEvaluation(cast(Any, None), cast(Any, None), agents, "lookup", DEFAULT_MODEL)
        found = trained_elsewhere(evaluation)
        assert len(found) == (name == "other"), name
    assert not trained_elsewhere(replace(evaluation, agents=("noop",)))
    with pytest.raises(BusybotError, match="plays a trained policy, none was named"):
        trained_elsewhere(replace(evaluation, agents=("noop", "bc")))
