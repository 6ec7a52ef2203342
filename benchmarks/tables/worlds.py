"""The table of worlds: what rows without learning find out, by the actions of an oracle of contacts.

    python -m benchmarks.tables.worlds record --data FOLDER --assets DIR [--only gates,time] [--sets training]
        [--policy FOLDER [--reasoner FOLDER]]
    python -m benchmarks.tables.worlds --data FOLDER --assets DIR --out benchmarks/results/worlds.json
        [--only gates,time] [--parts rows,discovery,exploring,learned] [--model FOLDER] [--boards 100]

`record` makes, for each world, boards of the training split to judge on (`validation`), to tune on (`training`), and
`others` for shortcuts and more training, and acts on them by the scripted policy: it takes a random link that
shows, at a contact and in a direction that move it. Pictures are small, everything else is as ever. No test split is
looked at. With `--policy`, a training of the interaction policy, `record` makes `explored`, too: for training, acted on
by that policy and photographed as the frozen boards are (`benchmarks.tables.world_gates`). It meets fewer links. With
`--reasoner` as well, a training of the model of relations, it makes `chosen`: where that chooses among what the policy
proposes (`collect --policy curious`), and meets nearly all.

The parts are `rows` (counting, lookup, persistence, the exact observer of what is detected, and of the truth),
`discovery` (two methods of causal-learn, from the extra `causal`; slow, so on the first boards alone) and `exploring`
(the exact observer after random, coverage-first and greedy choice of links, on the first boards, without a simulator);
on request `learned`: a trained model of relations. Where a network that had labels has been judged, all rows of the
world are compared with it, on the boards that both have (`compared`).

All commands resume: `record` where it was stopped, the other after the last world and part that it wrote.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmarks import runner
from benchmarks.studies.bounds import Drawn, play, summed
from benchmarks.tables.world_rows import (
    ACTIONS,
    ENCODER,
    METHODS,
    DiscoveryConfig,
    Seen,
    Tuned,
    counted,
    detected,
    discovered,
    strengths,
    tuned,
    tuned_discovery,
)
from busybot.boards.spec import PAPER, BoardSpec
from busybot.boards.worlds import WORLDS
from busybot.common.errors import UsageError
from busybot.common.process_pool import default_workers, share
from busybot.common.rng import generator
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.statistics import compare_boards, two_level_interval
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.reason.evaluation.causes import JudgedCauses, Watched, count_links, count_parents, judge_causes, law_of
from busybot.reason.evaluation.causes_summary import outspoken, summarise_causes
from busybot.reason.evaluation.decoders import NearestState, judged_objects
from busybot.reason.evaluation.evaluate import IMAGES, ReasonEvaluation, judge_episode, origin
from busybot.reason.evaluation.ground_truth import states_of
from busybot.reason.evaluation.prediction import JudgedPrediction
from busybot.reason.evaluation.summary import JudgedGraph, intervals, summarise_predictions
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.inputs.observation import observe_episode, pushes_of
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.counting import CountConfig
from busybot.reason.models.lookup import LookupConfig, Persistence
from busybot.reason.models.registry import ReasonerInfo
from busybot.training.model_cards import file_hashes, find_folder, read_info

KIND = "worlds"
NAMES = (*WORLDS, PAPER)
STEPS = 30
PICTURES = ("render.width=320", "render.height=240")
RECORDED = {
    "training": (60, 822),
    "validation": (200, 821),
    "others": (400, 825),
    "explored": (60, 826),
    "chosen": (60, 827),
}
"""Number of boards and seed, which no other recording has; nothing but shortcuts is judged on `others`."""
BY = {"explored": ("policy",), "chosen": ("policy", "reasoner")}
"""Which trainings act on a recording; on all others the scripted policy does."""
SCRIPTED = tuple(name for name in RECORDED if name not in BY)
FEW, CHOOSING, GREEDY, TUNING = 40, 60, 10, 6
"""Boards of the discovery methods, of random and coverage-first choice, of greedy choice, and that the discovery
methods are tuned on."""
MECHANISMS = (
    *("mechanism_accuracy", "kind_accuracy", "lag_accuracy", "what_if", "what_if_pairs", "ece_uncertain"),
    *("ece_by_chance", "uncertain_pairs", "shd"),
)
REWIRED = (
    "rewirings",
    *(f"rewired_{what}{who}" for what in ("found", "placed", "false_alarms") for who in ("", "_bound")),
)
LEVELS = {"object": "parent_f1", "link": "link_parent_f1", "mechanism": "mechanism_accuracy"}
"""Shares that rows are compared by."""
ALONE, UNTOLD = " from pictures alone", ", world not told"
NETWORK = "mechanism"
"""The row that others are compared with: the network that learned from labels, told the world."""
Judged = list[tuple[BoardSpec, JudgedCauses]]
Told = TypeVar("Told")


def record(words: list[str]) -> None:
    """Generate the boards and act on them; what is there is left alone."""
    options = runner.parser(__doc__, out=None)
    options.add_argument("--data", type=Path, required=True)
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    options.add_argument("--sets", help="which recordings, comma-separated; all that can be made by default")
    options.add_argument("--policy", help="a training of the interaction policy, which acts on `explored`")
    options.add_argument("--reasoner", help="one of the model of relations, which chooses on `chosen` what that does")
    options.add_argument("--most", type=int, default=10_000, help="boards per recording")
    arguments = options.parse_args(words)
    missing = {name: [one for one in BY.get(name, ()) if not getattr(arguments, one)] for name in RECORDED}
    able = [name for name in RECORDED if not missing[name]]
    sets = runner.chosen(arguments.sets or ",".join(able), RECORDED)
    for name in sets:
        if missing[name]:
            raise SystemExit(f"{name}: nobody is there to act; name a training by --{missing[name][0]}")
    for world in runner.chosen(arguments.only, NAMES) if arguments.only else NAMES:
        for name, (boards, seed) in ((one, RECORDED[one]) for one in sets):
            folder = arguments.data / world / name
            drawn = runner.generating(folder, "train", min(arguments.most, boards), seed, arguments.assets)
            runner.busybot(*drawn, "--world", world)
            acting = ("--steps", str(STEPS), "--seed", str(seed), "--assets", arguments.assets)
            runner.busybot("collect", str(folder), *acting, *_acting(name, arguments.policy, arguments.reasoner))


def _acting(name: str, policy: str | None, reasoner: str | None) -> tuple[str, ...]:
    """By whom boards are acted on; a learned policy reads pictures of the usual size."""
    if name not in BY:
        return ("--policy", "scripted", *runner.settings(*PICTURES))
    if "reasoner" in BY[name]:
        return ("--policy", "curious", "--model", str(policy), "--reasoner", str(reasoner))
    return ("--policy", "learned", "--model", str(policy))


@dataclass(frozen=True)
class Recorded:
    """A dataset with what its boards are judged by."""

    dataset: Dataset
    library: Library
    features: Any

    @staticmethod
    def at(folder: Path, assets: str) -> "Recorded":
        dataset = Dataset.open(folder)
        return Recorded(dataset, library_of(dataset, assets), features_of(dataset, ENCODER, workers=1))

    def boards(self, most: int | None = None) -> Iterator[Seen]:
        """The first boards that were acted on."""
        yield from map(self.seen, sorted(self.dataset.finished())[:most])

    def seen(self, index: int) -> Seen:
        """The board of a number."""
        return Seen.of(read_episode(self.dataset.episode_path(index), "lazy"), self.features[index])

    def judge(self, seen: Seen, config: LookupConfig, causes: bool = True) -> Any:
        """`lookup` on a board; without causes only its predictions count."""
        judging = ReasonEvaluation("lookup", config=config, library=self.library if causes else None)
        return judge_episode(seen.episode, judging, self.features[seen.episode.board.index])


def chosen_constants(training: Recorded) -> Tuned:
    """All that is tuned but the methods of discovery; of `lookup` what predicts best."""
    boards = list(training.boards())
    found, best = tuned(boards), -1.0
    for reach in (0.1, 0.2):
        for counting in (found.counting, CountConfig()):
            config = LookupConfig(reach=reach, counting=counting)
            forecasts = [(seen.episode.board, training.judge(seen, config, False).forecast) for seen in boards]
            share = summarise_predictions(forecasts)["pred_a"] or 0.0
            if share > best:
                best, found = share, found.model_copy(update={"lookup": config})
    return found


def learned(validation: Recorded, model: Path, most: int | None, seed: int) -> dict[str, Any]:
    """Figures of a trained model, under its name, and of one that reads in which world it is where nobody tells it."""
    card = read_info(find_folder(model, "reason"), ReasonerInfo)
    name = f"{card.model}{ALONE if card.training.get('labels') == 'none' else ''}"
    ways = (True, False) if card.model == NETWORK else (True,)
    return {f"{name}{'' if told else UNTOLD}": _learned(validation, model, most, seed, told) for told in ways}


def _learned(validation: Recorded, model: Path, most: int | None, seed: int, world: bool) -> dict[str, Any]:
    judging = ReasonEvaluation(str(model), library=validation.library, curve=(), told=world)
    judged = _by_all_cores(partial(_judged, validation, judging), validation, most)
    told = summarise_predictions([(one.board, one.forecast) for one in judged if one.forecast is not None])
    causes = [(one.board, one.causes) for one in judged if one.causes is not None]
    row = figures(causes, seed, (*MECHANISMS, *REWIRED))
    return {**row, "pred_a": told["pred_a"], "model": file_hashes(find_folder(model, "reason"))}


def _judged(validation: Recorded, judging: ReasonEvaluation, index: int) -> JudgedGraph:
    episode = read_episode(validation.dataset.episode_path(index), "lazy")
    return judge_episode(episode, judging, validation.features[index])


def rows_of(validation: Recorded, found: Tuned, most: int | None, seed: int) -> dict[str, Any]:
    """Figures of each row, by its name."""
    judged: dict[str, Judged] = {}
    told = _by_all_cores(partial(_of_board, validation, found), validation, most)
    for board, causes, _, _ in told:
        for name, one in causes.items():
            judged.setdefault(name, []).append((board, one))
    rows = {name: figures(boards, seed) for name, boards in judged.items()}
    forecasts = [(board, forecast) for board, _, forecast, _ in told]
    foretold = summarise_predictions(forecasts)
    rows["lookup"]["pred_a"], rows["persistence"]["pred_a"] = foretold["pred_a"], foretold["persistence"]["pred_a"]
    rows["lookup"]["pred_a_interval"] = intervals(forecasts, seed)["pred_a"]
    rows["observer-detected"]["detected"] = dict(
        zip(("clusters", "links", "responders"), np.mean([right for *_, right in told], axis=0).tolist(), strict=True)
    )
    return rows


def _by_all_cores(function: Callable[[int], Told], validation: Recorded, most: int | None) -> list[Told]:
    """What a function tells of each of the first boards, by their numbers."""
    boards = sorted(validation.dataset.finished())[:most]
    return list(share(function, boards, min(default_workers(), len(boards))))


def _of_board(
    validation: Recorded, found: Tuned, index: int
) -> tuple[BoardSpec, dict[str, JudgedCauses], JudgedPrediction, tuple[float, float, float]]:
    """Judged causes by row, predictions of `lookup`, and what is detected (`Seen.detected_rightly`)."""
    seen = validation.seen(index)
    looked = validation.judge(seen, found.lookup)
    truth = looked.causes
    clusters = seen.clusters
    law, states = law_of(seen.episode, validation.library), states_of(seen.episode)
    assert law is not None and states is not None
    observed = observe_episode(seen.episode)
    told = detected(seen, clusters)
    visible = judged_objects(observed)
    watched = Watched(
        seen.episode, pushes_of(observed), seen.sequence.acted, visible, IMAGES, validation.library, seen.sequence,
        NearestState(seen.sequence.features, seen.looks, states.states, visible), told, found.error,
    )  # fmt: skip
    nothing = judge_causes(watched, Persistence().graph(seen.sequence), Persistence())
    causes = {
        "count": claimed_by(truth, seen, counted(seen, clusters, found.counting)),
        "lookup": truth,
        "persistence": nothing,
        "observer-detected": observer_of(nothing),
        "observer": observer_of(truth),
    }
    return looked.board, causes, looked.forecast, seen.detected_rightly(clusters, told)


def claimed_by(judged: JudgedCauses, seen: Seen, graph: InferredGraph) -> JudgedCauses:
    """The same board judged by what another graph claims, of which nobody is asked about mechanisms."""
    count = len(judged.true) - 1
    claimed = np.array([graph.claimed(number) for number in range(count + 1)]) & judged.candidates
    links = None
    if graph.links is not None:
        links = count_links(seen.episode, graph.links, graph.threshold, claimed, judged.candidates)
    probabilities = np.array([graph.after(number) for number in range(count + 1)], np.float32)
    unasked = [replace(one, right=None, kind_right=None, lag_right=None) for one in judged.mechanisms]
    return replace(
        judged, claimed=claimed, probabilities=probabilities, links=links, mechanisms=tuple(unasked), told=None
    )


def observer_of(judged: JudgedCauses) -> JudgedCauses:
    """The same board judged by what the exact observer claims, who gives no probabilities here.

    Where nothing explains what was told it, it claims nothing.
    """
    bound = np.zeros_like(judged.claimed) if judged.bound is None else judged.bound
    told = judged.links_silent if judged.links is None else judged.links
    silent = None if told is None else told * (0, 0, 1)
    known = [
        replace(one, right=bool(one.bound), kind_right=bool(one.kind_bound), lag_right=bool(one.lag_bound))
        for one in judged.mechanisms
    ]
    return replace(
        judged, claimed=bound, probabilities=bound.astype(np.float32), links=judged.links_bound,
        links_silent=silent, mechanisms=tuple(known), told=None,
    )  # fmt: skip


def figures(judged: Judged, seed: int, asked: Sequence[str] = MECHANISMS) -> dict[str, Any]:
    """Parents after each of `ACTIONS` at both levels, what is asked after 22, and of each board what is compared."""
    told = summarise_causes([*judged], IMAGES, None, seed)
    objects = [[count_parents(one.claimed[k], one.true[k]) for k in ACTIONS] for _, one in judged]
    found = {"boards": len(judged), "object": _parents(judged, objects, seed)}
    links = [one.links for one in outspoken([one for _, one in judged])]
    if links and all(one is not None for one in links):
        found["link"] = _parents(judged, [[one[k] for k in ACTIONS] for one in links if one is not None], seed)
    mechanism = told["cause_intervals"]["objects"]["mechanism_accuracy"]
    by_board = {level: told["by_board"][name] for level, name in LEVELS.items() if name in told["by_board"]}
    return {**found, **{key: told[key] for key in asked}, "mechanism_interval": mechanism, "by_board": by_board}


def compared(told: dict[str, Any], world: str, seed: int) -> dict[str, Any]:
    """Of each row of a world the difference to `NETWORK` on the boards that both have; empty where that is missing."""
    rows = {name: row for part in COMPARED for name, row in told.get(part, {}).items() if "by_board" in row}
    if NETWORK not in rows:
        return {}
    first = rows.pop(NETWORK)["by_board"]
    return {
        name: compare_boards(first, row["by_board"], generator(seed, world, 0, f"worlds/compared/{name}"))
        for name, row in rows.items()
    }


def _parents(judged: Judged, counts: Sequence[Sequence[np.ndarray]], seed: int) -> dict[str, Any]:
    """By number of actions; intervals by a bootstrap over objects and their boards.

    Args:
        counts: of each board and number of actions int (N, 3), as of `count_parents`.
    """
    found = {}
    for place, actions in enumerate(ACTIONS):
        records = [
            (2 * hits, claimed + true, hits, claimed, true, board.objects[index].key, number)
            for number, (board, _) in enumerate(judged)
            for index, (hits, claimed, true) in enumerate(counts[number][place].tolist())
            if claimed + true
        ]
        part, whole, hits, claimed, true = (np.array([one[k] for one in records], int) for k in range(5))
        rng = generator(seed, "train", 0, f"worlds/{actions}")
        interval = two_level_interval(part, whole, [one[5] for one in records], [one[6] for one in records], rng)
        found[str(actions)] = {
            "p": float(hits.sum() / claimed.sum()) if claimed.sum() else None,
            "r": float(hits.sum() / true.sum()),
            "f1": float(part.sum() / whole.sum()),
            "interval": interval,
        }
    return found


def discovery_of(training: Recorded, validation: Recorded, boards: int, seed: int) -> dict[str, Any]:
    """Figures of the methods of discovery, with what was tuned."""
    tuning = list(training.boards(TUNING))
    rows: dict[str, Any] = {}
    for name in METHODS:
        config = tuned_discovery(tuning, name)
        told = _by_all_cores(partial(_discovered, validation, name, config), validation, boards)
        rows[name] = {"tuned": config.model_dump(mode="json"), **figures(told, seed)}
        print(f"{name}: {rows[name]['object']['22']['f1']:.2f}", file=sys.stderr, flush=True)
    return rows


def _discovered(validation: Recorded, name: str, config: DiscoveryConfig, index: int) -> tuple[BoardSpec, JudgedCauses]:
    seen = validation.seen(index)
    clusters = seen.clusters
    graph = discovered(seen, clusters, name, strengths(seen, clusters, name, config), config)
    observed = observe_episode(seen.episode)
    watched = Watched(seen.episode, pushes_of(observed), seen.sequence.acted, judged_objects(observed), IMAGES)
    return seen.episode.board, judge_causes(watched, graph)


def exploring(world: str, specs: Sequence[BoardSpec], library: Library, greedy: int, seed: int) -> dict[str, Any]:
    """The exact observer's figures by way of choosing links, on boards that are moved without a simulator."""
    found = {}
    for choice, boards in (("random", len(specs)), ("coverage", len(specs)), ("greedy", greedy)):
        drawn = [Drawn(spec, library) for spec in specs[:boards]]
        told = [
            play(board, choice, ACTIONS, generator(seed, world, number, f"worlds/{choice}"))
            for number, board in enumerate(drawn)
        ]
        responders = np.array([board.space.responders for board in drawn])
        rng = generator(seed, world, 0, "worlds/exploring")
        found[choice] = {"boards": len(drawn), **summed(np.array(told), responders, ACTIONS, rng)}
    return found


