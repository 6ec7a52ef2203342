"""A recording that nobody here simulated, as plain values, to an episode: what every source of recordings becomes.

What was not recorded stays missing: states, joints, segmentation and boxes of later frames, depth, often relations.
Colours are stored as PNG: what a JPEG decoded to would not survive another JPEG.

**Where nobody knows the camera's pose, positions are image coordinates**: the picture is taken to show a board straight
from above, its shorter side as long as a board (4 units). Directions are then those of the picture.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from busybot.boards.spec import BODY, IMPORTED, BoardSpec, LinkRef, PlacedObject, Relation
from busybot.common.atomic_io import make_folder, refuse_taken, remove_abandoned, rename, unfinished
from busybot.common.errors import BusybotError, naming
from busybot.common.frozen_model import first_fault
from busybot.common.limits import MAX_PIXELS
from busybot.common.process_pool import Progress
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import DatasetInfo, name_of
from busybot.episodes.camera import project
from busybot.episodes.codec import DepthScale
from busybot.episodes.episode import Camera, Episode, Image, Link, Step
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.episodes.validation import check_camera, check_episode, check_image

BOARD = 4.0
"""Width of a board, board units."""
LINK = "link"
"""Name of a trigger's link where only objects are known."""

Episodes = Iterator[tuple[object, Callable[[], Episode]]]
"""For each board what errors name, and who makes its episode."""
Picture = tuple[np.ndarray, np.ndarray | None]
"""Colours, uint8 (H, W, 3), and depth, float32 (H, W), board units, 0 for nothing; None where none was recorded."""


@dataclass(frozen=True)
class KnownObject:
    """What is told of an object.

    Attributes:
        name: empty where it has none.
        role: trigger or responder.
        box: u0, v0, u1, v1 (exclusive) in the first picture; None where nobody drew it.
        position: visible centre, board frame, board units; None to compute it from the box.
        where: file and line, for messages.
    """

    name: str
    role: str
    box: tuple[int, int, int, int] | None
    position: tuple[float, float, float] | None
    where: str


@dataclass(frozen=True)
class KnownAction:
    """An action at a pixel, or at a point (board frame, board units), or both.

    Attributes:
        direction: index among `DIRECTIONS`.
        where: file and line, for messages.
    """

    pixel: tuple[int, int] | None
    point: tuple[float, float, float] | None
    direction: int
    where: str


@dataclass(frozen=True)
class Recording:
    """One board with T actions.

    Attributes:
        place: file or folder, for messages.
        size: width and height of the pictures.
        pictures: T + 1 of them, decoded as they are asked for; frame 0 is the initial one.
        shown: which of the source's pictures each frame is, for people; T + 1.
        camera: None where nobody knows its pose.
        relations: pairs of objects, cause and effect; None where nobody knows them.
        states: int (T + 1, N), of the objects in each frame, -1 where unknown; None where nobody logged any.
    """

    place: Path
    size: tuple[int, int]
    pictures: Callable[[], Iterator[Picture]]
    shown: Sequence[str]
    actions: Sequence[KnownAction]
    objects: Sequence[KnownObject] = ()
    camera: Camera | None = None
    relations: tuple[tuple[int, int], ...] | None = None
    depth: bool = False
    states: np.ndarray | None = None
    facts: dict[str, str] = field(default_factory=dict)

    def summary(self) -> dict[str, object]:
        """What was read, JSON values."""
        roles = [one.role for one in self.objects]
        return {
            "place": str(self.place),
            "frames": len(self.shown),
            "first": self.shown[0],
            "last": self.shown[-1],
            "width": self.size[0],
            "height": self.size[1],
            "actions": len(self.actions),
            "depth": self.depth,
            "camera": "known" if self.camera is not None else "unknown: image coordinates",
            "triggers": roles.count("trigger"),
            "responders": roles.count("responder"),
            "boxes": sum(one.box is not None for one in self.objects),
            "relations": None if self.relations is None else len(self.relations),
            "states": self.states is not None,
            **self.facts,
        }


def image_camera(width: int, height: int) -> Camera:
    """The camera of image coordinates; see the module's beginning."""
    focal = float(min(width, height))
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = BOARD
    return Camera(width, height, matrix, pose)


