"""Show that a change of the code changed no result: run the same commands on two checkouts and compare all they give.

    python -m benchmarks.reliability.same_results --checkout OLD --work OLD_WORK --out before.json
    python -m benchmarks.reliability.same_results --checkout NEW --work NEW_WORK --out after.json --resume-from OLD_WORK
    python -m benchmarks.reliability.same_results --compare before.json after.json

Only the command line is used (`python -m busybot` with this interpreter and the checkout in front of `PYTHONPATH`), so
the two may be laid out as they like. With `--resume-from` the second one continues what the first one left interrupted,
evaluations excepted, and judges the models that the first one trained. `--only 'eval/*'` runs some of the cases
(`same_results_cases`), and may be repeated.

Cases with real objects are left out where these are not found (BUSYBOT_PARTNET_DIR names their folder, else it is
`../shared/partnet-mobility` beside this repository).

The comparison is exact, except for a short list of keys and for rounding in graph networks. It
also demands, of each checkout, that two workers give what one gives, and interrupted work what uninterrupted work
gives. Exits with 1 if anything differs, or a command fails.
"""

import argparse
import fnmatch
import hashlib
import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from safetensors.numpy import load_file

from benchmarks.reliability.same_results_cases import (
    BOARDS,
    DATASETS,
    EVALUATIONS,
    FAILED,
    OTHERS,
    WORKS,
    Facts,
    Work,
    compare,
    may_round,
    stripped,
    within,
)
from benchmarks.runner import BUSYBOT, kill_when
from busybot.common.atomic_io import write_atomically
from busybot.evaluation.results import stamp

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = 4
"""Weights of a tensor that are written down where rounding may differ; elsewhere a hash of all is."""


class CommandError(Exception):
    """A command that did not do what it should."""


@dataclass
class Runner:
    """Commands of one checkout, in one folder; the datasets of `DATASETS` are made when they are first needed.

    Attributes:
        real: folder of the annotated objects, or None.
    """

    checkout: Path
    work: Path
    real: Path | None
    made: set[str] = field(default_factory=set)

    def environment(self) -> dict[str, str]:
        """With the checkout in front of what the caller has, and a cache of its own."""
        path = [str(self.checkout), *filter(None, [os.environ.get("PYTHONPATH")])]
        return {**os.environ, "PYTHONPATH": os.pathsep.join(path), "BUSYBOT_CACHE": str(self.work / "cache")}

    def words(self, command: str, **names: str) -> list[str]:
        """Of a command of the tables; a dataset that it names is there afterwards."""
        found = shlex.split(command)
        for name, value in {"real": str(self.real), **names}.items():
            found = [word.replace(f"{{{name}}}", value) for word in found]
        for word in found:
            if word.startswith("data/"):
                self.dataset(word)
        return found

    def busybot(self, *words: str) -> Facts:
        """What the command prints with `--json`."""
        command = [*BUSYBOT, *words, "--json"]
        done = subprocess.run(command, cwd=self.work, env=self.environment(), capture_output=True, text=True)
        if done.returncode:
            said = f"{done.stdout[-1500:]}{done.stderr[-1500:]}"
            raise CommandError(f"busybot {shlex.join(words)}: exit {done.returncode}: {said}")
        return json.loads(done.stdout)

    def portable(self, facts: Facts) -> Facts:
        """Without paths of this machine."""
        text = json.dumps(facts)
        for path, name in ((self.work, "WORK"), (self.checkout, "CHECKOUT"), (self.real, "OBJECTS")):
            text = text.replace(str(path), name) if path else text
        return json.loads(text)

    def generate(self, folder: str, options: str) -> Facts:
        return self.busybot("generate", folder, "--seed", "7", *self.words(options))

    def dataset(self, folder: str) -> None:
        """A dataset of `DATASETS`, generated and collected."""
        if folder in self.made:
            return
        generate, collect = DATASETS[folder.removeprefix("data/")]
        self.generate(folder, f"{generate} --boards 2")
        words = self.words(collect)
        self.busybot("collect", folder, *words, *(() if "--workers" in words else ("--workers", "1")))
        self.made.add(folder)

    def kill(self, words: Sequence[str], folder: Path, patterns: tuple[str, ...]) -> None:
        """Start a command, and kill it with all its processes when each pattern matches a file that is not empty."""
        with open(self.work / "killed.log", "wb") as log:
            options: dict[str, Any] = {"stdout": log, "stderr": log, "start_new_session": True}
            process = subprocess.Popen([*BUSYBOT, *words], cwd=self.work, env=self.environment(), **options)
            if not kill_when(process, lambda: all(_there(folder, pattern) for pattern in patterns), 0.002):
                raise CommandError(f"busybot {shlex.join(words)}: ended before it was killed")


