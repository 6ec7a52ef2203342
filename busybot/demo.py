"""`busybot demo`: the whole way from objects to an inferred scene graph, small enough to watch.

Procedural objects become boards, a policy that learned where and how to act records interactions with them, recordings
become relations, relations lead to a goal, and a report shows each of them.

The demo's report: one board's story in Markdown, with the figures beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.boards.task import least_steps, start_states, task_of
from busybot.common.atomic_io import make_folder, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import DatasetInfo
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory, load_once, policy_config
from busybot.interact.policy.policy_trace import PolicyTrace, retrace
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.plan.agent_policy import reason
from busybot.plan.evaluate import PlanEvaluation, evaluate_agents
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset
from busybot.reason.evaluation.prediction import inferred_over_time
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.registry import DEFAULT_REASONER
from busybot.sim.collect import CollectConfig, collect
from busybot.view.annotations import judged_edges, named, object_names
from busybot.view.figures import episode as figures
from busybot.view.figures.affordance import affordance_figure
from busybot.view.figures.sequences import sequence_figure
from busybot.view.report.page import Block, Grid, Heading, Items, Picture, Text, markdown, number, plain_grid
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.viewer_process import save_screenshot

TITLE = "A switch, a lamp, and what connects them"
KINDS = {
    "one-to-one": "one switch, one effect",
    "one-to-many-effects": "a lever with three positions, one effect for each",
    "one-to-many-objects": "a panel, one effect for each of its buttons",
}
REASONERS = {
    "event": "The model `event` sees the pictures, the objects' boxes and roles, and the actions. It never sees the "
    "simulator's relations or states. It compares how each responder looks before and after every action, and learned "
    "on other boards what that tells about which trigger controls it.",
}
"""How the graph was inferred, by the reasoner's name."""
MORE = "```sh\nbusybot generate more --boards 100 && busybot collect more && busybot eval reason more\n```"
MEANING = (
    "Edge-P is the share of the claimed relations that are true, Edge-R the share of the true relations that were "
    "claimed, Edge-Acc the share of all pairs of a trigger and a responder that were judged rightly. The empty graph "
    "claims no relation, the all-ones graph every pair, and the random trigger one trigger, drawn by chance, for each "
    "responder."
)


@dataclass(frozen=True)
class Story:
    """What the report tells.

    Attributes:
        chosen: index of the episode that is shown in detail.
        result: of `reason.evaluation.evaluate.evaluate_dataset`.
        pictures: by name.
        early: the step of the early picture of the viewer.
        rollout: of the agent that reaches for a goal.
        planned: what `plan.evaluate.evaluate_agents` tells of this agent.
    """

    episodes: list[Episode]
    chosen: int
    inferred: InferredGraph
    result: dict[str, Any]
    info: DatasetInfo
    recording: Path
    pictures: dict[str, Path]
    early: int
    rollout: Episode
    planned: dict[str, Any]

    @property
    def episode(self) -> Episode:
        """The one that is shown."""
        return self.episodes[self.chosen]

    def picture(self, name: str, caption: str) -> Picture:
        """One of the pictures."""
        return Picture(self.pictures[name], caption)


def demo_report(story: Story, folder: Path) -> str:
    """The report's text; links are relative to `folder`."""
    parts = (_boards, _actions, _relations, _refinement, _numbers, _goal)
    blocks = [block for part in parts for block in part(story)]
    return markdown([Heading(TITLE, 1), *blocks, *_next(story, folder)], folder)


def _boards(story: Story) -> list[Block]:
    return [
        Heading("The boards"),
        Text(
            "A BusyBoard carries triggers (switches, levers, panels) and responders (lamps, doors, toys). Hidden "
            f"relations connect them. These {len(story.episodes)} were drawn with seed {story.info.seed} from "
            f"{story.info.assets.name} objects."
        ),
        story.picture("boards", f"The boards before anybody acts; board {story.chosen}, told of below, with names."),
    ]


def _actions(story: Story) -> list[Block]:
    moved = sum(step.success for step in story.episode.steps)
    delta = story.episode.settings.get("interaction", {}).get("delta", 500)
    return [
        Heading("Acting"),
        Text(
            "Where can something be moved, and in which direction? The policy learned it from depth images and from "
            "pixels that change, without labels, and has not seen these boards before. It chooses at random among what "
            "looks movable, first what it has not tried: a point to take hold of and one of 18 directions. On board "
            f"{story.chosen} it acted {len(story.episode.steps)} times and moved a trigger {moved} times. The reward "
            f"is 1 when more than {delta} pixels change."
        ),
        story.picture("affordance", "What the policy believed before its first actions: affordance in orange."),
        story.picture("episode", "Some actions and what they changed."),
        story.picture("changes", "Changed pixels of every action, and the threshold of the reward."),
    ]


def _relations(story: Story) -> list[Block]:
    return [
        Heading("What controls what"),
        Text(REASONERS[story.inferred.name]),
        story.picture("graph", "The inferred scene graph over the board."),
        _relation_grid(story),
    ]