def point_at(camera: Camera, pixel: tuple[float, float], depth: float) -> tuple[float, float, float]:
    """The point that a pixel shows, board frame; where depth is 0, that of the board's surface.

    Raises:
        BusybotError: the pixel's ray misses the board.
    """
    local = [*(np.add(pixel, 0.5) - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]], 1.0]
    ray, origin = camera.pose[:3, :3] @ local, camera.pose[:3, 3]
    far = depth if depth > 0 else -origin[2] / ray[2] if ray[2] else -1.0
    if not 0 < far < 1e4:
        raise BusybotError(f"pixel {pixel} does not show the board", "check the camera's pose: from camera to board")
    x, y, z = (float(np.float32(value)) for value in origin + far * ray)
    return x, y, z


def check_episodes(episodes: Episodes, count: int, progress: Progress | None = None) -> None:
    """Make so many episodes, one after the other, and write none: what `store_episodes` would refuse is refused."""
    for done, (named, make) in enumerate(episodes, start=1):
        with naming(named):
            episode = make()
            check_episode(episode)
            for image in episode.images:
                check_image(image, episode.camera, len(episode.board.objects), len(episode.links))
            DepthScale.covering([image.depth for image in episode.images if image.depth is not None])
        if progress:
            progress(done, count)


def store_episodes(
    out: Path,
    info: DatasetInfo,
    boards: Sequence[BoardSpec],
    episodes: Episodes,
    progress: Progress | None = None,
) -> Dataset:
    """Write a dataset of imported episodes; it is there whole or not at all."""
    place = out.absolute()
    refuse_taken(place)
    make_folder(place.parent)
    remove_abandoned(place.parent, place.name)
    with unfinished(place.parent, place.name) as temporary:
        dataset = Dataset.create(temporary / "dataset", info, boards)
        for done, (board, (named, make)) in enumerate(zip(boards, episodes, strict=True), start=1):
            with naming(named):
                write_episode(dataset.episode_path(board.index), make(), "png", dataset.path)
            if progress:
                progress(done, len(boards))
        dataset.write_tables()
        refuse_taken(place)
        rename(dataset.path, place)
    return Dataset.open(out)


def store_recordings(
    source: str, recordings: Sequence[Recording], out: Path, progress: Progress | None = None
) -> Dataset:
    """Make a dataset of recordings.

    Raises:
        BusybotError: naming file and line, if something contradicts itself; or something is at `out`.
    """
    return store_episodes(out, *_made(source, recordings, out.absolute().name), progress)


def check_recordings(source: str, recordings: Sequence[Recording], progress: Progress | None = None) -> None:
    """Refuse what `store_recordings` would refuse, and write nothing."""
    _, boards, made = _made(source, recordings, recordings[0].place.name)
    check_episodes(made, len(boards), progress)


def _made(source: str, recordings: Sequence[Recording], name: str) -> tuple[DatasetInfo, list[BoardSpec], Episodes]:
    """What a dataset of this name says of itself, its boards, and who makes their episodes."""
    boards = [board_of(index, one) for index, one in enumerate(recordings)]
    longest = max(recordings, key=lambda one: len(one.actions))
    collect = {"policy": "human", "steps": len(longest.actions)}
    info = imported_info(name, len(boards), collect, (str(longest.place), "divide the recording"))
    pairs = zip(recordings, boards, strict=True)
    made = ((one.place, lambda one=one, board=board: episode_of(source, one, board)) for one, board in pairs)
    return info, boards, made


def imported_info(
    name: str, boards: int, collect: dict[str, Any], told: tuple[str, str], split: str = IMPORTED, seed: int = 0
) -> DatasetInfo:
    """What a dataset of so many imported boards says of itself.

    Args:
        collect: fields of `CollectInfo`.
        told: what tells of it, and a hint, for messages.

    Raises:
        BusybotError: a value does not fit.
    """
    values = {"name": name_of(name) or IMPORTED, "split": split, "seed": seed, "boards": boards}
    values |= {"generator": {"version": IMPORTED}, "assets": {"source": "folder", "name": "unknown"}}
    try:
        return DatasetInfo.model_validate(values | {"collect": collect | {"images": "png"}})
    except ValidationError as error:
        raise BusybotError(f"{told[0]}: {first_fault(error)}", told[1]) from None


def link_of(known: KnownObject) -> str:
    """What of an object may be a cause: the one link that a trigger is taken to have, or what a responder shows."""
    return BODY if known.role == "responder" else LINK


