"""A training's folder: what was asked for, so that the same command continues and another one is refused."""

from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from busybot import __version__
from busybot.common.atomic_io import read_json, scan, write_json
from busybot.common.errors import BusybotError

TRAIN_FILE = "train.json"


def begin_folder(out: Path, config: BaseModel, seed: int, before: Collection[str] = (), **more: Any) -> None:
    """Note what is asked for, or refuse to continue a training that was asked for otherwise.

    Args:
        before: names that may lie in a folder in which a training begins.
        more: what else decides the outcome, JSON values.
    """
    wanted = {"seed": seed, "config": config.model_dump(mode="json"), **more}
    if out.exists() and not out.is_dir():
        raise BusybotError(f"{out}: it is a file", "name a folder")
    if others := scan(out).others if out.is_dir() else []:
        what = f"{out / others[0]}: a link or device; a training writes through none"
        raise BusybotError(what, "put a copy of what it leads to in its place, or remove it")
    if not (out / TRAIN_FILE).exists():
        strangers = sorted({entry.name for entry in out.iterdir()} - set(before)) if out.is_dir() else []
        if strangers:
            raise BusybotError(f"{out}: it holds {strangers[0]!r} and no {TRAIN_FILE}", "name another folder")
        write_json(out / TRAIN_FILE, wanted)
        return
    recorded = read_json(out / TRAIN_FILE)
    differing = _differences(recorded, wanted, "")
    if differing:
        raise BusybotError(
            f"{out}: a training with other parameters was begun there: {'; '.join(differing[:5])}",
            "continue it with the same parameters, or name another folder",
        )


def _differences(recorded: Any, wanted: Any, place: str) -> list[str]:
    if isinstance(recorded, dict) and isinstance(wanted, dict):
        names = sorted(recorded.keys() | wanted.keys())
        return [d for n in names for d in _differences(recorded.get(n), wanted.get(n), f"{place}.{n}".lstrip("."))]
    return [] if recorded == wanted else [f"{place} {recorded!r}, now {wanted!r}"]


def learner_versions() -> dict[str, str]:
    """Versions of what decides the weights."""
    return {"busybot": __version__, **{name: version(name) for name in ("torch", "numpy")}}
