"""`python tools/check_install.py`: recordings are read without simulator and torch, and each extra does what it is for.

A wheel is built and installed, without an extra, in environments of its own: with the lowest versions that
pyproject.toml allows, with the newest ones, and with numpy 2.3. In each the tiny dataset is opened, verified, exported
in every way, and what its frames decode to is compared with what they decode to here. Then each extra alone with the
lowest versions: `sim` draws boards and acts on them, `learn` infers relations with shipped models, `view` writes a
recording for Rerun and a figure; what comes out is compared, too. Beside LeRobot and ManiSkill it is only asked
whether the versions resolve.
"""

import argparse
import hashlib
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TINY = ROOT / "datasets" / "tiny"
LOWEST = ["--resolution", "lowest-direct", "-r", str(ROOT / "pyproject.toml")]
INSTALLED = {"lowest": LOWEST, "newest": [], "numpy-2.3": ["numpy==2.3.*"]}
"""Words for `uv pip install` beside the wheel."""
EXTRAS = {"lowest-sim": "sim", "lowest-learn": "learn", "lowest-view": "view"}
"""Installed alone, with the lowest versions of it and of the base."""
BESIDE = {"LeRobot": ["lerobot==0.4.4"], "ManiSkill": ["mani_skill==3.0.1"], "everything": ["busybot[all]"]}
"""What is resolved together with the wheel, and not installed."""
ABSENT = ("torch", "sapien", "rerun", "gymnasium", "scipy", "matplotlib")
TARGETS = ("parquet", "hf", "croissant", "lerobot", "images")
TOLD = ("numpy", "pandas", "pyarrow", "pydantic", "gymnasium", "scipy", "sapien", "torch", "rerun-sdk", "matplotlib")
UV = (sys.executable, "-m", "uv", "--no-config", "pip")


def main() -> int:
    """Exit code 1 if something is otherwise in one of the environments."""
    options = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    options.add_argument("--environments", type=Path, help="folder for the environments, made anew, 1 GB")
    options.add_argument("--only", choices=[*INSTALLED, *EXTRAS, *BESIDE], nargs="+", help="some of them")
    options.add_argument("--read", nargs=2, metavar=("WHAT", "FOLDER"), help="the second run; nobody types this")
    told = options.parse_args()
    if told.read:
        print(json.dumps(READ[told.read[0]](Path(told.read[1]))))
        return 0
    if told.environments is None:
        options.error("--environments DIR: a folder for the environments")
    with tempfile.TemporaryDirectory() as folder:
        build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir"]
        source = Path(folder) / "source"
        shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(".*", "tests", "build", "*.egg-info"))
        subprocess.run([*build, folder, str(source)], check=True)
        (wheel,) = Path(folder).glob("*.whl")
        sys.path.insert(0, str(ROOT))
        wrong, place = [], told.environments.resolve()
        for name in told.only or [*INSTALLED, *EXTRAS, *BESIDE]:
            well = _resolves(name, wheel, BESIDE[name]) if name in BESIDE else _works(place / name, wheel)
            wrong += [] if well else [name]
    print(f"wrong: {', '.join(wrong)}" if wrong else "all is as it was here")
    return int(bool(wrong))


def _works(place: Path, wheel: Path) -> bool:
    """Whether the wheel, installed as this environment's name says, does the same as here."""
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(place)], check=True)
    python, extra = str(place / "bin" / "python"), EXTRAS.get(place.name, "base")
    words = [*INSTALLED["lowest"], "--extra", extra] if place.name in EXTRAS else INSTALLED[place.name]
    if extra == "learn":
        words = [*words, _torch(python)]
    subprocess.run([*UV, "install", "--quiet", "--python", python, *words, str(wheel)], check=True)
    command = [python, str(Path(__file__).resolve()), "--read", extra, str(wheel.parent)]
    alone = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, cwd=wheel.parent, env=alone, capture_output=True, text=True)
    found = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else done.stderr[-2000:]
    listed = subprocess.run([*UV, "freeze", "--python", python], capture_output=True, text=True).stdout.splitlines()
    versions = [line for line in listed if line.split("==")[0] in TOLD]
    expected = READ[extra](wheel.parent) | ({"absent": list(ABSENT)} if extra == "base" else {})
    print(f"{place.name}: {'the same' if found == expected else found} ({', '.join(versions)})", flush=True)
    return bool(found == expected)


