"""Kill commands at random moments and see that the same command continues to an equal end, and that nothing is lost.

    python -m benchmarks.reliability.kills [--commands collect,freeze,repair] [--kills 20] [--out FILE]

Every trial starts from the same state, kills the command and all of its processes (SIGKILL) once, runs it again to its
end, and compares all files with those of an undisturbed run. Half of the moments are drawn over the whole run, half
from the first change on disk on, so that they meet the writing and not only the start of Python; a moment after the end
is drawn again. Looked at right after each kill:

- collect: every finished episode is whole; afterwards none was recorded again.
- freeze: the dataset is either not frozen and as it was, or frozen with a whole manifest.
- repair: the bytes of every damaged file are still there.
- train: the training in rounds, for which the last model and its networks are compared.
"""

import fnmatch
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.runner import BUSYBOT, chosen, finish, kill_when, one_of, parser, settings
from busybot.common.atomic_io import scan, sha256_of
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.manifest import is_frozen, read_manifest
from busybot.datasets.verify import verify

SMALL = settings("render.width=160", "render.height=120")
COLLECT = ["collect", "{}", "--policy", "scripted", "--steps", "4", "--workers", "2", *SMALL]
BOARDS = 8
PARAMETERS = (
    *("validation=0", "interaction.delta=30", "position.checkpoint=5", "direction.checkpoint=5"),
    "rounds=[{boards: 4, steps: 12, position: 20, direction: 20}, {boards: 2, steps: 8, position: 20, direction: 20}]",
)
TRAIN = ["train", "interact", "--out", "{}", "--workers", "1", *SMALL, *settings(*PARAMETERS)]
POLL_SECONDS = 0.005
LONGEST_SECONDS = 1800
DATA = "*"
"""All files, except for the lock."""
Facts = dict[str, str]


@dataclass(frozen=True)
class Subject:
    """A command that is killed.

    Attributes:
        arguments: `{}` stands for the folder.
        prepare: brings a new folder into the state in which the command starts.
        compared: which of its files must come out equal, a pattern.
        after_kill: raises AssertionError if something was lost; given the folder as it was, and as it is.
    """

    arguments: list[str]
    prepare: Callable[[Path], None]
    compared: str
    after_kill: Callable[[Path, Path], None]


def command(arguments: list[str], folder: Path) -> list[str]:
    return [*BUSYBOT, *(argument.replace("{}", str(folder)) for argument in arguments)]


def run(arguments: list[str], folder: Path) -> None:
    """Run to the end; what it printed is shown if it fails."""
    done = subprocess.run(command(arguments, folder), capture_output=True, text=True, timeout=LONGEST_SECONDS)
    if done.returncode:
        raise BusybotError(f"{' '.join(arguments)} exits with {done.returncode}: {done.stderr[-2000:]}")


def files(folder: Path, compared: str) -> Facts:
    """Hash and permissions of the files that are compared."""
    names = [name for name in scan(folder).files if name != ".lock" and fnmatch.fnmatchcase(name, compared)]
    return {name: f"{sha256_of(folder / name)} {(folder / name).stat().st_mode & 0o777:o}" for name in names}


def copy(source: Path, target: Path) -> None:
    """The folder with its times; the old copy goes."""
    if target.exists():
        for place in [target, *target.rglob("*")]:
            place.chmod(0o755)
        shutil.rmtree(target)
    if source.exists():
        shutil.copytree(source, target)


def subjects(base: Path) -> dict[str, Subject]:
    """All commands; their starting states are made once, in `base`."""
    boards, collected = base / "boards", base / "collected"

    def prepare_boards(folder: Path) -> None:
        if not boards.exists():
            run(["generate", "{}", "--boards", str(BOARDS), "--group-size", "2"], boards)
        copy(boards, folder)

    def prepare_collected(folder: Path) -> None:
        if not collected.exists():
            prepare_boards(collected)
            run(COLLECT, collected)
        copy(collected, folder)

    def prepare_damaged(folder: Path) -> None:
        prepare_collected(folder)
        rng = generator(0, "kills", 0, "damage")
        for index in range(0, BOARDS, 2):
            file = folder / f"episodes/{index:06d}.mcap"
            data = file.read_bytes()
            file.write_bytes(data[: int(rng.uniform(0.3, 1.0) * len(data))])
        (folder / "tables/steps/part-00000.parquet").write_bytes(b"torn")

    def prepare_nothing(folder: Path) -> None:
        copy(base / "none", folder)

    return {
        "collect": Subject(COLLECT, prepare_boards, DATA, episodes_whole),
        "freeze": Subject(["dataset", "freeze", "{}", "--workers", "1"], prepare_collected, DATA, frozen_or_not),
        "repair": Subject(["dataset", "repair", "{}", "--workers", "1"], prepare_damaged, DATA, originals_there),
        "train": Subject(TRAIN, prepare_nothing, "model/*.safetensors", lambda before, after: None),
    }


def episodes_whole(before: Path, after: Path) -> None:
    """Only episodes; tables may be behind."""
    problems = [problem for problem in verify(after).problems if problem.file.endswith(".mcap")]
    faults = [f"{problem.file}: {problem.what}" for problem in problems]
    assert not faults, f"a finished episode is damaged: {faults}"


