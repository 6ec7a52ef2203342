"""An episode to an MCAP file, which is written whole or not at all; `episodes.mcap.topics` lists its channels.

The order of channels and messages, times, and all attachments follow from the episode alone, so equal episodes give
equal bytes in any process; only the library versions in header and metadata may differ between installations.
"""

import io
import json
import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import foxglove
from foxglove import Channel, Context, Schema
from foxglove import messages as fg
from foxglove.mcap import MCAPWriteOptions

from busybot.common.atomic_io import write_atomically
from busybot.episodes.codec import DepthScale, ImageFormat, encode_plain, encode_rgb
from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.mcap import foxglove_messages as scene
from busybot.episodes.mcap import messages as topics
from busybot.episodes.mcap.messages import PACKAGE, message_class, message_schema
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS
from busybot.episodes.validation import check_episode, check_image

CHUNK_BYTES = 8 << 20
"""Before compression; a chunk holds a whole episode as a rule, so unchanged parts of images are stored once."""

_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class _Encoding:
    """How the images of a file are encoded; `links` is the number of links that segmentation may name."""

    rgb: ImageFormat
    depth: DepthScale
    links: int


def write_episode(path: Path, episode: Episode, images: ImageFormat = "jpeg", root: Path | None = None) -> int:
    """Write the file under a temporary name, sync, rename.

    Args:
        images: how RGB is encoded; depth (to 4e-5 units) and segmentation are lossless in either case.
        root: the dataset's folder; see `files`.

    Returns:
        The size of the file in bytes.

    Raises:
        BusybotError: naming the file and the contradiction, if the episode is not consistent.
    """
    check_episode(episode, str(path))
    data = episode_to_mcap(episode, images, str(path))
    write_atomically(path, data, root)
    return len(data)


def episode_to_mcap(episode: Episode, image_format: ImageFormat, where: str) -> bytes:
    """The whole file; `where` names it in messages. The episode must have passed `check_episode`."""
    images = [*episode.images, *episode.goals]
    for image in images:
        check_image(image, episode.camera, len(episode.board.objects), len(episode.links), where)
    depth_scale = DepthScale.covering([image.depth for image in images if image.depth is not None])
    encoding = _Encoding(image_format, depth_scale, len(episode.links))
    context, _ = _channels()
    buffer = io.BytesIO()
    options = MCAPWriteOptions(chunk_size=CHUNK_BYTES, compression_threads=0)
    with _one_at_a_time, foxglove.open_mcap(buffer, context=context, writer_options=options) as file:
        file.write_metadata(topics.METADATA, _metadata(episode, image_format, depth_scale))
        board = episode.board.model_dump(mode="json")
        for name, value in ((topics.BOARD_FILE, board), (topics.RECORDING_FILE, _recording(episode))):
            data = json.dumps(value, sort_keys=True, allow_nan=False).encode()
            file.attach(log_time=0, create_time=0, name=name, media_type="application/json", data=data)
        _write_static(episode)
        _write_image(topics.CAMERA, episode.images[0], 0, 0, encoding)
        for image in episode.goals:
            _write_image(topics.GOAL, image, 0, 0, encoding)
        for index, step in enumerate(episode.steps):
            _write_step(episode, index, step)
            before, after = episode.frame_of[index : index + 2]
            if after != before:
                _write_image(topics.CAMERA, episode.images[after], after, index + 1, encoding)
            _write_joints(episode, step.joint_positions_after, index + 1)
    return buffer.getvalue()


@cache
def _channels() -> tuple[Context, dict[str, Channel]]:
    """One set of channels for all files of a process: the SDK never forgets a channel."""
    context = Context()
    channels = {}
    for topic in sorted({**topics.FOXGLOVE, **topics.OWN}):
        if topic in topics.OWN:
            name = topics.OWN[topic]
            schema = Schema(name=f"{PACKAGE}.{name}", encoding="protobuf", data=message_schema(name))
        else:
            schema = getattr(fg, topics.FOXGLOVE[topic]).get_schema()
        channels[topic] = Channel(topic, schema=schema, message_encoding="protobuf", context=context)
    return context, channels


def _log(topic: str, data: bytes, frame: int) -> None:
    _channels()[1][topic].log(data, log_time=frame * topics.SECOND)


