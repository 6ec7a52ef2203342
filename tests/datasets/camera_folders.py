"""Simulated recordings as a person with a camera would bring them: pictures and CSV tables written by hand."""

import csv
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from busybot.episodes.codec import encode_plain, encode_rgb
from busybot.episodes.episode import Episode

WORDS = {(-1, 0, 0): "left", (1, 0, 0): "right", (0, 1, 0): "up", (0, -1, 0): "down", (0, 0, -1): "press"}
DEPTH_UNIT = 1e-4


def write_table(file: Path, rows: Iterable[dict[str, Any]]) -> None:
    rows = list(rows)
    with file.open("w", newline="") as text:
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def read_rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as text:
        return list(csv.DictReader(text))


def names_of(episode: Episode) -> list[str]:
    return [f"{one.category.lower()} {number}" for number, one in enumerate(episode.board.objects)]


def write_camera_folder(
    folder: Path,
    episode: Episode,
    *,
    camera: bool = False,
    relations: bool = True,
    times: bool = False,
    png: bool = True,
) -> Path:
    """A recording as a folder.

    Args:
        camera: with the camera's pose, depth and points; else pixels alone.
        times: a picture a second, an action half a second after each but the last; else pictures in order.
        png: pictures without loss.
    """
    folder.mkdir(parents=True)
    names, form = names_of(episode), "png" if png else "jpg"
    frames: list[dict[str, Any]] = []
    for number in range(len(episode.frame_of)):
        image = episode.image(number)
        data = encode_rgb(image.rgb, "png" if png else "jpeg")
        frames.append({"file": f"IMG_{number:04d}.{form}"})
        (folder / frames[-1]["file"]).write_bytes(data)
        if times:
            frames[-1]["time"] = 100.0 + number
        if camera:
            assert image.depth is not None
            frames[-1]["depth"] = f"depth/{number:04d}.png"
            (folder / "depth").mkdir(exist_ok=True)
            steps = np.round(image.depth / DEPTH_UNIT).astype(np.uint16)
            (folder / frames[-1]["depth"]).write_bytes(encode_plain(steps))
    if times or camera:
        write_table(folder / "frames.csv", frames)
    actions: list[dict[str, Any]] = []
    for number, step in enumerate(episode.steps):
        row: dict[str, Any] = {"time": 100.5 + number} if times else {}
        row |= {"u": step.pixel[0], "v": step.pixel[1]}
        if camera:
            row |= dict(zip("xyz", step.position, strict=True))
        actions.append(row | {"direction": step.direction})
    write_table(folder / "actions.csv", actions)
    boxes = episode.image(0).boxes.tolist()
    objects = [
        {"name": name, "role": one.role} | dict(zip(("u0", "v0", "u1", "v1"), "" if -1 in box else box, strict=False))
        for name, one, box in zip(names, episode.board.objects, boxes, strict=True)
    ]
    write_table(
        folder / "objects.csv", [{"name": "", "role": "", "u0": "", "v0": "", "u1": "", "v1": ""} | o for o in objects]
    )
    if camera:
        pose = {
            "matrix": episode.camera.matrix.tolist(),
            "pose": episode.camera.pose.tolist(),
            "depth_scale": DEPTH_UNIT,
        }
        (folder / "camera.json").write_text(json.dumps(pose))
    if relations:
        pairs = [(names[t.object], names[r.responder]) for r in episode.board.relations for t in r.triggers]
        write_table(folder / "relations.csv", [dict(zip(("cause", "effect"), pair, strict=True)) for pair in pairs])
    return folder


def write_video(file: Path, pictures: Sequence[np.ndarray]) -> None:
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (width, height))
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    writer.release()
