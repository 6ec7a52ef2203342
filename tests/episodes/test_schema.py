"""The contract: what columns there are, and which of them learners may read."""

import pyarrow as pa
import pytest

from busybot.episodes.schema import SCHEMA_VERSION, TABLES, arrow_schema, public_columns

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
    assert hidden == {"successes", "board_digest", "trace_digest", "content_digest"}


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