PARTS, LEARNED = ("rows", "discovery", "exploring"), "learned"
COMPARED = ("rows", "discovery", LEARNED)


def measure(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The whole result, after each part of each world; what is not asked for is kept from an earlier one."""
    rows = runner.told_rows(arguments.out, KIND, assets=runner.assets_name(arguments.assets))
    worlds = runner.chosen(arguments.only, NAMES) if arguments.only else NAMES
    parts = runner.chosen(arguments.parts, (*PARTS, LEARNED))
    if LEARNED in parts and arguments.model is None:
        raise UsageError(f"the part {LEARNED} is about a trained model", "name it by --model")
    for part in parts:
        for world in worlds:
            told = rows.setdefault(world, {})
            if _is_there(part, told, arguments.model) and not arguments.again:
                continue
            print(f"{world}, {part}", file=sys.stderr, flush=True)
            told[part] = _part(part, world, told, arguments)
            told["compared"] = compared(told, world, RECORDED["validation"][1])
            yield {
                "assets": runner.assets_name(arguments.assets),
                "rows": {one: rows[one] for one in NAMES if one in rows},
            }


def _is_there(part: str, told: dict[str, Any], model: Path | None) -> bool:
    """Whether a world has a part already, of what a model learned that of this one's weights."""
    if part not in told or part != LEARNED or model is None:
        return part in told
    return file_hashes(find_folder(model, "reason")) in [row["model"] for row in told[part].values()]


def _part(part: str, world: str, told: dict[str, Any], arguments: argparse.Namespace) -> dict[str, Any]:
    folder, seed = arguments.data / world, RECORDED["validation"][1]
    validation = Recorded.at(folder / "validation", arguments.assets)
    if part == "exploring":
        return exploring(
            world, list(validation.dataset.boards())[:CHOOSING], find(arguments.assets), arguments.greedy, seed
        )
    if part == LEARNED:
        rows = learned(validation, arguments.model, arguments.boards, seed)
        return {**told.get(LEARNED, {}), **rows}  # of other models
    training = Recorded.at(folder / "training", arguments.assets)
    if part == "discovery":
        return discovery_of(training, validation, arguments.few, seed)
    found = chosen_constants(training)
    rows = rows_of(validation, found, arguments.boards, seed)
    sets = {"training": training.dataset, "validation": validation.dataset}
    return {"tuned": found.model_dump(mode="json"), "data": {name: origin(one) for name, one in sets.items()}, **rows}


def main(words: list[str]) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", type=Path, required=True, help="what `record` made")
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    options.add_argument("--parts", default=",".join(PARTS))
    options.add_argument("--boards", type=int, help="boards that are judged, the first ones; all by default")
    options.add_argument("--model", type=Path, help="trained model of relations, for the part `learned`")
    options.add_argument("--few", type=int, default=FEW, help="boards of the methods of causal discovery")
    options.add_argument("--greedy", type=int, default=GREEDY, help="boards of greedy choice")
    options.add_argument("--again", action="store_true", help="what is in the result already, too")
    arguments = options.parse_args(words)
    for figures_ in measure(arguments):
        runner.finish(KIND, arguments, figures_, seed=RECORDED["validation"][1])


if __name__ == "__main__":
    runner.one_of(main, record=record)
