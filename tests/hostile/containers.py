"""Containers of pictures from others' recorders: HDF5 episodes, MCAP with Foxglove's images, logs of states, videos."""

import io
import json
import struct
import tempfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from busybot.episodes.mcap import channels
from tests.datasets.camera_folders import read_rows, write_camera_folder, write_table, write_video
from tests.datasets.test_imports_of_containers import log_of, state_rows, with_keys, write_hdf5, write_mcap
from tests.episodes.synthetic import make_episode
from tests.hostile.damage import ANY, BOMB_BYTES, JSON, TEXT, TEXTS, Damage, deep, flipped, huge_word, other_number
from tests.hostile.doors import imported_from, in_a_line, odd_picture
from tests.hostile.recordings import chunk_of
from tests.hostile.targets import Target, _printed

NAME = "containers of recordings"
STEPS, SECRET = 4, 201
"""Pictures that are all of this value lie beside the recording: no answer may hold them."""
IMAGES, TIMES, LOG = "observations/images", "observations/timestamp", "busybox/state_json"
Root = Any


def _tables(folder: Path) -> Any:
    """A recording without its pictures, whose objects have states; the times of pictures would be 100 s, 101 s, ..."""
    episode = make_episode(0, steps=STEPS)
    write_camera_folder(folder / "t", episode, times=True)
    for file in [*(folder / "t").glob("*.png"), folder / "t" / "frames.csv"]:
        file.unlink()
    return episode


def _hdf5(folder: Path) -> None:
    episode = _tables(folder)
    with_keys(folder / "t")
    log = [{"box": {"values": row.tolist()}} for row in state_rows(episode)[0]]
    write_hdf5(folder / "t" / "episode_0.hdf5", episode, True, log)
    (folder / "secret").mkdir()
    picture = episode.images[0]
    shown = np.full((STEPS + 1, *picture.rgb.shape), SECRET, np.uint8)
    (folder / "secret" / "raw").write_bytes(shown.tobytes())
    import h5py

    with h5py.File(folder / "secret" / "secret.h5", "w") as root:
        root[f"{IMAGES}/cam_0"], root[TIMES] = shown, 100.0 + np.arange(STEPS + 1)


def _mcap(folder: Path) -> None:
    write_mcap(folder / "t" / "recording.mcap", _tables(folder))


def _states(folder: Path) -> None:
    episode = make_episode(0, steps=STEPS)
    write_camera_folder(folder / "t", episode, times=True)
    with_keys(folder / "t")
    (folder / "t" / "states.jsonl").write_text(log_of(state_rows(episode)[0]))


def _video(folder: Path) -> None:
    episode = _tables(folder)
    for place in (folder / "t" / "film.mp4", folder / "secret.mp4"):
        dark = place.parent == folder
        pictures = [episode.image(n).rgb for n in range(STEPS + 1)]
        write_video(place, [np.full_like(one, SECRET) for one in pictures] if dark else pictures)
    rows = read_rows(folder / "t" / "actions.csv")
    write_table(folder / "t" / "actions.csv", [row | {"time": n + 0.5} for n, row in enumerate(rows)])


def in_hdf5(change: Callable[[Root, np.random.Generator], object]) -> Damage:
    """The change, done to a file that stays a valid HDF5 file."""

    def damaged(data: bytes, rng: np.random.Generator) -> bytes:
        import h5py

        buffer = io.BytesIO(data)
        with h5py.File(buffer, "r+") as root:
            change(root, rng)
        return buffer.getvalue()

    damaged.__name__ = change.__name__
    return damaged


def _place(rng: np.random.Generator, places: tuple[str, ...] = (f"{IMAGES}/cam_0", TIMES, LOG)) -> str:
    return places[int(rng.integers(len(places)))]