def _torch(python: str) -> str:
    """Install the build without CUDA of the lowest torch, which is the one that the set-up pins; how it is called."""
    from provision.packages import CONSTRAINTS, torch_commands, torch_pin

    version = torch_pin((ROOT / CONSTRAINTS).read_text(encoding="utf-8"))
    ways = torch_commands(python, version, gpu=False, machine=platform.machine())
    if not any(subprocess.run(command, capture_output=True).returncode == 0 for _, command in ways):
        raise SystemExit("torch could not be installed")
    ask = "from importlib.metadata import version; print('torch==' + version('torch'))"
    return subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True).stdout.strip()


def _resolves(name: str, wheel: Path, packages: list[str]) -> bool:
    light, whole = f"busybot @ {wheel.as_uri()}", f"busybot[all] @ {wheel.as_uri()}"
    wanted = [whole] if packages == ["busybot[all]"] else [light, *packages]
    compile_them = [*UV, "compile", "--quiet", "--python-version", "3.11", "--no-header", "-"]
    done = subprocess.run(compile_them, input="\n".join(wanted), capture_output=True, text=True)
    chosen = [line for line in done.stdout.splitlines() if line.startswith(("numpy=", "torch=", "lerobot=", "mani"))]
    print(f"beside {name}: {', '.join(chosen) if done.returncode == 0 else done.stderr}", flush=True)
    return done.returncode == 0


def read(folder: Path) -> dict[str, Any]:
    """All that the reading side does, as it comes out: from Python and by commands."""
    import busybot

    data, frames = busybot.load_dataset(TINY), hashlib.sha256()
    for episode in data:
        for t in range(len(episode.steps) + 1):
            frames.update(episode.rgb[t].tobytes() + episode.depth[t].tobytes() + episode.boxes[t].tobytes())
    tables = {name: hashlib.sha256(data.to_pandas(name).to_csv().encode()).hexdigest() for name in ("steps", "objects")}
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        exports = {target: _export(target, Path(scratch) / target) for target in TARGETS}
    absent = [name for name in ABSENT if importlib.util.find_spec(name) is None]
    told = {name: _told("dataset", name, str(TINY), "--json") for name in ("info", "verify")}
    return {
        "frames": frames.hexdigest(),
        "tables": tables,
        "content_hash": told["info"]["content_hash"],
        "verified": told["verify"]["ok"],
        "exports": exports,
        "refused": absent == [] or _refused(folder),
        "absent": absent,
    }


def simulate(folder: Path) -> dict[str, Any]:
    """Boards, recordings, and their hashes."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        _told("generate", f"{scratch}/boards", "--boards", "2", "--json")
        _told("collect", f"{scratch}/boards", "--policy", "scripted", "--steps", "3", "--json")
        told = _told("dataset", "info", f"{scratch}/boards", "--json")
    return {name: told[name] for name in ("board_hash", "trace_hash")}


def learn(folder: Path) -> dict[str, Any]:
    """Relations inferred by shipped models, and how well."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        shutil.copytree(TINY, f"{scratch}/tiny")
        words = ("eval", "reason", f"{scratch}/tiny", "--json", "--reasoner")
        told = {name: _told(*words, name) for name in ("event", "mechanism")}
    return {name: {key: round(one[key], 6) for key in ("edge_p", "edge_r", "edge_acc")} for name, one in told.items()}


def view(folder: Path) -> dict[str, Any]:
    """A recording for Rerun, and a figure."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        files = {"--save": Path(scratch) / "episode.rrd", "--figure": Path(scratch) / "episode.png"}
        for option, file in files.items():
            _told("view", str(TINY), "--episode", "3", option, str(file), "--json")
        return {option: file.stat().st_size > 10_000 for option, file in files.items()}


def _export(target: str, folder: Path) -> int:
    """Number of files."""
    _told("dataset", "export", str(TINY), "--to", target, "--out", str(folder), "--json")
    return sum(file.is_file() for file in folder.rglob("*"))


def _refused(folder: Path) -> bool:
    """Whether what is not installed is named, with what to do."""
    command = [sys.executable, "-m", "busybot", "replay", str(TINY / "episodes" / "000000.mcap")]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    return done.returncode == 1 and "is not installed" in done.stderr and "[sim]" in done.stderr


def _told(*words: str) -> Any:
    done = subprocess.run([sys.executable, "-m", "busybot", *words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"busybot {' '.join(words)}: {done.stderr}")
    return json.loads(done.stdout)


READ = {"base": read, "sim": simulate, "learn": learn, "view": view}

if __name__ == "__main__":
    sys.exit(main())
