"""A dataset is a folder; nothing in it is read through a link that leaves it, nothing written through any link.

One at an address (`common.remote`) is only read. There the recordings' sizes are compared with the tables when it is
opened, their checksums when they are read: to ask for thousands of them would take longer than the first batch.

dataset.json                      what it is (`datasets.info.DatasetInfo`)
boards/boards-00000.jsonl         one board per line, 1,000 a file
episodes/000000.mcap              one file per board, there whole or not at all
tables/{episodes,steps,objects}/part-00000.parquet      500 episodes a file, derived from the episodes
manifest.json, README.md          of a frozen dataset (`freeze`): every file with its hash, and a card
objects/                          of a frozen dataset, where their licence allows: those its boards were drawn from
damaged/                          originals of the files that `repair` replaced
"""

import operator
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice, starmap
from pathlib import Path
from typing import TYPE_CHECKING, Self

import pyarrow as pa
from pydantic import ValidationError

from busybot.boards.spec import BoardSpec
from busybot.common.atomic_io import (
    RESTORE,
    inside,
    make_folder,
    one_writer,
    read_regular,
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
from busybot.common.errors import BusybotError, NoEpisodeError
from busybot.common.frozen_model import first_fault
from busybot.common.limits import MAX_LINES_BYTES
from busybot.common.remote import RemotePath, is_remote
from busybot.datasets.info import CollectInfo, DatasetInfo, collect_command, read_description
from busybot.datasets.manifest import is_frozen, refuse_frozen, refuse_unlike_manifest
from busybot.episodes.digests import Digests, combine
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.records import Fingerprint, fingerprint
from busybot.episodes.schema import SCHEMA_VERSION, TABLES, arrow_schema, public_columns
from busybot.episodes.tables import (
    EPISODES_PER_SHARD,
    HINT_TABLES,
    MADE_OF_KEY,
    Rows,
    counts_of,
    episode_rows,
    read_shard,
    split_by_episode,
    write_shard,
)

if TYPE_CHECKING:
    import pandas

BOARDS_PER_SHARD = 1000
REQUESTS_AT_ONCE = 8
"""Shards of tables that are fetched from an address at a time."""
INFO_FILE = "dataset.json"
OBJECTS_FOLDER, DAMAGED_FOLDER = "objects", "damaged"
HASHED = ["episode", "board_digest", "trace_digest", "content_digest"]
"""Columns of table `episodes` from which a dataset's hashes are made."""
HINT_GENERATE = "generate the dataset again"
HINT_OTHER = "name another folder, or remove it"

_EPISODE_NAME = re.compile(r"([0-9]{6,9})\.mcap")
_SHARD_NAME = re.compile(r"part-([0-9]{5})\.parquet")


@dataclass
class Dataset:
    """A dataset that exists; make one with `create` or `open`."""

    path: Path
    info: DatasetInfo
    _derived: dict[tuple[int, int], Rows] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def create(
        cls, path: Path, info: DatasetInfo | Callable[[], DatasetInfo], boards: Iterable[BoardSpec] = ()
    ) -> Self:
        """Write a new dataset with its boards. It is there whole or not at all: a killed call is simply repeated.

        Args:
            info: or who tells it when the last board is drawn.
            boards: are written as they come.

        Raises:
            BusybotError: there is something already, or the boards are not numbered as the info says.
        """
        place = Path(path).absolute()
        refuse_taken(place)
        make_folder(place.parent)
        remove_abandoned(place.parent, place.name)
        with unfinished(place.parent, place.name) as folder:
            for name in ("boards", "episodes"):
                make_folder(folder / name, folder)
            written = _write_boards(folder, path, iter(boards))
            info = info() if callable(info) else info
            if written != info.boards:
                raise BusybotError(f"{path}: {written} boards where {info.boards} were announced")
            write_json(folder / INFO_FILE, info.model_dump(mode="json"))
            refuse_taken(place)  # by somebody who was faster
            rename(folder, place)
        return cls(Path(path), info)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read `dataset.json`.

        Raises:
            BusybotError: if the folder holds no dataset, or one of another schema version.
        """
        path = path if isinstance(path, RemotePath) else Path(path)
        # of an address the list is asked for, which tells more at once
        if not (INFO_FILE in path.names() if is_remote(path) else (path / INFO_FILE).exists()):
            if path.is_file():
                raise BusybotError(f"{path} is a file", "name the dataset's folder")
            if not path.is_dir():
                hint = "check the address" if is_remote(path) else "`busybot generate OUT` makes a dataset"
                raise BusybotError(f"{path}: there is no such folder", hint)
            raise BusybotError(f"{path}: not a dataset, it has no {INFO_FILE}", "`busybot generate OUT` makes one")
        file = inside(path, INFO_FILE)
        values = read_description(file, "schema", SCHEMA_VERSION)
        try:
            return cls(path, DatasetInfo.model_validate(values))
        except ValidationError as error:
            raise BusybotError(f"{file}: {first_fault(error)}", HINT_GENERATE) from None

    def grow(self, info: Callable[[], DatasetInfo], boards: Iterable[BoardSpec]) -> "Dataset":
        """Add boards; those that are there must be the first of `boards`, and episodes stay.

        `dataset.json` is written after the boards: a killed call is simply repeated, also with another number. What it
        wrote beyond the boards that `dataset.json` tells is not read, and goes with other leftovers.

        Args:
            info: tells how many boards there are and what stands on them when the last one is drawn.

        Raises:
            BusybotError: the dataset is frozen, another process writes into it, or its boards are others.
        """
        place = self.path.absolute()
        remove_abandoned(place.parent, place.name)
        with self.locked(), unfinished(place.parent, place.name) as folder:
            recorded = Dataset.open(self.path).info
            make_folder(folder / "boards")
            written, kept = _write_boards(folder, self.path, iter(boards)), -(-recorded.boards // BOARDS_PER_SHARD)
            for number, name in enumerate(map(_boards_name, range(kept))):
                before = b"".join(b"%s\n" % line for line in Dataset(self.path, recorded)._lines(number))
                if not read_regular(folder / name, MAX_LINES_BYTES).startswith(before):
                    raise BusybotError(f"{self.path / name}: its boards would be drawn otherwise today", HINT_OTHER)
            for shard in reversed(range(max(kept - 1, 0), -(-written // BOARDS_PER_SHARD))):
                rename(folder / _boards_name(shard), place / _boards_name(shard), place.parent)
            grown = info().model_copy(update={"name": recorded.name, "collect": recorded.collect})
            write_json(inside(self.path, INFO_FILE), grown.model_dump(mode="json"))
            Dataset(self.path, grown)._remove_untold_boards()  # of a killed call that was to grow further
        return Dataset(self.path, grown)

    def _remove_untold_boards(self) -> int:
        """Delete what a killed `grow` wrote beyond the boards of `dataset.json`; returns in how many files it was."""
        place = self.path.absolute()
        last = max(0, -(-self.info.boards // BOARDS_PER_SHARD) - 1)
        file = inside(place, _boards_name(last))
        later = [one for one in sorted(file.parent.glob("boards-*.jsonl")) if one.name > file.name]
        for one in later:
            remove(one, place)
        told = b"".join(b"%s\n" % line for line in self._lines(last)) if self.info.boards else b""
        if not self.info.boards or read_regular(file, MAX_LINES_BYTES) == told:
            return len(later)
        write_atomically(file, told, place)
        return len(later) + 1

    def boards(self) -> list[BoardSpec]:
        """All boards in order."""
        return list(self.each_board())

    def each_board(self) -> Iterator[BoardSpec]:
        """One board after the other, in order: a thousand boards take 20 MB."""
        for shard in range(-(-self.info.boards // BOARDS_PER_SHARD)):
            for number, line in enumerate(self._lines(shard)):
                yield self._board(shard, number, line)

    def board(self, index: int) -> BoardSpec:
        """Board `index`; reads one shard."""
        if not 0 <= index < self.info.boards:
            raise BusybotError(f"{self.path}: there is no board {index}, boards are 0 to {self.info.boards - 1}")
        shard, number = divmod(index, BOARDS_PER_SHARD)
        return self._board(shard, number, self._lines(shard)[number])

    def replace_board(self, board: BoardSpec) -> None:
        """Write another board in the place of that of its number. Call it under `locked`."""
        shard, number = divmod(board.index, BOARDS_PER_SHARD)
        lines = self._lines(shard)
        lines[number] = board.model_dump_json().encode()
        write_atomically(inside(self.path, _boards_name(shard)), b"".join(b"%s\n" % line for line in lines), self.path)

    def _lines(self, shard: int) -> list[bytes]:
        file = inside(self.path, _boards_name(shard))
        lines = read_regular(file, MAX_LINES_BYTES, HINT_GENERATE).splitlines()
        expected = min(BOARDS_PER_SHARD, self.info.boards - shard * BOARDS_PER_SHARD)
        if not expected <= len(lines) <= BOARDS_PER_SHARD:
            what = f"{file}: it should have {expected} lines, one for each board, and has {len(lines)}"
            raise BusybotError(what, HINT_GENERATE)
        return lines[:expected]  # more are of boards with which the dataset was about to grow, see `grow`

    def board_place(self, index: int) -> str:
        """File and line of a board, for messages."""
        shard, number = divmod(index, BOARDS_PER_SHARD)
        return f"{self.path / _boards_name(shard)}: line {number + 1}"

    def _board(self, shard: int, number: int, line: bytes) -> BoardSpec:
        place = self.board_place(shard * BOARDS_PER_SHARD + number)
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
            known = f"its boards are 0 to {self.info.boards - 1}" if self.info.boards else "it has no boards"
            raise NoEpisodeError(f"{self.path}: there is no episode {index} of {self.info.boards}", known)
        return inside(self.path, f"episodes/{_episode_name(index)}")

    def __len__(self) -> int:
        """Number of finished episodes."""
        return len(self.finished())

    def __bool__(self) -> bool:
        return True  # also without episodes

    def __iter__(self) -> Iterator[Episode]:
        """The finished episodes in order, each as `self[index]`."""
        return (self[index] for index in sorted(self.finished()))

    def __getitem__(self, index: int) -> Episode:
        """The episode of board `index`, from the end if negative; its pictures stay in the file until asked for.

        Raises:
            NoEpisodeError: there is no such board, or it has no episode yet.
            BusybotError: its file is damaged.
            TypeError: that is no number.
        """
        number = operator.index(index)
        number += self.info.boards if number < 0 else 0
        path = self.episode_path(number)
        if not _is_file(path):
            raise NoEpisodeError(f"{self.path}: board {number} has no episode", collect_command(self.path, self.info))
        return read_episode(path, "stored")

    def finished(self) -> set[int]:
        """Indices of episodes that are there under their final names.

        Raises:
            BusybotError: they lie in no folder, or one of them is no regular file.
        """
        folder = inside(self.path, "episodes")
        if is_remote(folder):
            names = folder.names()
        elif folder.is_dir():
            with os.scandir(folder) as entries:
                regular = {entry.name: entry.is_file(follow_symlinks=False) for entry in entries}
            names = list(regular)
            if odd := [name for name in names if _EPISODE_NAME.fullmatch(name) and not regular[name]]:
                what = f"{folder / min(odd)}: a link, or no regular file"
                raise BusybotError(what, "remove it, or put the recording itself in its place")
        elif os.path.lexists(folder):
            raise BusybotError(f"{folder}: not a folder", RESTORE)
        else:
            return set()
        found = {name: int(match[1]) for name in names if (match := _EPISODE_NAME.fullmatch(name))}
        return {index for name, index in found.items() if index < self.info.boards and name == _episode_name(index)}

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
            recorded = {name: was for name, (was, _) in changed.items() if was is not None}
            again = collect_command(self.path, self.info, differing=recorded)
            raise BusybotError(what, f"{again}; or collect into another dataset")

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
        """Delete what writers left that are no more; returns in how many files it was. Call it under `locked`."""
        return remove_leftovers(self.path) + self._remove_untold_boards()

    def table_path(self, table: str, shard: int) -> Path:
        """Where shard `shard` of a table is or will be."""
        return inside(self.path, f"tables/{table}/part-{shard:05d}.parquet")

    def write_tables(self, rows: Mapping[int, Rows] | None = None) -> None:
        """Bring the tables up to date with the finished episodes.

        Rows that are given are taken; those in the tables are kept where the file still has the size they tell; all
        others are derived from the files. Shards that are up to date are not written.

        Args:
            rows: episode index to rows, as `episode_rows` returned them for files of this dataset.
        """
        shards = self.finished_by_shard()
        for shard, indices in shards.items():
            self._write_shard(shard, indices, rows or {})
        for table in TABLES:
            for shard in set(self.stored_shards(table)) - set(shards):
                remove(self.table_path(table, shard), self.path)

    def store_rows(self, rows: Mapping[int, Rows]) -> None:
        """Bring those shards of the tables up to date that these episodes belong to, and look at no others.

        So what a long collection stores on its way costs as much at its end as at its beginning.
        """
        folder = inside(self.path, "episodes")
        for shard in sorted({index // EPISODES_PER_SHARD for index in rows}):
            first = shard * EPISODES_PER_SHARD
            own = range(first, min(first + EPISODES_PER_SHARD, self.info.boards))
            there = [i for i in own if _is_file(folder / _episode_name(i))]
            self._write_shard(shard, there, rows)

    def table(self, name: str, columns: list[str] | None = None) -> pa.Table:
        """A whole table as it is stored, or some columns (`schema.public_columns` names those for learners).

        Raises:
            BusybotError: there is none, or it is not the table of the episodes that are there.
        """
        shards = self.finished_by_shard()
        if not shards or not self.stored_shards(name):
            hint = HINT_TABLES if shards else collect_command(self.path, self.info)
            raise BusybotError(f"{self.path}: it has no table {name!r} yet", hint)
        believed = partial(self._believed, name, columns=columns)
        if not is_remote(self.path):
            return pa.concat_tables(starmap(believed, shards.items()))
        with ThreadPoolExecutor(REQUESTS_AT_ONCE) as threads:
            return pa.concat_tables(threads.map(believed, *zip(*shards.items(), strict=True)))

    def to_pandas(self, table: str = "steps", privileged: bool = False) -> "pandas.DataFrame":
        """A table (`episodes`, `steps` or `objects`) with the columns that learners may read, or with all.

        Raises:
            BusybotError: see `table`, or there is no table of that name.
        """
        if table not in TABLES:
            raise BusybotError(f"there is no table {table!r}", f"choose among {', '.join(TABLES)}")
        return self.table(table, None if privileged else public_columns(table)).to_pandas()

    def _believed(self, name: str, shard: int, indices: list[int], columns: list[str] | None) -> pa.Table:
        """A shard that was made of the episodes which are there now."""
        episodes = self._whole_shard(shard, indices)
        rows = episodes if name == "episodes" else None
        most = None if episodes is None else counts_of(episodes)[name]
        rows = read_shard(self.table_path(name, shard), name, columns, most) if rows is None else rows
        if episodes is None or _origin(rows) not in {_origin(episodes)} & {None, _made_of(episodes).encode()}:
            what = f"{self.table_path(name, shard)}: it was not made of the episodes that are there now"
            raise BusybotError(what, HINT_TABLES)
        return rows.select(columns or rows.schema.names).replace_schema_metadata(arrow_schema(name).metadata)

    def episodes_table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of table `episodes` for all finished episodes, also where the stored table lacks them.

        Args:
            columns: that are wanted; all by default. A row of them all takes 2 KB of memory.
        """
        wanted = list(columns or arrow_schema("episodes").names)
        rows = []
        for shard, indices in self.finished_by_shard().items():
            whole = self._whole_shard(shard, indices)
            rows += [self._mended_shard(shard, indices) if whole is None else whole]
            rows[-1] = rows[-1].select(wanted).combine_chunks()
        # an empty table imports pandas, which takes as long as reading a thousand rows
        return pa.concat_tables(rows) if rows else arrow_schema("episodes").empty_table().select(wanted)

    def _whole_shard(self, shard: int, indices: list[int]) -> pa.Table | None:
        """A shard of table `episodes` as it is stored, None if it is not that of the files that are there."""
        try:
            stored = read_shard(self.table_path("episodes", shard), "episodes")
        except BusybotError:
            return None
        same = stored["episode"].to_pylist() == indices and self._current(shard, stored) == set(indices)
        return stored if same else None

    def _current(self, shard: int, stored: pa.Table) -> set[int]:
        """Episodes among rows of table `episodes` whose files are those that the rows were derived from.

        Told by size and checksum. Rows from before checksums were stored are believed while the file is older than
        they are; of a frozen dataset the manifest tells.
        """
        rows = stored.select(["episode", "bytes", "checksum"]).to_pydict()
        found = self._fingerprints(rows["episode"])
        by_time = not is_remote(self.path) and not is_frozen(self.path)
        told = self.table_path("episodes", shard).stat().st_mtime_ns if by_time else None
        current = set()
        for index, size, checksum in zip(*rows.values(), strict=True):
            file = found.get(index)
            if file is None or file.bytes != size:
                continue
            unknown = checksum is None and (told is None or file.written_ns <= told)
            if unknown or file.checksum in (None, checksum):
                current.add(index)
        return current

    def _fingerprints(self, indices: Iterable[int]) -> dict[int, Fingerprint]:
        """Of those episodes' files that are there."""
        folder, found = inside(self.path, "episodes"), {}
        if is_remote(folder):
            sizes = folder.sizes()
            named = {index: _episode_name(index) for index in indices}
            return {index: Fingerprint(sizes[name], None, 0) for index, name in named.items() if name in sizes}
        if not folder.is_dir():
            return {}
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            for index in indices:
                with suppress(OSError):
                    found[index] = fingerprint(_episode_name(index), descriptor)
        finally:
            os.close(descriptor)
        return found

    def _mended_shard(self, shard: int, indices: list[int]) -> pa.Table:
        """A shard of table `episodes` with what the stored one lacks."""
        stored = self.stored_rows(shard, ("episodes",))
        current = self._current_rows(shard, stored)
        # remembered, because a stopped collection may lack hundreds and one command asks several times
        keys = {i: (i, self.episode_path(i).stat().st_mtime_ns) for i in indices if i not in current}
        missing = {i: key for i, key in keys.items() if key not in self._derived}
        self._derived |= {key: episode_rows(self.episode_path(i), i) for i, key in missing.items()}
        return pa.concat_tables((current[i] if i in current else self._derived[keys[i]])["episodes"] for i in indices)

    def hashes(self, episodes: pa.Table | None = None, compare: bool = True) -> Digests:
        """Hashes of the whole dataset: all boards, all finished episodes, as they are now.

        Whoever judges or learns from a dataset asks for them, so here it is compared with what it should be.

        Args:
            episodes: what `episodes_table` returned, if it was called already, with the columns `HASHED` at least.
            compare: refuse recordings of other boards, and a frozen dataset that is not as its manifest says.

        Raises:
            BusybotError: naming the file that is not as it should be.
        """
        os.fspath(self.path)  # refused at an address, where the recordings' checksums were not compared
        table = self.episodes_table(columns=HASHED) if episodes is None else episodes.select(HASHED)
        boards = [(board.index, board.digest()) for board in self.each_board()]
        rows = table.to_pydict()
        trace, content = (
            combine(kind, zip(rows["episode"], rows[f"{kind}_digest"], strict=True)) for kind in ("trace", "content")
        )
        found = Digests(board=combine("board", boards), trace=trace, content=content)
        if compare:
            self._refuse_other_boards(dict(boards), zip(rows["episode"], rows["board_digest"], strict=True))
            if is_frozen(self.path):
                refuse_unlike_manifest(self.path, found, self._checksums_known())
        return found

    def _refuse_other_boards(self, boards: dict[int, str], recorded: Iterable[tuple[int, str]]) -> None:
        for index, digest in recorded:
            if boards[index] != digest:
                what = f"{self.episode_path(index)}: its board is not board {index} of the dataset"
                raise BusybotError(what, "put the right recording there; `busybot dataset repair DATASET` removes it")

    def _checksums_known(self) -> bool:
        """Whether the tables hold a checksum of every recording; those of earlier versions do not."""
        shards = (
            read_shard(self.table_path("episodes", s), "episodes", ["checksum"]) for s in self.finished_by_shard()
        )
        return all(rows["checksum"].null_count == 0 for rows in shards)

    def finished_by_shard(self) -> dict[int, list[int]]:
        """Indices of finished episodes, in order, by the shard of the tables that they belong to."""
        shards: dict[int, list[int]] = {}
        for index in sorted(self.finished()):
            shards.setdefault(index // EPISODES_PER_SHARD, []).append(index)
        return shards

    def stored_shards(self, table: str) -> list[int]:
        """Numbers of the shards that a table has."""
        folder = inside(self.path, f"tables/{table}")
        there = is_remote(folder) or folder.is_dir()
        names = (_SHARD_NAME.fullmatch(file.name) for file in folder.iterdir()) if there else ()
        return sorted(int(match[1]) for match in names if match)

    def _write_shard(self, shard: int, indices: list[int], given: Mapping[int, Rows]) -> None:
        stored = self.stored_rows(shard)
        current = self._current_rows(shard, stored)
        ready = {i: current[i] for i in indices if i in current and i not in given and _is_whole(current[i])}
        if set(ready) == set(indices) == set(stored):
            return
        ready |= {i: given[i] for i in indices if i in given}
        ready |= {i: episode_rows(self.episode_path(i), i) for i in indices if i not in ready}
        made_of = _made_of(pa.concat_tables(ready[i]["episodes"] for i in indices))
        # `episodes` last: an episode counts as stored when its row is there, so its other rows must be there before
        for table in sorted(TABLES, key=lambda name: name == "episodes"):
            write_shard(self.table_path(table, shard), table, [ready[i][table] for i in indices], self.path, made_of)

    def stored_rows(self, shard: int, names: Sequence[str] = tuple(TABLES)) -> dict[int, Rows]:
        """Rows of the shard by episode of the first table; nothing if its files are not all there and of one origin."""
        whole: dict[str, pa.Table] = {}
        try:
            for name in names:  # `episodes` first, which tell how much the others may hold
                most = counts_of(whole["episodes"])[name] if "episodes" in whole else None
                whole[name] = read_shard(self.table_path(name, shard), name, most=most)
        except BusybotError:
            return {}
        if len({_origin(rows) for rows in whole.values()}) > 1:
            return {}
        tables = {name: split_by_episode(rows) for name, rows in whole.items()}
        empty = {name: arrow_schema(name).empty_table() for name in names}
        return {i: {name: tables[name].get(i, empty[name]) for name in names} for i in tables[names[0]]}

    def _current_rows(self, shard: int, stored: dict[int, Rows]) -> dict[int, Rows]:
        """Those of the stored rows that are of the files which are there."""
        if not stored:
            return {}
        current = self._current(shard, pa.concat_tables(rows["episodes"] for rows in stored.values()))
        return {index: rows for index, rows in stored.items() if index in current}


def _origin(rows: pa.Table) -> bytes | None:
    """What a shard says that it was made of, None where it is from before this was stored."""
    return (rows.schema.metadata or {}).get(MADE_OF_KEY)


def _made_of(episodes: pa.Table) -> str:
    """Digest of the episodes that rows were derived from."""
    return combine("content", zip(*episodes.select(["episode", "content_digest"]).to_pydict().values(), strict=True))


def _is_whole(rows: Rows) -> bool:
    """Whether an episode's rows are there in all tables: a writer may have been stopped between two of them."""
    return counts_of(rows["episodes"]) == {name: rows[name].num_rows for name in TABLES}


def _write_boards(folder: Path, path: Path, boards: Iterator[BoardSpec]) -> int:
    """Write boards as they come, a shard at a time; returns their number.

    Raises:
        BusybotError: one stands at another place than its index says; told of the dataset `path`.
    """
    written = 0
    while taken := list(islice(boards, BOARDS_PER_SHARD)):
        for index, board in enumerate(taken, start=written):
            if board.index != index:
                raise BusybotError(f"{path}: board {board.index} stands at place {index}")
        data = "".join(f"{board.model_dump_json()}\n" for board in taken).encode()
        write_atomically(folder / _boards_name(written // BOARDS_PER_SHARD), data, folder)
        written += len(taken)
    return written


def _is_file(path: Path) -> bool:
    """Whether a regular file is there, not a link to one."""
    return path.is_file() and not path.is_symlink()


def _episode_name(index: int) -> str:
    return f"{index:06d}.mcap"


def _boards_name(shard: int) -> str:
    return f"boards/boards-{shard:05d}.jsonl"