def _there(folder: Path, pattern: str) -> bool:
    return any(path.is_file() and path.stat().st_size for path in folder.glob(pattern))


def boards(runner: Runner, options: str, name: str) -> Facts:
    made = runner.generate(f"boards/{name}", f"{options} --boards 4 --group-size 2")
    return {key: made[key] for key in ("board_hash", "redraws")}


def recorded(runner: Runner, folder: str) -> Facts:
    """All hashes of a dataset and of its decoded tables; it is made if it is absent."""
    info = runner.busybot("dataset", "info", *runner.words(shlex.quote(folder)))
    tables = sorted((runner.work / folder / "tables").rglob("*.parquet"))
    return {"info": info, "tables": {str(file.relative_to(runner.work / folder)): table_hash(file) for file in tables}}


def table_hash(file: Path) -> str:
    """Of the decoded values of a Parquet file, with names and types."""
    table = pq.read_table(file)
    text = json.dumps([str(table.schema.remove_metadata()), table.to_pylist()], default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def evaluated(runner: Runner, command: str, name: str) -> Facts:
    """Figures of a shipped model or baseline; they are kept for the report."""
    result = runner.busybot("eval", *runner.words(command), "--workers", "1")
    file = runner.work / "results" / f"{name}.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(result))
    return result


def straight(runner: Runner, work: Work, name: str) -> Facts:
    """What comes of work without an interruption."""
    if work.generate:
        runner.generate(f"straight/{name}", work.generate)
    return worked(runner, work, "straight", name)


def interrupt(runner: Runner, work: Work, name: str) -> None:
    folder = f"interrupted/{name}"
    if work.generate:
        runner.generate(folder, work.generate)
    words = runner.words(work.command, out=folder)
    runner.kill([*words, "--workers", "1"], runner.work / folder, work.killed_at)
    if (runner.work / folder / "model").exists():
        raise CommandError(f"{folder}: it was killed too late, the model was there")


def continued(runner: Runner, work: Work, name: str) -> Facts:
    """What comes of work that the older checkout left interrupted, or this one an evaluation."""
    begun = runner.work if work.evaluates else runner.work / "old"
    shutil.copytree(begun / "interrupted" / name, runner.work / "continued" / name)
    return worked(runner, work, "continued", name)


def worked(runner: Runner, work: Work, place: str, name: str) -> Facts:
    """Begin or continue work to its end, and tell what came of it."""
    folder = f"{place}/{name}"
    told = runner.busybot(*runner.words(work.command, out=folder), "--workers", "1")
    if work.generate:
        return recorded(runner, folder)
    facts = {key: value for key, value in told.items() if key not in ("out", "model", "command")}
    model = runner.work / folder / "model"
    return {"weights": weights(model, may_round(folder)), **facts} if model.is_dir() else facts


def weights(folder: Path, rounded: bool) -> Facts:
    """Of every file a hash; where rounding may differ, some values of every tensor."""
    found: dict[str, Facts] = {}
    for file in sorted(folder.glob("*.safetensors")):
        tensors = load_file(file)
        if rounded:
            found[file.name] = {name: _sampled(tensors[name]) for name in sorted(tensors)}
        else:
            found[file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return found


def _sampled(values: np.ndarray) -> Facts:
    flat = np.asarray(values, dtype=float).ravel()
    places = np.unique(np.linspace(0, flat.size - 1, SAMPLE).astype(int))
    return {"shape": list(values.shape), "largest": float(abs(flat).max()), "sample": flat[places].tolist()}


def judged(runner: Runner, work: Work, model: str) -> Facts:
    result = runner.busybot(*runner.words(work.judged, model=model), "--workers", "1")
    return {key: value for key, value in result.items() if key != "command"}


def other(runner: Runner, command: str) -> Facts:
    """What a command prints, and the values of a table that it wrote."""
    words = runner.words(command)
    found = runner.busybot(*words)
    if "--parquet" in words:
        found["table"] = table_hash(runner.work / words[words.index("--parquet") + 1])
    return found


def take_old(runner: Runner, old: Path) -> None:
    """Copy what the older checkout left: interrupted work, models and results."""
    for name in ("interrupted", "straight", "results"):
        if (old / name).is_dir():
            shutil.copytree(old / name, runner.work / "old" / name)


def cases(runner: Runner, old: Path | None) -> Iterator[tuple[str, Callable[[], Facts]]]:
    """All cases, in the order in which they are run: name, and what gives its facts, None if there are none."""
    for name, options in BOARDS.items():
        yield f"boards/{name}", partial(boards, runner, options, name)
    for name in DATASETS:
        yield f"data/{name}", partial(recorded, runner, f"data/{name}")
    for name, command in EVALUATIONS.items():
        yield f"eval/{name}", partial(evaluated, runner, command, name)
    for name, work in WORKS.items():
        yield f"straight/{name}", partial(straight, runner, work, name)
        if old is None or work.evaluates:
            yield f"interrupted/{name}", partial(interrupt, runner, work, name)
    yield "old", partial(take_old, runner, old or runner.work)
    for name, work in WORKS.items():
        yield f"continued/{name}", partial(continued, runner, work, name)
        if work.judged:
            yield f"old model/{name}", partial(judged, runner, work, f"old/straight/{name}")
        if work.judged and may_round(f"straight/{name}"):  # any other model has the old one's weights to the last bit
            yield f"own model/{name}", partial(judged, runner, work, f"straight/{name}")
    for name, command in OTHERS.items():
        yield f"other/{name}", partial(other, runner, command)


def prepare(runner: Runner) -> None:
    """A new folder with copies of the recordings that the checkout ships."""
    runner.work.mkdir(parents=True, exist_ok=True)
    if any(runner.work.iterdir()):
        raise SystemExit(f"{runner.work}: it is not empty; name a new folder")
    shutil.copytree(runner.checkout / "datasets" / "tiny", runner.work / "tiny")
    fixtures = next(folder for folder in (runner.checkout / "tests").rglob("fixtures") if (folder / "1.0").is_dir())
    shutil.copytree(fixtures, runner.work / "fixtures")


def run(runner: Runner, old: Path | None, only: Sequence[str], out: Path) -> dict[str, Facts]:
    """Facts of all cases, by name, which are written after each; of a case that failed, what was said."""
    prepare(runner)
    found: dict[str, Facts] = {}
    for name, work in cases(runner, old):
        wanted = name == "old" or any(fnmatch.fnmatchcase(name, pattern) for pattern in only)
        if not wanted or (runner.real is None and "real" in name):
            continue
        began = time.monotonic()
        try:
            facts = work()
        except (CommandError, OSError) as error:
            facts = {FAILED: str(error)}
            print(f"{name}: {error}", file=sys.stderr, flush=True)
        if facts is not None:
            found[name] = runner.portable(stripped(facts))
            write(out, runner.checkout, found)
        print(f"{name}: {time.monotonic() - began:.1f} s", file=sys.stderr, flush=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{(used.ru_utime + used.ru_stime) / 60:.1f} minutes of processor time", file=sys.stderr)
    return found


def write(file: Path, checkout: Path, facts: dict[str, Facts]) -> None:
    """What every result says of itself, with the checkout's commit (and a plus sign if tracked files were changed), and
    the cases, one per line."""
    git = ["git", "-C", str(checkout)]
    commit = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True).stdout.strip()
    changed = subprocess.run([*git, "status", "--porcelain", "-uno"], capture_output=True, text=True).stdout
    lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(value, sort_keys=True)}" for name, value in facts.items())
    command = "python -m benchmarks.reliability.same_results --checkout CHECKOUT --work WORK --out OUT"
    told = stamp("same-results", command=command) | {"commit": commit + ("+" if changed else "")}
    head = json.dumps(told, indent=1).removesuffix("\n}")
    write_atomically(file, f'{head},\n "cases": {{\n{lines}\n }}\n}}\n'.encode())


def read(file: Path) -> dict[str, Facts]:
    return dict(json.loads(file.read_text())["cases"])


def real_objects() -> Path | None:
    """Where the annotated PartNet-Mobility objects are, if anywhere."""
    named = os.environ.get("BUSYBOT_PARTNET_DIR")
    folder = Path(named) if named else ROOT.parent / "shared" / "partnet-mobility"
    return folder.resolve() if folder.is_dir() else None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkout", type=Path, help="repository to run")
    parser.add_argument("--work", type=Path, help="new folder for what the commands write")
    parser.add_argument("--out", type=Path, help="file for the facts")
    parser.add_argument("--resume-from", type=Path, help="the work folder of the older checkout")
    parser.add_argument("--only", action="append", help="pattern of names of cases; repeatable")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("A", "B"), help="files of two checkouts")
    given = parser.parse_args()
    if given.compare:
        return 1 if compare(*map(read, given.compare)) else 0
    if not (given.checkout and given.work and given.out):
        parser.error("give --checkout, --work and --out, or --compare")
    runner = Runner(given.checkout.resolve(), given.work.resolve(), real_objects())
    facts = run(runner, given.resume_from and given.resume_from.resolve(), given.only or ["*"], given.out)
    return 1 if within(facts) else 0


if __name__ == "__main__":
    sys.exit(main())
