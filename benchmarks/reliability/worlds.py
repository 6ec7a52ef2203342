"""Boards of every world and split through all that is done with a dataset, and through kills on the way.

    python -m benchmarks.reliability.worlds --assets DIR --work FOLDER --out FILE [--boards 60] [--worlds gates,time]

For every world and split boards are generated and collected, frozen, verified against the manifest and regenerated, and
every recorded step is put back into the simulator and compared: states and memories of all steps, joints and picture of
the last. Beside it the same boards are collected by a command that is killed (SIGKILL, with all its processes) at five
random moments, some while it starts, and run again to its end. All three must have the same three hashes. Where
mechanisms are rewired there are actions enough for the first of them.

The same command continues after a stop: what the file tells without a fault is not repeated.
"""

import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.reliability.kills import POLL_SECONDS, copy
from benchmarks.runner import BUSYBOT, assets_name, chosen, finish, kill_when, one_of, parser, told_rows
from busybot.boards.config import SPLITS, BoardConfig
from busybot.boards.spec import PAPER
from busybot.boards.worlds import NOVEL, REWIRED_AT, WORLDS
from busybot.cli.common import episode_progress
from busybot.common.errors import BusybotError
from busybot.common.process_pool import run_tasks
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.verify import verify
from busybot.episodes.episode import Step
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import commit
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.regenerate import regenerate
from busybot.sim.replay import EpisodeReplay, simulator_of
from busybot.sim.scene.board_scene import BoardScene

KIND = "worlds-kept"
KILLS = 5
EPISODE_SECONDS = 0.5
"""A kill comes up to so long after the episode that it waits for: while another one is recorded or written."""
STEPS, STEPS_REWIRED = 8, REWIRED_AT[0] + 2
PICTURE = {"width": 96, "height": 72}
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """Boards of a world and split; its name is that of its row."""

    world: str
    split: str

    @property
    def name(self) -> str:
        return f"{self.world}/{self.split}"

    @property
    def steps(self) -> int:
        """Actions of an episode."""
        return STEPS_REWIRED if self.world in WORLDS and WORLDS[self.world].rewired else STEPS

    def boards(self, count: int, seed: int) -> BoardConfig:
        return BoardConfig.model_validate(
            {"world": self.world, "split": self.split, "boards": count, "seed": seed, "group_size": 1}
        )

    def collecting(self) -> CollectConfig:
        return CollectConfig.model_validate({"policy": "scripted", "steps": self.steps, "render": PICTURE})

    def command(self, folder: Path, assets: str) -> list[str]:
        """The command that collects as `collecting` says."""
        options = ["--policy", "scripted", "--steps", str(self.steps), "--assets", assets, "--workers", "1"]
        picture = [word for name, value in PICTURE.items() for word in ("--set", f"render.{name}={value}")]
        return [*BUSYBOT, "collect", str(folder), *options, *picture]


def cases(worlds: list[str]) -> list[Case]:
    """The paper's world has no split of novel mechanisms."""
    return [Case(world, split) for world in worlds for split in SPLITS if (world, split) != (PAPER, NOVEL)]


def checked(case: Case, library: Library, folder: Path, arguments: Any) -> Row:
    """What became of the case's boards, with all that was wrong under `faults`."""
    began, config = time.monotonic(), case.boards(arguments.boards, arguments.seed)
    straight = create_dataset(folder / "straight", config, library)
    collect(straight, library, case.collecting(), workers=1)
    freeze(straight.path, library)
    faults = [f"verify: {problem.file}: {problem.what}" for problem in verify(straight.path).problems]
    again = regenerate(straight.path, folder / "again", library)
    faults += [] if again.ok else [f"regenerate: boards {again.boards_unlike}, episodes {again.failed}"]
    disturbed = create_dataset(folder / "killed", config, library)
    moments = killed(case, disturbed, arguments)
    faults += [f"killed: {problem.file}: {problem.what}" for problem in verify(disturbed.path).problems]
    hashes = straight.hashes().model_dump()
    for name in ("again", "killed"):
        found = Dataset.open(folder / name).hashes().model_dump()
        faults += [f"{name}: another {kind} hash" for kind in hashes if found[kind] != hashes[kind]]
    replayed = dict(run_tasks(range(config.boards), _make_replay, (straight.path, library), workers=1))
    faults += [f"replay: episode {i}, step {step}" for i in sorted(replayed) for step in replayed[i][1]]
    faults += [] if len(moments) == KILLS else [f"killed {len(moments)} times only"]
    about = {"commit": commit(), "hashes": hashes, "boards": config.boards, **contents(straight.boards(), case.steps)}
    seconds = round(time.monotonic() - began, 1)
    steps = sum(steps for steps, _ in replayed.values())
    return about | {"steps_put_back": steps, "killed_with_episodes": moments, "seconds": seconds, "faults": faults}


