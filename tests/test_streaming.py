"""Datasets at an address: the same as in a folder, read only, by ranges, and nothing outside them."""

import json
import struct
import sys
import threading
import zlib
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import fsspec
import numpy as np
import pytest
from mcap.opcode import Opcode
from torch.utils.data import DataLoader

import busybot
from benchmarks.reliability.s3 import BUCKET, CREDENTIALS, serving
from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.common.limits import Budget
from busybot.common.remote import RemotePath
from busybot.episodes.mcap import pictures, ranges, writer
from busybot.episodes.mcap.pictures import Kept
from busybot.episodes.mcap.records import FOOTER, each_record
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode

ADDRESS = "memory://bucket/d"
SERVER = Path(sys.executable).parent / "moto_server"
ABSENT = "s3fs or moto is not installed: `make extras`"


@pytest.fixture(autouse=True)
def nothing_kept_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "_KEPT", Kept(pictures.KEPT_BYTES))


@pytest.fixture
def store() -> Iterator[fsspec.AbstractFileSystem]:
    """The memory of this process as a store, empty."""
    system = fsspec.filesystem("memory")
    yield system
    system.store.clear()
    system.pseudo_dirs[:] = [""]


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """What is read from addresses: (file, bytes)."""
    found, original = [], RemotePath.read

    def counted(self: RemotePath, start: int, end: int) -> bytes:
        data = original(self, start, end)
        found.append((self.name, len(data)))
        return data

    monkeypatch.setattr(RemotePath, "read", counted)
    return found


def put(store: fsspec.AbstractFileSystem, folder: Path) -> busybot.Dataset:
    store.put(str(folder), "/bucket/d", recursive=True)
    return busybot.load_dataset(ADDRESS)


def test_it_is_the_dataset_that_was_put_there(store: fsspec.AbstractFileSystem, tmp_path: Path) -> None:
    here = make_dataset(tmp_path / "d")
    data = put(store, tmp_path / "d")
    assert str(data.path) == ADDRESS and len(data) == 3 and data.boards() == here.boards() and data.info == here.info
    for table in ("episodes", "steps", "objects"):
        assert data.table(table).equals(here.table(table)) and len(data.to_pandas(table)) == len(here.to_pandas(table))
    for episode, same in zip(data, here, strict=True):
        assert episode.steps == same.steps
        np.testing.assert_array_equal(episode.rgb[3], same.rgb[3])
        np.testing.assert_array_equal(episode.depth[-1], same.depth[-1])
    with pytest.raises(BusybotError, match="board 2 has no episode"):
        data[2]


