"""The recording's own messages: one definition, stable numbers, the wire format of protobuf."""

import io
import json
import re
import struct
from importlib.resources import files
from pathlib import Path

import pytest
from google.protobuf import descriptor, descriptor_pb2
from mcap.reader import make_reader
from rerun.chunk import McapReader

from busybot.episodes.mcap.channels import (
    CALIBRATION,
    DEPTH,
    LOG,
    MESSAGES,
    PACKAGE,
    RGB,
    SCENE,
    SCHEMAS,
    SECOND,
    STEP,
    message_class,
    message_schema,
)
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS
from tests.episodes.make_fixture import FIXTURES
from tests.episodes.synthetic import make_episode
from tests.episodes.test_schema import version_of
from tests.episodes.test_schema_versions import VERSIONS

ROOT = Path(__file__).resolve().parents[3]
NUMBERS = {
    "Step": "index image_before image_after pixel_u pixel_v position direction executed distance changed_pixels reward",
    "StepTruth": "index acted_object acted_link success vetoed trigger_states_before trigger_states_after"
    " responder_states_before responder_states_after joint_positions_before joint_positions_after memory_after",
    "Object": "role position box",
    "Objects": "objects",
    "Boxes": "image frame corners",
    "Link": "object name trigger",
    "Links": "links",
    "Trigger": "object link",
    "Relation": "kind triggers responder stage states parameters",
    "Relations": "relations",
}


@pytest.mark.parametrize("name", NUMBERS)
def test_fields_keep_their_numbers(name: str) -> None:
    """Old files are read by number: a field may be added at the end, never moved."""
    fields = {field.number: field.name for field in message_class(f"{PACKAGE}.{name}").DESCRIPTOR.fields}
    assert fields == dict(enumerate(NUMBERS[name].split(), start=1))


def test_messages_have_the_wire_format() -> None:
    step = message_class("busybot.v1.Step")(index=3, pixel_u=-1, position=[1.0, 2.0], executed=[0, 17], distance=0.5)
    expected = b"\x08\x03" + b"\x20\x01" + b"\x32\x08" + struct.pack("<ff", 1, 2) + b"\x42\x02\x00\x11"
    assert step.SerializeToString() == expected + b"\x49" + struct.pack("<d", 0.5)
    truth = message_class("busybot.v1.StepTruth")(acted_link="ab", success=True, trigger_states_before=[-1])
    assert truth.SerializeToString() == b"\x1a\x02ab" + b"\x20\x01" + b"\x32\x01\x01"


def test_the_layout_for_foxglove_shows_what_recordings_have(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "reference" / "foxglove-layout.json").read_text(encoding="utf-8")
    layout = json.loads(text)
    write_episode(tmp_path / "e.mcap", make_episode())
    with open(tmp_path / "e.mcap", "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    recorded = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    assert {topic: recorded[topic] for topic in re.findall(r'"(/[\w/]+)"', text)} == {
        topic: SCHEMAS[topic] for topic in (RGB, DEPTH, CALIBRATION, SCENE, LOG, STEP)
    }
    tree, placed = [layout["layout"]], []
    while tree:
        part = tree.pop(0)
        if isinstance(part, dict):
            tree[:0] = [part["first"], part["second"]]
        else:
            placed.append(part)
    assert placed == list(layout["configById"]), "in order, each once"
    images = {name: panel for name, panel in layout["configById"].items() if name.startswith("ImageViewPanel!")}
    told = {name: (panel["cameraTopic"], panel["imageMode"]["imageTopic"]) for name, panel in images.items()}
    assert told == {"ImageViewPanel!rgb": (RGB, RGB), "ImageViewPanel!depth": (DEPTH, DEPTH)}, "old and new keys"


def test_rerun_alone_has_every_frame_and_its_step_at_their_times(tmp_path: Path) -> None:
    episode = make_episode(steps=4)
    write_episode(tmp_path / "e.mcap", episode)
    seconds: dict[str, list[int]] = {}
    for chunk in McapReader(tmp_path / "e.mcap", timeline_type="duration_ns").stream().to_chunks():
        batch = chunk.to_record_batch()
        shown = {"EncodedImage:blob", "TextLog:text"} & set(batch.schema.names)
        if shown:
            times = batch.column("message_log_time").cast("int64").to_pylist()
            seconds.setdefault(str(chunk.entity_path), []).extend(time // SECOND for time in times)
    frames = sorted(
        {frame for frame in range(5) if frame == 0 or episode.frame_of[frame] != episode.frame_of[frame - 1]}
    )
    assert seconds[RGB] == seconds[DEPTH] == frames
    assert seconds[LOG] == [0, 1, 2, 3]


def test_a_schema_holds_the_message_and_its_parts_and_no_more() -> None:
    schema = descriptor_pb2.FileDescriptorSet.FromString(message_schema("busybot.v1.Relations"))
    assert [message.name for message in schema.file[0].message_type] == ["Trigger", "Relation", "Relations"]
    assert len(message_schema("busybot.v1.Step")) < 500


def test_the_public_definition_says_the_same() -> None:
    """`busybot.proto`, read here line by line, declares the messages that recordings describe in themselves."""
    text = files("busybot.episodes.mcap").joinpath("busybot.proto").read_text(encoding="utf-8")
    assert f"package {PACKAGE};" in text and 'syntax = "proto3";' in text
    declared = re.findall(r"^message (\w+) \{\n(.*?)^\}$", text, re.MULTILINE | re.DOTALL)
    assert [name for name, _ in declared] == list(MESSAGES) == list(NUMBERS)
    for name, body in declared:
        lines = re.findall(r"^  (repeated )?(\w+) (\w+) = (\d+);$", body, re.MULTILINE)
        assert len(lines) == len(body.splitlines())
        described = [
            ("repeated " if field.is_repeated else "", kind_of(field), field.name, str(field.number))
            for field in message_class(f"{PACKAGE}.{name}").DESCRIPTOR.fields
        ]
        assert lines == described


def kind_of(field: descriptor.FieldDescriptor) -> str:
    """The word for a field's type in a definition."""
    if field.message_type is not None:
        return str(field.message_type.name)
    return str(descriptor_pb2.FieldDescriptorProto.Type.Name(field.type)).removeprefix("TYPE_").lower()


@pytest.mark.parametrize("version", VERSIONS)
def test_released_recordings_describe_their_messages_alike(version: str) -> None:
    """Schemas are the same bytes in all files of a version; older ones lack what came since, and nothing else."""
    found: dict[str, bytes] = {}
    for path in (FIXTURES / version / "real.mcap", FIXTURES / version / "dataset" / "episodes" / "000000.mcap"):
        summary = make_reader(io.BytesIO(path.read_bytes())).get_summary()
        assert summary is not None
        found |= {one.name.rpartition(".")[2]: one.data for one in summary.schemas.values() if PACKAGE in one.name}
    assert found.keys() >= {"Step", "StepTruth", "Objects", "Boxes", "Links", "Relations"}
    for name, data in found.items():
        if version == SCHEMA_VERSION:
            assert data == message_schema(f"{PACKAGE}.{name}"), name
    then = {name: descriptor_pb2.FileDescriptorSet.FromString(found[name]) for name in ("Step", "StepTruth")}
    recorded = {(name, field.name) for name in then for field in then[name].file[0].message_type[0].field}
    expected = {
        ("StepTruth" if field.privileged else "Step", name)
        for field in STEP_FIELDS
        if field.wire and version_of(field.since) <= version_of(version)
        for name in field.wire_names
    }
    assert recorded == expected | {("StepTruth", "index")}
