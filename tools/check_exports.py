"""`make check-exports`: exports of the tiny dataset, opened in the real tools and compared frame by frame.

The tools do not fit beside the project, so this file runs twice: here it exports, and says what every frame has to
decode to; in the environments `tables` and `lerobot` (see provision/extras.py), or in the Debian 13 of
tools/debian_root.sh, it runs again with `--read`, without busybot, and opens the exports as their users would. LeRobot
borrows the project's torch, with which torchvision's compiled operators do not load; its datasets use none of them.
"""

import argparse
import hashlib
import importlib
import importlib.metadata
import io
import itertools
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TARGETS = ("parquet", "hf", "croissant", "lerobot", "images")


def main() -> int:
    """Exit code 1 if a tool shows something else than was recorded."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--tools", type=Path, default=ROOT / ".tools", help="folder of the environments")
    parser.add_argument("--dataset", type=Path, default=ROOT / "datasets" / "tiny")
    parser.add_argument("--only", choices=list(CHECKS), nargs="+", default=["tables", "lerobot"], help="environments")
    parser.add_argument("--read", nargs=2, metavar=("ENVIRONMENT", "FOLDER"), help="the second run; nobody types this")
    told = parser.parse_args()
    if told.read:
        return read(told.read[0], Path(told.read[1]))
    with tempfile.TemporaryDirectory() as folder:
        export(told.dataset, Path(folder))
        shutil.copy(__file__, folder)
        failed = sum(not opened(name, told.tools.absolute() / name, Path(folder)) for name in told.only)
    return int(failed > 0)


def opened(name: str, place: Path, folder: Path) -> bool:
    """Whether the tools of this environment show what is in the folder."""
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": f"{folder}/cache"}
    python, root = [str(place / "bin" / "python")], place / "tmp" / folder.name
    if name == "debian":
        shutil.copytree(folder, root, dirs_exist_ok=True)
        folder, offline["PYTHONPATH"] = Path("/tmp") / folder.name, "/opt/lerobot"
        python = ["/usr/sbin/chroot", str(place), "/usr/bin/python3"]
    environment = {**offline, "PATH": f"{place}/bin:/usr/bin:/bin", "BORROWED": sysconfig.get_path("purelib")}
    command = [*python, f"{folder}/{Path(__file__).name}", "--read", name, str(folder)]
    done = subprocess.run(command, env=environment, stderr=subprocess.PIPE, text=True)
    shutil.rmtree(root, ignore_errors=True)
    if done.returncode:
        print(done.stderr, file=sys.stderr)
    return done.returncode == 0


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
    sys.path.append(os.environ["BORROWED"])  # behind what LeRobot brings; not there in Debian, which has a torch
    torch, numpy = _module("torch"), _module("numpy")
    if torch.__version__.endswith("+cpu"):  # beside which torchvision's compiled operators are missing
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
    "debian": {"LeRobot": lerobot},
}
"""By environment and tool."""

if __name__ == "__main__":
    sys.exit(main())