def _relation_grid(story: Story) -> Grid:
    board, inferred = story.episode.board, story.inferred
    names, steps = object_names(board), len(inferred.probabilities)
    kinds = {(ref.object, one.responder): one.kind for one in board.relations for ref in one.triggers}
    probabilities = inferred.after(steps)
    rows = []
    for edge in judged_edges(board, inferred, steps):
        pair = (edge.cause, edge.effect)
        kind = KINDS.get(kinds.get(pair, ""), "")
        rows.append((names[edge.cause], (names[edge.effect], f"{probabilities[pair]:.3f}", edge.verdict, kind)))
    return plain_grid(("responder", "probability", "verdict", "kind"), rows, "trigger")


def _refinement(story: Story) -> list[Block]:
    end = len(story.inferred.probabilities)
    return [
        Heading("How certainty grows"),
        story.picture("refinement", "Probabilities after more and more steps; true relations are framed."),
        Text(f"The viewer after {story.early} steps, and at the end:"),
        story.picture(f"viewer_{story.early}", f"Rerun after {story.early} steps."),
        story.picture(f"viewer_{end}", "Rerun at the end."),
    ]


def _numbers(story: Story) -> list[Block]:
    result = story.result
    baselines = {name.replace("_", " "): values for name, values in result["baselines"].items()}
    judged = {"the model that comes with busybot": result, **baselines}
    keys = {"edge_p": "Edge-P", "edge_r": "Edge-R", "edge_acc": "Edge-Acc"}
    rows = [(name, [_percent(values[key]) for key in keys]) for name, values in judged.items()]
    return [
        Heading("The numbers"),
        Text(
            f"Over all {result['boards']} boards, from their first {result['images']} images; percent. Four boards are "
            "a picture, not a result. More of them:"
        ),
        Text(MORE),
        Text(MEANING),
        plain_grid(tuple(keys.values()), rows),
        Text(
            f"Relations whose effect was visible at all: {_percent(result['edge_r_bound'])} %. Of the "
            f"{result['predicted_steps']} later steps, all responders looked as predicted after "
            f"{_percent(result['pred_a'])} %; whoever predicts no change: "
            f"{_percent(result['persistence']['pred_a'])} %."
        ),
    ]


def _percent(share: float | None) -> str:
    return "-" if share is None else number(100 * share)


def _goal(story: Story) -> list[Block]:
    rollout = story.rollout
    said = [named(rollout.board, reason(rollout, step)) for step in range(len(rollout.steps) + 1)]
    return [
        Heading("Reaching a goal"),
        Text(
            "Another board comes with a picture of a goal. The policy acts on it as on the others; from what that "
            f"changed, `{rollout.policy}` knows which trigger to move, and which way. It compares the board with the "
            "goal after every action, and stops when nothing differs. At the end "
            f"{_percent(story.planned['success'])} % of the responders that some trigger controls were in their goal "
            "state."
        ),
        story.picture("sequence", "From the start, action by action, to the goal at the right."),
        Text("What it said:"),
        Text("\n".join(f"{count}. {words}" for count, words in enumerate(filter(None, said), start=1))),
    ]


def _next(story: Story, folder: Path) -> list[Block]:
    recording, hashes = story.recording.relative_to(folder).as_posix(), story.result["dataset"]
    board, trace, content = (hashes[f"{name}_hash"][:16] for name in ("board", "trace", "content"))
    return [
        Heading("Look further"),
        Items(
            (
                f"`busybot view boards --episode {story.chosen}` opens the episode in Rerun; `{recording}` is the same "
                "as a file.",
                "`busybot dataset info boards` tells what was recorded, `busybot dataset verify boards` checks it.",
                "`busybot eval reason boards` repeats the inference; `relations.json` holds its result.",
                "`busybot view rollouts/search` shows what the agent could choose from on its way to the goal; "
                "`busybot eval plan task --agents search,random` plays the task again.",
            )
        ),
        Text(
            f"Board hash `{board}`, trace hash `{trace}`, content hash `{content}`: the same seed on the same machine "
            "gives the same three."
        ),
    ]


BOARDS = 4
STEPS = 30
EARLY_STEP = 6
"""A second picture of the viewer shows how little is known after so many steps."""