@pytest.fixture
def plain_server(tmp_path: Path) -> Iterator[str]:
    """The address of a folder that Python's own server shows: it lists no sizes, and knows no ranges."""
    pytest.importorskip("aiohttp")
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_from_a_server_that_knows_neither_sizes_nor_ranges(
    plain_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = make_dataset(tmp_path / "d")
    data = busybot.load_dataset(f"{plain_server}/d")
    assert len(data) == 3 and data.boards() == here.boards()
    assert data.table("steps").equals(here.table("steps"))
    monkeypatch.setattr(ranges, "_TAIL_BYTES", 64)
    monkeypatch.setattr(pictures, "WHOLE_BYTES", 0)
    np.testing.assert_array_equal(data[1].rgb[2], here[1].rgb[2])


def test_a_batch_reads_what_it_shows(
    store: fsspec.AbstractFileSystem, tmp_path: Path, read: list[tuple[str, int]]
) -> None:
    here = make_dataset(tmp_path / "d")
    frames = put(store, tmp_path / "d").frames("rgb", "next_depth")
    assert not [name for name, _ in read if name.endswith(".mcap")]
    own = [busybot.load_dataset(tmp_path / "d").frames("rgb", "next_depth")[i] for i in range(4)]
    batch = next(iter(DataLoader(frames, 4)))
    assert {name for name, _ in read if name.endswith(".mcap")} == {here.episode_path(0).name}
    for key, values in batch.items():
        np.testing.assert_array_equal(values, np.stack([item[key] for item in own]))
    in_a_worker = next(iter(DataLoader(frames, 4, num_workers=1)))
    np.testing.assert_array_equal(in_a_worker["rgb"], batch["rgb"])


@pytest.fixture
def long(store: fsspec.AbstractFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> busybot.Dataset:
    """One whose recordings have several chunks, which are read one by one."""
    monkeypatch.setattr(writer, "CHUNK_BYTES", 4000)
    monkeypatch.setattr(ranges, "_TAIL_BYTES", 64)
    monkeypatch.setattr(pictures, "WHOLE_BYTES", 0)
    make_dataset(tmp_path / "d", images="png")
    return put(store, tmp_path / "d")


def test_of_a_long_recording_one_chunk_is_read(
    long: busybot.Dataset, tmp_path: Path, read: list[tuple[str, int]]
) -> None:
    file = tmp_path / "d" / "episodes" / "000001.mcap"
    index = ranges.read_index(RemotePath(ADDRESS) / "episodes" / file.name, file.stat().st_size)
    assert len(index.chunks) > 3
    frames, own = long.frames("rgb"), busybot.load_dataset(tmp_path / "d").frames("rgb")
    read.clear()
    for number in (len(frames) - 1, *range(len(frames))):
        np.testing.assert_array_equal(frames[number]["rgb"], own[number]["rgb"])
        largest = max(size for _, size in read)
        assert largest < file.stat().st_size / 2
    with pytest.raises(BusybotError, match=r"000001\.mcap: there is no picture 99"):
        pictures.PictureFile(long.episode_path(1)).holding("/camera/rgb", 99)


def test_an_index_that_names_its_metadata_again_and_again_is_a_few_requests(
    long: busybot.Dataset, store: fsspec.AbstractFileSystem, read: list[tuple[str, int]]
) -> None:
    place = "/bucket/d/episodes/000000.mcap"
    data = store.cat_file(place)
    opcode, length, start, _, _, magic = FOOTER.unpack(data[-FOOTER.size :])
    summary = data[start : -FOOTER.size]
    kinds = {kind: summary[at : at + 9 + len(body)] for at, kind, body, _ in each_record(summary, Budget())}
    summary = kinds[Opcode.METADATA_INDEX] * 500 + summary + struct.pack("<BQQQ", opcode, length, start, 0)
    store.pipe_file(place, data[:start] + summary + struct.pack("<I8s", zlib.crc32(summary), magic))
    index = ranges.read_index(RemotePath(ADDRESS) / "episodes" / "000000.mcap", store.size(place))
    assert index.records.metadata.keys() == {"busybot"} and len(read) < 5


def test_a_recording_of_another_time_is_refused(long: busybot.Dataset, store: fsspec.AbstractFileSystem) -> None:
    frames, place = long.frames("rgb"), "/bucket/d/episodes/000000.mcap"
    data = bytearray(store.cat_file(place))
    data[-40] ^= 1
    store.pipe_file(place, bytes(data))
    with pytest.raises(BusybotError, match=r"000000\.mcap: the index does not match"):
        frames[0]
    again = writer._encoded(make_episode(0, steps=5), "png")
    store.pipe_file(place, again)
    with pytest.raises(BusybotError, match=r"000000\.mcap: it was recorded again"):
        long.frames("rgb")[0] if len(again) == len(data) else frames[0]


def test_nothing_is_written_and_nothing_else_is_read(store: fsspec.AbstractFileSystem, tmp_path: Path) -> None:
    make_dataset(tmp_path / "d")
    data, before = put(store, tmp_path / "d"), dict(store.store)
    attempts = (
        data.graphs,
        data.hashes,
        lambda: data.locked().__enter__(),
        lambda: data.table_path("steps", 0).write_bytes(b""),
    )
    for attempt in attempts:
        with pytest.raises(BusybotError, match="only read") as error:
            attempt()
        assert "copy the dataset" in str(error.value.hint)
    with pytest.raises(BusybotError, match="only read"):
        write_episode(data.episode_path(2), make_episode(2))
    assert store.store == before
    for name in ("../x", "/x", "a//b", "."):
        with pytest.raises(BusybotError, match="leaves the folder"):
            RemotePath(ADDRESS) / name


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("memory://nothing", "there is no such folder"),
        ("memory://bucket/d/dataset.json", "is a file"),
        ("gopher://me:secret@host/d", "gopher://host/d: .*not known"),
        ("s3://me:secret@[bucket/d", r"^s3://\[bucket/d: Invalid IPv6 URL"),
        ("s3://me:secret@bucket\u2100/d", "^s3://bucket\u2100/d: it has signs that no host has"),
        ("file://me:secret@host/d", "^file://host/d: a folder of another machine"),
        ("gopher://me:half@secret@host/d", "gopher://host/d: .*not known"),
    ],
)
def test_addresses_that_hold_none(store: fsspec.AbstractFileSystem, tmp_path: Path, address: str, told: str) -> None:
    make_dataset(tmp_path / "d")
    put(store, tmp_path / "d")
    with pytest.raises(BusybotError, match=told) as error:
        busybot.load_dataset(address)
    assert error.value.hint