def board_of(index: int, told: Recording) -> BoardSpec:
    """A board of which only is known what can be seen, and relations where somebody told them."""
    causes: dict[int, list[int]] = {}
    for cause, effect in told.relations or ():
        causes.setdefault(effect, []).append(cause)
    relations = [
        Relation(
            kind="given",
            triggers=tuple(LinkRef(object=cause, link=link_of(told.objects[cause])) for cause in sorted(set(own))),
            responder=effect,
            stage="single",
            states=(),
        )
        for effect, own in sorted(causes.items())
    ]
    try:
        return BoardSpec(
            index=index,
            seed=0,
            split=IMPORTED,
            appearance_group=index,
            texture="unknown",
            color=(1.0, 1.0, 1.0),
            objects=tuple(_first_states(told, number) for number in range(len(told.objects))),
            relations=tuple(relations),
            relations_known=told.relations is not None,
        )
    except ValidationError as error:
        raise BusybotError(f"{told.place}: {first_fault(error)}", "at most 64 objects stand on a board") from None


def _known(told: Recording, role: str) -> list[int]:
    """The objects of a role, if the states of all of them are known; else none."""
    own = [number for number, one in enumerate(told.objects) if one.role == role]
    return own if told.states is not None and (told.states[:, own] >= 0).all() else []


def _first_states(told: Recording, number: int) -> PlacedObject:
    placed = placed_object(number, told.objects[number])
    if told.states is None or number not in _known(told, "trigger"):
        return placed
    return placed.model_copy(update={"states": (int(told.states[0, number]),)})


def _with_states(told: Recording, steps: list[Step]) -> tuple[tuple[Link, ...], list[Step]]:
    """Trigger links and steps with what the log tells of each: states before and after, and which trigger moved."""
    triggers, responders = _known(told, "trigger"), _known(told, "responder")
    if told.states is None or not triggers:
        return (), steps
    shown = np.where(np.isin(np.arange(len(told.objects)), responders), told.states, -1)
    found = []
    for number, step in enumerate(steps):
        (before, after), (seen, left) = told.states[number : number + 2], shown[number : number + 2]
        moved = [trigger for trigger in triggers if before[trigger] != after[trigger]]
        values = {
            "trigger_states_before": tuple(before[triggers].tolist()),
            "trigger_states_after": tuple(after[triggers].tolist()),
            "responder_states_before": tuple(seen.tolist()) if responders else (),
            "responder_states_after": tuple(left.tolist()) if responders else (),
        }
        held = {"acted_object": moved[0], "acted_link": LINK} if len(moved) == 1 else {}
        found.append(replace(step, **values, **held, success=bool(moved)))  # type: ignore[arg-type]
    return tuple(Link(trigger, LINK, True) for trigger in triggers), found


def placed_object(number: int, told: KnownObject) -> PlacedObject:
    """The object on its board; its name is its category, so that people read it."""
    word = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in told.name).strip("-")[:64]
    position = told.position or (0.0, 0.0, 0.0)
    values = {"key": f"{word or 'Unknown'}/object-{number}", "role": told.role, "position": position}
    try:
        return PlacedObject.model_validate(values | {"yaw": 0, "scale": 1})
    except ValidationError as error:
        raise BusybotError(f"{told.where}: {first_fault(error)}", "a role is trigger or responder") from None


def refuse_large(told: Recording) -> None:
    """Refuse, before any is decoded, more pixels than an episode may have."""
    width, height = told.size
    if len(told.shown) * width * height > MAX_PIXELS:
        what = f"{len(told.shown)} pictures of {width} x {height} pixels, at most {MAX_PIXELS} in all are read"
        raise BusybotError(f"{told.place}: {what}", "--width makes pictures smaller; or make shorter recordings")


def episode_of(source: str, told: Recording, board: BoardSpec) -> Episode:
    """The recording's episode; all its pictures are decoded."""
    width, height = told.size
    camera = told.camera or image_camera(width, height)
    check_camera(camera)
    refuse_large(told)
    boxes = boxes_of(told.objects, width, height, f" ({told.shown[0]})")
    images: list[Image] = []
    frame_of: list[int] = []
    steps: list[Step] = []
    for frame, (rgb, depth) in enumerate(told.pictures()):
        last = images[-1] if images else None
        if last is None or not (np.array_equal(rgb, last.rgb) and _alike(depth, last.depth)):
            images.append(Image(rgb, depth, None, np.full_like(boxes, -1) if images else boxes))
        frame_of.append(len(images) - 1)
        if frame < len(told.actions):
            steps.append(_step(told.actions[frame], camera, depth, told.shown[frame]))
    links, steps = _with_states(told, steps)
    facts = {"source": source, "camera": "known" if told.camera else "image", **told.facts}
    return Episode(
        board=board,
        camera=camera,
        links=links,
        positions=positions_of(told.objects, camera, images[0].depth),
        images=images,
        frame_of=frame_of,
        steps=steps,
        policy="human",
        oracle=False,
        settings={IMPORTED: facts},
    )