AGENT = "search"
"""Reaches the goal."""
TASK_STEPS, TASKS_SEEN = 3, 20
"""The task takes so many actions at the least, if one of so many does."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Demo:
    """What the demo left behind.

    Attributes:
        out: the folder with everything in it.
        report: Markdown.
        recording: for Rerun.
        pictures: PNG files, figures and screenshots.
        result: of `busybot eval reason`.
        task_success: share of the task's affectable responders in their goal state.
    """

    out: Path
    report: Path
    recording: Path
    pictures: tuple[Path, ...]
    result: dict[str, Any]
    task_success: float


def run_demo(
    out: Path, seed: int, workers: int, say: Say, assets: str = "procedural", model: str = DEFAULT_MODEL
) -> Demo:
    """Run everything into an empty folder.

    Args:
        model: of the policy that acts: a shipped model's name, or a folder.

    Raises:
        BusybotError: the folder is not empty, there is no such model, or the environment is at fault.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BusybotError(f"{out}: it exists and is not an empty folder", "name another with --out, or remove it")
    policy, library = policy_config(load_once(model).info, {}), find(assets)
    say(f"drawing {BOARDS} boards with {len(library.objects)} {library.name} objects to choose from")
    # levers with three positions and panels on every board: more to discover
    config = BoardConfig(boards=BOARDS, group_size=1, seed=seed, relations="one-to-many")
    dataset = _collect(out / "boards", config, library, workers, say, model)
    say("inferring which switch controls what, from pictures and actions alone")
    result = evaluate_dataset(dataset, ReasonEvaluation(DEFAULT_REASONER), seed=seed, workers=1)
    write_json(out / "relations.json", result)
    episodes = [read_episode(dataset.episode_path(index), "lazy") for index in range(BOARDS)]
    chosen = most_telling([episode.board for episode in episodes])
    inferred = inferred_over_time(episodes[chosen], DEFAULT_REASONER, STEPS + 1)
    rollout, planned = _reach_goal(out, library, seed, say, model)
    say("drawing figures")
    thoughts = list(retrace(episodes[chosen], load_once(model), policy))
    pictures = _figures(out / "figures", episodes, chosen, inferred, thoughts)
    pictures["sequence"] = sequence_figure(out / "figures" / "sequence.png", rollout)
    recording = out / f"board-{chosen}.rrd"
    save_rrd(recording, episodes[chosen], [inferred], layers=RecordingLayers(thoughts))
    say("taking pictures of the viewer")
    for step in (EARLY_STEP, STEPS):
        picture = out / "figures" / f"viewer-step-{step:02d}.png"
        save_screenshot(recording, picture, step)
        pictures[f"viewer_{step}"] = picture
    report = out / "report.md"
    story = Story(episodes, chosen, inferred, result, dataset.info, recording, pictures, EARLY_STEP, rollout, planned)
    write_atomically(report, demo_report(story, out).encode())
    return Demo(out, report, recording, tuple(pictures.values()), result, planned["success"])


def _collect(path: Path, config: BoardConfig, library: Library, workers: int, say: Say, model: str) -> Dataset:
    dataset = create_dataset(path, config, library)
    say(f"acting {STEPS} times on {'each' if config.boards > 1 else 'it'} and recording what happens")
    factory, acting = LearnedPolicyFactory(model, "collect"), CollectConfig(policy="learned", steps=STEPS)
    collect(dataset, library, acting, min(workers, config.boards), None, factory, factory.provenance())
    return dataset


def _reach_goal(out: Path, library: Library, seed: int, say: Say, model: str) -> tuple[Episode, dict[str, Any]]:
    """A board with a goal, and `search` on it: the rollout, and what `busybot eval plan` tells of the agent."""
    say("drawing a board with a goal")
    dataset = _collect(out / "task", _task(library, seed), library, 1, say, model)
    say("reaching the goal with what was learned")
    record = out / "rollouts"
    evaluation = PlanEvaluation(dataset, library, [AGENT], DEFAULT_REASONER, model, seed=seed, record=record)
    result = evaluate_agents(evaluation)
    rollout = read_episode(Dataset.open(record / AGENT).episode_path(0), "lazy")
    return rollout, result["agents"][AGENT]


def _task(library: Library, seed: int) -> BoardConfig:
    """A board with a goal: from the seed on, the first one that takes several actions."""
    for draw in range(seed, seed + TASKS_SEEN):
        config = BoardConfig(boards=1, group_size=1, seed=draw, tasks="one-to-many")
        board = next(iter(generate_boards(config, library)))
        if least_steps(start_states(board), task_of(board).goal) >= TASK_STEPS:
            break
    return config


def most_telling(boards: list[BoardSpec]) -> int:
    """The board with the most kinds of relations, then the most relations."""
    return max(range(len(boards)), key=lambda i: (len({r.kind for r in boards[i].relations}), len(boards[i].relations)))


def _figures(
    folder: Path, episodes: list[Episode], chosen: int, inferred: InferredGraph, thoughts: list[PolicyTrace]
) -> dict[str, Path]:
    make_folder(folder, folder.parent)
    episode = episodes[chosen]
    return {
        "boards": figures.boards_figure(folder / "boards.png", episodes, named=chosen),
        "affordance": affordance_figure(folder / "affordance.png", episode, thoughts),
        "episode": figures.episode_figure(folder / "episode.png", episode),
        "graph": figures.graph_figure(folder / "graph.png", episode, inferred),
        "refinement": figures.refinement_figure(folder / "refinement.png", episode, inferred),
        "changes": figures.changes_figure(folder / "changes.png", episode),
    }
