"""What is read from files that others made, and how one sees that the answer is not wrong."""

import contextlib
import io
import json
import os
import resource
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from busybot.boards.config import BoardConfig
from busybot.cli.main import app
from busybot.common.atomic_io import read_regular, scan
from busybot.common.config import build
from busybot.common.errors import BusybotError, explained, naming
from busybot.common.limits import MAX_RECORDING_BYTES
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.dvc_remote import read_pointer
from busybot.datasets.freeze import freeze
from busybot.datasets.manifest import is_frozen
from busybot.datasets.summary import summarise
from busybot.datasets.verify import verify
from busybot.episodes.digests import combine
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.salvage import salvage
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import episode_rows
from busybot.interact.affordance.load import load_model
from busybot.models import describe_model
from busybot.objects import cache
from busybot.objects.partnet.loader import load_object
from busybot.objects.resolve import find
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.registry import load_reasoner
from busybot.training.model_cards import find_folder
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.hostile.damage import ANY, JSON, TEXT, Damage, array_header, odd_tensors, odd_weights, other_number
from tests.hostile.recordings import BOMBS, WITHIN

Read = Callable[[Path], Any]


@dataclass(frozen=True)
class Target:
    """A kind of file.

    Attributes:
        make: fills a folder.
        files: pattern of the files in it that are damaged, one at a time.
        ways: in which a file may be damaged.
        read: reads the folder as users' commands do; returns what it understood, to be compared.
        strict: whether any change of the file must be noticed or be without effect.
        line: the class of attacks it belongs to, as a row of the table.
        every: of so many cases one is tried, where it takes long.
        spoil: changes a folder where there are no `ways`, and returns what it changed, and how; `exchange` if None.
        seconds: one copy may take so long, time left out in which others had the processor.
    """

    make: Callable[[Path], None]
    files: str
    ways: tuple[Damage, ...]
    read: Read
    strict: bool
    line: str = "damaged files"
    every: int = 1
    spoil: Callable[[Path, np.random.Generator], tuple[Path, str]] | None = None
    seconds: float = 30.0


def _frozen(folder: Path) -> None:
    from busybot.datasets.freeze import freeze

    dataset = make_dataset(folder / "d", boards=2, finished=(0, 1))
    freeze(dataset.path, None)
    for path in sorted(folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)  # who damages files does not mind that they are read-only


def _verified(folder: Path) -> Any:
    """Nothing if the dataset is not as it was frozen: `verify` says so."""
    report = verify(folder / "d")
    return True if report.ok else NOTICED


NOTICED = "noticed"


def _episode(folder: Path) -> Any:
    return _plain(read_episode(folder / "d" / "episodes" / "000000.mcap"))


def _plain(episode: Episode) -> Any:
    pictures = [
        (image.rgb.tobytes(), None if image.depth is None else image.depth.tobytes()) for image in episode.images
    ]
    return episode.board, episode.steps, pictures


def _dataset(folder: Path) -> None:
    make_dataset(folder / "d", boards=2, finished=(0, 1))


def _boards(folder: Path) -> Any:
    dataset = Dataset.open(folder / "d")
    return [dataset.board(index) for index in range(dataset.info.boards)]


def _tables(folder: Path) -> Any:
    report = verify(folder / "d")
    return True if report.ok else NOTICED


