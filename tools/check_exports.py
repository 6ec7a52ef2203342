"""`python tools/check_exports.py`: exports of the tiny dataset, opened in the real tools and compared frame by frame.

The tools do not fit beside the project, so this file runs twice: here it exports, makes the environments (once; they
stay in the folder that `--environments` names) and says what every frame has to decode to; in each environment it runs
again with `--read`, without busybot, and opens the exports as their users would. LeRobot 0.4.4 asks for an older torch;
it is installed beside the one that this project pins, in its build without CUDA. torchvision then lacks its compiled
operators, of which LeRobot's datasets use none.
"""

import argparse
import hashlib
import importlib
import importlib.metadata
import io
import itertools
import json
import platform
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENTS = {
    "tables": [
        "datasets==5.2.0", "duckdb==2.0.0", "polars==2.1.0", "pandas==3.1.1", "mlcroissant==1.1.1", "pillow==13.0.0",
        "lerobot-doctor==0.2.0",
    ],
    "lerobot": [
        "datasets==4.8.5", "huggingface-hub==0.35.3", "numpy==2.2.6", "pandas==2.3.3", "av==15.1.0", "jsonlines==4.0.0",
        "packaging==25.0", "einops==0.8.2", "draccus==0.10.0", "gymnasium==1.4.0", "deepdiff==8.6.2",
        "termcolor==3.3.0", "imageio==2.38.1", "opencv-python-headless==4.12.0.88", "accelerate==1.15.0", "sympy",
        "jinja2", "networkx",
    ],
}  # fmt: skip
"""Packages of each environment with the versions with which the exports were checked."""
ALONE = {"lerobot": ["lerobot==0.4.4", "torchvision==0.28.0"]}
"""Packages that are installed without what they require."""
TARGETS = ("parquet", "hf", "croissant", "lerobot", "images")