def frozen_or_not(before: Path, after: Path) -> None:
    data = {name: size for name, size in scan(before).files.items() if name != ".lock"}
    for name in data:
        assert sha256_of(before / name) == sha256_of(after / name), f"{name} was changed by freezing"
    if is_frozen(after):
        listed = read_manifest(after).files
        assert data.keys() <= listed.keys(), "frozen without all files in the manifest"
        assert verify(after).ok, "frozen and not sound"


def originals_there(before: Path, after: Path) -> None:
    kept = {sha256_of(after / name) for name in scan(after).files}
    for name in scan(before / "episodes").files:
        assert sha256_of(before / "episodes" / name) in kept, f"the only copy of {name} is lost"


def changed(folder: Path, before: dict[str, int]) -> bool:
    try:
        return folder.exists() and scan(folder).files != before
    except FileNotFoundError:  # a temporary file went while we looked: something is being written
        return True


def started(subject: Subject, folder: Path) -> subprocess.Popen[bytes]:
    words, quiet = command(subject.arguments, folder), subprocess.DEVNULL
    return subprocess.Popen(words, start_new_session=True, stdout=quiet, stderr=quiet)


def undisturbed(subject: Subject, folder: Path) -> tuple[Facts, float, float]:
    """Files at the end, seconds until the first change on disk, and seconds in all."""
    subject.prepare(folder)
    before = scan(folder).files if folder.exists() else {}
    process, began, first = started(subject, folder), time.monotonic(), None
    while process.poll() is None:
        if first is None and changed(folder, before):
            first = time.monotonic() - began
        time.sleep(POLL_SECONDS)
    seconds = time.monotonic() - began
    if process.returncode:
        raise BusybotError(f"the undisturbed run fails: {' '.join(command(subject.arguments, folder))}")
    return files(folder, subject.compared), seconds if first is None else first, seconds


def killed(subject: Subject, folder: Path, start: Path, delay: float, after_change: bool) -> float | None:
    """Kill once; the moment in seconds, or None if the command had ended before."""
    copy(start, folder)
    before = scan(folder).files if folder.exists() else {}
    process, began = started(subject, folder), time.monotonic()
    while after_change and process.poll() is None and not changed(folder, before):
        time.sleep(POLL_SECONDS)
    end = time.monotonic() + delay
    if not kill_when(process, lambda: time.monotonic() >= end, POLL_SECONDS):
        return None
    time.sleep(0.2)  # workers end with their parent
    return end - began


def trial(subject: Subject, start: Path, folder: Path, expected: Facts) -> list[str]:
    """After a kill: what is lost, and how the same command ends unlike the undisturbed one."""
    faults = []
    try:
        subject.after_kill(start, folder)
    except AssertionError as error:
        faults.append(str(error))
    finished = {} if not (folder / "episodes").is_dir() else times(folder)
    run(subject.arguments, folder)
    found = files(folder, subject.compared)
    names = sorted(name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name))
    faults += [f"{name} differs" for name in names]
    if subject.arguments[0] == "collect":
        now = times(folder)
        faults += [f"{name} was recorded again" for name, when in finished.items() if now.get(name) != when]
    return faults


def times(folder: Path) -> dict[str, int]:
    dataset = Dataset.open(folder)
    return {path.name: path.stat().st_mtime_ns for path in map(dataset.episode_path, dataset.finished())}


def campaign(name: str, subject: Subject, kills: int, seed: int, base: Path) -> dict[str, Any]:
    start, folder = base / f"{name}-start", base / name
    subject.prepare(start)
    expected, first, seconds = undisturbed(subject, folder)
    rng = generator(seed, "kills", 0, name)
    moments: list[float] = []
    faults: list[str] = []
    missed = 0
    while len(moments) < kills and missed < 5 * kills:
        after_change = len(moments) % 2 == 1
        delay = float(rng.uniform(0, seconds - first if after_change else seconds))
        moment = killed(subject, folder, start, delay, after_change)
        if moment is None:
            missed += 1
            continue
        found = trial(subject, start, folder, expected)
        faults += [f"kill {len(moments)} after {moment:.2f} s: {fault}" for fault in found]
        moments.append(round(moment, 3))
        print(f"{name}: kill {len(moments)} of {kills} after {moment:.2f} s", *faults[-1:], file=sys.stderr, flush=True)
    return {
        "kills": len(moments),
        "equal_end": not faults and len(moments) == kills,
        "faults": faults,
        "seconds_undisturbed": round(seconds, 2),
        "seconds_until_first_change": round(first, 2),
        "moments_s": moments,
        "files_compared": len(expected),
        "sha256_of_end": hashlib.sha256(json.dumps(expected, sort_keys=True).encode()).hexdigest(),
    }


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--commands", default="collect,freeze,repair", help="of collect, freeze, repair, train")
    options.add_argument("--kills", type=int, default=20, help="of each command")
    options.add_argument("--seed", type=int, default=0, help="of the moments")
    arguments = options.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="busybot-kills-") as folder:
        known = subjects(Path(folder))
        names = chosen(arguments.commands, known)
        found = {name: campaign(name, known[name], arguments.kills, arguments.seed, Path(folder)) for name in names}
        for name in names:
            copy(Path("absent"), Path(folder) / name)  # frozen folders are read-only
    print(json.dumps(finish("kills", arguments, {"results": found}), indent=1))
    sys.exit(0 if all(one["equal_end"] for one in found.values()) else 1)


if __name__ == "__main__":
    one_of(main)
