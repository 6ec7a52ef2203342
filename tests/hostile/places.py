"""Links, pipes, sockets, holes and strange names in the place of any file or folder that a command finds.

A case replaces one entry of a folder and runs one command on it. It must end within the limits: with the answer for the
folder as it was, or with an exit code, a hint and the name of what lies there. What the links lead to stays untouched.
"""

import json
import os
import re
import shutil
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from busybot.common.text import plain
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.freeze import freeze
from busybot.reason.inputs.feature_store import features_of
from tests.episodes.folders import make_dataset
from tests.hostile.damage import TEXTS
from tests.hostile.targets import NOTICED, OBJECT, Target, _object, _reasoner, _result, _said

LINE = "links, pipes and holes for files and folders"
AWAY, COMMAND = "away", "command.json"
"""Where links lead, and what is run on the folder."""
ODD_NAMES = (
    *(text for text in TEXTS if text.isprintable() and 0 < len(text) < 100),
    "\x1b[31m",
    "\udcff",
    "a\nb",
    "-x",
    "..x",
)
Commands = tuple[tuple[str, ...], ...]


def replaced(folder: Path, rng: np.random.Generator) -> tuple[Path, str]:
    """Put something else in the place of an entry, or beside it; returns which, and what."""
    commands = json.loads((folder / COMMAND).read_text())["all"]
    words = commands[int(rng.integers(len(commands)))]
    named = {word[1:] for word in words if word.startswith("@")}  # with what lies beside: OUT.partial, DATASET.features
    entries = sorted(p for p in folder.rglob("*") if p.relative_to(folder).parts[0].partition(".")[0] in named)
    depths = [len(path.parts) for path in entries]
    depth = sorted(set(depths))[int(rng.integers(len(set(depths))))]  # folders are few, and as tempting
    chosen = [path for path in entries if len(path.parts) == depth]
    path = chosen[int(rng.integers(len(chosen)))]
    if rng.random() < 0.1 and path.parent != folder:
        path = path.parent / ODD_NAMES[int(rng.integers(len(ODD_NAMES)))].replace("/", "|")
        what = "beside others: "
    else:
        shutil.move(path, folder / AWAY / "same")
        what = ""
    kinds = sorted(NODES)
    kind = kinds[int(rng.integers(len(kinds)))]
    NODES[kind](path)
    same = folder / AWAY / "same"
    names = sorted({path.name, *(one.name for one in same.rglob("*"))})
    if path.name == "episodes" and kind in ("empty folder", "deep folders"):
        names.append("no board has an episode")  # and so it is

    asked = path.parent == folder and path.name in named and path.is_symlink()
    (folder / COMMAND).write_text(json.dumps({"one": words, "names": names, "asked": kind if asked else ""}))
    return path, f"{what}{kind}; {' '.join(words)}"


def _link(target: str) -> Callable[[Path], None]:
    """A link to this; `AWAY` lies beside what commands get."""

    def make(path: Path) -> None:
        away = next(parent / AWAY for parent in path.parents if (parent / AWAY).is_dir())
        path.symlink_to(target.format(away=away, name=os.fsdecode(os.fsencode(path.name))))

    return make


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        folder = os.open(path.parent, os.O_PATH)  # the whole path may be longer than the name of a socket
        made.bind(f"/proc/self/fd/{folder}/{path.name}"[:100])
        os.close(folder)


def _hole(size: int, path: Path) -> None:
    path.touch()
    os.truncate(path, size)


def _deep(path: Path) -> None:
    """Folders in each other, as deep as a path can be, and a link back up."""
    for _ in range(30):
        path.mkdir()
        path = path / ("x" * 100)
    path.symlink_to("../../..")


NODES: dict[str, Callable[[Path], None]] = {
    "link to what was there": _link("{away}/same"),
    "link to a file": _link("{away}/precious"),
    "link to a folder": _link("{away}/folder"),
    "link to nothing": _link("{away}/nothing"),
    "link to itself": _link("{name}"),
    "link to its folder": _link("."),
    "link to /dev/zero": _link("/dev/zero"),
    "link to /proc/self/mem": _link("/proc/self/mem"),
    "pipe": os.mkfifo,
    "socket": _socket,
    "hole of 30 GB": partial(_hole, 30 * 10**9),
    "hole of 4 TB": partial(_hole, 4 * 10**12),
    "empty file": Path.touch,
    "empty folder": Path.mkdir,
    "deep folders": _deep,
}


def _state(folder: Path) -> list[tuple[Any, ...]]:
    """What a link leads to; not its content where it is large."""
    rows = []
    for path in [folder, *sorted(folder.rglob("*"))]:
        facts = path.lstat()
        data = path.read_bytes() if path.is_file() and not path.is_symlink() and facts.st_size < 1 << 20 else b""
        rows.append((str(path), facts.st_mode, facts.st_size, facts.st_mtime_ns, data))
    return rows


