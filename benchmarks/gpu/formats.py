"""Writes and reads the two folders that travel: a pack of recorded boards on the way there, a training on the way back.

A pack holds all that the paper's graph networks learn from, without loss, in 3 to 4 kB a board of 30 steps:

pack.json                          what is in it (`PackInfo`), written last
boards-000.safetensors.xz, ...     boards in their order
wheels/                            packages that the other machine lacks, if they were asked for

| array | of one file with B boards of N objects, T steps and A appearances each |
|---|---|
| `sizes` | int32 (B, 3): N, T, A |
| `features` | float16 (sum of A, 256), every appearance on a board once |
| `appearances` | uint16 (sum of (T + 1) N), which of its board's an object shows in a frame |
| `positions`, `triggers`, `responders` | (sum of N, ...) as of `BoardSequence` |
| `actions`, `acted` | (sum of T, ...) as of `BoardSequence` |

What comes back are `run.json` (`RunInfo`, written last), `metrics.jsonl` with the losses, and `weights-0.safetensors`,
`weights-1.safetensors` and so on, none larger than was asked for if a row of a tensor is smaller: of a tensor that is
larger, rows lie in several, as `NAME#0`, `NAME#1` and so on.
"""

import hashlib
import lzma
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import torch
from pydantic import Field, ValidationError
from safetensors import SafetensorError
from safetensors.numpy import load, save
from torch import Tensor

from busybot.common.atomic_io import read_json, read_regular, sha256_of, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.limits import MAX_WEIGHTS_BYTES
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.training.checkpoint import load_tensors, save_tensors
from busybot.training.model_cards import Hashes

PACK, RUN, METRICS = "pack.json", "run.json", "metrics.jsonl"
OF_OBJECTS, OF_STEPS = ("positions", "triggers", "responders"), ("actions", "acted")
MAX_BOARDS_BYTES = 512 << 20
"""Of a file of boards, decompressed; 2,500 boards have some 25 MB."""
LINE = 200
"""Bytes that a file's header may need for a tensor."""
Info = TypeVar("Info", bound=FrozenModel)
Arrays = dict[str, np.ndarray]


class PackInfo(FrozenModel):
    """What a pack holds.

    Attributes:
        commit: of the code that made it.
        boards: how many.
        data: the datasets that they come from, as a training notes them.
        features: which features, with a digest of all that decides them.
        oracle: whether these hold what only the simulator knows.
        rows: parameters of the trainings that are to be run (`PaperReasonConfig`), by the row's name in Table 2.
        files: SHA-256 of the files with boards, in their order.
    """

    format: Literal["1"] = "1"
    commit: str | None
    boards: Annotated[int, Field(ge=1)]
    data: list[dict[str, Any]]
    features: str
    oracle: bool
    rows: dict[str, dict[str, Any]]
    files: Hashes


class RunInfo(FrozenModel):
    """What came of a training.

    Attributes:
        pack: SHA-256 of the pack's `pack.json`, which has those of everything else; None for interaction networks.
        row: which of its trainings, or of those of Table 1.
        iterations, schedule: how many were done, of how many; of interaction networks, epochs.
        seconds: that they took, reading the pack left out.
        figures: what the training tells of held-out boards; of interaction networks, the model's card.
        half: whether matrices were rounded to float16 on the way back.
        machine, versions, commit: where, with what, and by which code it was trained; the commit may be unknown there.
        files: SHA-256 of the files with weights, and of the losses.
    """

    format: Literal["1"] = "1"
    pack: str | None
    row: str
    seed: Annotated[int, Field(ge=0)]
    iterations: Annotated[int, Field(ge=1)]
    schedule: Annotated[int, Field(ge=1)]
    seconds: float
    figures: dict[str, Any]
    half: bool
    machine: dict[str, Any]
    versions: dict[str, str]
    commit: str | None
    files: Hashes


def packed(boards: Sequence[BoardSequence]) -> bytes:
    """A file with these boards."""
    parts: dict[str, list[np.ndarray]] = {}
    for seen in boards:
        rows = seen.features.astype(np.float16).reshape(-1, CHANNELS)
        distinct, which = np.unique(rows.view(np.uint16), axis=0, return_inverse=True)
        one = {name: getattr(seen, name) for name in (*OF_OBJECTS, *OF_STEPS)} | {
            "sizes": np.array([[len(seen.positions), seen.steps, len(distinct)]], np.int32),
            "features": distinct.view(np.float16),
            "appearances": which.reshape(-1).astype(np.uint16),
        }
        for name, values in one.items():
            parts.setdefault(name, []).append(values)
    return lzma.compress(save({name: np.concatenate(values) for name, values in parts.items()}))


