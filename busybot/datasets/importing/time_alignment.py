"""Times of actions and pictures: which picture shows what stood before each action, and what the last one left."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from busybot.common.errors import BusybotError

QUARTER_S = 900.0
"""Time zones differ by multiples of it."""
LONGEST_S = 26 * 3600.0
"""And by no more."""
LATEST_S = 1e12
"""A number beyond it is no time in seconds."""


def read_time(cell: str | None, where: str) -> float | None:
    """Seconds, of whatever clock; None for an empty cell. Times of the day without a zone are taken as UTC.

    Raises:
        BusybotError: the cell is neither a number nor a time of ISO 8601.
    """
    if cell is None:
        return None
    try:
        return _finite(float(cell))
    except ValueError:
        pass
    try:
        at = datetime.fromisoformat(cell.strip())
    except ValueError:
        raise BusybotError(f"{where}: {cell[:40]!r} is no time", "seconds, or 2026-05-01T12:00:00.25+02:00") from None
    return at.timestamp() if at.tzinfo else (at - datetime(1970, 1, 1)).total_seconds()


def _finite(number: float) -> float:
    if not abs(number) < LATEST_S:
        raise ValueError
    return number


Times = Sequence[tuple[float | None, str]]
"""Seconds, and file and line that tell them."""


def frames_around(file: Path, actions: Times, pictures: Times) -> list[int]:
    """Numbers of the pictures that show frames 0 to T. Without times there is one picture more than actions; with
    times the picture before an action is the last one that is older, and the last of all shows what the last one left.

    Args:
        file: that tells the actions, for messages.

    Raises:
        BusybotError: naming the line, if times do not fit, or there are too few pictures.
    """
    if all(at is None for at, _ in actions):
        if len(pictures) == len(actions) + 1:
            return list(range(len(pictures)))
        what = f"{file}: {len(actions)} actions need {len(actions) + 1} pictures, one before each and one after all; "
        timed = all(at is not None for at, _ in pictures)
        hint = "add a column time to actions.csv" + ("" if timed else " and to frames.csv")
        raise BusybotError(f"{what}there are {len(pictures)}", hint)
    if all(at is None for at, _ in pictures):
        hint = "frames.csv with columns file and time tells it"
        what = f"{file}: actions have times, {pictures[0][1]} has none; when was each picture taken?"
        raise BusybotError(what, hint)
    whens, times = _ordered(actions), _ordered(pictures)
    _check_within(whens, times, [where for _, where in actions], (pictures[0][1], pictures[-1][1]))
    places = (np.searchsorted(times, whens, side="left") - 1).tolist()
    for (before, after), (at, where) in zip(
        zip(places, [*places[1:], len(times) - 1], strict=True), actions, strict=True
    ):
        if before == after:
            then = f"{pictures[before][1]} is the last before it"
            what = f"{where}: no picture shows what the action at {at:.10g} s left; {then}"
            raise BusybotError(what, "a picture is needed before and after each; is time when the hand comes in?")
    return [*places, len(times) - 1]


def _ordered(told: Times) -> list[float]:
    times: list[float] = []
    for at, where in told:
        if at is None:
            raise BusybotError(f"{where}: no time", "give every line a time, or none")
        if times and at <= times[-1]:
            what = f"{where}: its time {at:.10g} s is not after {times[-1]:.10g} s of the line before"
            raise BusybotError(what, "put the lines into the order in which things happened")
        times.append(at)
    return times


def _check_within(
    actions: Sequence[float], times: Sequence[float], places: Sequence[str], ends: tuple[str, str]
) -> None:
    """Actions lie between the first and the last picture; else a shift is proposed, never taken."""
    outside = [number for number, at in enumerate(actions) if not times[0] < at < times[-1]]
    if not outside:
        return
    what = f"{places[outside[0]]}: the action at {actions[outside[0]]:.10g} s is outside of the pictures, "
    what += f"which are from {times[0]:.10g} s to {times[-1]:.10g} s ({ends[0]}; {ends[1]})"
    if len(outside) < len(actions):
        raise BusybotError(what, "was the recording cut? Remove the actions without pictures, or add the pictures")
    apart = np.round((times[0] - actions[0]) / QUARTER_S) * QUARTER_S + np.array([0, QUARTER_S, -QUARTER_S])
    fits = [shift for shift in apart.tolist() if times[0] < actions[0] + shift and actions[-1] + shift < times[-1]]
    if fits and abs(fits[0]) <= LONGEST_S:
        raise BusybotError(what, f"a clock in another time zone? with --shift {fits[0]:g} all of them fit")
    raise BusybotError(what, "--shift SECONDS moves the actions; are both in seconds of one clock?")
