"""A device's log of its own states, joined with a recording by time: lines of JSON with `ts` and `values`.

    {"ts": 1767225600.5, "device": "switches", "values": [1, 0]}        switches.0, switches.1
    {"ts": 1767225600.5, "values": {"red lamp": 1}}                     red lamp
    {"switches": {"values": [1, 0]}, "knob": {"values": [3]}}           as BusyBox's recorder stores it beside pictures

`ts` are seconds of the pictures' clock, or ISO 8601; `topic` may stand in place of `device`. An object's state in a
frame is what its key (column `state` of objects.csv) had last when the picture was taken. Values are numbered in order.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from os.path import lexists
from pathlib import Path
from typing import Any

import numpy as np

from busybot.common.atomic_io import inside, parse_json, read_text
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_LINES_BYTES
from busybot.datasets.importing.containers import logged_states
from busybot.datasets.importing.time_alignment import read_time

STATES_FILE = "states.jsonl"
MOST_STATES = 16
MOST_LINES = 4_000_000
"""Of a log: a day at 46 a second."""
LARGEST = 1e300
"""Of a value: whole numbers may be larger than a float can be."""
HINT = 'a line is {"ts": 12.5, "device": "switches", "values": [1, 0]}'


def read_states(
    folder: Path, container: Path | None, keys: Sequence[str | None], times: Sequence[float | None]
) -> np.ndarray | None:
    """States of N objects in frames 0 to T, int (T + 1, N), -1 where an object has no key; None without keys.

    Args:
        container: of the pictures, which may hold a log.
        keys: of the objects, None for those whose state is not known.
        times: of the frames.

    Raises:
        BusybotError: naming the line, or the key that is not there, or the frame that is too early.
    """
    if not any(keys):
        return None
    named, log = _log(folder, container)
    if any(at is None for at in times):
        raise BusybotError(f"{folder}: states are joined by time; when was each picture taken?", "frames.csv tells it")
    found = np.full((len(times), len(keys)), -1)
    for number, key in enumerate(keys):
        if key is None:
            continue
        told = [(at, values[key]) for at, values in log if key in values]
        if not told:
            known = sorted({name for _, values in log for name in values})
            what = f"{named}: no line of the log tells of {key!r}, as state of objects.csv has it"
            raise BusybotError(what, f"it tells of {', '.join(known[:20])}")
        found[:, number] = _joined(f"{named}: {key!r}", told, [at for at in times if at is not None])
    return found


def _joined(named: str, told: Sequence[tuple[float, float]], times: Sequence[float]) -> np.ndarray:
    when, values = np.array([at for at, _ in told]), np.array([value for _, value in told])
    last, first, end = np.searchsorted(when, times, side="right") - 1, min(times), max(times)
    if first < when[0] or end > when[-1] + max(3600.0, end - first):
        what = f"{named}: its log is from {when[0]:.10g} s to {when[-1]:.10g} s, "
        what += f"the pictures from {first:.10g} s to {end:.10g} s"
        raise BusybotError(what, "both are seconds of one clock; a log in another time zone?")
    kinds = np.unique(values)
    if len(kinds) > MOST_STATES:
        raise BusybotError(f"{named}: {len(kinds)} different values", f"log at most {MOST_STATES} states; round them")
    return np.searchsorted(kinds, values[last])


def _log(folder: Path, container: Path | None) -> tuple[Path, list[tuple[float, Mapping[str, float]]]]:
    """The file, and values by key in the order of time."""
    file = folder / STATES_FILE
    lines: Iterable[tuple[str, str, float | None]] = ()
    if lexists(file):
        text = io.StringIO(read_text(inside(folder, STATES_FILE), MAX_LINES_BYTES, HINT), newline=None)
        lines = ((f"{file}: line {n}", line, None) for n, line in enumerate(text, start=1))
    elif container is not None and (lines := logged_states(container)):
        file = container
    found: list[tuple[float, Mapping[str, float]]] = []
    for where, line, at in lines:
        if not line.strip():
            continue
        told, values = _line(where, line)
        at = told if told is not None else at
        if at is None:
            raise BusybotError(f"{where}: no ts", HINT)
        if found and at < found[-1][0]:
            raise BusybotError(
                f"{where}: its time {at:.10g} s is before that of the line before", "sort the log by time"
            )
        if len(found) == MOST_LINES:
            raise BusybotError(f"{file}: it has more than {MOST_LINES} lines", "log changes alone, or less often")
        found.append((at, values))
    if not found:
        raise BusybotError(f"{file}: objects have states, but nobody logged any", f"put {STATES_FILE} there; {HINT}")
    return file, found


def _line(where: str, line: str) -> tuple[float | None, dict[str, float]]:
    try:
        told = parse_json(line)
    except (ValueError, RecursionError) as error:
        raise BusybotError(f"{where}: not valid JSON: {error}", HINT) from None
    if not isinstance(told, dict):
        raise BusybotError(f"{where}: no object of JSON", HINT)
    if "values" in told:
        device = str(told.get("device", told.get("topic", "")))
        at = told.get("ts")
        seconds = read_time(None if at is None else str(at), where)
        return seconds, _values(where, device, told["values"])
    found: dict[str, float] = {}
    for device, state in told.items():
        if isinstance(state, dict) and "values" in state:
            found |= _values(where, device, state["values"])
        elif state is not None:
            raise BusybotError(f"{where}: {device[:40]!r} has no values", HINT)
    return None, found


def _values(where: str, device: str, values: Any) -> dict[str, float]:
    pairs = (
        list(enumerate(values))
        if isinstance(values, list)
        else list(values.items())
        if isinstance(values, dict)
        else None
    )
    if pairs is None or any(not isinstance(value, bool | int | float) or abs(value) > LARGEST for _, value in pairs):
        raise BusybotError(f"{where}: its values are no numbers, or beyond {LARGEST:g}", HINT)
    return {f"{device}.{name}" if device else str(name): float(value) for name, value in pairs}