def _log_own(topic: str, at_frame: int, **values: Any) -> None:
    _log(topic, message_class(topics.OWN[topic])(**values).SerializeToString(deterministic=True), at_frame)


def _metadata(episode: Episode, image_format: ImageFormat, depth_scale: DepthScale) -> dict[str, str]:
    board = episode.board
    return {
        "schema_version": SCHEMA_VERSION,
        "board": str(board.index),
        "seed": str(board.seed),
        "split": board.split,
        "steps": str(len(episode.steps)),
        "images": str(len(episode.images)),
        "goals": str(len(episode.goals)),
        "image_format": image_format,
        "depth_offset": repr(depth_scale.offset),
        "depth_scale": repr(depth_scale.scale),
        "versions": json.dumps(episode.versions, sort_keys=True),
    }


def _recording(episode: Episode) -> dict[str, Any]:
    camera = episode.camera
    return {
        "camera": {
            "width": camera.width,
            "height": camera.height,
            "matrix": camera.matrix.tolist(),
            "pose": camera.pose.tolist(),
        },
        "policy": episode.policy,
        "oracle": episode.oracle,
        "settings": episode.settings,
        "renderer": episode.renderer,
    }


def _write_static(episode: Episode) -> None:
    """What holds for the whole episode, at time 0."""
    _log(topics.CALIBRATION, scene.calibration(episode.camera).encode(), 0)
    _log(topics.TRANSFORMS, scene.transforms(episode.camera).encode(), 0)
    _log(topics.SCENE, scene.board(episode.board, episode.positions).encode(), 0)
    objects = zip(episode.board.objects, episode.positions, episode.images[0].boxes, strict=True)
    rows = [{"role": o.role, "position": p.tolist(), "box": b.tolist()} for o, p, b in objects]
    _log_own(topics.OBJECTS, 0, objects=rows)
    _log_own(topics.LINKS, 0, links=[vars(link) for link in episode.links])
    relations = [
        {
            "kind": relation.kind,
            "triggers": [trigger.model_dump() for trigger in relation.triggers],
            "responder": relation.responder,
            "stage": relation.stage,
            "states": relation.states,
            "parameters": json.dumps(relation.parameters, sort_keys=True),
        }
        for relation in episode.board.relations
    ]
    _log_own(topics.RELATIONS, 0, relations=relations)
    if episode.steps:
        _write_joints(episode, episode.steps[0].joint_positions_before, 0)


def _write_image(place: topics.Pictures, image: Image, index: int, frame: int, encoding: _Encoding) -> None:
    _write_picture(place.rgb, encode_rgb(image.rgb, encoding.rgb), encoding.rgb, frame)
    if image.depth is not None:
        _write_picture(place.depth, encode_plain(encoding.depth.quantise(image.depth)), "png", frame)
    if image.segmentation is not None:
        labels = image.segmentation.astype("uint8") if encoding.links < 256 else image.segmentation
        _write_picture(place.segmentation, encode_plain(labels), "png", frame)
    _log_own(place.boxes, frame, image=index, frame=frame, corners=image.boxes.ravel().tolist())


def _write_picture(topic: str, data: bytes, image_format: str, frame: int) -> None:
    stamp = fg.Timestamp(sec=frame, nsec=0)
    message = fg.CompressedImage(timestamp=stamp, frame_id=topics.CAMERA_FRAME, data=data, format=image_format)
    _log(topic, message.encode(), frame)


def _write_step(episode: Episode, index: int, step: Step) -> None:
    values = episode.values(index)
    for field in STEP_FIELDS:
        if field.wire and field.wire.each:
            values |= zip(field.wire_names, values[field.name], strict=True)
    for topic in (topics.STEP, topics.STEP_TRUTH):
        names = message_class(topics.OWN[topic]).DESCRIPTOR.fields_by_name
        _log_own(topic, index, **{name: values[name] for name in names})
    _log(topics.SCENE, scene.action(step, index).encode(), index)
    _log(topics.LOG, scene.sentence(step, index).encode(), index)


def _write_joints(episode: Episode, positions: tuple[float, ...], frame: int) -> None:
    if positions:
        names = [f"{link.object}/{link.name}" for link in episode.links if link.trigger]
        _log(topics.JOINTS, scene.joints(names, positions, frame).encode(), frame)