@pytest.mark.parametrize("name", ["dataset.json", "episodes/000000.mcap", "tables/steps/part-00000.parquet"])
def test_damaged_and_huge_files_are_refused(
    store: fsspec.AbstractFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    make_dataset(tmp_path / "d")
    whole = put(store, tmp_path / "d")
    store.pipe_file(f"/bucket/d/{name}", store.cat_file(f"/bucket/d/{name}")[:-9])
    with pytest.raises(BusybotError, match=name.rpartition("/")[2]):
        busybot.load_dataset(ADDRESS).frames() if "mcap" not in name else whole[0]
    monkeypatch.setattr(RemotePath, "size", lambda _: 1 << 50)
    with pytest.raises(BusybotError, match="more than the"):
        (RemotePath(ADDRESS).forget(), busybot.load_dataset(ADDRESS))[1][0]


@pytest.mark.long
def test_from_s3(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With workers, too, which are forked from a process that has spoken with the server."""
    s3fs = pytest.importorskip("s3fs", reason=ABSENT)
    pytest.importorskip("moto", reason=ABSENT)
    for name, value in CREDENTIALS.items():
        monkeypatch.setenv(name, value)
    with serving(SERVER) as address:
        options = {"endpoint_url": address}
        s3fs.S3FileSystem(**options).put(str(tiny), f"{BUCKET}/tiny", recursive=True)
        data, here = busybot.load_dataset(f"s3://{BUCKET}/tiny", options), busybot.load_dataset(tiny)
        assert len(data) == len(here) and data.table("steps").equals(here.table("steps"))
        np.testing.assert_array_equal(data[3].rgb[2], here[3].rgb[2])
        for workers in (0, 2):
            frames = data.frames()
            batch = next(iter(DataLoader(frames, 8, sampler=frames.shuffled(seed=1), num_workers=workers)))
            episode, step = int(batch["episode"][5]), int(batch["step"][5])
            np.testing.assert_array_equal(batch["rgb"][5], here[episode].rgb[step])
        with pytest.raises(BusybotError, match=r"s3://frozen/none: there is no such folder"):
            busybot.load_dataset(f"s3://{BUCKET}/none", options)
        with pytest.raises(BusybotError, match=r"s3://elsewhere/tiny: "):
            busybot.load_dataset("s3://elsewhere/tiny", options)


def said(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command that runs in this process, where the store is."""
    with pytest.raises(SystemExit) as end:
        app(list(words), prog_name="busybot")
    told = capsys.readouterr()
    return int(end.value.code or 0), told.out, told.err


def test_info_reads_an_address(
    store: fsspec.AbstractFileSystem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_dataset(tmp_path / "d")
    put(store, tmp_path / "d")
    here = json.loads(said(capsys, "dataset", "info", str(tmp_path / "d"), "--json")[1])
    there = json.loads(said(capsys, "dataset", "info", ADDRESS, "--json")[1])
    hashes = {f"{kind}_hash": None for kind in ("board", "trace", "content")}
    assert there == here | hashes and all(here[name] for name in hashes)
    assert here == json.loads(said(capsys, "dataset", "info", f"file://{tmp_path}/d", "--json")[1])
    code, out, error = said(capsys, "dataset", "info", "memory://bucket/none")
    assert (
        (code, out) == (1, "") and "memory://bucket/none: there is no such folder" in error and "generate" not in error
    )


@pytest.mark.parametrize(
    "words",
    ["dataset verify A", "dataset export A --out x", "view A", "eval reason A", "generate A", "dataset diff x A"],
)
def test_what_takes_a_path_refuses_an_address(
    words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, error = said(capsys, *words.replace("A", "s3://me:secret@bucket/d").split())
    assert (code, out) == (2, "") and "s3://bucket/d: an address" in error and "load_dataset" in error
    assert not list(tmp_path.iterdir()), "no folder s3: is made"
