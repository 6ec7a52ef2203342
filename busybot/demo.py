"""`busybot demo`: the whole way from objects to an inferred scene graph, small enough to watch.

Procedural objects become boards, a policy that learned where and how to act records interactions with them, recordings
become relations, relations lead to a goal, and a report in Markdown (`view/report/demo.md`) tells the story of one
board with the figures beside it. It ends with a board of the world `mixed`, on which counting is not enough.
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
from busybot.common.process_pool import keeping_workers
from busybot.common.text import markdown_text
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory, load_once, policy_config
from busybot.interact.policy.policy_trace import PolicyTrace, retrace
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.plan.agent_policy import reason
from busybot.plan.evaluate import PlanEvaluation, evaluate_agents
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.causes import JudgedCauses
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, judge_episode
from busybot.reason.evaluation.prediction import inferred_over_time
from busybot.reason.evaluation.what_if import TOUR
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.registry import DEFAULT_REASONER, reasoner_of
from busybot.sim.collect import CollectConfig, collect
from busybot.view.annotations import judged_edges, named, object_names
from busybot.view.figures import episode as figures
from busybot.view.figures.mechanisms import mechanism_figure, understood_figure
from busybot.view.figures.sequences import affordance_figure, sequence_figure
from busybot.view.mechanisms import MechanismView
from busybot.view.report.page import Grid, filled, markdown, plain_grid, share
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.understood import Understanding
from busybot.view.viewer_process import save_screenshot

KINDS = {
    "one-to-one": "one switch, one effect",
    "one-to-many-effects": "a lever with three positions, one effect for each",
    "one-to-many-objects": "a panel, one effect for each of its buttons",
}
REASONERS = {
    "event": "The model `event` sees the pictures, the objects' boxes and roles, and the actions. It never sees the "
    "simulator's relations or states. It compares how each responder looks before and after every action, and learned "
    "on other boards what that tells about which trigger controls it."
}
"""How the graph was inferred, by the reasoner's name."""
SCORES = {"edge_p": "Edge-P", "edge_r": "Edge-R", "edge_acc": "Edge-Acc"}
BOARDS = 4
STEPS = 30
EARLY_STEP = 6
"""A second picture of the viewer shows how little is known after so many steps."""

AGENT = "search"
"""Reaches the goal."""
TASK_STEPS, TASKS_SEEN = 3, 20
"""The task takes so many actions at the least, if one of so many does."""
SEEDS = 2**63
"""A dataset's seed is smaller."""

GATES, MECHANISMS = "gates", "mechanism"
"""A world in which it takes two links for an effect, and the model that finds out which."""
MIXED, MIXED_SEEN = "mixed", 6
"""The world of the last board, which is the one with the most kinds of mechanisms among so many."""

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
        BusybotError: the folder is not empty, there is no such model, the seed is too large, or the environment is at
            fault.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BusybotError(f"{out}: it exists and is not an empty folder", "name another with --out, or remove it")
    if seed + TASKS_SEEN > SEEDS:
        raise BusybotError(
            f"--seed {seed}: boards are drawn from it and those that follow", f"give at most {SEEDS - TASKS_SEEN}"
        )
    policy, library = policy_config(load_once(model).info, {}), find(assets)
    say(f"drawing {BOARDS} boards with {len(library.objects)} {library.name} objects to choose from")
    # levers with three positions and panels on every board: more to discover
    config = BoardConfig(boards=BOARDS, group_size=1, seed=seed, relations="one-to-many")
    with keeping_workers():
        dataset = _collect(out / "boards", config, library, workers, say, model)
        say("inferring which switch controls what, from pictures and actions alone")
        result = evaluate_dataset(dataset, ReasonEvaluation(DEFAULT_REASONER), seed=seed, workers=1)
        write_json(out / "relations.json", result)
        episodes = [read_episode(dataset.episode_path(index), "lazy") for index in range(BOARDS)]
        chosen = most_telling([episode.board for episode in episodes])
        inferred = inferred_over_time(episodes[chosen], DEFAULT_REASONER, STEPS + 1)
        rollout, planned = _reach_goal(out, library, seed, say, model)
        say(f"drawing a board of the world {GATES!r}")
        gates = _only_episode(_collect(out / GATES, _gates(library, seed), library, 1, say, model))
        judged, understood = _judged(gates, library)
        say(f"drawing a board of the world {MIXED!r}")
        mixed = _only_episode(_collect(out / MIXED, _mixed(library, seed), library, 1, say, model))
    say("drawing figures")
    thoughts = list(retrace(episodes[chosen], load_once(model), policy))
    pictures = _figures(out / "figures", episodes, chosen, inferred, thoughts)
    pictures["sequence"] = sequence_figure(out / "figures" / "sequence.png", rollout)
    pictures[GATES] = understood_figure(out / "figures" / "gates.png", understood)
    pictures[MIXED] = mechanism_figure(out / "figures" / "mixed.png", mixed)
    recording = out / f"board-{chosen}.rrd"
    save_rrd(recording, episodes[chosen], [inferred], layers=RecordingLayers(thoughts))
    say("taking pictures of the viewer")
    for step in (EARLY_STEP, STEPS):
        picture = out / "figures" / f"viewer-step-{step:02d}.png"
        save_screenshot(recording, picture, step)
        pictures[f"viewer_{step}"] = picture
    links = {name: path.relative_to(out).as_posix() for name, path in pictures.items()}
    drawn = {"pictures": links, "recording": recording.name, "early": EARLY_STEP, "chosen": chosen}
    story = _story(episodes[chosen], inferred, result, rollout) | _mixed_story(mixed)
    story |= {"understood": _understood(judged, understood), "understood_steps": len(gates.steps), "tour": TOUR}
    told = filled("demo.md", boards=BOARDS, info=dataset.info, result=result, planned=planned, **drawn, **story)
    report = out / "report.md"
    write_atomically(report, told.encode())
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
    return _only_episode(Dataset.open(record / AGENT)), result["agents"][AGENT]