def odd_array(root: Root, rng: np.random.Generator) -> None:
    """Values of another kind, number or shape in the place of an array."""
    import h5py

    place, count = _place(rng), STEPS + 1
    times, words = 100.0 + np.arange(count), [text.encode(errors="surrogatepass") for text in TEXTS]
    spoilt = times.copy()
    spoilt[int(rng.integers(count))] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e300, 0])
    arrays: tuple[Any, ...] = (
        *(spoilt, spoilt, spoilt, spoilt, times[::-1], times + 1j, times > 102, times.astype(np.float16)),
        *(
            times.astype("S8"),
            np.array(words[:count], "S20"),
            np.array([b"\xff"] * count),
            np.zeros(0),
            np.zeros((0, 5)),
        ),
        *(times[:, None], np.float64(100), h5py.Empty("f8"), np.full(count, 2**64 - 1, np.uint64), np.int64(-(2**63))),
        *(np.zeros(count, [("a", "f8"), ("b", "S3")]), np.zeros(count, "(3,)u1"), np.zeros(count, "V5")),
        *(np.zeros((count, 4, 4, 3), np.uint8), np.zeros((count, 0, 0, 3), np.uint8), np.zeros((count, 99), np.uint8)),
        *(np.zeros((count, 40, 40, 4), np.uint8), np.zeros((count, 40, 40, 3)), np.zeros((count, 3, 40, 40), np.uint8)),
        np.frombuffer(b"".join(word.ljust(5000, b"\0")[:5000] for word in words[:count]), np.uint8).reshape(count, -1),
    )
    del root[place]
    kind = int(rng.integers(len(arrays) + 4))
    if kind < len(arrays):
        root[place] = arrays[kind]
    elif kind == len(arrays):
        chosen = [words[int(rng.integers(len(words)))].replace(b"\0", b"") for _ in range(count)]
        root.create_dataset(place, data=chosen, dtype=h5py.string_dtype())
    elif kind == len(arrays) + 1:
        root.create_dataset(place, (count,), dtype=h5py.vlen_dtype(np.int32))
    elif kind == len(arrays) + 2:
        root.create_dataset(place, (count,), dtype=(h5py.ref_dtype, h5py.regionref_dtype)[int(rng.integers(2))])
    else:
        root.create_dataset(place, data=np.arange(count), dtype=h5py.enum_dtype({"a": 1, "b": 2}))


def odd_log(root: Root, rng: np.random.Generator) -> None:
    """A line of the log of states is damaged JSON, or other JSON."""
    import h5py

    lines = [bytes(line) for line in root[LOG][:]]
    number = int(rng.integers(len(lines)))
    lines[number] = LINES[int(rng.integers(len(LINES)))](lines[number], rng)
    del root[LOG]
    root.create_dataset(LOG, data=lines, dtype=h5py.string_dtype())


def odd_packed(root: Root, rng: np.random.Generator) -> None:
    """One of the packed pictures is another one."""
    rows = [row.tobytes().rstrip(b"\0") for row in root[f"{IMAGES}/cam_0"][:]]
    number = int(rng.integers(len(rows)))
    rows[number] = (odd_picture, flipped)[int(rng.integers(2))](rows[number], rng)
    longest = max(map(len, rows))
    del root[f"{IMAGES}/cam_0"]
    root[f"{IMAGES}/cam_0"] = np.array([np.frombuffer(row.ljust(longest, b"\0"), np.uint8) for row in rows])


