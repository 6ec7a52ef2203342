"""What the real camera does to pictures, and how often a reward from its photos is wrong.

    python -m benchmarks.studies.real_camera --assets DIR --out benchmarks/results/real_camera.json [--alone]
    python -m benchmarks.studies.real_camera sheet --data DATASET --out docs/images/real-camera.jpg

Boards are generated and collected with the clean and with the real camera, and with `--alone` with each of its terms
alone, by the scripted and by the random policy. Of the actions that moved a link: the share without a reward. Of those
that moved nothing: the share with one.

`sheet` puts photos of four frames below each other for each term alone and for all together, of a dataset that was
collected with the clean camera (`busybot collect DATASET --policy scripted --images png`).
"""

import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from benchmarks.runner import as_typed, assets_name, busybot, finish, generating, one_of, parser, settings
from busybot.common.atomic_io import write_atomically
from busybot.datasets.dataset import Dataset
from busybot.episodes.codec import encode_rgb
from busybot.episodes.episode import Image
from busybot.episodes.mcap.reader import read_episode
from busybot.sim.scene.real_camera import REAL, TERMS, CameraConfig, take_photo

POLICIES = ("scripted", "random")
STEPS = 20
HASHES = ("board_hash", "trace_hash", "content_hash")
FINE = ("shake", "blur", "noise", "depth_edges", "jpeg")
"""Terms that change what cannot be seen in a small picture."""
SHEET_FRAMES, TILE_HEIGHT, MARGIN, LABEL = 4, 150, 4, 20


def main(words: list[str]) -> None:
    options = parser(__doc__)
    options.add_argument("--boards", type=int, default=20)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--alone", action="store_true", help="each term of the camera alone, too")
    arguments = options.parse_args(words)
    cameras: dict[str, tuple[str, ...]] = {"clean": (), "real": ("--camera", "real")}
    cameras |= {term: settings(f"render.camera.{term}={REAL[term]}") for term in TERMS if arguments.alone}
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            measured(Path(folder), camera, chosen, policy, arguments)
            for policy in POLICIES
            for camera, chosen in cameras.items()
        ]
    hashes = {f"{row['camera']}, {row['policy']}": {name: row[name] for name in HASHES} for row in rows}
    finish("real-camera", arguments, {"assets": assets_name(arguments.assets), "rows": rows}, hashes={"data": hashes})
    for row in rows:
        print(row["policy"], row["camera"], row["without_reward"], "of", row["moved"], row["for_nothing"], row["still"])


def measured(folder: Path, camera: str, chosen: tuple[str, ...], policy: str, arguments: Any) -> dict[str, Any]:
    """One collection and how its rewards compare with what moved."""
    data = folder / f"{camera}-{policy}"
    commands = (
        generating(data, "train", arguments.boards, arguments.seed, arguments.assets),
        ("collect", str(data), "--policy", policy, "--steps", str(STEPS), *chosen),
    )
    for command in commands:
        busybot(*command)
    info = busybot("dataset", "info", str(data))
    places = {str(data): "DATA", arguments.assets: "ASSETS"}
    return {
        "camera": camera,
        "policy": policy,
        **wrong_rewards(pd.read_parquet(data / "tables" / "steps")),
        "bytes": info["bytes"],
        **{name: info[name] for name in HASHES},
        "commands": [as_typed(command, places) for command in commands],
    }


def wrong_rewards(steps: pd.DataFrame) -> dict[str, int]:
    """How many actions moved a link and how many of these went without a reward; likewise those that moved nothing."""
    moved, rewarded = steps["success"].astype(bool), steps["reward"].astype(bool)
    return {
        "moved": int(moved.sum()),
        "without_reward": int((moved & ~rewarded).sum()),
        "still": int((~moved).sum()),
        "for_nothing": int((~moved & rewarded).sum()),
    }


def sheet(words: list[str]) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--data", type=Path, required=True)
    options.add_argument("--episode", type=int, default=6)
    options.add_argument("--first", type=int, default=9, help="of the four frames")
    arguments = options.parse_args(words)
    episode = read_episode(Dataset.open(arguments.data).episode_path(arguments.episode))
    frames = {frame: episode.image(frame) for frame in range(arguments.first, arguments.first + SHEET_FRAMES)}
    write_atomically(arguments.out, encode_rgb(contact_sheet(frames, arguments.episode), "jpeg"))


def contact_sheet(frames: dict[int, Image], board: int) -> np.ndarray:
    """Photos of clean images by the numbers of their frames, uint8 (H, W, 3): a column each, a row for each term.

    Rows of terms that change depth alone show depth, bright where it is near and black where there is none; the last
    two rows show colours and depth of all terms together. What is fine is shown in a part of the picture, pixel by
    pixel, around the object of the largest box.
    """
    everything = CameraConfig.model_validate(REAL)
    rows = {"clean": (CameraConfig(), False)}
    rows |= {term: (CameraConfig.model_validate({term: REAL[term]}), term.startswith("depth")) for term in TERMS}
    rows |= {"all": (everything, False), "all, depth": (everything, True)}
    shown = []
    for name, (config, depth) in rows.items():
        photos = [take_photo(image, config, (0, "sheet", board), frame) for frame, image in frames.items()]
        views = [_grey(photo.depth) if depth else photo.rgb for photo in photos]
        tiles = [
            _tile(_part(view, image.boxes) if name in FINE else view) for view, image in zip(views, photos, strict=True)
        ]
        strength = "" if name not in REAL else f" {REAL[name]:g}"
        shown.append(_labelled(np.concatenate(tiles, axis=1), name + strength))
    return np.concatenate(shown)


def _grey(depth: np.ndarray | None) -> np.ndarray:
    assert depth is not None
    seen = depth > 0
    near, far = np.percentile(depth[seen], [0.5, 99.5])
    bright = 255 - 200 * ((depth - near) / max(far - near, 1e-6)).clip(0, 1)
    return np.repeat(np.where(seen, bright, 0).astype(np.uint8)[..., None], 3, axis=-1)


def _part(view: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """As much of a view as a tile shows without making it smaller, around the middle of the largest box."""
    u0, v0, u1, v1 = max(boxes.astype(int).tolist(), key=lambda box: (box[2] - box[0]) * (box[3] - box[1]))
    height, width = view.shape[:2]
    half = (TILE_HEIGHT // 2, round(TILE_HEIGHT * width / height) // 2)
    row, column = np.clip(((v0 + v1) // 2, (u0 + u1) // 2), half, np.subtract((height, width), half))
    return view[row - half[0] : row + half[0], column - half[1] : column + half[1]]


def _tile(rgb: np.ndarray) -> np.ndarray:
    size = (round(TILE_HEIGHT * rgb.shape[1] / rgb.shape[0]), TILE_HEIGHT)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    return np.pad(small, ((0, MARGIN), (0, MARGIN), (0, 0)), constant_values=255)


def _labelled(row: np.ndarray, text: str) -> np.ndarray:
    label = np.full((LABEL, row.shape[1], 3), 255, np.uint8)
    cv2.putText(label, text, (2, LABEL - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (40, 40, 40), 1, cv2.LINE_AA)
    return np.concatenate([label, row])


if __name__ == "__main__":
    one_of(main, sheet=sheet)