class PackedBoards(Sequence[BoardSequence]):
    """The boards of a pack, each made when it is asked for.

    Args:
        files: their contents in their order.
    """

    def __init__(self, files: Sequence[bytes]):
        self._boards = [board for data in files for board in _split(load(_decompressed(data)))]

    def __len__(self) -> int:
        return len(self._boards)

    def __getitem__(self, index: Any) -> Any:
        board = self._boards[index]
        shape = len(board["actions"]) + 1, len(board["positions"])
        features = board["features"][board["appearances"].astype(np.int64)].astype(np.float32)
        others = {name: board[name] for name in (*OF_OBJECTS, *OF_STEPS)}
        return BoardSequence(features=features.reshape(*shape, CHANNELS), **others)


def _decompressed(data: bytes) -> bytes:
    """As far as it is no larger than a file of boards may be."""
    reader = lzma.LZMADecompressor()
    found = reader.decompress(data, MAX_BOARDS_BYTES)
    if not reader.eof:
        raise ValueError(f"cut off, or more than {MAX_BOARDS_BYTES >> 20} MiB")
    return found


def _split(arrays: Arrays) -> Iterator[Arrays]:
    """The arrays of each board of a file."""
    objects, steps, distinct = arrays["sizes"].astype(np.int64).T
    counts = {name: objects for name in OF_OBJECTS} | {name: steps for name in OF_STEPS}
    counts |= {"features": distinct, "appearances": (steps + 1) * objects}
    for name, count in counts.items():
        if len(arrays[name]) != count.sum():
            raise ValueError(f"{name} has {len(arrays[name])} rows, its boards {count.sum()}")
    parts = {name: np.split(arrays[name], np.cumsum(count)[:-1]) for name, count in counts.items()}
    return (dict(zip(parts, board, strict=True)) for board in zip(*parts.values(), strict=True))


def write_pack(folder: Path, boards: Sequence[BoardSequence], each: int, **facts: Any) -> PackInfo:
    """Write the boards, `each` of them in a file, and what `PackInfo` says of them."""
    files = {}
    for number, start in enumerate(range(0, len(boards), each)):
        name = f"boards-{number:03d}.safetensors.xz"
        data = packed([boards[index] for index in range(start, min(start + each, len(boards)))])
        write_atomically(folder / name, data)
        files[name] = hashlib.sha256(data).hexdigest()
    info = PackInfo(boards=len(boards), files=files, **facts)
    write_json(folder / PACK, info.model_dump(mode="json"))
    return info


def read_pack(folder: Path) -> tuple[PackInfo, PackedBoards]:
    """What a pack says, and its boards.

    Raises:
        BusybotError: a file is absent, or another one than was packed.
    """
    info = _info(folder / PACK, PackInfo)
    _compare(folder, info.files)
    try:
        boards = PackedBoards([read_regular(folder / name, MAX_WEIGHTS_BYTES) for name in info.files])
    except (lzma.LZMAError, SafetensorError, KeyError, ValueError) as error:
        raise BusybotError(f"{folder}: its files with boards are damaged: {error}", "pack the boards again") from None
    if len(boards) != info.boards:
        raise BusybotError(f"{folder}: {len(boards)} boards of {info.boards}", "pack the boards again")
    return info, boards


def config_of(info: PackInfo, row: str, place: Path) -> PaperReasonConfig:
    """The parameters of one of a pack's trainings.

    Raises:
        BusybotError: naming `place`, which asks for a row that the pack has not, or has in another version.
    """
    if row not in info.rows:
        raise BusybotError(f"{place}: there is no row {row} in the pack", f"choose {', '.join(info.rows)}")
    try:
        return PaperReasonConfig.model_validate(info.rows[row])
    except ValidationError as error:
        raise BusybotError(f"{place}: row {row}: {first_fault(error)}", "pack the boards again") from None


def read_pack_info(folder: Path) -> tuple[PackInfo, str]:
    """What a pack says, and its hash."""
    return _info(folder / PACK, PackInfo), sha256_of(folder / PACK)