def huge_array(root: Root, rng: np.random.Generator) -> None:
    """An array that says it is huge, of which nothing or little is stored."""
    place, side = _place(rng), int(rng.choice([2**10, 2**16, 2**24, 2**32, 2**40]))
    kind, dtype = int(rng.integers(5)), "f8" if rng.random() < 0.3 else "u1"
    count = int(rng.choice([STEPS + 1, 10**6, 2**40]))
    shapes = ((count,), (count, side), (count, side, side, 3), (side, 3), (STEPS + 1, 2**32, 2**32, 3))
    shape = shapes[kind]
    del root[place]
    chunks = tuple(min(length, 64) for length in shape) if rng.random() < 0.5 else shape
    while np.prod([float(length) for length in chunks]) > 4e8:
        chunks = tuple(-(-length // 2) for length in chunks)
    root.create_dataset(place, shape, dtype, chunks=chunks, compression=(None, "gzip", "lzf")[int(rng.integers(3))])


def packed_bomb(root: Root, rng: np.random.Generator) -> None:
    """A chunk that becomes a lot when it is unpacked: as much as it says, or much more."""
    place, kind = _place(rng), int(rng.integers(3))
    rows, row = ((10**6, ()), (STEPS + 1, (8000, 8000, 3)), (STEPS + 1, (BOMB_BYTES,)))[kind]
    size = (rows, *row)
    chunk = (rows,) if not row else (1, *row) if rng.random() < 0.5 else (2, *row)
    del root[place]
    made = root.create_dataset(place, size, "u1", chunks=chunk, compression="gzip")
    packer = zlib.compressobj(1)
    more = b"".join(packer.compress(bytes(50_000_000)) for _ in range(int(rng.choice([1, 4, 60]))))
    made.id.write_direct_chunk((0,) * len(size), more + packer.flush())


def link_elsewhere(root: Root, rng: np.random.Generator) -> None:
    """A link to another file, to itself or round in a circle, an array whose values lie in other files."""
    import h5py

    place, count = _place(rng, (f"{IMAGES}/cam_0", IMAGES, "observations", TIMES, LOG)), STEPS + 1
    shape, kind = (count, 120, 160, 3), int(rng.integers(9))
    del root[place]
    secret = str(Path("..") / "secret" / "secret.h5")
    if kind == 0:
        root[place] = h5py.ExternalLink(secret, f"{IMAGES}/cam_0" if place.startswith(IMAGES) else TIMES)
    elif kind == 1:
        root[place] = h5py.SoftLink(f"/{place}")
    elif kind == 2:
        root[place], root["round"] = h5py.SoftLink("/round"), h5py.SoftLink(f"/{place}")
    elif kind == 3:
        root[place] = root
    elif kind == 4:
        root[place] = np.dtype("f8")
    elif kind == 5:
        root.create_group(place)
    elif kind == 6:
        raw = ("copy/secret/raw", "/etc/passwd", "/dev/zero")[int(rng.integers(3))]
        root.create_dataset(place, shape, "u1", external=[(raw, 0, h5py.h5f.UNLIMITED)])
    elif kind == 7:
        layout = h5py.VirtualLayout(shape, "u1")
        layout[:] = h5py.VirtualSource(secret, f"{IMAGES}/cam_0", shape)
        root.create_virtual_dataset(place, layout)
    else:
        root[place] = h5py.ExternalLink(("/dev/zero", "/etc/passwd", ".", "episode_0.hdf5")[int(rng.integers(4))], "/")


def odd_camera(root: Root, rng: np.random.Generator) -> None:
    """The camera has a name that means something to terminals, pages or encoders; or there are many."""
    import h5py

    name = (
        TEXTS[int(rng.integers(len(TEXTS)))].replace("\0", "").replace("/", "|").encode(errors="surrogatepass")
        or b"\xff\xfe"
    )
    folder = root[IMAGES]
    h5py.h5o.link(folder["cam_0"].id, folder.id, name)
    for number in range(20_000 if rng.random() < 0.2 else 0):
        folder[f"x{number}"] = folder["cam_0"]
    if rng.random() < 0.8:
        del folder["cam_0"]


def in_mcap(change: Callable[[list[list[Any]], np.random.Generator], object]) -> Damage:
    """The change, done to the messages: topic, encoding, schema, time in ns and data of each."""

    def damaged(data: bytes, rng: np.random.Generator) -> bytes:
        read = make_reader(io.BytesIO(data)).iter_messages()
        told = [[c.topic, c.message_encoding, s.name if s else "", m.log_time, m.data] for s, c, m in read]
        change(told, rng)
        buffer = io.BytesIO()
        kinds = list(CompressionType)
        writer = Writer(buffer, compression=kinds[int(rng.integers(len(kinds)))] if rng.random() < 0.3 else kinds[0])
        writer.start()
        numbers: dict[Any, int] = {}
        for topic, encoding, schema, at, body in told:
            key = (topic, encoding, schema)
            if key not in numbers:
                number = writer.register_schema(schema, "protobuf", b"") if schema else 0
                numbers[key] = writer.register_channel(topic, encoding, number)
            writer.add_message(numbers[key], at, body, at)
        writer.finish()
        return buffer.getvalue()

    damaged.__name__ = change.__name__
    return damaged


def odd_time(told: list[list[Any]], rng: np.random.Generator) -> None:
    told[int(rng.integers(len(told)))][3] = int(rng.choice(np.array([0, 1, 2**63, 2**64 - 1, 10**11], np.uint64)))


def odd_channel(told: list[list[Any]], rng: np.random.Generator) -> None:
    """Another name, encoding or schema, of one message or all."""
    column = int(rng.integers(3))
    texts = [text.encode(errors="replace").decode() for text in TEXTS]
    value = ((*texts, "x" * 100_000), ("json", "ros1", "", "cbor"), ("", "foxglove.RawImage", *texts))[column]
    changed = value[int(rng.integers(len(value)))]
    for one in told if rng.random() < 0.5 else [told[int(rng.integers(len(told)))]]:
        one[column] = changed


def odd_image(told: list[list[Any]], rng: np.random.Generator) -> None:
    """A message is damaged, or holds another picture; or there is one more, or many, or one less."""
    one, kind = told[int(rng.integers(len(told)))], int(rng.integers(5))
    made = channels.message_class("foxglove.CompressedImage")
    if kind == 0:
        one[4] = (flipped(one[4], rng), one[4] * 2, b"", one[4][:50])[int(rng.integers(4))]
    elif kind < 3:
        image = made.FromString(one[4])
        image.data = (odd_picture, flipped)[kind - 1](image.data, rng)
        one[4] = image.SerializeToString()
    elif kind == 3:
        told.remove(one)
    else:
        told += [[*one[:3], told[-1][3] + n + 1, one[4]] for n in range(int(rng.choice([1, 50_000])))]


def chunk_bomb(data: bytes, rng: np.random.Generator) -> bytes:
    """Chunks that expand to gigabytes before what was there."""
    bomb = chunk_of(("records", "messages", "zeros")[int(rng.integers(3))])
    return data[:8] + bomb * int(rng.integers(1, 40)) + data[8:]


def odd_clock(data: bytes, rng: np.random.Generator) -> bytes:
    """The time of one line or all is of another clock, zone or type."""
    stamps = (
        "1970-01-01T00:01:{:09.6f}",
        "1970-01-01T00:01:{:09.6f}Z",
        "1970-01-01T02:01:{:09.6f}+02:00",
        "NaN",
        "inf",
    )
    stamps += ("{}e3", "-{}", "", " {} ", "0x64", "1_0{:.0f}", "\u0660", "9999-12-31T23:59:59-23:59")
    stamps += ("0001-01-01T00:00:00+23:59", "1970-01-01", "NaN", "inf")
    values = (*(stamp.format(39.5 + rng.integers(9)) for stamp in stamps), None, True, [], {}, 10**400, 1e300, -5)
    lines = [json.loads(line) for line in data.splitlines()]
    changed = values[int(rng.integers(len(values)))]
    for line in lines if rng.random() < 0.3 else [lines[int(rng.integers(len(lines)))]]:
        line["ts"] = changed
    return "".join(json.dumps(line) + "\n" for line in lines).encode()


def playlist(data: bytes, rng: np.random.Generator) -> bytes:
    """A list that tells where pictures lie, in the place of a video."""
    secret = ("../secret.mp4", "/dev/zero", "http://127.0.0.1:9/x.mp4", "concat:../secret.mp4")[int(rng.integers(4))]
    hls = f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{secret}\n#EXT-X-ENDLIST\n"
    concat, sdp = f"ffconcat version 1.0\nfile '{secret}'\n", "v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n"
    base = f"<Representation id='1' bandwidth='1'><BaseURL>{secret}</BaseURL></Representation>"
    mpd = f"<MPD type='static'><Period><AdaptationSet mimeType='video/mp4'>{base}</AdaptationSet></Period></MPD>"
    return (hls, concat, sdp, mpd)[int(rng.integers(4))].encode()


def _boxes(data: bytes, changed: dict[bytes, bytes]) -> bytes:
    """The boxes of an MP4, those of some names with another content."""
    made, place = b"", 0
    while place < len(data):
        size, name = int.from_bytes(data[place : place + 4]), data[place + 4 : place + 8]
        body = data[place + 8 : place + size]
        if name in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
            body = _boxes(body, changed)
        body = changed.get(name, body)
        made, place = made + struct.pack(">I4s", 8 + len(body), name) + body, place + size
    return made


@cache
def _one_frame(width: int, height: int) -> bytes:
    """An MP4 of one frame; all of its first box but one, the data, come last."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "x.mp4"
        write_video(file, [np.zeros((height, width, 3), np.uint8)])
        return file.read_bytes()


def repeated_frame(film: bytes, count: int, other: bytes = b"") -> bytes:
    """An MP4 of one frame whose tables name it again and again, perhaps told to be of the kind and size of another."""
    sizes, offsets = film.index(b"stsz") + 8, film.index(b"stco") + 12
    size, offset = (int.from_bytes(film[place : place + 4]) for place in (sizes, offsets))
    changed = {
        b"edts": b"",  # an edit would end the film after its one frame
        b"stts": struct.pack(">IIII", 0, 1, count, 1),
        b"stsz": struct.pack(">III", 0, size, count),
        b"stsc": struct.pack(">IIIII", 0, 1, 1, 1, 1),
        b"stco": struct.pack(">II", 0, count) + struct.pack(">I", offset) * count,
    }
    if other:
        place = other.index(b"stsd") - 4
        changed[b"stsd"] = other[place + 8 : place + int.from_bytes(other[place : place + 4])]
    return _boxes(film, changed)


def video_bomb(data: bytes, rng: np.random.Generator) -> bytes:
    """A small file that becomes 100 gigapixels or more, or frames that are larger than any picture may be."""
    sides = ((3840, 2160), (1920, 1080), (640, 480), (160, 120), (4096, 4096), (8000, 8000))
    width, height = sides[int(rng.integers(len(sides)))]
    count = int(rng.choice([max(10**11 // (width * height), 100_001), 10**6]))
    other = _one_frame(*sides[int(rng.integers(4))]) if rng.random() < 0.3 else b""
    return repeated_frame(_one_frame(width, height), count, other)


def _read(fps: float | None = None) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        answer = imported_from(folder / "t", fps=fps)
        for _, _, pictures in answer[2]:
            if any(set(rgb) == {SECRET} for rgb, _ in pictures):
                raise ValueError("it shows pictures of another file")
        return answer

    return read


LINES: tuple[Damage, ...] = (*JSON, *JSON, other_number, other_number, huge_word, deep)
LOGGED = (*(in_a_line(way) for way in LINES), *[odd_clock] * 4, *TEXT)
CHANGES = (odd_array, odd_array, odd_array, odd_log, odd_packed, huge_array, huge_array, packed_bomb)
WITHIN_HDF5 = tuple(in_hdf5(change) for change in (*CHANGES, link_elsewhere, link_elsewhere, odd_camera))
WITHIN_MCAP = (*(in_mcap(change) for change in (odd_time, odd_channel, odd_image, odd_image)), chunk_bomb)
PRINTED = _printed("dataset", "import", "t", "--dry-run")
PIXELS_TAKE = 150.0
"""Seconds: all pixels that a video may have are decoded before it is refused, in 20 s of a usual processor."""
CONTAINERS: dict[str, Target] = {
    "hdf5 episodes": Target(_hdf5, "t/*.hdf5", ANY, _read(), False, NAME, 2),
    "hdf5 values": Target(_hdf5, "t/*.hdf5", WITHIN_HDF5, _read(), False, NAME, 2),
    "logs of states": Target(_states, "t/*.jsonl", LOGGED, _read(), False, NAME, 2),
    "foxglove images": Target(_mcap, "t/*.mcap", ANY, _read(), False, NAME, 2),
    "foxglove values": Target(_mcap, "t/*.mcap", WITHIN_MCAP, _read(), False, NAME, 2),
    "videos": Target(_video, "t/*.mp4", (*ANY, playlist, playlist), _read(1.0), False, NAME, 2),
    "video bombs": Target(_video, "t/*.mp4", (video_bomb,), _read(1.0), True, "bombs", 8, seconds=PIXELS_TAKE),
    "printed hdf5": Target(_hdf5, "t/*.hdf5", (in_hdf5(odd_camera), in_hdf5(odd_log)), PRINTED, False, NAME, 8),
    "printed foxglove": Target(_mcap, "t/*.mcap", (in_mcap(odd_channel),), PRINTED, False, NAME, 8),
}
