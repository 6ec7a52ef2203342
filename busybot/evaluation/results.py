"""One format of result files: a JSON object that says what its figures are and where they come from.

Before the figures of its kind every file has these keys; what is not known or does not apply is null, or empty.

| key | what |
|---|---|
| `kind` | which figures follow, one of `KINDS`; readers go by it and by nothing else |
| `commit` | of the code, with `-dirty` behind it if files differed; null outside a repository |
| `command` | the command that makes the file |
| `seed` | of what was drawn |
| `machine` | cores, system, processor |
| `versions` | of busybot, Python and the packages that the figures depend on; `code`, a digest of busybot's files |
| `hashes` | of `models`, `tasks`, `histories` and `data`: for each its hashes by name |

The rows of a table and what belongs to one of several evaluations have hashes, seeds and versions of their own.
"""

import json
import os
import platform
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from busybot import __version__
from busybot.common import plugins
from busybot.common.atomic_io import read_json, write_atomically
from busybot.common.errors import BusybotError
from busybot.common.installed import source_digest
from busybot.common.process_pool import machine

SOURCE = Path(__file__).resolve().parents[1]
"""Of the package: its commit is told."""
MAY_DIFFER = (":(top,exclude)params.yaml", ":(top,exclude)benchmarks/results")
"""From the commit that is told."""
GIT_SECONDS = 10
PACKAGES = ("numpy", "sapien", "torch")
HASHED = ("models", "tasks", "histories", "data")
KEYS = ("kind", "commit", "command", "seed", "machine", "versions", "hashes")

KINDS = {
    "interact": "busybot eval interact",
    "reason": "busybot eval reason",
    "plan": "busybot eval plan",
    "what-if": "busybot eval what-if",
    "play": "busybot play",
    "table1": "python -m benchmarks.tables.table1",
    "table2": "python -m benchmarks.tables.table2",
    "table3": "python -m benchmarks.tables.table3",
    "whole-pipeline": "python -m benchmarks.tables.whole_pipeline",
    "worlds": "python -m benchmarks.tables.worlds",
    "kitchens": "python -m benchmarks.tables.kitchens",
    "new-switches": "python -m benchmarks.tables.new_switches",
    "real-board": "python -m benchmarks.tables.real_board",
    "learned-agents": "python -m benchmarks.studies.learned_agents",
    "shortcuts": "python -m benchmarks.studies.shortcuts",
    "curiosity": "python -m benchmarks.studies.curiosity",
    "plan-procedural": "python -m benchmarks.tables.table3 procedural",
    "reason-procedural": "python -m benchmarks.tables.table2 procedural",
    "stages": "python -m pipelines.tables",
    "reason-robustness": "python -m benchmarks.studies.reason_robustness",
    "orientation": "python -m benchmarks.studies.orientation",
    "bounds": "python -m benchmarks.studies.bounds",
    "mechanism-ablations": "python -m benchmarks.studies.mechanism_ablations",
    "mechanisms": "python -m benchmarks.studies.mechanisms",
    "perception-costs": "python -m benchmarks.studies.perception_costs",
    "changed-pixels": "python -m benchmarks.studies.splits changed-pixels",
    "coverage": "python -m benchmarks.studies.policy_constants coverage",
    "patches": "python -m benchmarks.studies.policy_constants patches",
    "features": "python -m benchmarks.studies.features",
    "import-rules": "python -m benchmarks.studies.import_rules",
    "real-camera": "python -m benchmarks.studies.real_camera",
    "proposed-boxes": "python -m benchmarks.studies.proposed_boxes",
    "policy-constants": "python -m benchmarks.studies.policy_constants",
    "resnet-weights": "python -m benchmarks.studies.resnet_weights",
    "splits": "python -m benchmarks.studies.splits",
    "collection": "python -m benchmarks.speed.collection",
    "memory": "python -m benchmarks.speed.collection --memory",
    "collection-parts": "python -m benchmarks.speed.parts",
    "world-costs": "python -m benchmarks.speed.parts worlds",
    "drawing": "python -m benchmarks.speed.parts drawing",
    "plan-learned": "python -m benchmarks.tables.table3 learned",
    "plan-network": "python -m benchmarks.tables.table3 network",
    "waiting": "python -m benchmarks.speed.waiting",
    "scale": "python -m benchmarks.speed.scale",
    "reproduce": "python -m benchmarks.speed.waiting reproduce",
    "hardware": "python -m benchmarks.speed.hardware",
    "features-speed": "python -m benchmarks.speed.reason features",
    "frames-speed": "python -m benchmarks.speed.reason frames",
    "streaming": "python -m benchmarks.speed.streaming",
    "interact-speed": "python -m benchmarks.speed.interact",
    "paper-interact-speed": "python -m benchmarks.speed.interact paper",
    "message-passing": "python -m benchmarks.speed.reason message-passing",
    "paper-reason-speed": "python -m benchmarks.speed.reason",
    "opening": "python -m benchmarks.speed.opening",
    "hostile": "python -m tests.hostile.run",
    "kills": "python -m benchmarks.reliability.kills",
    "world-row": "python -m benchmarks.speed.world_row",
    "world-plans": "python -m benchmarks.tables.world_plans",
    "world-gates": "python -m benchmarks.tables.world_gates",
    "worlds-kept": "python -m benchmarks.reliability.worlds",
    "s3": "python -m benchmarks.reliability.s3",
    "same-results": "python -m benchmarks.reliability.same_results",
}
"""Every kind with the command that makes it."""


