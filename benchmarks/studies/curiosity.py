"""Which action next: how soon relations are known when chance, turns or curiosity choose what to do.

    python -m benchmarks.studies.curiosity --assets DIR --out benchmarks/results/curiosity.json
        [--parts drawn,greedy,recorded,stopping --work FOLDER --policy FOLDER] [--only gates,time] [--boards 60]
        [--few 12] [--seeds FOLDER FOLDER]
    python -m benchmarks.studies.curiosity plot --result RESULT --out docs/images/curiosity.png

All are judged by the shipped `mechanism` model: the F1 of the links that it claims after each action. Its trainings
from other seeds (`--seeds`) judge, and choose where they are curious, by themselves; what they reach stands beside it.

- `drawn`: boards of the training split that are moved without a simulator, true states. Links are chosen at random, in
  turn (`coverage`), or by the model's curiosity after one turn (`curious`, which waits, too, if that tells more). What
  may be held is told from what is not, and opened, as `collect --policy curious` does.
- `greedy`: the same, chosen by the exact observer's information; slow, so on the first boards alone, with the others
  beside it on just these. *Regret* is how far F1 is behind that of greedy choice, mean over the first 30 actions.
- `recorded`: simulated boards, pictures, and the learned policy's contacts: `collect --policy learned` draws among
  known links, `--policy curious` asks the model, and is told which objects are triggers. The processor time of an
  action is told, with everything that recording it takes.

- `stopping`: what is curious alone, on other drawn boards, of which there can be many more.

"I know" is said when every responder's likeliest parents are right with a probability of `CERTAIN`, by the model: after
how many actions, and how often a parent is then missing or wrong. No test split is looked at.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import runner
from benchmarks.studies.bounds import WORKS, Drawn
from benchmarks.tables.worlds import Recorded
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.boards.worlds import WORLDS
from busybot.common.errors import UsageError
from busybot.common.process_pool import default_workers, share
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import read_result
from busybot.evaluation.statistics import percentile_interval
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.plan.curious import CERTAIN, REASONER
from busybot.plan.held_links import HeldLinks, Place
from busybot.reason.evaluation.evaluate import ReasonEvaluation, judge_episode
from busybot.reason.evaluation.upper_bound import Observer, greedy
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.curiosity import certainty, expected, released, yields
from busybot.reason.models.mechanism.reasoner import MechanismReasoner
from busybot.reason.models.registry import reasoner_of
from busybot.training.model_cards import file_hashes, find_folder
from busybot.view.figures import parts
from busybot.view.palette import CORRECT, FAINT, MISSED, MUTED, TRIGGER, unit

KIND = "curiosity"
PARTS = ("drawn", "greedy", "recorded", "stopping")
CHOICES = ("random", "coverage", "curious")
COLORS = {"random": MISSED, "coverage": TRIGGER, "curious": CORRECT}
ACTIONS, STEPS = 40, 30
SEED, SEED_OF_STOPPING = 991, 994
"""Of boards that decided nothing: `CERTAIN` was chosen on those of 992 and 993."""
CLAIMED, KNOWN, DRAWS = 0.5, 0.95, 1000


Try = tuple[int, bool, bool]
"""Which action took hold of a link, whether it moved, and that it was pushed as it moves."""
Done = list[tuple[int | None, tuple[int, ...]]]
"""Actions: the link that each was to move, None for none, and the states of the links after it."""


class Player:
    """Plays one drawn board and tells what the model claims.

    Args:
        script: what is done, in the place of what would be chosen.

    Attributes:
        done: the actions so far.
        counts: of each action so far, links rightly claimed, claimed and true.
        stop: after how many actions the model says that it knows, and whether it does then; None until it says so.
    """

    def __init__(
        self,
        board: Drawn,
        reasoner: MechanismReasoner,
        choice: str,
        rng: np.random.Generator,
        script: Done | None = None,
    ):
        self._board, self._reasoner, self._choice, self._rng, self._script = board, reasoner, choice, rng, script
        self._links, self._shown = [board.triggers], [board.shown]
        self._order = rng.permutation(len(board.triggers))
        self._held, self._tries = HeldLinks(), [list[Try]() for _ in board.triggers]
        watches = choice == "greedy" and script is None
        self._observer = Observer(board.space, board.triggers, board.shown) if watches else None
        self.done: Done = []
        self.counts: list[tuple[int, int, int]] = []
        self.stop: tuple[int, bool] | None = None

    def act(self) -> None:
        board = self._board
        link, after = self._tried() if self._script is None else self._script[len(self.done)]
        if link is not None:
            self._remember(link, after[link] != board.triggers[link])
        board.act(after)
        self.done.append((link, after))
        self._links.append(board.triggers)
        self._shown.append(board.shown)
        if self._observer:
            self._observer.see(board.triggers, board.shown)
        self._judge()

    def _tried(self) -> tuple[int | None, tuple[int, ...]]:
        """As of `Done`; an action may fail."""
        link, there = self._chosen()
        works = link is None or (self._rng.random() < WORKS and not self._board.held(link))
        return link, there if works else self._board.triggers

    def _chosen(self) -> tuple[int | None, tuple[int, ...]]:
        """The link to be moved, None for none, and the states that are meant to follow."""
        board, done = self._board, len(self._links) - 1
        moves: list[tuple[int | None, tuple[int, ...]]] = [
            (link, there) for link in range(len(board.triggers)) for there in board.moves(link)
        ]
        if self._observer:
            free = [(link, there) for link, there in moves if link is None or not board.held(link)]
            free += [(None, board.triggers)] if board.waits or not free else []
            return free[greedy(self._observer.belief(), [there for _, there in free], self._rng)]
        if self._choice == "curious" and done >= len(self._order):
            moves.append((None, board.triggers))
            told = self._worth([link for link, _ in moves], [there for _, there in moves])
            return moves[int(self._rng.choice(np.flatnonzero(told >= told.max())))]
        turn = int(self._order[done % len(self._order)])
        link = int(self._rng.integers(len(self._order))) if self._choice == "random" else turn
        own = board.moves(link)
        return link, own[int(self._rng.integers(len(own)))]

    def _remember(self, link: int, moved: bool) -> None:
        """That a link was tried: until it moves it is where something may be held, and then a known one."""
        step, place = len(self.done), self._place(link)
        if not any(success for _, success, _ in self._tries[link]):
            released = 1.0 if place is None else float(self._released([place])[0])
            self._held.tried(step, (0, 0), link, (WORKS, released), moved)
        self._tries[link].append((step, moved, True))

    def _place(self, link: int) -> Place | None:
        """Where a link was tried that never moved."""
        return self._held.at((0, 0), link)

    def _released(self, places: Sequence[Place], shown: np.ndarray | None = None) -> np.ndarray:
        return released(np.array(self._shown), [one.actions for one in places], shown)

    def _worth(self, links: Sequence[int | None], moves: Sequence[tuple[int, ...]]) -> np.ndarray:
        """What moves of links, None for none, are worth, float (M,), as the curious policy has it; what a link is worth
        that never moved is what moving it would tell."""
        expects, held = expected(self._trace, self._found, self._shares, moves), self._held
        told, works = expects.information.copy(), np.ones(len(moves))
        worth, places = dict[int, float](), dict[int, Place]()
        for number, link in enumerate(links):
            if link is None:
                continue
            if (place := self._place(link)) is None:
                works[number] = WORKS * yields(self._trace.responders, self._tries[link])
            else:
                locked = held.held(place) * place.promised
                works[number] = locked * self._released([place])[0] + (1 - locked) * WORKS
                told[number] /= 1 - held.share
                worth[link], places[link] = max(worth.get(link, 0.0), told[number]), place
        known = [number for number, link in enumerate(links) if link not in places]
        told, closed = told * works, list(places.values())
        opened = self._released(closed, expects.shown[known])
        told[known] = held.with_what_opens(told[known], works[known], np.array(list(worth.values())), closed, opened)
        return told

    def _judge(self) -> None:
        """What the model makes of the trace, which curiosity reads next."""
        board = self._board
        self._trace = Trace(np.array(self._links), np.array(self._shown), board.links.sizes)
        self._found, shares, _ = self._reasoner.explain(self._trace, [len(self._links) - 1])
        self._shares = shares[..., 0]
        claimed = (self._shares @ self._found.inputs).T > CLAIMED
        true = np.zeros_like(claimed)
        for responder, one in enumerate(board.truth()):
            true[list(one.inputs), responder] = True
        self.counts.append((int((claimed & true).sum()), int(claimed.sum()), int(true.sum())))
        swept = len(self.counts) >= len(self._order)
        if self.stop is None and swept and certainty(self._found, self._shares) >= CERTAIN:
            self.stop = len(self.counts), bool((claimed == true).all())


Played = tuple[list[tuple[int, int, int]], tuple[int, bool] | None]
"""`Player.counts` and `Player.stop`."""


def drawn(
    world: str, boards: int, choices: tuple[str, ...], library: Library, seed: int, models: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Figures of each choice on drawn boards, by model."""
    specs = list(generate_boards(BoardConfig(world=world, boards=boards, seed=seed, group_size=1), library))
    found: dict[str, dict[str, Any]] = {model: {} for model in models}
    for choice in choices:
        # the exact observer may think about a board for longer than workers have for a task
        workers = 1 if choice == "greedy" else min(default_workers(), len(specs))
        played = list(share(partial(_played, world, choice, library, seed, models), enumerate(specs), workers))
        for model, told in found.items():
            told[choice] = _told([each[model] for each in played], world)
            print(world, choice, told[choice]["until"], told[choice]["stops"], file=sys.stderr, flush=True)
    for told in found.values() if "greedy" in choices else ():
        for one in told.values():
            one["regret"] = float(np.mean(np.subtract(told["greedy"]["f1"], one["f1"])[:STEPS]))
    return found


