"""Exports as a reader has them who knows nothing of busybot; `tools/check_exports.py` opens them in the real tools."""

import csv
import hashlib
import io
import json
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from PIL import Image

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting import folder as folders
from busybot.datasets.exporting import hugging_face, lerobot
from busybot.datasets.exporting.frames import TABLES
from busybot.datasets.exporting.targets import TARGETS, export_recordings
from busybot.datasets.importing.images import import_export
from busybot.episodes.codec import ImageFormat
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import TABLES as RECORDED
from tests.cli.commands import busybot
from tests.cli.killing import kill_once
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "share-a-dataset.md"
PRIVILEGED = {column.name for table in RECORDED.values() for column in table if column.privileged}

ROOT = Path(__file__).resolve().parents[2]


def exported(tmp_path: Path, to: str, images: ImageFormat = "jpeg", **how: Any) -> tuple[Dataset, Path]:
    dataset = make_dataset(tmp_path / "data", images=images)
    export_recordings(dataset, to, tmp_path / "out", **how)
    return dataset, tmp_path / "out"


def episodes(dataset: Dataset) -> dict[int, Episode]:
    return {index: read_episode(dataset.episode_path(index)) for index in sorted(dataset.finished())}


def recorded(dataset: Dataset, kind: str) -> list[str]:
    """Hashes of all frames, as they decode from the recordings."""
    return [
        digest(getattr(episode.image(frame), kind))
        for episode in episodes(dataset).values()
        for frame in range(len(episode.frame_of))
    ]


def digest(values: np.ndarray) -> str:
    return hashlib.sha256(f"{values.dtype} {values.shape}".encode() + values.tobytes()).hexdigest()


def decoded(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)))


def metres(values: np.ndarray, episode: Any) -> np.ndarray:
    """Depth as an export's own words say that it is stored."""
    return np.where(values > 0, episode.depth_offset + values * episode.depth_scale, 0).astype(np.float32)


@pytest.mark.parametrize("images", ["jpeg", "png"])
@pytest.mark.parametrize("to", ["parquet", "hf", "croissant"])
def test_parquet_has_the_pictures_that_were_recorded(to: str, images: ImageFormat, tmp_path: Path) -> None:
    dataset, out = exported(tmp_path, to, images, privileged=True)
    frames = pd.concat(pd.read_parquet(path) for path in sorted((out / "data/frames").iterdir()))
    truth = pd.read_parquet(out / "data/privileged_frames")
    told = pd.read_parquet(out / "data/episodes").set_index("episode")
    assert [digest(decoded(one["bytes"])) for one in frames.rgb] == recorded(dataset, "rgb")
    depth = [metres(decoded(one["bytes"]), told.loc[e]) for e, one in zip(frames.episode, frames.depth, strict=True)]
    assert [digest(one) for one in depth] == recorded(dataset, "depth")
    labels = [decoded(one["bytes"]).astype(np.uint16) for one in truth.segmentation]
    assert [digest(one) for one in labels] == recorded(dataset, "segmentation")


def test_a_row_has_what_was_seen_and_done_there(tmp_path: Path) -> None:
    dataset, out = exported(tmp_path, "parquet", privileged=True)
    frames, truth = (pd.read_parquet(out / "data" / name) for name in ("frames", "privileged_frames"))
    for index, episode in episodes(dataset).items():
        rows, known = frames[frames.episode == index], truth[truth.episode == index]
        assert list(rows.frame) == list(known.frame) == list(range(len(episode.steps) + 1))
        for (_, row), (_, one), step in zip(rows.iterrows(), known.iterrows(), episode.steps, strict=False):
            assert (row.pixel_u, row.pixel_v, row.direction, row.reward) == (*step.pixel, step.direction, step.reward)
            assert tuple(row[["position_x", "position_y", "position_z"]]) == step.position
            assert (one.success, one.acted_object) == (step.success, step.acted_object)
            assert tuple(one.trigger_states_after) == step.trigger_states_after
        assert rows.iloc[-1][list(set(rows) - {"episode", "frame", "rgb", "depth"})].isna().all(), "no action there"
        assert (rows.iloc[-1].rgb is not None) and rows.iloc[-1].rgb["path"].startswith(f"episodes/{index:06d}/rgb/")
    assert list(pd.read_parquet(out / "data/objects").object) == [0, 1, 2, 3, 4] * 3