def _run(folder: Path, words: list[str]) -> str:
    """What a command says; names of what was found in the folder are places in it."""
    words = [str(folder / word[1:]) if word.startswith("@") else word for word in words]
    code, out, err = _said([*words, "--quiet"])
    if code not in (0, 1, 2):
        raise ValueError(f"exit code {code}")
    said = (out + err).decode()
    told = re.sub("[━─-]+", "-", out.decode().replace(str(folder), ""))  # a table is as wide as the folder's name
    return f"{NOTICED}: {said}" if code else " ".join(told.split())


_expected: dict[str, str] = {}


def _commanded(folder: Path) -> Any:
    """`True` if the answer is the one for the folder as it was; of that folder, each command's answer is kept."""
    asked = json.loads((folder / COMMAND).read_text())
    for words in asked.get("all", ()):
        copy = folder.with_name("copy")
        shutil.copytree(folder, copy)
        _expected[json.dumps(words)] = answer = _run(copy, words)
        assert not answer.startswith(NOTICED), answer
        shutil.rmtree(copy)
    if "one" not in asked:
        return True
    before = _state(folder / AWAY)
    answer = _run(folder, asked["one"])
    if _state(folder / AWAY) != before and asked["asked"] != "link to what was there":
        raise ValueError("what a link leads to was changed")
    if not answer.startswith(NOTICED):
        return bool(asked["asked"]) or answer == _expected[json.dumps(asked["one"])] or answer
    if not any(plain(name) in answer for name in asked["names"]):
        raise ValueError(f"nothing of {asked['names'][:5]} is named: {answer[:300]}")
    return NOTICED


def _place(make: Callable[[Path], None], commands: Commands, every: int = 2) -> Target:
    def made(folder: Path) -> None:
        make(folder)
        (folder / AWAY / "folder").mkdir(parents=True)
        (folder / AWAY / "folder" / "precious").write_bytes(b"precious")
        (folder / AWAY / "precious").write_bytes(b"precious")
        (folder / COMMAND).write_text(json.dumps({"all": commands}))

    return Target(made, "", (), _commanded, True, LINE, every, replaced)


def _recorded(folder: Path) -> None:
    features_of(make_dataset(folder / "d", boards=2, finished=(0, 1)), workers=1)


def _frozen(folder: Path) -> None:
    _recorded(folder)
    freeze(folder / "d", None)
    for path in sorted(folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def _reports(folder: Path) -> None:
    _result(folder)
    _said(["report", str(folder / "r"), "--out", str(folder / "page"), "--quiet"])


def _trained(folder: Path) -> None:
    _reasoner(folder)
    (folder / "m" / "README.md").unlink(missing_ok=True)  # nobody reads it


def _exported(folder: Path) -> None:
    dataset = make_dataset(folder / "d", boards=2, finished=(0, 1))
    for form in FORMATS:
        with suppress(InterruptedError):
            export_recordings(dataset, form, folder / form, progress=_cut)
    export_recordings(dataset, "images", folder / "i")
    export_recordings(dataset, "lerobot", folder / "l")


def _cut(done: int, count: int) -> None:
    raise InterruptedError


def _objects(folder: Path) -> None:
    _object(OBJECT)(folder / "o")
    _object("Lamp/bulb-01")(folder / "o")
    split = {kind: {"train": [name], "test": []} for kind, name in (OBJECT.split("/"), ("Lamp", "bulb-01"))}
    (folder / "o" / "data.json").write_text(json.dumps({"Reason": split}))


FORMATS = ("images", "parquet", "lerobot")
DATASET: Commands = (
    ("dataset", "info", "@d"),
    ("dataset", "verify", "@d", "--workers", "1"),
    ("features", "@d", "--workers", "1"),
    ("eval", "reason", "@d", "--reasoner", "count", "--images", "4", "--workers", "1"),
    ("dataset", "export", "@d", "--to", "images", "--out", "@new", "--workers", "1"),
    ("view", "@d", "--episode", "0", "--figure", "@new.png"),
)
UNFROZEN: Commands = (
    *DATASET,
    ("dataset", "repair", "@d", "--workers", "1"),
    ("dataset", "freeze", "@d", "--no-objects", "--workers", "1"),
)
PLACES: dict[str, Target] = {
    "places in datasets": _place(_recorded, UNFROZEN, 1),
    "places in frozen datasets": _place(_frozen, DATASET),
    "places in models": _place(
        _trained, (("models", "info", "@m"), ("models", "verify", "@m"), ("models", "list", "@m"))
    ),
    "places in reports": _place(_reports, (("report", "@r", "--out", "@page"),), 8),
    "places in exports": _place(
        _exported,
        (
            *(("dataset", "export", "@d", "--to", form, "--out", f"@{form}", "--workers", "1") for form in FORMATS),
            ("dataset", "import", "@i", "--out", "@new"),
            ("dataset", "import", "@l", "--camera", "observation.images.rgb", "--out", "@new"),
        ),
    ),
    "places in objects": _place(
        _objects, (("assets", "list", "@o"), ("assets", "check", "@o"), ("assets", "merge", "@o", "--out", "@new"))
    ),
}
