"""Output for machines and errors for people: shared by all subcommands.

With `--json` a command prints exactly one JSON object on standard output, also when input or environment are at fault;
progress and logs go to standard error. After wrong usage or Ctrl-C standard output stays empty.
"""

import json
import os
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from busybot.common.errors import BusybotError, UsageError, explained, naming_extras
from busybot.common.quiet import is_quiet, quiet_within
from busybot.common.text import plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

JSON_WANTED = "busybot.json"
CONTEXT = {"help_option_names": ["-h", "--help"]}


def say(message: str) -> None:
    """A line of progress or explanation, on standard error; none with `--quiet`."""
    if not is_quiet():
        warn(message)


def warn(message: str) -> None:
    """A line on standard error that `--quiet` does not take away: what is wrong or will be."""
    print(plain(message), file=sys.stderr, flush=True)


def tell(message: object) -> None:
    """A line of a command's answer, on standard output; nothing in it reaches the terminal as a command to it."""
    print(plain(message), flush=True)


def console() -> "Console":
    """Where tables are printed: names in them are text, never markup, links or commands to the terminal.

    No table is cut. Where one needs more columns than a terminal has, it is printed in parts, one below the other; in
    files and pipes it is as wide as it needs.
    """
    from rich.console import Console
    from rich.table import Table

    class Plain(Console):
        def render_str(self, text: str, **how: Any) -> Any:
            return super().render_str(plain(text), **how)

        def print(self, *objects: Any, **how: Any) -> None:
            if len(objects) != 1 or not isinstance(objects[0], Table):
                super().print(*objects, **how)
            elif self.is_terminal:
                for part in _parts(self, objects[0]):
                    super().print(part, **how)
            else:
                usual, self.width = self.width, max(self.width, _width(self, objects[0]))
                super().print(*objects, **how)
                self.width = usual

    return Plain(markup=False, emoji=False)


def _width(screen: "Console", table: "Table", chosen: Sequence[int] | None = None) -> int:
    """How wide a screen must be for a table, or some of its columns, so that nothing is cut."""
    from rich.measure import Measurement

    wide, width = screen.options.update(width=10_000, max_width=10_000), 1
    for number in range(len(table.columns)) if chosen is None else chosen:
        found = Measurement.get(screen, wide, _with_columns(table, [number]))
        width += (found.maximum if table.columns[number].no_wrap else found.minimum) - 1  # columns share their borders
    return width


def _parts(screen: "Console", table: "Table") -> list["Table"]:
    """The table, or as many as are needed for none to be wider than the screen; each has the first column."""
    if len(table.columns) < 2 or _width(screen, table) <= screen.width:
        return [table]
    if _width(screen, table, [0]) > screen.width // 2:
        table.columns[0].no_wrap, table.columns[0].overflow = False, "fold"
    groups = [[0, 1]]
    for number in range(2, len(table.columns)):
        if _width(screen, table, [*groups[-1], number]) > screen.width:
            groups.append([0])
        groups[-1].append(number)
    parts = [_with_columns(table, group) for group in groups]
    for part in parts:
        part.title, part.caption = part.title if part is parts[0] else None, part.caption if part is parts[-1] else None
        if _width(screen, part) > screen.width:  # one cell alone is too long: it is broken
            for column in part.columns:
                column.no_wrap, column.overflow = False, "fold"
    return parts


def _with_columns(table: "Table", chosen: list[int]) -> "Table":
    from rich.table import Table

    columns = [table.columns[number] for number in chosen]
    part = Table(
        title=table.title, caption=table.caption, title_justify=table.title_justify, show_header=table.show_header
    )
    for column in columns:
        part.add_column(column.header, justify=column.justify, no_wrap=column.no_wrap, overflow=column.overflow)
    for row, cells in zip(table.rows, zip(*(column.cells for column in columns), strict=True), strict=True):
        part.add_row(*cells, style=row.style, end_section=row.end_section)
    return part


def processes(wanted: int | None) -> int:
    """How many share the work: as many as `--workers` says, or one per core."""
    from busybot.common.process_pool import default_workers

    return wanted or default_workers()


@contextmanager
def kept_in(out: Path) -> Iterator[None]:
    """Around work that goes on where it stopped: after Ctrl-C, say so."""
    try:
        yield
    except KeyboardInterrupt:
        say(f"what is done is kept in {out}; the same command continues")
        raise


def counted(number: int, thing: str) -> str:
    """`1 problem`, `2 problems`."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def pixel_shares(image: Any) -> str:
    """How much of a picture differs from another one (`ImageDifference`)."""
    return f"colour {image.colour:.3%}, depth {image.depth:.3%}, links {image.links:.3%} of the pixels"


def own_name() -> str:
    """How to call this program again: `busybot`, or its path when the environment is not active."""
    found = shutil.which("busybot")
    called = Path(sys.argv[0])
    if called.name != "busybot" or (found and Path(found).samefile(called)):
        return "busybot"
    return os.path.relpath(called) if called.is_relative_to(Path.cwd()) else str(called)


SYSTEMS_OWN = Path("/dev"), Path("/dev/fd"), Path("/proc/self/fd")
"""What lies there is no file of anybody's, also where it leads to one; folders in there, as `/dev/shm`, are."""