def _told(played: Sequence[Played], world: str) -> dict[str, Any]:
    stops = [stop for _, stop in played if stop]
    said = {
        "boards": len(stops),
        "wrong": sum(not right for _, right in stops),
        "actions": float(np.mean([after for after, _ in stops])) if stops else None,
    }
    return {**figures(np.array([counts for counts, _ in played]), world), "stops": said}


def _played(
    world: str, choice: str, library: Library, seed: int, models: Sequence[str], drawn_board: tuple[int, BoardSpec]
) -> dict[str, Played]:
    """One board, by each model. What the exact observer chooses, which takes long, it chooses once."""
    (number, spec), told, script = drawn_board, {}, None
    for model in models:
        rng = generator(seed, world, number, f"curiosity/{choice}")
        player = Player(Drawn(spec, library), _reasoner(model), choice, rng, script)
        for _ in range(ACTIONS):
            player.act()
        told[model] = player.counts, player.stop
        script = player.done if choice == "greedy" else None
    return told


@cache
def _reasoner(model: str) -> MechanismReasoner:
    reasoner = reasoner_of(model)
    if not isinstance(reasoner, MechanismReasoner):
        raise UsageError(f"{model}: a model {reasoner.name}", "name trainings of `mechanism`")
    return reasoner


def recorded(world: str, arguments: argparse.Namespace, model: str) -> dict[str, Any]:
    """Figures of both policies on simulated boards; without processor time where recording was interrupted, or was
    there."""
    boards, assets, found = arguments.boards, arguments.assets, {}
    for policy in ("learned", "curious"):
        asks = policy == "curious" and model != REASONER
        folder = arguments.work / world / (f"{policy}-{Path(model).name}" if asks else policy)
        begun = runner.cpu_seconds()
        runner.busybot(*runner.generating(folder, "train", boards, SEED, assets), "--world", world)
        fresh = not Dataset.open(folder).finished()
        acting = ("--steps", str(STEPS), "--policy", policy, *runner.option("--model", arguments.policy))
        acting += ("--reasoner", model) if asks else ()
        runner.busybot("collect", str(folder), *acting, "--seed", str(SEED), "--assets", assets)
        spent = runner.cpu_seconds() - begun
        data = Recorded.at(folder, assets)
        judging = ReasonEvaluation(model, library=data.library, curve=(), what_if=False)
        counts = []
        for index in sorted(data.dataset.finished()):
            episode = read_episode(data.dataset.episode_path(index), "lazy")
            causes = judge_episode(episode, judging, data.features[index]).causes
            assert causes is not None and causes.links is not None
            counts.append(np.asarray(causes.links)[1:].sum(1))
        found[policy] = figures(np.array(counts), world)
        found[policy]["cpu_ms"] = 1000 * spent / (boards * STEPS) if fresh else None
        print(world, policy, found[policy]["until"], file=sys.stderr, flush=True)
    return found


