"""Run a stage of dvc.yaml so that it goes on where it was interrupted.

    python -m pipelines.stage OUT... [--input PATH...] -- BUSYBOT-ARGUMENTS [-- BUSYBOT-ARGUMENTS ...]

busybot's commands continue in the folders that they began. So what a stage left behind is kept (`persist: true`) as
long as it comes from the same commands, inputs, objects and code; otherwise it is removed first. Beside the first OUT,
in `.stages`, a note tells the commands, their wall time and their processor time, those of interrupted runs included.
"""

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from busybot.common import plugins
from busybot.common.atomic_io import read_json, remove, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.evaluation.results import code_digest

ASSETS = "--assets"
STATE = ".stages"
NOTE_EVERY_S = 20.0
INTERRUPTED = 130


class Note(BaseModel):
    """What is known of a stage.

    Attributes:
        key: digest of all that decides its outputs.
        commands: of busybot, in order.
        seconds: that they took, what was lost with a killed process being less than `NOTE_EVERY_S`.
        cpu_seconds: of all their processes, those of a command that is interrupted left out.
        done: whether the last of them ended well.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    commands: list[list[str]]
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    done: bool = False


def digest(path: Path) -> str:
    """Of a file, or of all files of a folder with their names; caches of the interpreter are no part of it."""
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    total = hashlib.sha256()
    for file in files:
        if "__pycache__" not in file.parts:
            total.update(f"{file.relative_to(path.parent).as_posix()}\0".encode())
            total.update(hashlib.sha256(file.read_bytes()).digest())
    return total.hexdigest()


def objects(commands: list[list[str]]) -> dict[str, str]:
    """Digests of the folders of objects that commands name; other objects come with the code or with a package."""
    named = {after for command in commands for word, after in pairwise(command) if word == ASSETS}
    return {name: digest(Path(name)) for name in sorted(named) if Path(name).is_dir()}


def note_of(out: Path) -> Path:
    """Where the note of a stage with this output lies."""
    return out.parent / STATE / f"{out.name}.json"


def read_note(file: Path) -> Note:
    """A note that is there.

    Raises:
        BusybotError: it is damaged; names the file.
    """
    hint = "remove it: the stage begins anew"
    try:
        return Note.model_validate(read_json(file))
    except ValidationError as error:
        raise BusybotError(f"{file}: {first_fault(error)}", hint) from None
    except BusybotError as error:
        raise BusybotError(error.what, hint) from None


def key_of(commands: list[list[str]], inputs: list[Path]) -> str:
    """Digest of all that decides what the commands make."""
    parts = [code_digest(), *plugins.packages().values(), *map(digest, inputs), *objects(commands).values()]
    return hashlib.sha256(json.dumps([commands, parts]).encode()).hexdigest()


def begin(outs: list[Path], key: str, commands: list[list[str]]) -> Note:
    """Note what the outputs are made from; remove what was made from something else.

    What an earlier run took counts if it was interrupted; of one that was done, as long as its outputs are there.
    """
    file = note_of(outs[0])
    known = read_note(file) if file.is_file() else Note(key="", commands=[])
    same = known.key == key
    if same and (not known.done or all(out.exists() for out in outs)):
        return known
    for out in outs if not same else []:
        remove(out)
    note = Note(key=key, commands=commands)
    write_json(file, note.model_dump())
    return note


def run(commands: list[list[str]], note: Note, file: Path) -> int:
    """The exit code of the first command that fails, or 0, or 130 after Ctrl-C; time is noted as it passes.

    Of a stage that was done the outputs are there already: looking at them once more is no cost of theirs.
    """
    began, code, interrupted = time.monotonic(), 0, False
    together = max if note.done else sum

    def keep(done: bool) -> None:
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)  # only commands that ended are in it
        spent = {
            "seconds": round(together((note.seconds, time.monotonic() - began)), 1),
            "cpu_seconds": round(together((note.cpu_seconds, ended.ru_utime + ended.ru_stime)), 1),
        }
        write_json(file, note.model_copy(update={**spent, "done": done}).model_dump())

    for command in commands:
        with subprocess.Popen([sys.executable, "-m", "busybot", *command]) as process:
            while process.poll() is None:
                try:
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(NOTE_EVERY_S)
                    keep(done=False)
                except KeyboardInterrupt:  # the command heard it, too: what it still stores is there before we end
                    interrupted = True
        code = INTERRUPTED if interrupted else process.returncode
        if code:
            break
    keep(done=code == 0)
    return code


def main() -> int:
    own, *commands = _split(sys.argv[1:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="+", type=Path)
    parser.add_argument("--input", nargs="*", type=Path, default=[])
    arguments = parser.parse_args(own)
    key = key_of(commands, arguments.input)
    return run(commands, begin(arguments.out, key, commands), note_of(arguments.out[0]))


def _split(words: list[str]) -> list[list[str]]:
    """Parts between the words `--`."""
    parts: list[list[str]] = [[]]
    for word in words:
        if word == "--":
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


if __name__ == "__main__":
    try:
        sys.exit(main())
    except BusybotError as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
