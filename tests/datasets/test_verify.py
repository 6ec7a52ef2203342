"""`verify` names what is wrong and how to mend it, and is silent otherwise."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.importing.images import import_export
from busybot.datasets.info import collect_command
from busybot.datasets.repair import repair
from busybot.datasets.verify import VerifyReport, verify
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import HINT_TABLES
from tests.cli.commands import busybot
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return make_dataset(tmp_path / "d")


def faults(report: VerifyReport) -> list[tuple[str, str]]:
    assert all(problem.hint for problem in report.problems)
    return [(Path(problem.file).name, problem.what) for problem in report.problems]


def test_a_sound_dataset_has_no_problems(dataset: Dataset) -> None:
    seen: list[tuple[int, int]] = []
    report = verify(dataset.path, progress=lambda done, total: seen.append((done, total)))
    assert report.ok and report.episodes == 3 and report.problems == ()
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.long
def test_several_workers_find_the_same(dataset: Dataset) -> None:
    data = bytearray(dataset.episode_path(1).read_bytes())
    data[len(data) // 2] ^= 1
    dataset.episode_path(1).write_bytes(data)
    assert verify(dataset.path, workers=2) == verify(dataset.path)


def test_a_dataset_without_episodes_is_sound(tmp_path: Path) -> None:
    assert verify(make_dataset(tmp_path / "d", finished=()).path).ok


def test_damaged_episodes_are_named(dataset: Dataset) -> None:
    data = dataset.episode_path(1).read_bytes()
    dataset.episode_path(1).write_bytes(data[:-100])
    ((name, what),) = faults(verify(dataset.path))
    assert name == "000001.mcap" and "MCAP" in what and name not in what, "the file is named once"


def test_an_episode_of_another_board_or_collection_is_found(dataset: Dataset) -> None:
    shutil.copy(dataset.episode_path(3), dataset.episode_path(0))
    write_episode(dataset.episode_path(1), make_episode(1, steps=8), images="png")
    found = faults(verify(dataset.path))
    assert ("000000.mcap", "its board is not board 0 of the dataset") in found
    assert ("000001.mcap", "image_format is 'png', the dataset says 'jpeg'") in found
    assert ("000001.mcap", "it has 8 steps, the dataset says 6") in found


def edit_table(dataset: Dataset, name: str, column: str, value: object) -> None:
    path = dataset.table_path(name, 0)
    table = pq.read_table(path)
    values = [value, *table[column].to_pylist()[1:]]
    place = table.column_names.index(column)
    pq.write_table(
        table.set_column(place, table.schema.field(column), pa.array(values, table.schema.field(column).type)), path
    )


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [("steps", "reward", 5), ("objects", "box_u0", None), ("episodes", "trace_digest", "0" * 64)],
)
def test_tables_that_differ_from_the_episodes_are_found(
    dataset: Dataset, table: str, column: str, value: object
) -> None:
    edit_table(dataset, table, column, value)
    fault = f"episode 0 differs from its file in {column}"
    fault = "it was written by another program" if table == "episodes" else fault
    assert faults(verify(dataset.path)) == [("part-00000.parquet", fault)]


def test_missing_and_superfluous_rows_are_found(dataset: Dataset) -> None:
    write_episode(dataset.episode_path(2), make_episode(2))
    dataset.episode_path(0).unlink()
    found = faults(verify(dataset.path))
    for fault in ("holds episode 0, which is not there", "lacks episode 2"):
        assert found.count(("part-00000.parquet", fault)) == 3


def test_an_episode_that_is_gone_is_collected_again(dataset: Dataset) -> None:
    """Its rows are still there; the command that brings it back is told once."""
    dataset.episode_path(1).unlink()
    problems = verify(dataset.path).problems
    assert len(problems) == 3 and {problem.hint for problem in problems} == {
        f"busybot collect {dataset.path} --steps 6 --policy random --set interaction.delta=20"
    }
    told = busybot("dataset", "verify", dataset.path, "--workers", 1).stderr
    assert told.count("holds episode 1, which is not there") == 3 and told.count("hint: busybot collect") == 1


def test_a_fault_of_the_boards_names_their_file_once(dataset: Dataset) -> None:
    (dataset.path / "boards/boards-00000.jsonl").write_text("{}\n")
    (problem,) = [one for one in verify(dataset.path).problems if "line" in one.what]
    assert problem.file == str(dataset.path / "boards/boards-00000.jsonl") and str(dataset.path) not in problem.what


def test_missing_and_unreadable_tables_are_found(dataset: Dataset) -> None:
    dataset.table_path("steps", 0).unlink()
    dataset.table_path("objects", 0).write_bytes(b"x")
    missing, unreadable = sorted(faults(verify(dataset.path)), key=lambda fault: "missing" not in fault[1])
    assert missing[1] == "missing; 3 episodes belong to it"
    assert "not a readable Parquet file" in unreadable[1]


def test_strangers_and_links_are_found(dataset: Dataset, tmp_path: Path) -> None:
    (dataset.path / "episodes/000099.mcap").write_bytes(b"")
    (dataset.path / "notes.txt").write_text("mine")
    assert [name for name, _ in faults(verify(dataset.path))] == ["notes.txt", "000099.mcap"]
    shutil.move(dataset.path / "episodes", tmp_path / "elsewhere")
    (dataset.path / "episodes").symlink_to(tmp_path / "elsewhere")
    assert ("episodes", "a link where a file or folder is expected") in faults(verify(dataset.path))


def test_boards_that_are_not_the_datasets_are_found(dataset: Dataset) -> None:
    info = json.loads((dataset.path / "dataset.json").read_text())
    (dataset.path / "dataset.json").write_text(json.dumps({**info, "seed": 9}))
    what = "board 0 has seed 0 and split 'train', the dataset 9 and 'train'"
    assert ("boards", what) in faults(verify(dataset.path))
    (dataset.path / "boards/boards-00000.jsonl").write_text("[]\n" * 4)
    assert "line 1" in faults(verify(dataset.path))[0][1]


def test_a_folder_that_is_no_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="not a dataset"):
        verify(tmp_path)


@pytest.fixture
def imported(tmp_path: Path) -> Dataset:
    """A dataset that nobody can collect again, though its policy has the name of one of ours."""
    export_recordings(make_dataset(tmp_path / "source", boards=3, finished=range(3)), "images", tmp_path / "images")
    return import_export(tmp_path / "images", tmp_path / "imported")


def test_what_mends_an_imported_dataset_is_told(imported: Dataset) -> None:
    """`collect` refuses it; `repair` makes its tables again."""
    imported.table_path("objects", 0).write_bytes(b"x")
    edit_table(imported, "episodes", "trace_digest", "0" * 64)
    imported.table_path("steps", 0).unlink()
    problems = verify(imported.path).problems
    assert len(problems) == 3 and {problem.hint for problem in problems} == {HINT_TABLES}
    with pytest.raises(BusybotError) as error:
        imported.table("steps")
    shutil.rmtree(imported.path / "tables")
    with pytest.raises(BusybotError, match="no table 'steps' yet") as absent:
        imported.table("steps")
    assert error.value.hint == absent.value.hint == HINT_TABLES and "busybot dataset repair" in HINT_TABLES
    repair(imported.path)
    assert verify(imported.path).ok and len(imported.table("steps")) == 18


@pytest.mark.usefixtures("in_process")
def test_nobody_is_told_to_collect_what_was_imported(imported: Dataset) -> None:
    lazy = imported[0]
    write_episode(imported.episode_path(0), make_episode(2), "png")
    hints = []
    for ask in (lambda: lazy.images[0].rgb, imported.hashes, lambda: imported[1]):
        with pytest.raises(BusybotError, match="recorded again since|its board is not|MCAP") as error:
            ask()
        hints.append(str(error.value.hint))
        imported.episode_path(1).write_bytes(b"lost")
    problems = verify(imported.path).problems
    assert len(problems) > 2 and all("dataset repair" in hint for hint in hints)
    told = CliRunner().invoke(app, ["dataset", "repair", str(imported.path)])
    assert told.exit_code == 0 and "busybot dataset import" in told.stderr
    hints += [problem.hint for problem in problems] + [told.stderr, collect_command(imported.path, imported.info)]
    assert not any("busybot collect" in hint for hint in hints), hints
