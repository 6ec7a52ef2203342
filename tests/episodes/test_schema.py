"""The contract: what columns there are, which of them learners may read, and that one list drives what is stored."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from busybot.episodes.digests import episode_digests
from busybot.episodes.episode import Step
from busybot.episodes.episode_diff import compare_episodes
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS, TABLES, StepField, arrow_schema, public_columns
from busybot.episodes.tables import episode_rows
from tests.episodes.synthetic import make_episode

PUBLIC = {
    "steps": "episode step image_before image_after pixel_u pixel_v position_x position_y position_z direction"
    " direction_x direction_y direction_z executed distance changed_pixels reward",
    "objects": "episode frame object role position_x position_y position_z first_box_u0 first_box_v0 first_box_u1"
    " first_box_v1",
}


@pytest.mark.parametrize("table", PUBLIC)
def test_learners_may_read_these_columns_and_no_others(table: str) -> None:
    """A column that is added stays out of reach until somebody decides otherwise, here."""
    assert public_columns(table) == PUBLIC[table].split()


def test_no_public_column_of_episodes_tells_states_or_successes() -> None:
    hidden = {column.name for column in TABLES["episodes"] if column.privileged}
    assert hidden == {"checksum", "successes", "board_digest", "trace_digest", "content_digest"}


@pytest.mark.parametrize("table", TABLES)
def test_every_column_says_what_it_is(table: str) -> None:
    schema = arrow_schema(table)
    assert schema.metadata[b"busybot_schema_version"] == SCHEMA_VERSION.encode()
    assert len(set(schema.names)) == len(schema.names)
    for field in schema:
        assert field.metadata[b"description"]
        assert field.metadata[b"privileged"] in (b"true", b"false")
        if field.name.startswith(("position", "camera_pose")):
            assert b"board" in field.metadata[b"frame"]
        if field.name.startswith(("pixel", "box", "first_box")):
            assert field.metadata[b"unit"] == b"pixel" and b"row v" in field.metadata[b"frame"]


def test_what_a_real_board_cannot_know_may_be_null() -> None:
    for table, columns in TABLES.items():
        for column in columns:
            if column.privileged and not column.name.endswith("_digest"):
                assert column.nullable, f"{table}.{column.name}"


def test_positions_are_float32() -> None:
    assert arrow_schema("steps").field("position_x").type == pa.float32()


OF_STEP = {field.name: field for field in STEP_FIELDS if field.name in Step.__dataclass_fields__}


def test_the_field_list_has_every_value_of_a_step_once() -> None:
    assert set(OF_STEP) == {field.name for field in fields(Step)}
    assert [f.name for f in STEP_FIELDS if f.name not in OF_STEP] == [
        "index", "image_before", "image_after", "direction_vector",
    ]  # fmt: skip
    assert len({field.name for field in STEP_FIELDS}) == len(STEP_FIELDS)
    assert [column for field in STEP_FIELDS for column in field.columns] == list(TABLES["steps"][1:])
    assert all(field.wire and field.hashed and field.compared for field in OF_STEP.values())
    places = [field.hashed for field in STEP_FIELDS if field.hashed]
    assert len(set(places)) == len(places)
    for field in STEP_FIELDS:
        assert len({column.privileged for column in field.columns}) == 1
        assert version_of(field.since) <= version_of(SCHEMA_VERSION)


def version_of(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(".")))


def other(value: Any) -> Any:
    """Another value that a step may have in its place."""
    if isinstance(value, tuple):
        return tuple(map(other, value)) or (1,)
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + "x"
    return -value if isinstance(value, float) else int(value == 0)


@pytest.mark.parametrize("field", OF_STEP.values(), ids=OF_STEP)
def test_every_value_is_stored_hashed_and_compared(tmp_path: Path, field: StepField) -> None:
    """Recordings that differ in one value of one step differ in its place everywhere, and nowhere else."""
    episode = make_episode()
    changed = make_episode()
    changed.steps[2] = replace(changed.steps[2], **{field.name: other(getattr(changed.steps[2], field.name))})
    read, rows = [], []
    for name, one in (("a.mcap", episode), ("b.mcap", changed)):
        write_episode(tmp_path / name, one)
        read.append(read_episode(tmp_path / name))
        rows.append(episode_rows(tmp_path / name, 0)["steps"])
        assert read[-1].steps == one.steps
    columns = {name for name in rows[0].column_names if not rows[0][name].equals(rows[1][name])}
    derived = {"direction_x", "direction_y", "direction_z"} if field.name == "direction" else set()
    assert {column.name for column in field.columns} == columns - derived
    digests = [vars(episode_digests(one)) for one in read]
    assert field.hashed is not None
    assert {name for name in digests[0] if digests[0][name] != digests[1][name]} == {field.hashed.digest, "content"}
    difference = compare_episodes(*read)
    found = {part for part in ("action", "state", "reward") if getattr(difference, part) is not None}
    assert found | ({"joints"} if difference.joints else set()) == {field.compared}