def stamp(
    kind: str,
    *,
    command: str | None = None,
    seed: int | None = None,
    versions: Mapping[str, str] | None = None,
    hashes: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """The keys of every result file, to be written before the figures.

    Args:
        versions: those of `package_versions()` if None.
        hashes: by a name of `HASHED`, then by the name of what is hashed: a digest, or several by name.
    """
    assert kind in KINDS, f"{kind}: add it to KINDS"
    assert not set(hashes or {}) - set(HASHED)
    return {
        "kind": kind,
        "commit": commit(),
        "command": command,
        "seed": seed,
        "machine": machine(),
        "versions": dict(package_versions() if versions is None else versions),
        "hashes": {name: dict((hashes or {}).get(name, {})) for name in HASHED},
    }


def write_result(path: Path, result: dict[str, Any]) -> None:
    """Write a stamped result as JSON, atomically; keys keep their order, so that `kind` comes first."""
    assert result.keys() >= set(KEYS), "stamp it first"
    write_atomically(path, (json.dumps(result, indent=1, allow_nan=False) + "\n").encode())


def read_result(path: Path, kind: str | None = None) -> dict[str, Any]:
    """A result file's content.

    Args:
        kind: the only one that is wanted.

    Raises:
        BusybotError: there is no such file, it is not JSON, or it has no kind, an unknown one or another one.
    """
    value = read_json(path)
    told = value.get("kind") if isinstance(value, dict) else None
    if not isinstance(told, str):
        again = f"`{KINDS[kind]}`" if kind else "`busybot eval ... --out`"
        hint = f"run the evaluation again ({again}), or add the key `kind` to an older file: {', '.join(KINDS)}"
        raise BusybotError(f"{path}: it is no result, because it has no `kind`", hint)
    if told not in KINDS:
        raise BusybotError(f"{path}: a result of the unknown kind {told!r}", f"known are {', '.join(KINDS)}")
    if kind is not None and told != kind:
        raise BusybotError(f"{path}: a result of the kind {told}, not {kind}", f"`{KINDS[kind]}` makes one")
    return dict(value)


def package_versions(packages: tuple[str, ...] = PACKAGES) -> dict[str, str]:
    """Of busybot, its `code` as of `code_digest`, Python and packages, also those that bring something of their own;
    those that are not installed are left out."""
    found = {"busybot": __version__, "code": code_digest(), "python": platform.python_version(), **plugins.packages()}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def code_digest(package: Path = SOURCE) -> str:
    """What tells this version of busybot from others, committed or not: SHA-256 of all its files and their names.

    Of a process it is that of its first call, so call it before a long work begins.
    """
    return source_digest(package)


def of_this_code(told: Any) -> bool:
    """Whether what was read from a file has `versions` with the digest of this code, and of what packages bring."""
    versions = told.get("versions") if isinstance(told, dict) else None
    own = {"code": code_digest(), **plugins.packages()}
    return isinstance(versions, dict) and all(versions.get(name) == digest for name, digest in own.items())


def commit(source: Path = SOURCE) -> str | None:
    """The commit of the source, 40 hexadecimal digits; `-dirty` behind them if tracked files differ from it.

    `params.yaml` may: whoever reproduces a profile makes it that profile's; and so may results, which commands write
    one row after the other. None where the source is not tracked by git
    (an installed package may lie inside of somebody else's repository), and where git is not there or says nothing.
    """
    tracked = git(source, "ls-files", "--error-unmatch", "__init__.py")
    head = git(source, "rev-parse", "--verify", "HEAD") if tracked else None
    differs = head and git(source, "diff", "HEAD", "--name-only", "--", ":/", *MAY_DIFFER)
    return f"{head}-dirty" if differs else head


def git(folder: Path, *arguments: str) -> str | None:
    """What git answers there; None where it is not there, fails or says nothing."""
    environment = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=GIT_SECONDS,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