@pytest.mark.parametrize("to", [name for name in TARGETS])
def test_nothing_privileged_is_exported_unless_it_is_asked_for(to: str, tmp_path: Path) -> None:
    _, out = exported(tmp_path, to)
    names = {name for path in out.rglob("*.parquet") for name in pq.read_schema(path).names}
    for path in out.rglob("*.csv"):
        names |= set(next(csv.reader(path.open())))
    assert len(names) > 15 and not names & (PRIVILEGED | {"board_spec", "links"}) and "reward" in " ".join(names)
    told = " ".join(path.read_text(errors="replace") for path in out.rglob("*.json")) + " ".join(
        map(str, out.rglob("*"))
    )
    assert not any(f'"{name}"' in told for name in PRIVILEGED) and "segmentation/" not in told
    assert not any("privileged" in path.name for path in out.rglob("*"))


@pytest.mark.parametrize("to", ["parquet", "images"])
def test_what_is_privileged_is_so_by_its_name(to: str, tmp_path: Path) -> None:
    _, out = exported(tmp_path, to, privileged=True)
    for path in [*out.rglob("*.parquet"), *out.rglob("*.csv")]:
        names = pq.read_schema(path).names if path.suffix == ".parquet" else next(csv.reader(path.open()))
        assert bool(set(names) & PRIVILEGED) == ("privileged_" in str(path.relative_to(out))), path
    kept = {name for name, columns in TABLES.items() if {c.name for c in columns} & PRIVILEGED}
    assert kept == {"privileged_frames", "privileged_objects", "privileged_episodes"}
    assert {c.name for name in kept for c in TABLES[name]} >= PRIVILEGED


def test_readers_are_told_which_columns_are_pictures(tmp_path: Path) -> None:
    _, out = exported(tmp_path, "hf", privileged=True)
    pictures = {"frames": {"rgb", "depth"}, "privileged_frames": {"segmentation"}, "episodes": {"goal"}}
    for table in TABLES:
        schema = pq.read_schema(out / f"data/{table}/part-00000.parquet")
        said = json.loads((schema.metadata or {}).get(b"huggingface", b'{"info": {"features": {}}}'))["info"][
            "features"
        ]
        assert said == {name: {"_type": "Image"} for name in pictures.get(table, ())}
        for column in TABLES[table]:
            field = schema.field(column.name)
            assert field.metadata[b"description"].decode() == column.description
            assert not said.get(column.name) or field.nullable, "else `datasets` takes it for something else"
    assert pq.ParquetFile(out / "data/frames/part-00000.parquet").num_row_groups == 3, "one per episode"


def test_the_card_names_configurations_that_are_there(tmp_path: Path) -> None:
    dataset, out = exported(tmp_path, "hf", privileged=True)
    text = (out / "README.md").read_text()
    found = dict(re.findall(r"- config_name: (\w+)\n  data_files: (\S+)", text))
    assert set(found) == {"learner", "objects", "episodes", *(name for name in TABLES if name.startswith("privileged"))}
    assert all(list(out.glob(pattern)) for pattern in found.values()) and "default: true" in text
    assert found["learner"] == "data/frames/*.parquet"
    hashes = dataset.hashes()
    assert all(f"`{value}`" in text for value in (hashes.board, hashes.trace, hashes.content))
    assert all(f"| `{column.name}` |" in text for columns in TABLES.values() for column in columns)


def test_words_of_a_strangers_dataset_stay_words(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=1, finished=[0])
    evil = "<script>alert(1)</script> [x](http://evil) `code`\n# heading"
    info = dataset.info.model_copy(update={"name": evil})
    (tmp_path / "data" / "dataset.json").write_text(info.model_dump_json())
    for to in ("hf", "croissant"):
        export_recordings(Dataset.open(tmp_path / "data"), to, tmp_path / to)
    body = (tmp_path / "hf" / "README.md").read_text().split("---", 2)[2]
    assert "<script>" not in body and "[x](" not in body and "\n# heading" not in body
    assert json.loads((tmp_path / "croissant" / "croissant.json").read_text())["name"] == evil