def figures(counts: np.ndarray, world: str) -> dict[str, Any]:
    """F1 after each action, and after how many it is at least `KNOWN`, with intervals by a bootstrap over boards.

    Args:
        counts: int (boards, actions, 3), links rightly claimed, claimed and true.
    """
    rng = generator(SEED, world, 0, "curiosity/bootstrap")
    picked = rng.integers(len(counts), size=(DRAWS, len(counts)))
    curves = np.array([_f1(counts[one]) for one in picked])
    return {
        "boards": len(counts),
        "f1": _f1(counts).tolist(),
        "f1_interval": np.quantile(curves, (0.025, 0.975), axis=0).T.tolist(),
        "until": _until(_f1(counts)),
        "until_interval": percentile_interval(np.array([_until(one) for one in curves])),
    }


def _f1(counts: np.ndarray) -> np.ndarray:
    hits, claimed, true = counts.sum(0).T
    return np.asarray(2 * hits / (claimed + true))


def _until(curve: np.ndarray) -> int:
    """The first action after which F1 is at least `KNOWN`; one more than there were if it never is."""
    return int(np.argmax(curve >= KNOWN)) + 1 if (curve >= KNOWN).any() else len(curve) + 1


def models_of(arguments: argparse.Namespace) -> dict[str, str]:
    """The model that ships and trainings from other seeds, by name.

    Raises:
        UsageError: two have one name.
    """
    models = {REASONER: REASONER, **{Path(seed).name: seed for seed in arguments.seeds}}
    if len(models) <= len(arguments.seeds):
        raise UsageError("two trainings have one name, or that of the model that ships", "name each folder otherwise")
    return models