def _only_episode(dataset: Dataset) -> Episode:
    return read_episode(dataset.episode_path(0), "lazy")


def _task(library: Library, seed: int) -> BoardConfig:
    """A board with a goal: from the seed on, the first one that takes several actions."""
    for draw in range(seed, seed + TASKS_SEEN):
        config = BoardConfig(boards=1, group_size=1, seed=draw, tasks="one-to-many")
        board = next(iter(generate_boards(config, library)))
        if least_steps(start_states(board), task_of(board).goal) >= TASK_STEPS:
            break
    return config


def _gates(library: Library, seed: int) -> BoardConfig:
    """A board on which two switches light a lamp together: from the seed on, the first one."""
    for draw in range(seed, seed + TASKS_SEEN):
        config = BoardConfig(boards=1, group_size=1, seed=draw, world=GATES)
        board = next(iter(generate_boards(config, library)))
        if any(
            one.parameters.get("function") == "and"
            and len({ref.object for ref in one.triggers}) > 1
            and board.objects[one.responder].category == "Lamp"
            for one in board.relations
        ):
            break
    return config


def _mixed(library: Library, seed: int) -> BoardConfig:
    """A board of the world `mixed`, from one of the first seeds: the one with the most kinds, locks among them."""

    def kinds(config: BoardConfig) -> int:
        board = next(iter(generate_boards(config, library)))
        return len({one.kind for one in board.relations}) + bool(board.locks) + bool(board.rewirings)

    seeds = range(seed, seed + MIXED_SEEN)
    return max((BoardConfig(boards=1, group_size=1, seed=draw, world=MIXED) for draw in seeds), key=kinds)


def most_telling(boards: list[BoardSpec]) -> int:
    """The board with the most kinds of relations, then the most relations."""
    return max(range(len(boards)), key=lambda i: (len({r.kind for r in boards[i].relations}), len(boards[i].relations)))


def _story(episode: Episode, inferred: InferredGraph, result: dict[str, Any], rollout: Episode) -> dict[str, Any]:
    """What the report tells of the chosen board, of all boards, and of the way to the goal."""
    baselines = {name.replace("_", " "): values for name, values in result["baselines"].items()}
    judged = {"the model that comes with busybot": result, **baselines}
    rows = [(name, [share(values[key]) for key in SCORES]) for name, values in judged.items()]
    said = (named(rollout.board, reason(rollout, step)) for step in range(len(rollout.steps) + 1))
    return {
        "steps": episode.steps,
        "delta": episode.settings.get("interaction", {}).get("delta", 500),
        "explanation": REASONERS[inferred.name],
        "relations": markdown([_relation_grid(episode.board, inferred)]).strip(),
        "end": len(inferred.probabilities),
        "scores": markdown([plain_grid(tuple(SCORES.values()), rows)]).strip(),
        "rollout": rollout,
        "said": "\n".join(f"{count}. {words}" for count, words in enumerate(filter(None, said), start=1)),
    }


def _mixed_story(episode: Episode) -> dict[str, Any]:
    """What the report tells of the last board: its mechanisms, and how far the same reasoner comes on it."""
    view = MechanismView(episode)
    steps = len(episode.steps)
    edges = judged_edges(episode.board, inferred_over_time(episode, DEFAULT_REASONER, steps + 1), steps)
    counts = {f"mixed_{name}": sum(edge.verdict == name for edge in edges) for name in ("correct", "wrong", "missed")}
    words = [f"- **{markdown_text(who)}** {markdown_text(words)}" for who, words in view.sentences]
    return {**counts, "mechanisms": "\n".join(words), "late": sum(change.late > 0 for change in view.changes)}


def _judged(episode: Episode, library: Library) -> tuple[JudgedCauses, Understanding]:
    """What the model of mechanisms says of a board after all steps, and what is right of it."""
    reasoner = reasoner_of(MECHANISMS)
    features = make_extractor(reasoner.encoder).of_episode(episode)
    judging = ReasonEvaluation(MECHANISMS, images=len(episode.steps) + 1, library=library)
    judged = judge_episode(episode, judging, features)
    assert judged.causes is not None  # a drawn board's relations are known
    assert judged.graph.links is not None  # this model tells links apart
    return judged.causes, Understanding(MechanismView(episode), judged.graph, judged.graph.links)


def _understood(judged: JudgedCauses, understood: Understanding) -> str:
    """What the model says of each responder beside what is true, and whether it is the same."""
    rows, true = [], dict(understood.view.sentences)
    for mechanism in judged.mechanisms:
        name = understood.view.object_name(mechanism.responder)
        told = markdown_text(understood.words(mechanism.responder)), markdown_text(true.get(name, ""))
        rows.append((name, (*told, understood.verdict(mechanism))))
    heads = ("the model says that it", "in truth it", "verdict")
    return markdown([plain_grid(heads, rows, "responder")]).strip()


def _relation_grid(board: BoardSpec, inferred: InferredGraph) -> Grid:
    names, steps = object_names(board), len(inferred.probabilities)
    kinds = {(ref.object, one.responder): one.kind for one in board.relations for ref in one.triggers}
    rows = []
    for edge in judged_edges(board, inferred, steps):
        kind = KINDS.get(kinds.get((edge.cause, edge.effect), ""), "")
        rows.append((names[edge.cause], (names[edge.effect], f"{edge.probability:.3f}", edge.verdict, kind)))
    return plain_grid(("responder", "probability", "verdict", "kind"), rows, "trigger")


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