def test_croissant_describes_every_file_and_column(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "SHARD_BYTES", 1)
    dataset, out = exported(tmp_path, "croissant", privileged=True)
    said = json.loads((out / "croissant.json").read_text())
    assert said["conformsTo"][0].endswith("croissant/1.1")
    files = {part["contentUrl"]: part for part in said["distribution"] if part["@type"] == "cr:FileObject"}
    assert set(files) == {path.relative_to(out).as_posix() for path in out.rglob("*.parquet")}
    assert len(files) == 3 * len(TABLES), "a large file per episode here"
    for name, part in files.items():
        assert hashlib.sha256((out / name).read_bytes()).hexdigest() == part["sha256"]
    for records in said["recordSet"]:
        columns = [field["source"]["extract"]["column"] for field in records["field"]]
        sources = {field["source"]["fileSet"]["@id"] for field in records["field"]}
        pattern = next(part["includes"] for part in said["distribution"] if part["@id"] in sources)
        assert len(sources) == 1 and all(pq.read_schema(path).names == columns for path in out.glob(pattern))
        assert {key["@id"].split("/")[1] for key in records["key"]} <= set(columns)
    responsible = ("dataCollection", "dataLimitations", "dataBiases", "personalSensitiveInformation", "dataUseCases")
    assert all(said[f"rai:{name}"] for name in responsible)
    assert dataset.hashes().content in said["prov:wasDerivedFrom"]["@id"] and len(said["prov:wasGeneratedBy"]) == 3


@pytest.mark.parametrize("to", ["hf", "croissant"])
def test_of_what_was_recorded_elsewhere_nothing_is_said_that_nobody_told(to: str, tmp_path: Path) -> None:
    dataset, images = exported(tmp_path, "images")
    imported = import_export(images, tmp_path / "imported")
    told = {}
    for name, one in (("made", dataset), ("imported", imported)):
        export_recordings(one, to, tmp_path / to / name)
        file = "README.md" if to == "hf" else "croissant.json"
        told[name] = (tmp_path / to / name / file).read_text().lower()
    for words in {
        "hf": ("drawn with seed",),
        "croissant": ("synthetic", "simulated", "in simulation", "rendered", "human annotated", "nobody is in it"),
    }[to]:
        assert words in told["made"] and words not in told["imported"], words
    assert "recorded elsewhere" in told["imported"]


def test_a_frozen_datasets_licence_is_told(tmp_path: Path, tiny: Path) -> None:
    for to in ("hf", "croissant"):
        export_recordings(Dataset.open(tiny), to, tmp_path / to)
    assert "\nlicense: mit\n" in (tmp_path / "hf" / "README.md").read_text()
    assert "spdx.org/licenses/MIT" in json.loads((tmp_path / "croissant" / "croissant.json").read_text())["license"]


def test_images_and_tables_are_the_recording(tmp_path: Path) -> None:
    dataset, out = exported(tmp_path, "images", privileged=True)
    found: dict[str, list[str]] = {"rgb": [], "depth": [], "segmentation": []}
    for index, episode in episodes(dataset).items():
        place = out / "episodes" / f"{index:06d}"
        frames, truth = (pd.read_csv(place / f"{name}.csv") for name in ("frames", "privileged_frames"))
        told = pd.read_csv(place / "episodes.csv").iloc[0]
        assert len(list((place / "rgb").iterdir())) == len(episode.images), "frames without change share a file"
        found["rgb"] += [digest(np.asarray(Image.open(place / name))) for name in frames.rgb]
        found["depth"] += [digest(metres(np.asarray(Image.open(place / name)), told)) for name in frames.depth]
        labels = [np.asarray(Image.open(place / name)).astype(np.uint16) for name in truth.segmentation]
        found["segmentation"] += map(digest, labels)
        assert list(zip(frames.pixel_u[:-1], frames.pixel_v[:-1], strict=True)) == [s.pixel for s in episode.steps]
        assert np.allclose(json.loads(told.camera_pose), episode.camera.pose.ravel())
    assert all(values == recorded(dataset, kind) for kind, values in found.items())


class LeRobot:
    """As its readers go through the folder."""

    def __init__(self, root: Path):
        self.info = json.loads((root / "meta/info.json").read_text())
        self.stats = json.loads((root / "meta/stats.json").read_text())
        self.tasks = pd.read_parquet(root / "meta/tasks.parquet")
        self.episodes = pd.concat(
            pd.read_parquet(path) for path in sorted((root / "meta/episodes").glob("*/*.parquet"))
        )
        self.files = sorted((root / "data").glob("*/*.parquet"))
        self.frames = pd.concat([pd.read_parquet(path) for path in self.files], ignore_index=True)