def _alike(depth: np.ndarray | None, other: np.ndarray | None) -> bool:
    return depth is other or (depth is not None and other is not None and np.array_equal(depth, other))


def boxes_of(objects: Sequence[KnownObject], width: int, height: int, first: str = "") -> np.ndarray:
    """Boxes of the first picture, int16 (N, 4), -1 where nobody drew one.

    Raises:
        BusybotError: naming the line of one that is empty, or not in the picture.
    """
    for one in objects:
        if one.box is not None:
            u0, v0, u1, v1 = one.box
            if not (0 <= u0 < u1 <= width and 0 <= v0 < v1 <= height):
                what = f"{one.where}: the box {one.box} is empty, or outside of pictures of {width} x {height} pixels"
                what += first
                raise BusybotError(what, "u0 and u1 are left and right, v0 and v1 top and bottom, counted from 0")
    rows = [(-1,) * 4 if one.box is None else one.box for one in objects]
    return np.array(rows, np.int16).reshape(-1, 4)


def positions_of(objects: Sequence[KnownObject], camera: Camera, depth: np.ndarray | None) -> np.ndarray:
    """Visible centres, float32 (N, 3), as told or from boxes; NaN where neither is there."""
    found = np.full((len(objects), 3), np.nan, np.float32)
    for number, one in enumerate(objects):
        if one.position is not None:
            found[number] = one.position
        elif one.box is not None:
            u0, v0, u1, v1 = one.box
            hit = np.zeros(0) if depth is None else depth[v0:v1, u0:u1]
            far = float(np.median(hit[hit > 0])) if (hit > 0).any() else 0.0
            with naming(one.where):
                found[number] = point_at(camera, ((u0 + u1 - 1) / 2, (v0 + v1 - 1) / 2), far)
    return found


def _step(told: KnownAction, camera: Camera, depth: np.ndarray | None, shown: str) -> Step:
    with naming(told.where):
        pixel = acted_pixel(told, camera, shown)
        far = 0.0 if depth is None else float(depth[pixel[1], pixel[0]])
        x, y, z = (float(np.float32(value)) for value in told.point or point_at(camera, pixel, far))
    return unknown_step(pixel, (x, y, z), told.direction)


def acted_pixel(told: KnownAction, camera: Camera, shown: str) -> tuple[int, int]:
    """The pixel of an action; BusybotError where the picture, which is called `shown`, does not have it."""
    pixel = told.pixel or pixel_of(camera, told.point)
    if not (0 <= pixel[0] < camera.width and 0 <= pixel[1] < camera.height):
        what = f"pixel {pixel} is outside of pictures of {camera.width} x {camera.height} pixels ({shown})"
        raise BusybotError(what, "u counts columns from the left, v rows from the top, both from 0")
    return pixel


def pixel_of(camera: Camera, point: tuple[float, float, float] | None) -> tuple[int, int]:
    """The pixel that shows a point; BusybotError where none does."""
    seen, far = project(np.array(point, float), camera)
    pixel = (int(np.floor(seen[0])), int(np.floor(seen[1]))) if far > 0 and np.isfinite(seen).all() else UNKNOWN_PIXEL
    inside = 0 <= pixel[0] < camera.width and 0 <= pixel[1] < camera.height
    if not inside:
        raise BusybotError(f"the camera does not see the point {point}", "points are in the board's frame")
    return pixel


def unknown_step(pixel: tuple[int, int], position: tuple[float, float, float], direction: int) -> Step:
    """A step of which only is known what was done."""
    return Step(
        pixel=pixel,
        position=position,
        direction=direction,
        executed=(direction,),
        distance=0.0,
        changed_pixels=0,
        reward=0,
        acted_object=-1,
        acted_link="",
        trigger_states_before=(),
        trigger_states_after=(),
        responder_states_before=(),
        responder_states_after=(),
        joint_positions_before=(),
        joint_positions_after=(),
        success=False,
    )
