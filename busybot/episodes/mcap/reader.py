"""An MCAP file back to an episode, trusting nothing in it."""

from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from busybot.boards.spec import BoardSpec
from busybot.common.atomic_io import parse_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.common.limits import MAX_ATTACHED_BYTES, MAX_DECODED_BYTES
from busybot.episodes.codec import EncodedImage, LazyImage, LazyImages, image_size
from busybot.episodes.episode import Camera, Episode, Image, Link, Step
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.pictures import PictureFile, StoredImage, depth_scale
from busybot.episodes.mcap.records import Records, read_records, refusing
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS
from busybot.episodes.validation import check_camera, check_episode

MAX_STEPS = 100_000
PICTURE = channels.SCHEMAS[channels.RGB]

Decoding = Literal["eager", "lazy", "stored"]

_READERS = [
    (field.name, field.privileged, attrgetter(*field.wire_names), field.shape)
    for field in STEP_FIELDS
    if field.wire and field.name in Step.__dataclass_fields__
]
"""Name in `Step`, whether it is in the truth, how it is read from its message, shape."""


def read_episode(path: Path, images: Decoding = "eager") -> Episode:
    """The episode of a file.

    Args:
        images: `eager` decodes all images; `lazy` decodes a picture when it is asked for, boxes never need decoding;
            `stored` does, too, and holds no pictures: it reads them again (`pictures`).

    Raises:
        BusybotError: naming the file and what is wrong with it: truncated, damaged, of another schema version,
            contradicting itself, or claiming sizes beyond reason.
    """
    records = read_records(path)
    episode = decode_episode(records, str(path), images)
    if images == "stored":
        file = PictureFile(path, records.checksum)
        for kept, place in ((episode.images, channels.CAMERA), (episode.goals, channels.GOAL)):
            assert isinstance(kept, LazyImages)
            kept.keeps = 0
            kept.encoded = [StoredImage.of(file, place, number, image) for number, image in enumerate(kept.encoded)]
    return episode


def decode_episode(records: Records, where: str, images: Decoding = "eager") -> Episode:
    """The episode of a file's records; `where` names the file in messages."""
    with refusing(where, "not a recording of this project"):
        _check_version(records)
        _check_schemas(records)
        episode = _decode(records, where)
        check_episode(episode)
    if images == "eager":
        episode.images, episode.goals = whole(episode.images), whole(episode.goals)
    return episode


def whole(images: Sequence[Image]) -> list[Image]:
    """Images with all their pictures decoded."""
    return [image.whole() if isinstance(image, LazyImage) else image for image in images]


def _check_version(records: Records) -> None:
    """Files of the same major schema version are read, newer ones refused."""
    version = records.metadata.get(channels.METADATA, {}).get("schema_version", "")
    if not version:
        raise BusybotError("an MCAP file, but not a recording of busybot (it has no metadata of that name)")
    if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
        what = f"written with episode schema {version}; this installation reads {SCHEMA_VERSION}"
        raise BusybotError(what, "use the busybot version that wrote it, or record the episode again")


def _check_schemas(records: Records) -> None:
    for topic, schema in records.schema_names.items():
        if schema != channels.SCHEMAS.get(topic, schema):
            raise ValueError(f"topic {topic} has schema {schema!r}, expected {channels.SCHEMAS[topic]!r}")


def _decode(records: Records, where: str) -> Episode:
    recording, board_data = (_attached(records, name) for name in (channels.RECORDING_FILE, channels.BOARD_FILE))
    try:
        board = BoardSpec.model_validate(board_data)
    except ValidationError as error:
        raise BusybotError(f"{channels.BOARD_FILE}: {first_fault(error)}") from None
    size = recording["camera"]
    matrices = (np.array(size[name], np.float64) for name in ("matrix", "pose"))
    camera = Camera(int(size["width"]), int(size["height"]), *matrices)
    check_camera(camera)
    links = tuple(Link(int(link.object), link.name, link.trigger) for link in _one(records, channels.LINKS).links)
    positions = [list(item.position) for item in _one(records, channels.OBJECTS).objects]
    steps, frame_of = _steps(records)
    metadata = records.metadata[channels.METADATA]
    counts = {channels.CAMERA: int(metadata["images"]), channels.GOAL: int(metadata.get("goals", 0))}
    images, goals = (
        _images(records, place, count, where, camera, len(links), len(board.objects)) for place, count in counts.items()
    )
    return Episode(
        board=board,
        camera=camera,
        links=links,
        positions=np.array(positions, np.float32).reshape(-1, 3),
        images=images,
        frame_of=frame_of,
        steps=steps,
        policy=str(recording["policy"]),
        oracle=bool(recording["oracle"]),
        settings=dict(recording["settings"]),
        renderer=dict(recording["renderer"]),
        versions=dict(parse_json(metadata["versions"])),
        goals=goals,
    )