@pytest.mark.parametrize("large", [1, 10**9])
def test_lerobots_layout_holds_together(large: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "SHARD_BYTES", large)
    for module in (folders, lerobot):
        monkeypatch.setattr(module, "CHUNK", 2)
    dataset, out = exported(tmp_path, "lerobot")
    found = LeRobot(out)
    info, frames = found.info, found.frames
    assert info["codebase_version"] == "v3.0" and info["splits"] == {"train": "0:3"} and info["fps"] == 1
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, len(frames), 1)
    assert set(info["features"]) == set(frames) and list(found.tasks.index) == [lerobot.TASKS[0]]
    assert list(frames["index"]) == list(range(len(frames))), "one number after the other over all files"
    assert len(found.files) == (3 if large == 1 else 1)
    for place, row in enumerate(found.episodes.to_dict("records")):
        own = frames[row["dataset_from_index"] : row["dataset_to_index"]]
        assert set(own.episode_index) == {place} == {row["episode_index"]} and row["length"] == len(own)
        named = {"chunk_index": row["data/chunk_index"], "file_index": row["data/file_index"]}
        assert set(pd.read_parquet(out / info["data_path"].format(**named)).episode_index) >= {place}
        assert list(own.frame_index) == list(own.timestamp) == list(range(len(own)))
    assert [digest(decoded(one["bytes"])) for one in frames["observation.images.rgb"]] == recorded(dataset, "rgb")
    assert [digest(decoded(one["bytes"])) for one in frames["observation.images.depth"]] == recorded(dataset, "depth")
    assert info["features"]["observation.images.depth"]["shape"] == [120, 160, 1]


def test_lerobots_actions_and_statistics(tmp_path: Path) -> None:
    dataset, out = exported(tmp_path, "lerobot")
    found = LeRobot(out)
    actions = np.stack(list(found.frames.action))
    steps = [step for episode in episodes(dataset).values() for step in episode.steps]
    moving = np.linalg.norm(actions[:, 3:], axis=1)
    assert np.allclose(moving[moving > 0], 1) and (moving > 0).sum() == len(steps), "a frame a recording is without"
    assert np.array_equal(actions[moving > 0, :3], np.array([step.position for step in steps], np.float32))
    assert list(found.frames["next.reward"][moving > 0]) == [step.reward for step in steps]
    ends = found.frames.groupby("episode_index")["next.done"].apply(list)
    assert all(values == [False] * (len(values) - 2) + [True, True] for values in ends)
    for kind in ("min", "max", "mean", "std"):
        assert np.allclose(found.stats["action"][kind], getattr(actions.astype(float), kind)(0)), kind
    assert found.stats["action"]["count"] == [len(actions)]
    rgb, depth = (found.stats[f"observation.images.{kind}"] for kind in ("rgb", "depth"))
    assert np.shape(rgb["mean"]) == (3, 1, 1) and np.shape(depth["q50"]) == (1, 1, 1)
    pixels = np.stack([image.rgb for episode in episodes(dataset).values() for image in episode.images]) / 255
    assert np.allclose(np.ravel(rgb["mean"]), pixels.mean((0, 1, 2)), atol=0.02)
    assert 0 <= depth["min"][0][0][0] <= depth["mean"][0][0][0] <= depth["max"][0][0][0] < 4.7
    assert set(rgb) >= {"q01", "q10", "q50", "q90", "q99"}


def test_lerobot_is_told_of_goals(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=1, finished=[])
    episode = make_episode(0)
    write_episode(dataset.episode_path(0), replace(episode, goals=[episode.images[0]]), "png")
    export_recordings(dataset, "lerobot", tmp_path / "out")
    found = LeRobot(tmp_path / "out")
    assert list(found.tasks.index[found.frames.task_index.unique()]) == [lerobot.TASKS[1]]
    export_recordings(dataset, "parquet", tmp_path / "tables")
    goal = pd.read_parquet(tmp_path / "tables/data/episodes").goal[0]
    assert digest(decoded(goal["bytes"])) == digest(episode.images[0].rgb)