def _object(key: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        library = find("procedural")
        shutil.copytree(library.folder / key, folder / key)

    return make


def _load(key: str) -> Read:
    def read(folder: Path) -> Any:
        model = load_object(folder / key)
        return model.sha256

    return read


def _textured(suffix: str) -> Callable[[Path], None]:
    """An object whose first material has a picture."""

    def make(folder: Path) -> None:
        _object(OBJECT)(folder)
        meshes = folder / OBJECT / "textured_objs"
        material = sorted(meshes.glob("*.mtl"))[0]
        material.write_text(material.read_text() + f"map_Kd picture{suffix}\n")
        picture = generator(0, "hostile", 0, "picture").integers(0, 255, (64, 48, 3), np.uint8)
        cv2.imwrite(str(meshes / f"picture{suffix}"), picture)

    return make


def _pointer(folder: Path) -> None:
    out = "- md5: 4ffb46ba37bd2ce52470086b4756420b.dir\n  size: 300003\n  nfiles: 4\n  hash: md5\n  path: toys\n"
    (folder / "toys.dvc").write_text("outs:\n" + out)


def _config(folder: Path) -> None:
    text = "boards: 3\nsplit: novel-object\nlamps: [3, 4]\nseed: 5\nuniform: true\n"
    (folder / "boards.yaml").write_text(text)


def _built(folder: Path) -> Any:
    return build(BoardConfig, folder / "boards.yaml", [], {})


def _model(folder: Path) -> None:
    from busybot.interact.affordance.load import find_model

    shutil.copytree(find_model("procedural"), folder / "m")


def _strangers_model(folder: Path) -> None:
    """A card without hashes, as older models have it: all depends on what the weights themselves are."""
    _model(folder)
    card = folder / "m" / "model.json"
    card.write_text(json.dumps(json.loads(card.read_text()) | {"files": {}}))


def _weights(folder: Path) -> Any:
    model = load_model(folder / "m")
    return [np.asarray(value).tobytes() for net in model.networks.values() for value in net.state_dict().values()]


def _repaired(folder: Path) -> Any:
    """What is read, and what is saved when it cannot be: neither may cost more than is said."""
    file = folder / "d" / "episodes" / "000000.mcap"
    with contextlib.suppress(BusybotError):
        salvage(read_regular(file, MAX_RECORDING_BYTES))
    return _episode(folder)


def _used(folder: Path) -> Any:
    """A recording goes on to what computes with its numbers and draws its names."""
    from busybot.reason.encoders.registry import make_extractor
    from busybot.view.figures.episode import episode_figure

    file = folder / "d" / "episodes" / "000000.mcap"
    rows = episode_rows(file, 0)
    episode = read_episode(file, "lazy")
    with naming(file), np.errstate(all="ignore"):
        values = make_extractor().of_episode(episode)
        episode_figure(folder.parent / "copy" / "figure.png", episode)
    return {name: table.to_pylist() for name, table in rows.items()}, values.tobytes()


def _exchangeable(folder: Path) -> None:
    """A dataset with features, beside another one whose files may come in the place of its own."""
    for name, split in (("d", "train"), ("other", "train")):
        dataset = make_dataset(folder / name, boards=2, finished=(0, 1), split=split)
        if name == "other":
            for index in (0, 1):
                write_episode(dataset.episode_path(index), make_episode(index, steps=5 + index))
            dataset.write_tables()
        features_of(dataset, workers=1)


def _room(folder: Path) -> None:
    (folder / "room").write_text("1000000000")


def _exchangeable_frozen(folder: Path) -> None:
    _exchangeable(folder)
    freeze(folder / "d", None)
    for path in sorted(folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def exchange(folder: Path, rng: np.random.Generator) -> tuple[Path, str]:
    """Put a file of another dataset or episode, or one that was edited, in the place of one; returns which, and how.

    Times are as they were: only what the files hold can tell.
    """
    files = sorted(p for p in folder.glob("d*/**/*") if p.is_file() and p.suffix in (".mcap", ".parquet", ".npy"))
    file = files[int(rng.integers(len(files)))]
    facts, kind = file.stat(), int(rng.integers(4 if file.suffix == ".parquet" else 2))
    others = [p for p in folder.glob(f"**/*{file.suffix}") if p != file and p.read_bytes() != file.read_bytes()]
    others = [p for p in others if file.suffix != ".parquet" or p.parent.name == file.parent.name]
    if kind < 2:
        shutil.copyfile(sorted(others)[int(rng.integers(len(others)))], file)
    else:
        _edit(file, rng, keep=kind == 2)
    os.utime(file, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    return file, "exchanged" if kind < 2 else "edited"


def _edit(file: Path, rng: np.random.Generator, keep: bool) -> None:
    """Another number somewhere in a table, written by pyarrow with or without what it knew of the schema."""
    table = pq.read_table(file)
    numeric = [
        n for n in table.column_names if pa.types.is_integer(table.schema.field(n).type) and table[n].null_count == 0
    ]
    name = [n for n in numeric if n != "episode"][int(rng.integers(len(numeric) - 1))]
    values = table[name].to_pylist()
    row = int(rng.integers(len(values)))
    values[row] = 1 - values[row] if values[row] in (0, 1) else values[row] - 1
    field = table.schema.field(name)
    edited = table.set_column(table.column_names.index(name), field, pa.array(values, field.type))
    pq.write_table(edited if keep else edited.replace_schema_metadata(None), file)


def _answers(folder: Path) -> Any:
    """Whether what commands are told of a dataset is what its recordings say, if they do not notice that it is not."""
    dataset = Dataset.open(folder / "d")
    try:
        told = summarise(dataset.path)
        steps = dataset.table("steps", ["reward"])["reward"].to_pylist()
        features = features_of(dataset, workers=1, store=folder / "d.features")
        values = [features[index] for index in sorted(features)]
    except BusybotError:
        return NOTICED
    rows = {i: episode_rows(dataset.episode_path(i), i) for i in sorted(dataset.finished())}
    content = combine("content", ((i, one["episodes"]["content_digest"][0].as_py()) for i, one in rows.items()))
    fresh = [make_extractor().of_episode(read_episode(dataset.episode_path(i), "lazy")) for i in rows]
    right = told["content_hash"] == content and told["bytes"] == sum(
        one["episodes"]["bytes"][0].as_py() for one in rows.values()
    )
    right &= told["steps"] == sum(one["steps"].num_rows for one in rows.values())
    right &= steps == [reward for one in rows.values() for reward in one["steps"]["reward"].to_pylist()]
    return right and all(np.array_equal(a, b) for a, b in zip(values, fresh, strict=True))


def less_room(data: bytes, rng: np.random.Generator) -> bytes:
    """No file may become larger than this."""
    return str(int(10 ** rng.uniform(0, 5.5))).encode()


def _with_little_room(folder: Path) -> Any:
    """What writes ends in a fault that can be told, and the same command continues when there is room again."""
    room = int(read_regular(folder / "room", 100))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with tempfile.TemporaryDirectory(prefix="busybot-hostile-room-") as place:
        dataset = make_dataset(Path(place) / "d", boards=1, finished=(0,))
        shutil.rmtree(dataset.path / "tables")
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
        try:
            _written(dataset)
        except OSError as error:
            told = explained(error)
            assert "are free" in told.what and told.hint and place in told.what, told
        except BusybotError as error:
            assert error.hint, error
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        if not is_frozen(dataset.path):
            _written(dataset)
        return verify(dataset.path).ok and not [name for name in scan(Path(place)).files if name.endswith(".tmp")]


def _written(dataset: Dataset) -> None:
    dataset.write_tables()
    features_of(dataset, workers=1, store=dataset.path.parent / "features")
    freeze(dataset.path, None)


def _printed(*arguments: str) -> Read:
    """What a command of ours prints, for people and as JSON."""

    def read(folder: Path) -> Any:
        words = [str(folder / word) if (folder / word).exists() or word == "page" else word for word in arguments]
        said = [_said(words), _said([*words, "--json"])]
        codes, outs, _ = zip(*said, strict=True)
        if outs[1].strip():
            json.loads(outs[1].decode().splitlines()[-1], parse_constant=_no_json)
        if set(codes) != {0}:
            return NOTICED
        return outs[0]

    return read


def _no_json(name: str) -> None:
    raise ValueError(f"{name} in --json")


def _said(words: list[str]) -> tuple[int, bytes, bytes]:
    """Exit code, output and error of a command; whatever it says must suit a terminal that knows ASCII alone."""
    streams = [io.TextIOWrapper(io.BytesIO(), "ascii", errors="backslashreplace") for _ in range(2)]
    with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
        try:
            app(words, prog_name="busybot")
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    out, err = (stream.detach().getvalue() for stream in _flushed(streams))
    for text in (out, err):
        if any(byte < 32 and byte not in b"\n\t" for byte in text) or b"\x7f" in text:
            raise ValueError(f"a control character is printed: {text[:200]!r}")
    if code and not (b"hint:" in err or {"verify", "check"} & {*words}):  # these tell in a table what is wrong
        raise ValueError(f"exit code {code} without a hint: {err[-300:]!r}")
    if (page := Path("copy/page/report.html")).is_file():
        _check_page(page.read_text(encoding="utf-8"))
    return code, out, err


def _flushed(streams: list[io.TextIOWrapper]) -> list[io.TextIOWrapper]:
    for stream in streams:
        stream.flush()
    return streams


def _check_page(text: str) -> None:
    if "<script>alert" in text or 'href="https://example.com' in text:
        raise ValueError("a text of a result is markup in the report")


def _result(folder: Path) -> None:
    results = Path(__file__).resolve().parents[2] / "benchmarks" / "results"
    (folder / "r").mkdir()
    shutil.copyfile(results / "table2.json", folder / "r" / "table2.json")


def _reasoner(folder: Path) -> None:
    shutil.copytree(find_folder("event", "reason"), folder / "m")


def _reasons(folder: Path) -> Any:
    from busybot.models import verify as verify_model

    describe_model(folder / "m")
    verdict = verify_model(folder / "m")
    reasoner = load_reasoner(folder / "m")
    return verdict.ok, type(reasoner).__name__, reasoner.encoder


def _cached(folder: Path) -> None:
    os.environ["BUSYBOT_CACHE"] = str(folder / "cache")
    cache.remember(folder, {"a": "b"})


def _places(folder: Path) -> Any:
    """A convenience: whatever lies there costs time alone."""
    os.environ["BUSYBOT_CACHE"] = str(folder / "cache")
    found = cache.places({"a": "b"})
    with contextlib.suppress(OSError):
        cache.remember(folder, {"c": "d"})
    return [str(place) for place in found]


OBJECT = "Switch/rocker-01"
TARGETS: dict[str, Target] = {
    "boards": Target(_frozen, "d/boards/*.jsonl", TEXT, _verified, True),
    "boards read": Target(_dataset, "d/boards/*.jsonl", TEXT, _boards, False),
    "dataset.json": Target(_frozen, "d/dataset.json", TEXT, _verified, True),
    "manifest": Target(_frozen, "d/manifest.json", TEXT, _verified, False),
    "parquet": Target(_dataset, "d/tables/*/*.parquet", ANY, _tables, True),
    "mcap": Target(_dataset, "d/episodes/000000.mcap", ANY, _episode, True),
    "mcap bombs": Target(_dataset, "d/episodes/000000.mcap", BOMBS, _repaired, True, "bombs", 8),
    "mcap values": Target(
        _dataset, "d/episodes/000000.mcap", WITHIN, _used, False, "numbers and texts in recordings", 4
    ),
    "exchanged": Target(_exchangeable, "d*/**/*.*", (), _answers, True, "wrong answers", 4),
    "exchanged frozen": Target(_exchangeable_frozen, "d/**/*.*", (), _answers, True, "wrong answers", 4),
    "features": Target(_exchangeable, "d.features/*/*.npy", ANY, _answers, True, "wrong answers", 4),
    "headers of features": Target(
        _exchangeable, "d.features/*/*.npy", (array_header,), _answers, True, "wrong answers", 4
    ),
    "full disk": Target(_room, "room", (less_room,), _with_little_room, True, "full disks", 10),
    "printed dataset": Target(
        _dataset, "d/dataset.json", JSON, _printed("dataset", "info", "d"), False, "text and JSON that are printed", 2
    ),
    "printed recording": Target(
        _dataset,
        "d/episodes/000000.mcap",
        WITHIN,
        _printed("dataset", "verify", "d", "--workers", "1"),
        False,
        "text and JSON that are printed",
        4,
    ),
    "printed model": Target(
        _model, "m/model.json", JSON, _printed("models", "info", "m"), False, "text and JSON that are printed", 2
    ),
    "printed models": Target(
        _model,
        "m/model.json",
        (*JSON, other_number),
        _printed("models", "list", "m"),
        False,
        "text and JSON that are printed",
        2,
    ),
    "report": Target(
        _result, "r/*.json", JSON, _printed("report", "r", "--out", "page"), False, "text and JSON that are printed", 10
    ),
    "urdf": Target(_object(OBJECT), f"{OBJECT}/mobility.urdf", TEXT, _load(OBJECT), False),
    "annotation": Target(_object(OBJECT), f"{OBJECT}/object_meta_info.json", TEXT, _load(OBJECT), False),
    "obj and mtl": Target(_object(OBJECT), f"{OBJECT}/textured_objs/*", TEXT, _load(OBJECT), False),
    "png": Target(_textured(".png"), f"{OBJECT}/textured_objs/*.png", ANY, _load(OBJECT), False),
    "jpeg": Target(_textured(".jpg"), f"{OBJECT}/textured_objs/*.jpg", ANY, _load(OBJECT), False),
    "dvc pointer": Target(_pointer, "toys.dvc", TEXT, lambda folder: read_pointer(folder / "toys.dvc", "toys"), False),
    "yaml": Target(_config, "boards.yaml", TEXT, _built, False),
    "safetensors": Target(_model, "m/*.safetensors", (*ANY, odd_weights, odd_weights), _weights, True, "models", 2),
    "safetensors of strangers": Target(
        _strangers_model, "m/*.safetensors", (*ANY, odd_weights, *[odd_tensors] * 4), _weights, False, "models", 2
    ),
    "model.json": Target(_model, "m/model.json", (*TEXT, *JSON), _weights, False, "models", 2),
    "model.json of relations": Target(
        _reasoner, "m/model.json", (*JSON, *JSON, other_number), _reasons, False, "models", 2
    ),
    "cache": Target(_cached, "cache/libraries.json", TEXT, _places, False, "damaged files", 1),
}