def measure(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The whole result, after each part of each world; what is there is kept."""
    rows = runner.told_rows(arguments.out, KIND, assets=runner.assets_name(arguments.assets))
    names = models_of(arguments)
    for part in runner.chosen(arguments.parts, PARTS):
        for world in runner.chosen(arguments.only, WORLDS) if arguments.only else list(WORLDS):
            told = rows.setdefault(world, {})
            places = {name: told if name == REASONER else _of_seed(told, name) for name in names}
            missing = {name: names[name] for name, place in places.items() if part not in place}
            if not missing:
                continue
            for name, found in played(part, world, missing, arguments).items():
                places[name][part] = found
            kept = {name: rows[name] for name in WORLDS if name in rows}
            yield {"assets": runner.assets_name(arguments.assets), "certain": CERTAIN, "rows": kept}


def _of_seed(told: dict[str, Any], name: str) -> dict[str, Any]:
    parts: dict[str, Any] = told.setdefault("seeds", {}).setdefault(name, {})
    return parts


def played(part: str, world: str, models: Mapping[str, str], arguments: argparse.Namespace) -> dict[str, Any]:
    """Figures of a part, by the models' names."""
    if part == "recorded":
        return {name: recorded(world, arguments, model) for name, model in models.items()}
    boards, choices, seed = {
        "drawn": (arguments.boards, CHOICES, SEED),
        "stopping": (arguments.boards, ("curious",), SEED_OF_STOPPING),
        "greedy": (arguments.few, (*CHOICES, "greedy"), SEED),
    }[part]
    found = drawn(world, boards, choices, find(arguments.assets), seed, tuple(models.values()))
    return {name: found[model] for name, model in models.items()}


def curves(path: Path, told: dict[str, Any]) -> None:
    """F1 after every action on drawn boards, a panel for each world."""
    worlds = {world: each["drawn"] for world, each in told["rows"].items() if "drawn" in each}
    figure = parts.page(parts.WIDTH, 4.4)
    for place, (world, rows) in enumerate(worlds.items(), start=1):
        axes = figure.add_subplot(2, 4, place)
        parts.plain_axes(axes, (0.35, 1.02))
        parts.draw_title(axes, world)
        for choice, color in COLORS.items():
            steps = np.arange(1, len(rows[choice]["f1"]) + 1)
            axes.plot(steps, rows[choice]["f1"], color=unit(color), linewidth=1.6)
            axes.fill_between(
                steps, *np.transpose(rows[choice]["f1_interval"]), color=unit(color), alpha=0.15, linewidth=0
            )
        axes.axhline(KNOWN, color=unit(FAINT), linewidth=0.8)
        axes.set(xlim=(0, ACTIONS))
        axes.set_xlabel("actions" if place > len(worlds) - 4 else "", fontsize=8, color=unit(MUTED))
    parts.draw_legend(figure, [parts.line_key(name, color) for name, color in COLORS.items()])
    parts.save_png(figure, path)


def plot(words: list[str]) -> None:
    """The command `plot`."""
    options = argparse.ArgumentParser()
    options.add_argument("--result", type=Path, required=True)
    options.add_argument("--out", type=Path, required=True)
    arguments = options.parse_args(words)
    curves(arguments.out, read_result(arguments.result, KIND))


def main(words: list[str]) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--parts", default="drawn")
    options.add_argument("--work", type=Path, help="for recordings of the part `recorded`")
    options.add_argument("--policy", help="interaction model of the part `recorded`; the shipped one by default")
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    options.add_argument("--boards", type=int, default=60)
    options.add_argument("--few", type=int, default=12, help="boards of the exact observer")
    options.add_argument("--seeds", nargs="*", default=[], help="trainings of the same variant from other seeds")
    arguments = options.parse_args(words)
    models = {name: file_hashes(find_folder(model, "reason")) for name, model in models_of(arguments).items()}
    hashes = {"models": runner.hashes_beside(arguments.out, KIND, "models", models)}  # what was played is kept
    runner.torch_with(1)
    for told in measure(arguments):
        runner.finish(KIND, arguments, told, hashes=hashes, seed=SEED)


if __name__ == "__main__":
    runner.one_of(main, plot=plot)