def test_lerobot_refuses_what_it_cannot_hold(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=2, finished=[0])
    with pytest.raises(BusybotError, match="no place for what is privileged") as error:
        export_recordings(dataset, "lerobot", tmp_path / "out", privileged=True)
    assert error.value.hint
    write_episode(dataset.episode_path(1), make_episode(1, width=80, height=64), "png")
    with pytest.raises(BusybotError, match="of one size"):
        export_recordings(dataset, "lerobot", tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]
    assert export_recordings(dataset, "images", tmp_path / "out").episodes == 2


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("to", list(TARGETS))
def test_a_cut_export_goes_on(to: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut after every few files until it is complete: it is as if nobody had cut it."""
    monkeypatch.setattr(folders, "SHARD_BYTES", 1)
    dataset, whole = exported(tmp_path, to)
    place, out = tmp_path / "cut.partial", tmp_path / "cut"
    left, tries, kept = 0, 0, dict[str, int]()

    def cut(work: Callable[..., None]) -> Callable[..., None]:
        def some(*arguments: Any) -> None:
            nonlocal left
            if left == 0:
                raise KeyboardInterrupt
            left -= 1
            work(*arguments)

        return some

    for module in (folders, lerobot, hugging_face):
        monkeypatch.setattr(module, "write_table", cut(folders.write_table))
    monkeypatch.setattr(folders, "rename", cut(folders.rename))
    while not out.exists():
        left, tries = 7, tries + 1
        assert tries < 60
        try:
            done = export_recordings(dataset, to, out)
        except KeyboardInterrupt:
            assert place.is_dir() and not out.exists()
            now = {name: (place / "episodes" / name).stat().st_ino for name in finished(place)}
            assert all(now.get(name, number) == number for name, number in kept.items()), "none is written again"
            kept |= now
    assert done.continued == (0 if to == "images" else 3) and not place.exists()
    assert contents(out) == contents(whole)


def finished(place: Path) -> list[str]:
    folder = place / "episodes"
    return [entry.name for entry in folder.iterdir() if not entry.name.startswith(".")] if folder.is_dir() else []


@pytest.mark.long
def test_a_killed_export_goes_on(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=40, finished=range(40))
    place = tmp_path / "out.partial"
    command = ["dataset", "export", str(dataset.path), "--to", "lerobot", "--out", str(tmp_path / "out")]
    kill_once([*command, "--workers", "1"], lambda: len(finished(place)) >= 3)
    assert not (tmp_path / "out").exists()
    done = busybot(*command, "--workers", "1", "--json")
    told = json.loads(done.stdout)
    assert told["episodes"] == 40 and 3 <= told["continued"] < 40
    export_recordings(dataset, "lerobot", tmp_path / "again")
    assert contents(tmp_path / "out") == contents(tmp_path / "again")


@pytest.mark.parametrize("left", [(folders.PLAN, folders.LOCK_FILE, folders.MARKER), (folders.MARKER,)])
def test_an_export_that_was_killed_at_its_place_is_finished(left: tuple[str, ...], tmp_path: Path) -> None:
    dataset, out = exported(tmp_path, "parquet")
    whole = contents(out)
    facts = {"target": "parquet", "version": folders.VERSION, "privileged": False, **dataset.hashes().model_dump()}
    for name in left:
        (out / name).write_text(json.dumps(facts) if name == folders.MARKER else "")
    with pytest.raises(BusybotError, match="not an empty folder"):
        export_recordings(dataset, "hf", out)
    done = export_recordings(dataset, "parquet", out)
    assert (done.episodes, done.continued, done.files) == (3, 3, len(whole)) and contents(out) == whole
    with pytest.raises(BusybotError, match="not an empty folder"):
        export_recordings(dataset, "parquet", out)


def test_only_its_own_unfinished_folder_is_continued(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=2, finished=[0])
    place, out = tmp_path / "out.partial", tmp_path / "out"
    place.mkdir()
    (place / "precious").write_text("kept")
    with pytest.raises(BusybotError, match="not an export that was begun") as error:
        export_recordings(dataset, "hf", out)
    assert error.value.hint and [path.name for path in place.iterdir()] == ["precious"]
    shutil.rmtree(place)
    place.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BusybotError, match="no folder"):
        export_recordings(dataset, "hf", out)
    place.unlink()
    place.mkdir()
    (place / folders.MARKER).write_text(json.dumps({"target": "images"}))
    with pytest.raises(BusybotError, match="of something else"):
        export_recordings(dataset, "hf", out)
    out.mkdir()
    (out / "precious").write_text("kept")
    with pytest.raises(BusybotError, match="not an empty folder"):
        export_recordings(dataset, "hf", out)
    with pytest.raises(BusybotError, match="in the dataset"):
        export_recordings(dataset, "hf", tmp_path / "data" / "x")
    assert contents(out) == {"precious": b"kept"}


def test_links_in_the_unfinished_folder_are_not_followed(tmp_path: Path) -> None:
    """One that somebody planted where episodes will be written."""
    dataset = make_dataset(tmp_path / "data", boards=1, finished=[0])
    (tmp_path / "outside").mkdir()
    export_recordings(dataset, "parquet", tmp_path / "out")
    shutil.rmtree(tmp_path / "out")
    place = tmp_path / "out.partial"
    place.mkdir()
    facts = {"target": "parquet", "version": folders.VERSION, "privileged": False, **dataset.hashes().model_dump()}
    (place / folders.MARKER).write_text(json.dumps(facts))
    (place / "episodes").symlink_to(tmp_path / "outside")
    with pytest.raises(BusybotError, match="nothing is written through links"):
        export_recordings(dataset, "parquet", tmp_path / "out")
    assert not list((tmp_path / "outside").iterdir())


def test_a_recording_that_changes_meanwhile_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = make_dataset(tmp_path / "data", boards=2, finished=[0, 1])
    hashes = Dataset.hashes

    def exchanged(self: Dataset, *arguments: Any) -> Any:
        found = hashes(self, *arguments)
        write_episode(self.episode_path(1), make_episode(1, steps=5), "jpeg")
        return found

    monkeypatch.setattr(Dataset, "hashes", exchanged)
    with pytest.raises(BusybotError, match=r"000001\.mcap: it changed"):
        export_recordings(dataset, "images", tmp_path / "out")


@pytest.mark.parametrize("to", ["images", "lerobot"])
def test_a_folder_without_a_name_of_its_own_is_refused(
    to: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = make_dataset(tmp_path / "data", boards=1, finished=[0]).path
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for out, why in ((".", "it is the current folder"), ("..", "not an empty folder"), ("/", "not an empty folder")):
        done = busybot("dataset", "export", dataset, "--to", to, "--out", out)
        assert done.returncode == 1 and why in " ".join(done.stderr.split()) and "hint" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"data", "here"}


def test_nothing_to_export(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="no board has an episode"):
        export_recordings(make_dataset(tmp_path / "data", finished=[]), "hf", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_the_guides_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_dataset(tmp_path / "DATASET")
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^    busybot (dataset export DATASET --to .*)$", GUIDE.read_text(), re.MULTILINE)
    assert {command.split()[4] for command in commands} >= set(TARGETS)
    for command in commands:
        if "causal" not in command:  # it needs real objects: tests/datasets/test_causal_export.py
            done = busybot(*command.split(), "--workers", "1")
            assert done.returncode == 0, done.stderr
            assert "3 episodes, 21 frames" in done.stderr
    made = {command.split()[6] for command in commands} - {"tables"}
    assert {path.name for path in tmp_path.iterdir()} == {"DATASET", *made}
    back = re.findall(r"^    busybot (dataset import .*)$", GUIDE.read_text(), re.MULTILINE)
    assert len(back) == 1 and busybot(*back[0].split()).returncode == 0 and Dataset.open(Path("back")).info.boards == 3


def test_an_unknown_format_is_wrong_usage(tmp_path: Path) -> None:
    make_dataset(tmp_path / "data", boards=1, finished=[0])
    done = busybot("dataset", "export", tmp_path / "data", "--to", "rlds", "--out", tmp_path / "out")
    assert done.returncode == 2 and "lerobot" in done.stderr and not (tmp_path / "out").exists()


@pytest.mark.parametrize("to", ["parquet", "images", "lerobot"])
def test_a_file_that_may_not_grow_is_named(to: str, tmp_path: Path) -> None:
    """As on a full disk, writing into an open file fails, and tells no path of itself."""
    export = (sys.executable, "-m", "busybot", "dataset", "export", "datasets/tiny", "--to", to, "--out")
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (20_000, 20_000))
    command = [*export, str(tmp_path / "out"), "--workers", "1", "--quiet"]
    done = subprocess.run(command, cwd=ROOT, text=True, capture_output=True, preexec_fn=limit)
    assert done.returncode == 1 and re.match(rf"error: {tmp_path}/out.partial/\S+: File too large", done.stderr)
    assert re.search(r"[\d.]+ MB are free on its disk", done.stderr) and not (tmp_path / "out").exists()
