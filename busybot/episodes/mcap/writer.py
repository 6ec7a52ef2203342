"""An episode to an MCAP file, which is written whole or not at all; `episodes.mcap.channels` lists its channels.

The order of channels and messages, times, and all attachments follow from the episode alone, so equal episodes give
equal bytes in any process; only the library versions in header and metadata may differ between installations.
"""

import io
import json
import threading
from functools import cache
from pathlib import Path
from typing import Any

import foxglove
from foxglove import Channel, Context, Schema
from foxglove import messages as fg
from foxglove.mcap import MCAPWriteOptions

from busybot.common.atomic_io import write_atomically
from busybot.common.errors import naming
from busybot.episodes.codec import DepthScale, EncodedImage, ImageFormat, encode_image
from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.mcap import channels, foxglove_messages
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS
from busybot.episodes.validation import check_episode, check_image

CHUNK_BYTES = 8 << 20
"""Before compression; a chunk holds a whole episode as a rule, so unchanged parts of images are stored once."""

_one_at_a_time = threading.Lock()


def write_episode(path: Path, episode: Episode, images: ImageFormat = "jpeg", root: Path | None = None) -> int:
    """Write the file under a temporary name, sync, rename.

    Args:
        images: how RGB is encoded; depth (to 4e-5 units) and segmentation are lossless in either case.
        root: the dataset's folder; see `atomic_io`.

    Returns:
        The size of the file in bytes.

    Raises:
        BusybotError: naming the file and the contradiction, if the episode is not consistent.
    """
    with naming(path):
        check_episode(episode)
        data = _encoded(episode, images)
    write_atomically(path, data, root)
    return len(data)


def _encoded(episode: Episode, image_format: ImageFormat) -> bytes:
    """The whole file."""
    images = [*episode.images, *episode.goals]
    for image in images:
        check_image(image, episode.camera, len(episode.board.objects), len(episode.links))
    scale = DepthScale.covering([image.depth for image in images if image.depth is not None])

    def write_image(place: channels.Pictures, image: Image, index: int, frame: int) -> None:
        _write_image(place, encode_image(image, image_format, scale, len(episode.links)), index, frame, image_format)

    context, _ = _open_channels()
    buffer = io.BytesIO()
    options = MCAPWriteOptions(chunk_size=CHUNK_BYTES, compression_threads=0)
    with _one_at_a_time, foxglove.open_mcap(buffer, context=context, writer_options=options) as file:
        file.write_metadata(channels.METADATA, _metadata(episode, image_format, scale))
        board = episode.board.model_dump(mode="json")
        for name, value in ((channels.BOARD_FILE, board), (channels.RECORDING_FILE, _recording(episode))):
            data = json.dumps(value, sort_keys=True, allow_nan=False).encode()
            file.attach(log_time=0, create_time=0, name=name, media_type="application/json", data=data)
        shown = foxglove_messages.board(episode.board, episode.positions)
        _write_static(episode, shown)
        write_image(channels.CAMERA, episode.images[0], 0, 0)
        for image in episode.goals:
            write_image(channels.GOAL, image, 0, 0)
        for index, step in enumerate(episode.steps):
            _write_step(episode, index, step, shown)
            before, after = episode.frame_of[index : index + 2]
            if after != before:
                write_image(channels.CAMERA, episode.images[after], after, index + 1)
            _write_joints(episode, step.joint_positions_after, index + 1)
    return buffer.getvalue()


@cache
def _open_channels() -> tuple[Context, dict[str, Channel]]:
    """One set of channels for all files of a process: the SDK never forgets a channel."""
    context, opened = Context(), {}
    for topic, name in sorted(channels.SCHEMAS.items()):
        schema = Schema(name=name, encoding="protobuf", data=channels.message_schema(name))
        opened[topic] = Channel(topic, schema=schema, message_encoding="protobuf", context=context)
    return context, opened


def _log(topic: str, data: bytes, frame: int) -> None:
    _open_channels()[1][topic].log(data, log_time=frame * channels.SECOND)


def _log_own(topic: str, at_frame: int, **values: Any) -> None:
    message = channels.message_class(channels.SCHEMAS[topic])(**values)
    _log(topic, message.SerializeToString(deterministic=True), at_frame)


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
        "camera": vars(camera) | {"matrix": camera.matrix.tolist(), "pose": camera.pose.tolist()},
        "policy": episode.policy,
        "oracle": episode.oracle,
        "settings": episode.settings,
        "renderer": episode.renderer,
    }


def _write_static(episode: Episode, shown: fg.SceneEntity) -> None:
    """What holds for the whole episode, at time 0."""
    _log(channels.CALIBRATION, foxglove_messages.calibration(episode.camera).encode(), 0)
    _log(channels.TRANSFORMS, foxglove_messages.transforms(episode.camera).encode(), 0)
    _log(channels.SCENE, foxglove_messages.scene(shown).encode(), 0)
    objects = zip(episode.board.objects, episode.positions, episode.images[0].boxes, strict=True)
    rows = [{"role": o.role, "position": p.tolist(), "box": b.tolist()} for o, p, b in objects]
    _log_own(channels.OBJECTS, 0, objects=rows)
    _log_own(channels.LINKS, 0, links=[vars(link) for link in episode.links])
    relations = [
        relation.model_dump() | {"parameters": json.dumps(relation.parameters, sort_keys=True)}
        for relation in episode.board.relations
    ]
    _log_own(channels.RELATIONS, 0, relations=relations)
    if episode.steps:
        _write_joints(episode, episode.steps[0].joint_positions_before, 0)


def _write_image(place: channels.Pictures, image: EncodedImage, index: int, frame: int, rgb: ImageFormat) -> None:
    stamp, pictures = fg.Timestamp(sec=frame, nsec=0), (image.rgb, image.depth, image.segmentation)
    for topic, data, form in zip(place, pictures, (rgb, "png", "png"), strict=False):
        if data is not None:
            picture = fg.CompressedImage(timestamp=stamp, frame_id=channels.CAMERA_FRAME, data=data, format=form)
            _log(topic, picture.encode(), frame)
    _log_own(place.boxes, frame, image=index, frame=frame, corners=image.boxes.ravel().tolist())


def _write_step(episode: Episode, index: int, step: Step, shown: fg.SceneEntity) -> None:
    values = episode.values(index)
    for field in STEP_FIELDS:
        if field.wire and field.wire.each:
            values |= zip(field.wire_names, values[field.name], strict=True)
    for topic in (channels.STEP, channels.STEP_TRUTH):
        names = channels.message_class(channels.SCHEMAS[topic]).DESCRIPTOR.fields_by_name
        _log_own(topic, index, **{name: values[name] for name in names})
    _log(channels.SCENE, foxglove_messages.scene(shown, foxglove_messages.action(step, index)).encode(), index)
    _log(channels.LOG, foxglove_messages.sentence(step, index).encode(), index)


def _write_joints(episode: Episode, positions: tuple[float, ...], frame: int) -> None:
    if positions:
        names = [f"{link.object}/{link.name}" for link in episode.links if link.trigger]
        _log(channels.JOINTS, foxglove_messages.joints(names, positions, frame).encode(), frame)