def _attached(records: Records, name: str) -> Any:
    data = records.attachments[name].data
    if len(data) > MAX_ATTACHED_BYTES:
        raise BusybotError(f"{name} has {len(data)} bytes, at most {MAX_ATTACHED_BYTES} are read")
    return parse_json(data)


def _one(records: Records, topic: str) -> Any:
    messages = _messages(records, topic)
    if len(messages) != 1:
        raise ValueError(f"{len(messages)} messages on {topic}, expected one")
    return messages[0]


def _messages(records: Records, topic: str) -> list[Any]:
    payloads = records.payloads.get(topic, ())
    pictures = channels.SCHEMAS[topic] == PICTURE
    if len(payloads) > MAX_STEPS + 1 or (not pictures and sum(map(len, payloads)) > MAX_DECODED_BYTES):
        raise BusybotError(
            f"{len(payloads)} messages on {topic}, {sum(map(len, payloads))} bytes: more than there can be"
        )
    decode = channels.message_class(channels.SCHEMAS[topic]).FromString
    return [decode(data) for data in payloads]


def _steps(records: Records) -> tuple[list[Step], list[int]]:
    seen, truths = _messages(records, channels.STEP), _messages(records, channels.STEP_TRUTH)
    if len(seen) > MAX_STEPS or len(seen) != int(records.metadata[channels.METADATA]["steps"]):
        raise ValueError(f"{len(seen)} messages on {channels.STEP} do not fit the file's metadata")
    frame_of = [0]
    steps = []
    for index, (step, truth) in enumerate(zip(seen, truths, strict=True)):
        if step.index != index or truth.index != index or step.image_before != frame_of[-1]:
            raise ValueError(f"step {index} is out of order")
        frame_of.append(step.image_after)
        steps.append(_step(step, truth))
    return steps, frame_of


def _step(step: Any, truth: Any) -> Step:
    values: dict[str, Any] = {}
    for name, privileged, read, shape in _READERS:
        value = read(truth if privileged else step)
        if shape:
            value = tuple(value)
            if isinstance(shape[0], int) and len(value) != shape[0]:
                raise ValueError(f"{name} has {len(value)} components, not {shape[0]}")
        values[name] = value
    return Step(**values)


def _images(
    records: Records, place: channels.Pictures, count: int, where: str, camera: Camera, links: int, objects: int
) -> LazyImages:
    rgbs, depths, segmentations = (_pictures(records, topic, count, camera) for topic in place[:3])
    boxes = [np.array(message.corners, np.int16).reshape(objects, 4) for message in _messages(records, place.boxes)]
    encoded = [EncodedImage(*parts) for parts in zip(rgbs, depths, segmentations, boxes, strict=True)]
    if encoded and encoded[0].rgb is None:
        raise ValueError(f"no images on {place.rgb}")
    return LazyImages(where, camera.width, camera.height, links, depth_scale(records), encoded)


def _pictures(records: Records, topic: str, count: int, camera: Camera) -> list[Any]:
    """The encoded pictures of a topic, all of the camera's size; Nones if the topic is absent."""
    pictures = [message.data for message in _messages(records, topic)]
    if not pictures:
        return [None] * min(count, MAX_STEPS + 1)
    if len(pictures) != count:
        raise ValueError(f"{len(pictures)} pictures on {topic}, expected {count}")
    for position, picture in enumerate(pictures):
        if image_size(picture) != (camera.width, camera.height):
            raise ValueError(f"picture {position} on {topic} is {image_size(picture)}, not as the camera says")
    return pictures
