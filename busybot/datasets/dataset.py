"""A dataset is a folder; nothing in it is read through a link that leaves it, nothing written through any link.

dataset.json                      what it is (`datasets.info.DatasetInfo`)
boards/boards-00000.jsonl         one board per line, 1,000 a file
episodes/000000.mcap              one file per board, there whole or not at all
tables/{episodes,steps,objects}/part-00000.parquet      500 episodes a file, derived from the episodes
manifest.json, README.md          of a frozen dataset (`freeze`): every file with its hash, and a card
objects/                          of a frozen dataset, where their licence allows: the objects on its boards
damaged/                          originals of the files that `repair` replaced
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
from pydantic import ValidationError

from busybot.boards.spec import BoardSpec
from busybot.common.atomic_io import (
    inside,
    make_folder,
    one_writer,
    refuse_taken,
    remove,
    remove_abandoned,
    remove_leftovers,
    rename,
    unfinished,
    write_atomically,
    write_json,
)
from busybot.common.config import changes, flat
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.datasets.info import CollectInfo, DatasetInfo, collect_command, read_description, refuse_frozen
from busybot.episodes.digests import Digests, combine
from busybot.episodes.schema import SCHEMA_VERSION, TABLES, arrow_schema
from busybot.episodes.tables import EPISODES_PER_SHARD, Rows, episode_rows, read_shard, split_by_episode, write_shard

BOARDS_PER_SHARD = 1000
INFO_FILE = "dataset.json"
OBJECTS_FOLDER, DAMAGED_FOLDER = "objects", "damaged"
HINT_GENERATE = "generate the dataset again"

_EPISODE_NAME = re.compile(r"^(\d{6,9})\.mcap$")
_SHARD_NAME = re.compile(r"^part-(\d{5})\.parquet$")

Derive = Callable[[list[tuple[Path, int]]], Iterable[dict[str, pa.Table]]]
"""Maps (file, index) pairs to their rows in the same order; workers may share the work."""


def derive_here(files: list[tuple[Path, int]]) -> Iterator[dict[str, pa.Table]]:
    """Rows of files, one after the other in this process."""
    return (episode_rows(path, index) for path, index in files)


@dataclass
class Dataset:
    """A dataset that exists; make one with `create` or `open`."""

    path: Path
    info: DatasetInfo
    _derived: dict[tuple[int, int], Rows] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def create(cls, path: Path, info: DatasetInfo, boards: Iterable[BoardSpec] = ()) -> "Dataset":
        """Write a new dataset with its boards. It is there whole or not at all: a killed call is simply repeated.

        Raises:
            BusybotError: there is something already, or the boards are not numbered as the info says.
        """
        place = Path(path).absolute()
        refuse_taken(place)
        lines = []
        for index, board in enumerate(boards):
            if board.index != index:
                raise BusybotError(f"{path}: board {board.index} stands at place {index}")
            lines.append(board.model_dump_json() + "\n")
        if len(lines) != info.boards:
            raise BusybotError(f"{path}: {len(lines)} boards where {info.boards} were announced")
        make_folder(place.parent)
        remove_abandoned(place.parent, place.name)
        with unfinished(place.parent, place.name) as folder:
            for name in ("boards", "episodes"):
                make_folder(folder / name, folder)
            for shard, start in enumerate(range(0, len(lines), BOARDS_PER_SHARD)):
                data = "".join(lines[start : start + BOARDS_PER_SHARD]).encode()
                write_atomically(folder / _boards_name(shard), data, folder)
            write_json(folder / INFO_FILE, info.model_dump(mode="json"))
            refuse_taken(place)  # by somebody who was faster
            rename(folder, place)
        return cls(Path(path), info)

    @classmethod
    def open(cls, path: Path) -> "Dataset":
        """Read `dataset.json`.

        Raises:
            BusybotError: if the folder holds no dataset, or one of another schema version.
        """
        path = Path(path)
        if path.is_file():
            raise BusybotError(f"{path} is a file", "name the dataset's folder")
        if not path.is_dir():
            raise BusybotError(f"{path}: there is no such folder", "`busybot generate OUT` makes a dataset")
        if not (path / INFO_FILE).exists():
            raise BusybotError(f"{path}: not a dataset, it has no {INFO_FILE}", "`busybot generate OUT` makes one")
        file = inside(path, INFO_FILE)
        values = read_description(file, "schema", SCHEMA_VERSION)
        try:
            return cls(path, DatasetInfo.model_validate(values))
        except ValidationError as error:
            raise BusybotError(f"{file}: {first_fault(error)}", HINT_GENERATE) from None

    def boards(self) -> list[BoardSpec]:
        """All boards in order."""
        shards = range(-(-self.info.boards // BOARDS_PER_SHARD))
        return [self._board(shard, number, line) for shard in shards for number, line in enumerate(self._lines(shard))]

    def board(self, index: int) -> BoardSpec:
        """Board `index`; reads one shard."""
        if not 0 <= index < self.info.boards:
            raise BusybotError(f"{self.path}: there is no board {index}, boards are 0 to {self.info.boards - 1}")
        shard, number = divmod(index, BOARDS_PER_SHARD)
        return self._board(shard, number, self._lines(shard)[number])

    def _lines(self, shard: int) -> list[bytes]:
        file = inside(self.path, _boards_name(shard))
        try:
            lines = file.read_bytes().splitlines()
        except OSError as error:
            raise BusybotError(f"{file}: cannot be read: {error.strerror}", HINT_GENERATE) from None
        expected = min(BOARDS_PER_SHARD, self.info.boards - shard * BOARDS_PER_SHARD)
        if len(lines) != expected:
            raise BusybotError(f"{file}: {len(lines)} boards, expected {expected}", HINT_GENERATE)
        return lines

    def _board(self, shard: int, number: int, line: bytes) -> BoardSpec:
        place = f"{self.path / _boards_name(shard)}: line {number + 1}"
        try:
            board = BoardSpec.model_validate_json(line)
        except ValidationError as error:
            raise BusybotError(f"{place}: {first_fault(error)}", HINT_GENERATE) from None
        if board.index != shard * BOARDS_PER_SHARD + number:
            raise BusybotError(f"{place}: holds board {board.index}", HINT_GENERATE)
        return board

    def episode_path(self, index: int) -> Path:
        """Where episode `index` is or will be."""
        if not 0 <= index < self.info.boards:
            raise BusybotError(f"{self.path}: there is no episode {index} of {self.info.boards}")
        return inside(self.path, f"episodes/{index:06d}.mcap")

    def finished(self) -> set[int]:
        """Indices of episodes that are there under their final names."""
        folder = inside(self.path, "episodes")
        if not folder.is_dir():
            return set()
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries if entry.is_file(follow_symlinks=False)]
        found = {int(match[1]) for name in names if (match := _EPISODE_NAME.match(name))}
        return {index for index in found if index < self.info.boards}

    def begin_collecting(self, collect: CollectInfo) -> None:
        """Record how episodes are made, or refuse to continue otherwise than before. Call it under `locked`.

        While there are no episodes, a new attempt replaces what an earlier one recorded.

        Raises:
            BusybotError: naming each setting that differs from the recorded one; or the dataset is frozen.
        """
        refuse_frozen(self.path)
        self.info = Dataset.open(self.path).info  # another process may have begun since this one opened the dataset
        if self.info.collect is None or not self.finished():
            self.info = self.info.model_copy(update={"collect": collect})
            write_json(inside(self.path, INFO_FILE), self.info.model_dump(mode="json"))
            return
        recorded, wanted = (flat(value.model_dump(mode="json")) for value in (self.info.collect, collect))
        changed = changes(recorded, wanted)
        if changed:
            differing = [f"{name} {was!r}, now {now!r}" for name, (was, now) in changed.items()]
            what = f"{self.path}: its episodes were begun with other settings: {'; '.join(differing)}"
            raise BusybotError(what, f"{collect_command(self.path, self.info)}; or collect into another dataset")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """One writer at a time; the lock ends with the process, however it ends.

        Raises:
            BusybotError: another process holds the lock, or the dataset is frozen.
        """
        refuse_frozen(self.path)  # before the lock, too: in a read-only folder it could not be made
        with one_writer(self.path):
            refuse_frozen(self.path)
            yield

    def remove_leftovers(self) -> int:
        """Delete temporary files of writers that are no more; returns their number. Call it under `locked`."""
        return remove_leftovers(self.path)

    def table_path(self, table: str, shard: int) -> Path:
        """Where shard `shard` of a table is or will be."""
        return inside(self.path, f"tables/{table}/part-{shard:05d}.parquet")

    def write_tables(self, rows: Mapping[int, Rows] | None = None, derive: Derive = derive_here) -> None:
        """Bring the tables up to date with the finished episodes.

        Rows that are given are taken; those in the tables are kept where the file still has the size they tell; all
        others are derived from the files. Shards that are up to date are not written.

        Args:
            rows: episode index to rows, as `episode_rows` returned them for files of this dataset.
        """
        shards = self.finished_by_shard()
        for shard, indices in shards.items():
            self._write_shard(shard, indices, rows or {}, derive)
        for table in TABLES:
            for shard in set(self.stored_shards(table)) - set(shards):
                remove(self.table_path(table, shard), self.path)

    def table(self, name: str, columns: list[str] | None = None) -> pa.Table:
        """A whole table as it is stored, or some columns (`schema.public_columns` names those for learners)."""
        shards = self.stored_shards(name)
        if not shards:
            raise BusybotError(f"{self.path}: it has no table {name!r} yet", "`busybot collect` makes it")
        return pa.concat_tables(read_shard(self.table_path(name, shard), name, columns) for shard in shards)

    def episodes_table(self, derive: Derive = derive_here) -> pa.Table:
        """The rows of table `episodes` for all finished episodes, also where the stored table lacks them."""
        rows = [arrow_schema("episodes").empty_table()]
        for shard, indices in self.finished_by_shard().items():
            stored = self.stored_rows(shard, ("episodes",))
            current = {i: stored[i] for i in indices if i in stored and self._is_current(i, stored[i])}
            # remembered, because a stopped collection may lack hundreds and one command asks several times
            keys = {i: (i, self.episode_path(i).stat().st_mtime_ns) for i in indices if i not in current}
            missing = [i for i, key in keys.items() if key not in self._derived]
            derived = derive([(self.episode_path(i), i) for i in missing])
            self._derived |= zip([keys[i] for i in missing], derived, strict=True)
            rows += [(current[i] if i in current else self._derived[keys[i]])["episodes"] for i in indices]
        return pa.concat_tables(rows)

    def hashes(self, episodes: pa.Table | None = None) -> Digests:
        """Hashes of the whole dataset: all boards, all finished episodes.

        Args:
            episodes: what `episodes_table` returned, if it was called already.
        """
        rows = (self.episodes_table() if episodes is None else episodes).to_pydict()
        boards = combine("board", ((board.index, board.digest()) for board in self.boards()))
        trace, content = (
            combine(kind, zip(rows["episode"], rows[f"{kind}_digest"], strict=True)) for kind in ("trace", "content")
        )
        return Digests(board=boards, trace=trace, content=content)

    def finished_by_shard(self) -> dict[int, list[int]]:
        """Indices of finished episodes, in order, by the shard of the tables that they belong to."""
        shards: dict[int, list[int]] = {}
        for index in sorted(self.finished()):
            shards.setdefault(index // EPISODES_PER_SHARD, []).append(index)
        return shards

    def stored_shards(self, table: str) -> list[int]:
        """Numbers of the shards that a table has."""
        folder = inside(self.path, f"tables/{table}")
        names = (_SHARD_NAME.match(file.name) for file in folder.iterdir()) if folder.is_dir() else ()
        return sorted(int(match[1]) for match in names if match)

    def _write_shard(self, shard: int, indices: list[int], given: Mapping[int, Rows], derive: Derive) -> None:
        stored = self.stored_rows(shard)
        kept = [i for i in indices if i in stored and i not in given]
        ready = {i: stored[i] for i in kept if self._is_current(i, stored[i]) and _is_whole(stored[i])}
        if set(ready) == set(indices) == set(stored):
            return
        ready |= {i: given[i] for i in indices if i in given}
        missing = [i for i in indices if i not in ready]
        ready |= zip(missing, derive([(self.episode_path(i), i) for i in missing]), strict=True)
        # `episodes` last: an episode counts as stored when its row is there, so its other rows must be there before
        for table in sorted(TABLES, key=lambda name: name == "episodes"):
            write_shard(self.table_path(table, shard), table, [ready[i][table] for i in indices], self.path)

    def stored_rows(self, shard: int, names: Sequence[str] = tuple(TABLES)) -> dict[int, Rows]:
        """Rows of the shard by episode of the first table; nothing if one of its files is absent or unreadable."""
        try:
            tables = {name: split_by_episode(read_shard(self.table_path(name, shard), name)) for name in names}
        except BusybotError:
            return {}
        empty = {name: arrow_schema(name).empty_table() for name in names}
        return {i: {name: tables[name].get(i, empty[name]) for name in names} for i in tables[names[0]]}

    def _is_current(self, index: int, rows: Rows) -> bool:
        return rows["episodes"]["bytes"][0].as_py() == self.episode_path(index).stat().st_size


def _is_whole(rows: Rows) -> bool:
    """Whether an episode's rows are there in all tables: a writer may have been stopped between two of them."""
    steps = rows["episodes"]["steps"][0].as_py()
    return rows["steps"].num_rows == steps and rows["objects"].num_rows > 0


def _boards_name(shard: int) -> str:
    return f"boards/boards-{shard:05d}.jsonl"