def write_run(folder: Path, tensors: dict[str, Tensor], metrics: bytes, most: int, **facts: Any) -> RunInfo:
    """Write what comes back of a training.

    Args:
        most: bytes of a file of weights.
    """
    files = {}
    for number, some in enumerate(_parts(_halved(tensors) if facts["half"] else tensors, most)):
        name = f"weights-{number}.safetensors"
        save_tensors(folder / name, some)
        files[name] = sha256_of(folder / name)
    write_atomically(folder / METRICS, metrics)
    files[METRICS] = sha256_of(folder / METRICS)
    for former in {one.name for one in folder.glob("weights-*.safetensors")} - files.keys():
        (folder / former).unlink()
    info = RunInfo(files=files, **facts)
    write_json(folder / RUN, info.model_dump(mode="json"))
    return info


def _halved(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Matrices in float16; biases and what normalises stay as they are."""
    large = {name: value.half() for name, value in tensors.items() if value.dim() > 1}
    return tensors | large


def _parts(tensors: dict[str, Tensor], most: int) -> list[dict[str, Tensor]]:
    """The tensors in their order, as many together as a file may hold."""
    parts: list[dict[str, Tensor]] = []
    room = 0
    for name, value in _pieces(tensors, most):
        size = value.nbytes + LINE
        if size > room:
            parts.append({})
            room = most
        parts[-1][name] = value
        room -= size
    return parts


def _pieces(tensors: dict[str, Tensor], most: int) -> Iterator[tuple[str, Tensor]]:
    """The tensors; of those that no file could hold, rows."""
    for name, value in tensors.items():
        if value.dim() == 0 or value.nbytes + LINE <= max(most, 2 * LINE):
            yield name, value
        else:
            rows = max(1, len(value) * (most - LINE) // value.nbytes)
            yield from ((f"{name}#{number}", piece) for number, piece in enumerate(value.split(rows)))


def _joined(pieces: list[tuple[str, Tensor]]) -> dict[str, Tensor]:
    """The tensors of which these are pieces.

    Raises:
        ValueError: pieces are missing, there twice, or do not belong together.
    """
    tensors: dict[str, dict[str, Tensor]] = {}
    for whole, value in pieces:
        name, _, number = whole.partition("#")
        if number in (found := tensors.setdefault(name, {})):
            raise ValueError(f"{whole} is there twice")
        found[number] = value
    return {name: found[""] if found.keys() == {""} else _in_order(name, found) for name, found in tensors.items()}


def _in_order(name: str, found: dict[str, Tensor]) -> Tensor:
    wanted = [str(number) for number in range(len(found))]
    if found.keys() != set(wanted) or len({(value.shape[1:], value.dtype) for value in found.values()}) != 1:
        raise ValueError(f"of {name} there are the pieces {', '.join(sorted(found))}, or they do not belong together")
    return torch.cat([found[number] for number in wanted])


def read_run_info(folder: Path) -> RunInfo:
    """What is said of a training, without its weights.

    Raises:
        BusybotError: the file is absent, or another version wrote it.
    """
    return _info(folder / RUN, RunInfo)


def read_run(folder: Path) -> tuple[RunInfo, dict[str, Tensor]]:
    """What came of a training, and its weights in float32.

    Raises:
        BusybotError: a file is absent, or another one than was written.
    """
    info = read_run_info(folder)
    _compare(folder, info.files)
    weights = [file for file in info.files if file != METRICS]
    try:
        tensors = _joined([piece for file in weights for piece in load_tensors(folder / file).tensors.items()])
    except ValueError as error:
        raise BusybotError(f"{folder}: {error}", "copy the folder again, or make it again") from None
    return info, {name: value.float() if value.dtype == torch.float16 else value for name, value in tensors.items()}


def _info(file: Path, kind: type[Info]) -> Info:
    try:
        return kind.model_validate(read_json(file))
    except ValidationError as error:
        raise BusybotError(f"{file}: {first_fault(error)}", "another version wrote it: make it again") from None


def _compare(folder: Path, files: Hashes) -> None:
    for name, known in files.items():
        if sha256_of(folder / name) != known:
            raise BusybotError(f"{folder / name}: its SHA-256 is not the recorded one", "copy it again")