def main() -> int:
    """Exit code 1 if a tool shows something else than was recorded."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--environments", type=Path, help="folder for the environments of the tools, about 2 GB")
    parser.add_argument("--dataset", type=Path, default=ROOT / "datasets" / "tiny")
    parser.add_argument("--only", choices=[*ENVIRONMENTS], help="one of the environments")
    parser.add_argument("--read", nargs=2, metavar=("ENVIRONMENT", "FOLDER"), help="the second run; nobody types this")
    told = parser.parse_args()
    if told.read:
        return read(told.read[0], Path(told.read[1]))
    if told.environments is None:
        parser.error("--environments DIR: a folder for the environments of the tools")
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        export(told.dataset, Path(folder))
        for name in [told.only] if told.only else ENVIRONMENTS:
            python = environment(told.environments.absolute() / name, name)
            offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": f"{folder}/cache", "PATH": f"{python.parent}:/usr/bin:/bin"}
            command = [str(python), str(Path(__file__).resolve()), "--read", name, folder]
            failed += subprocess.run(command, cwd=folder, env=offline).returncode != 0
    return int(failed > 0)


def export(dataset: Path, folder: Path) -> None:
    """All exports in folders of their names, and `expected.json`: hashes of the frames as they were recorded."""
    sys.path.insert(0, str(ROOT))
    from busybot.datasets.dataset import Dataset
    from busybot.datasets.exporting.targets import export_recordings
    from busybot.episodes.mcap.reader import read_episode

    source = Dataset.open(dataset)
    for target in TARGETS:
        export_recordings(source, target, folder / target)
    episodes = [read_episode(source.episode_path(index)) for index in sorted(source.finished())]
    images = [episode.image(frame) for episode in episodes for frame in range(len(episode.frame_of))]
    actions = [[*step.pixel, step.direction] for episode in episodes for step in episode.steps]
    expected = {"rgb": [digest(one.rgb) for one in images], "depth": [digest(one.depth) for one in images]}
    (folder / "expected.json").write_text(json.dumps({**expected, "actions": actions}))


def environment(place: Path, name: str) -> Path:
    """The Python of an environment, which is made if these packages are not in it."""
    python, done = place / "bin" / "python", place / "installed.json"
    wanted = json.dumps([ENVIRONMENTS[name], ALONE.get(name)])
    if done.exists() and done.read_text() == wanted:
        return python
    print(f"{name}: installing into {place}", flush=True)
    venv.create(place, with_pip=True, clear=True)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--no-warn-conflicts"]
    if name == "lerobot":
        sys.path.insert(0, str(ROOT))
        from provision.packages import CONSTRAINTS, torch_commands, torch_pin

        version = torch_pin((ROOT / CONSTRAINTS).read_text(encoding="utf-8"))
        subprocess.run([*pip, "uv"], check=True)
        ways = [command for _, command in torch_commands(str(python), version, gpu=False, machine=platform.machine())]
        if not any(subprocess.run(command).returncode == 0 for command in ways):
            raise SystemExit("torch could not be installed")
    for package in ALONE.get(name, []):
        subprocess.run([*pip, "--no-deps", package], check=True)
    subprocess.run([*pip, *ENVIRONMENTS[name]], check=True)
    done.write_text(wanted)
    return python


def digest(values: Any) -> str:
    """Of an array, whatever its byte order and who decoded it."""
    return hashlib.sha256(f"{values.dtype} {values.shape}".encode() + values.tobytes()).hexdigest()


def read(name: str, folder: Path) -> int:
    """Open the exports with the tools of this environment; the exit code."""
    expected = json.loads((folder / "expected.json").read_text())
    failed = 0
    for label, check in CHECKS[name].items():
        try:
            told = check(folder, expected)
        except Exception as error:  # of any kind, of a tool that is not ours: told, and the others are tried, too
            failed, told = failed + 1, f"FAILED: {type(error).__name__}: {error}"
        print(f"{label}: {told}", flush=True)
    return int(failed > 0)


def _module(name: str) -> Any:
    return importlib.import_module(name)


def _same(kind: str, found: list[str], expected: dict[str, list[str]]) -> None:
    wrong = [number for number, pair in enumerate(itertools.zip_longest(found, expected[kind])) if pair[0] != pair[1]]
    if wrong:
        raise AssertionError(f"{kind} of {len(wrong)} of {len(expected[kind])} frames is another one, first {wrong[0]}")


def _picture(data: bytes) -> Any:
    return _module("numpy").asarray(_module("PIL.Image").open(io.BytesIO(data)))


def _depths(folder: Path, pictures: Any) -> list[str]:
    """Hashes of depth in board units, as the card says that it is stored; (episode, picture) come in."""
    numpy = _module("numpy")
    rows = _module("pandas").read_parquet(folder / "data/episodes").set_index("episode")
    found = []
    for episode, values in pictures:
        row = rows.loc[episode]
        scaled = row.depth_offset + numpy.asarray(values).astype(float) * row.depth_scale
        found.append(digest(numpy.where(numpy.asarray(values) > 0, scaled, 0).astype(numpy.float32)))
    return found


def datasets_library(folder: Path, expected: dict[str, Any]) -> str:
    """`datasets.load_dataset` of every configuration of the card."""
    tool, numpy = _module("datasets"), _module("numpy")
    names = tool.get_dataset_config_names(str(folder / "hf"))
    counts = {name: len(tool.load_dataset(str(folder / "hf"), name, split="train")) for name in names}
    frames = tool.load_dataset(str(folder / "hf"), split="train")  # the default configuration
    learner = tool.load_dataset(str(folder / "hf"), "learner", split="train")
    assert frames.features == learner.features and isinstance(frames.features["rgb"], tool.Image)
    _same("rgb", [digest(numpy.asarray(row["rgb"])) for row in learner], expected)
    _same("depth", _depths(folder / "hf", ((row["episode"], row["depth"]) for row in learner)), expected)
    actions = [[row["pixel_u"], row["pixel_v"], row["direction"]] for row in learner if row["direction"] is not None]
    assert actions == expected["actions"]
    return f"{tool.__version__}, {counts}"


def duckdb(folder: Path, expected: dict[str, Any]) -> str:
    """SQL over the files."""
    tool = _module("duckdb")
    query = f"select rgb.bytes from '{folder}/parquet/data/frames/*.parquet' order by episode, frame"
    _same("rgb", [digest(_picture(row[0])) for row in tool.sql(query).fetchall()], expected)
    return f"{tool.__version__}, {len(expected['rgb'])} pictures"


def polars(folder: Path, expected: dict[str, Any]) -> str:
    """A structure of bytes and path."""
    tool = _module("polars")
    frames = tool.read_parquet(f"{folder}/parquet/data/frames/*.parquet")
    _same("rgb", [digest(_picture(row["bytes"])) for row in frames["rgb"]], expected)
    return f"{tool.__version__}, {len(frames)} pictures"


def pandas(folder: Path, expected: dict[str, Any]) -> str:
    """The folder as one table; and the CSV tables with the files that they name."""
    tool, image, numpy = _module("pandas"), _module("PIL.Image"), _module("numpy")
    frames = tool.read_parquet(folder / "parquet/data/frames")
    _same("rgb", [digest(_picture(one["bytes"])) for one in frames.rgb], expected)
    found = []
    for place in sorted((folder / "images/episodes").iterdir()):
        names = tool.read_csv(place / "frames.csv").rgb
        found += [digest(numpy.asarray(image.open(place / name))) for name in names]
    _same("rgb", found, expected)
    return f"{tool.__version__}, {len(frames)} pictures in Parquet, {len(found)} in CSV"


def croissant(folder: Path, expected: dict[str, Any]) -> str:
    """Validated without errors, and every record of every set read."""
    tool, numpy = _module("mlcroissant"), _module("numpy")
    dataset = tool.Dataset(folder / "croissant/croissant.json")
    assert not dataset.metadata.ctx.issues.errors and dataset.metadata.ctx.is_v1_1()
    records = {one.id: list(dataset.records(one.id)) for one in dataset.metadata.record_sets}
    _same("rgb", [digest(numpy.asarray(row["frames/rgb"])) for row in records["frames"]], expected)
    depths = ((row["frames/episode"], row["frames/depth"]) for row in records["frames"])
    _same("depth", _depths(folder / "croissant", depths), expected)
    for part in json.loads((folder / "croissant/croissant.json").read_text())["distribution"]:
        if "sha256" in part:
            data = (folder / "croissant" / part["contentUrl"]).read_bytes()
            assert hashlib.sha256(data).hexdigest() == part["sha256"]
    return f"{_version('mlcroissant')}, { ({name: len(rows) for name, rows in records.items()}) }"


def doctor(folder: Path, expected: dict[str, Any]) -> str:
    """All of its checks, none FAIL."""
    done = subprocess.run(["lerobot-doctor", folder / "lerobot", "--json"], capture_output=True, text=True)
    counts = json.loads(done.stdout)["summary"]
    assert counts["PASS"] and not counts["FAIL"], done.stdout + done.stderr
    return f"{_version('lerobot-doctor')}, {counts}"


def lerobot(folder: Path, expected: dict[str, Any]) -> str:
    """Every frame of `LeRobotDataset`, some with their neighbours, and two episodes alone."""
    torch, numpy = _module("torch"), _module("numpy")
    operators = torch.library.Library("torchvision", "DEF")  # of which it registers variants, compiled or not
    for name in ("nms", "qnms"):
        operators.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
    tool = _module("lerobot.datasets.lerobot_dataset").LeRobotDataset
    frames = tool("me/boards", root=folder / "lerobot")
    found: dict[str, list[str]] = {"rgb": [], "depth": []}
    actions = []
    for row in (frames[number] for number in range(len(frames))):
        colours = (row["observation.images.rgb"].numpy() * 255).round().astype(numpy.uint8)
        found["rgb"].append(digest(numpy.ascontiguousarray(colours.transpose(1, 2, 0))))
        found["depth"].append(digest(row["observation.images.depth"].numpy()[0]))
        if row["action"][3:].any():
            actions.append(row["pixel"].tolist())
    _same("rgb", found["rgb"], expected)
    _same("depth", found["depth"], expected)
    assert actions == [pair[:2] for pair in expected["actions"]]
    nearby = tool("me/boards", root=folder / "lerobot", delta_timestamps={"action": [-1, 0, 1]})
    assert nearby[1]["action"].shape == (3, 6)
    some = tool("me/boards", root=folder / "lerobot", episodes=[0, 1])
    assert some[0]["task"] and 0 < len(some) < len(frames)
    return f"{_version('lerobot')}, {len(frames)} frames of {frames.num_episodes} episodes"


def _version(package: str) -> str:
    return importlib.metadata.version(package)


CHECKS = {
    "tables": {
        "datasets": datasets_library,
        "DuckDB": duckdb,
        "polars": polars,
        "pandas": pandas,
        "mlcroissant": croissant,
        "lerobot-doctor": doctor,
    },
    "lerobot": {"LeRobot": lerobot},
}
"""By environment and tool."""

if __name__ == "__main__":
    sys.exit(main())
