"""The recording's own messages: one definition, stable numbers, the wire format of protobuf."""

import struct

import pytest
from google.protobuf import descriptor_pb2

from busybot.episodes.protobuf import message_class, message_schema, parse_proto

NUMBERS = {
    "Step": "index image_before image_after pixel_u pixel_v position direction executed distance changed_pixels reward",
    "StepTruth": "index acted_object acted_link success vetoed trigger_states_before trigger_states_after"
    " responder_states_before responder_states_after joint_positions_before joint_positions_after",
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
    fields = {field.number: field.name for field in message_class(name).DESCRIPTOR.fields}
    assert fields == dict(enumerate(NUMBERS[name].split(), start=1))


def test_messages_have_the_wire_format() -> None:
    step = message_class("Step")(index=3, pixel_u=-1, position=[1.0, 2.0], executed=[0, 17], distance=0.5)
    expected = b"\x08\x03" + b"\x20\x01" + b"\x32\x08" + struct.pack("<ff", 1, 2) + b"\x42\x02\x00\x11"
    assert step.SerializeToString() == expected + b"\x49" + struct.pack("<d", 0.5)
    truth = message_class("StepTruth")(acted_link="ab", success=True, trigger_states_before=[-1])
    assert truth.SerializeToString() == b"\x1a\x02ab" + b"\x20\x01" + b"\x32\x01\x01"


def test_a_schema_holds_the_message_and_its_parts_and_no_more() -> None:
    schema = descriptor_pb2.FileDescriptorSet.FromString(message_schema("Relations"))
    assert [message.name for message in schema.file[0].message_type] == ["Trigger", "Relation", "Relations"]
    assert len(message_schema("Step")) < 500


def test_what_the_parser_does_not_know_is_an_error() -> None:
    with pytest.raises(ValueError, match="busybot.proto:2: cannot parse 'map<string, string> x = 1;'"):
        parse_proto("message A {\n  map<string, string> x = 1;\n}")