def check_file(option: str, path: Path | None, example: str, kind: str = "") -> None:
    """Refuse, before any work, what cannot be written where an option names a file to write.

    Args:
        kind: how the file's name has to end, as `.png`: a name says what it is.

    Raises:
        BusybotError: the path is a folder or a device, or lies where nothing can be made.
    """
    if path is None:
        return
    if path.is_dir():
        raise BusybotError(f"{path} is a folder", f"{option} names a file, for example {path / example}")
    if not path.name.lower().endswith(kind):
        raise BusybotError(f"{option} {path}: it writes {kind} files", f"name a file that ends in {kind}")
    if path.absolute().parent in SYSTEMS_OWN or (path.exists() and not path.is_file()):
        raise BusybotError(f"{path} is a device or a pipe", f"{option} names a file, which is replaced: {example}")
    there = next(place for place in path.absolute().parents if place.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        what = "cannot be written into" if there.is_dir() else "is no folder"
        raise BusybotError(f"{path} cannot be written: {there} {what}", f"choose another place for {option}")


def print_json(value: Any) -> None:
    """The one JSON object of a command with `--json`, on standard output; what is no number (NaN, infinity) is null."""
    try:
        text = json.dumps(value, default=_plain, allow_nan=False)
    except ValueError:
        text = json.dumps(json.loads(json.dumps(value, default=_plain), parse_constant=lambda _: None))
    print(text, flush=True)


def answer(json: bool, facts: Any, *lines: str) -> None:
    """What a command leaves: one JSON object with `--json`, else lines for people, on standard error."""
    if json:
        print_json(facts)
    else:
        for line in lines:
            say(line)


def _plain(value: Any) -> Any:
    """What json does not know: paths, dataclasses, pydantic models, numpy scalars and arrays."""
    if isinstance(value, Path):
        return plain(value)
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    if hasattr(value, "__dataclass_fields__"):
        return {name: getattr(value, name) for name in value.__dataclass_fields__}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, set | frozenset):
        return sorted(value)
    raise TypeError(f"cannot write a {type(value).__name__} as JSON")


@contextmanager
def report_errors(context: typer.Context) -> Iterator[None]:
    """Turn faults of input and environment into `error: ...` and exit code 1, wrong usage into 2, Ctrl-C into 130.

    `busybot.cli.main` does this around every subcommand.
    """
    with quiet_within():
        try:
            with naming_extras():
                yield
        except BusybotError as error:
            _report(context, error)
        except BrokenPipeError:
            raise  # the reader of our output has gone, as `head` does: typer ends quietly
        except (OSError, MemoryError) as error:
            # of the system: nothing that our own code expected, but something that the user can mend
            _report(context, explained(error))
        except KeyboardInterrupt:
            say("interrupted")
            raise typer.Exit(130) from None


def _report(context: typer.Context, error: BusybotError) -> NoReturn:
    warn(f"error: {error}")
    if isinstance(error, UsageError):
        raise typer.Exit(2) from None
    if context.meta.get(JSON_WANTED):
        print_json({"error": error.what, "hint": error.hint})
    raise typer.Exit(1) from None


@contextmanager
def native_output_on_stderr(wanted: bool) -> Iterator[None]:
    """Let native libraries and child processes that write to file descriptor 1 write to standard error instead.

    SAPIEN logs to standard output from C++; Python's `sys.stdout` keeps the real one, so the JSON stays alone there.
    """
    if not wanted:
        yield
        return
    sys.stdout.flush()
    real = os.dup(1)
    os.dup2(2, 1)
    before = sys.stdout
    sys.stdout = os.fdopen(real, "w", encoding="utf-8", errors="backslashreplace")
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stdout, opened = before, sys.stdout
        os.dup2(opened.fileno(), 1)
        opened.close()


@contextmanager
def episode_progress(label: str) -> Iterator[Any]:
    """A callback (done, total) that shows progress with rate and time left on standard error.

    On a terminal it is a bar; elsewhere a line is printed every few seconds, so that logs stay short. With `--quiet`
    there is neither.
    """
    if is_quiet():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _LinePrinter(label)
        return
    rate = TextColumn("{task.fields[rate]}")
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        rate,
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(plain(label), total=None, rate="")
        started: dict[str, float] = {}

        def update(done: int, total: int) -> None:
            first = started.setdefault("done", done - 1)
            seconds = time.monotonic() - started.setdefault("time", time.monotonic())
            speed = f"{(done - first - 1) / seconds:.2f}/s" if seconds > 0 else ""
            bar.update(task, completed=done, total=total, rate=speed)

        yield update


class _LinePrinter:
    """Prints done, total, rate and time left, at most every `SECONDS` seconds and at the end."""

    SECONDS = 10.0

    def __init__(self, label: str):
        self._label, self._began, self._first, self._last = label, time.monotonic(), -1, 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if self._first < 0:
            self._first = done - 1
        if now - self._last < self.SECONDS and done < total:
            return
        self._last = now
        rate = (done - self._first) / max(now - self._began, 1e-9)
        say(f"{self._label}: {done} of {total}, {rate:.2f}/s, {(total - done) / rate:.0f} s left")