def contents(boards: list[Any], steps: int) -> Row:
    """How many boards have what is hard in their world, and how often each mechanism is on them."""
    kinds = Counter(relation.kind for board in boards for relation in board.relations)
    return {
        "actions": steps * len(boards),
        "mechanisms": dict(kinds.most_common()),
        "boards_with_locks": sum(bool(board.locks) for board in boards),
        "boards_rewired_meanwhile": sum(any(one.step < steps for one in board.rewirings) for board in boards),
    }


def killed(case: Case, dataset: Dataset, arguments: Any) -> list[int]:
    """Collect, killed at random moments, to the end; how many episodes were there at each kill."""
    rng, moments = generator(arguments.seed, case.split, 0, f"kills {case.name}"), []
    command = case.command(dataset.path, arguments.assets)
    for wanted in sorted(int(number) for number in rng.integers(0, dataset.info.boards, size=KILLS)):
        due = _due(dataset, wanted, float(rng.uniform(0, EPISODE_SECONDS)))
        if kill_when(_started(command), due, POLL_SECONDS):
            moments.append(len(dataset.finished()))
        time.sleep(0.2)  # workers end with their parent
    if code := _started(command).wait():
        raise BusybotError(f"{case.name}: after {len(moments)} kills collecting exits with {code}")
    return moments


def _due(dataset: Dataset, wanted: int, delay: float) -> Callable[[], bool]:
    """Whether so many episodes have been there for so long, seconds."""
    since: list[float] = []

    def due() -> bool:
        if not since and len(dataset.finished()) >= wanted:
            since.append(time.monotonic())
        return bool(since) and time.monotonic() - since[0] >= delay

    return due


def _started(command: list[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _make_replay(path: Path, library: Library) -> Callable[[int], tuple[int, list[int]]]:
    """What a worker does with an episode: put every step back; returns how many, and those that differ."""
    dataset = Dataset.open(path)
    simulator = simulator_of(read_episode(dataset.episode_path(0), images="lazy"), library)

    def work(index: int) -> tuple[int, list[int]]:
        replay = EpisodeReplay(simulator, read_episode(dataset.episode_path(index), images="lazy"))
        steps = replay.episode.steps
        unlike = [
            number for number, step in enumerate(steps, start=1) if not _there_again(replay.put_back(number), step)
        ]
        return len(steps), unlike if replay.compare(len(steps)).holds else [*unlike, len(steps)]

    return work


def _there_again(scene: BoardScene, step: Step) -> bool:
    """Whether the board is as it was recorded after a step."""
    here = (scene.trigger_states(), scene.responder_states(), scene.memory)
    return here == (step.trigger_states_after, step.responder_states_after, step.memory_after)


def tried(case: Case, library: Library, arguments: Any) -> Row:
    """As `checked`; what could not be done at all is a fault. The folder is there while something is wrong only."""
    folder = arguments.work / case.world / case.split
    copy(Path("absent"), folder)  # frozen folders are read-only
    try:
        row = checked(case, library, folder, arguments)
    except BusybotError as error:
        row = {"commit": commit(), "faults": [f"{error.what}; {error.hint}"]}
    if not row["faults"]:
        copy(Path("absent"), folder)
    return row


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__)
    options.add_argument(
        "--work", type=Path, required=True, help="for the datasets, which are removed when all is well"
    )
    options.add_argument("--boards", type=int, default=60, help="of each world and split")
    options.add_argument("--seed", type=int, default=0, help="of the boards and of the moments")
    options.add_argument("--worlds", default=",".join((PAPER, *WORLDS)), help="which, in this order")
    arguments = options.parse_args(words)
    library, about = find(arguments.assets), {"assets": assets_name(arguments.assets)}
    rows = told_rows(arguments.out, KIND, **about, seed=arguments.seed)
    told = {**about, "rows": rows}
    wanted = cases(chosen(arguments.worlds, (PAPER, *WORLDS)))
    with episode_progress("worlds") as progress:
        for number, case in enumerate(wanted, start=1):
            if case.name not in rows or rows[case.name]["faults"]:
                rows[case.name] = tried(case, library, arguments)
                finish(KIND, arguments, told, hashes={"data": {"objects": {"sha256": library.sha256}}})
            for fault in rows[case.name]["faults"]:
                print(f"{case.name}: {fault}", file=sys.stderr, flush=True)
            progress(number, len(wanted))
    sys.exit(any(rows[case.name]["faults"] for case in wanted))


if __name__ == "__main__":
    one_of(main)
