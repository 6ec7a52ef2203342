"""Episodes of boards of any world without a simulator: links move as drawn, the mechanisms do the rest."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics, DynamicState
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.boards.worlds import links_of
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Camera, Episode, Image, Link, Step
from busybot.episodes.mcap.writer import write_episode
from busybot.objects.library import Library
from busybot.objects.resolve import load_and_remember
from tests.episodes.folders import COLLECT
from tests.episodes.synthetic import DELTA, make_camera

MISSES = 0.15
"""Share of actions that hold nothing."""
HALF = 7
"""Of an object's rectangle, pixels."""


@cache
def library_at(folder: Path) -> Library:
    return load_and_remember(folder)


def world_boards(folder: Path, world: str, boards: int, split: str = "train", seed: int = 0) -> list[BoardSpec]:
    """Boards of a world, of the objects in a folder."""
    return list(generate_boards(_config(world, boards, split, seed), library_at(folder)))


def _config(world: str, boards: int, split: str, seed: int) -> BoardConfig:
    return BoardConfig.model_validate(dict(world=world, boards=boards, group_size=1, split=split, seed=seed))


def make_world_dataset(path: Path, folder: Path, world: str, boards: int = 3, split: str = "train") -> Dataset:
    """A dataset of such boards with an episode of 30 actions on each."""
    library = library_at(folder)
    dataset = create_dataset(path, _config(world, boards, split, 0), library)
    dataset.begin_collecting(COLLECT.model_copy(update={"images": "png", "steps": 30}))
    for board in dataset.boards():
        write_episode(dataset.episode_path(board.index), make_world_episode(board, library), "png")
    dataset.write_tables()
    return dataset


def make_world_episode(board: BoardSpec, library: Library, steps: int = 30) -> Episode:
    """Random moves of links that nothing holds, and of held ones, which do not give way; some actions miss."""
    models = [library.get(placed.key) for placed in board.objects]
    links, camera = links_of(models), make_camera()
    dynamics = Dynamics(board, links)
    shown = [Link(i, "body", False) for i in range(len(models))]
    shown += [Link(index, name, True) for index, name in links.names]
    triggers = tuple(state for placed in board.objects for state in placed.states)
    state, images, frame_of, done = dynamics.start(triggers), [], [0], []
    images.append(_draw(board, camera, links.names, triggers, state))
    for link, there in _moves(board, links.sizes, triggers, steps):
        held = link >= 0 and dynamics.locked(link, state.shown)
        moved = link >= 0 and not held
        after = (*triggers[:link], there, *triggers[link + 1 :]) if moved and there != triggers[link] else triggers
        # a move that the locks stopped leaves the drawn states behind: the next one starts from what is
        following = dynamics.step(after, state)
        picture = _draw(board, camera, links.names, after, following)
        if not np.array_equal(picture.rgb, images[-1].rgb):
            images.append(picture)
        frame_of.append(len(images) - 1)
        done.append(_step(board, links.names, link, (triggers, state), (after, following)))
        triggers, state = after, following
    return Episode(
        board=board,
        camera=camera,
        links=tuple(shown),
        positions=np.array([placed.position for placed in board.objects], np.float32),
        images=images,
        frame_of=frame_of,
        steps=done,
        policy="random",
        oracle=False,
        settings={"delta": DELTA},
    )


def _moves(board: BoardSpec, sizes: tuple[int, ...], start: tuple[int, ...], steps: int) -> Iterator[tuple[int, int]]:
    """A link, -1 for none, and the state that it is pulled to."""
    rng = np.random.default_rng([board.seed, board.index, 7])
    for _ in range(steps):
        link = -1 if rng.random() < MISSES else int(rng.integers(len(sizes)))
        yield link, int(rng.integers(sizes[link])) if link >= 0 else 0


def _draw(
    board: BoardSpec,
    camera: Camera,
    names: tuple[tuple[int, str], ...],
    triggers: tuple[int, ...],
    state: DynamicState,
) -> Image:
    """Rectangles whose colour tells the state of an object's links, or of its responder."""
    rgb = np.full((camera.height, camera.width, 3), 150, np.uint8)
    depth = np.full((camera.height, camera.width), 4.0, np.float32)
    segmentation = np.zeros((camera.height, camera.width), np.uint16)
    boxes = np.full((len(board.objects), 4), -1, np.int16)
    for index, placed in enumerate(board.objects):
        own = [now for (owner, _), now in zip(names, triggers, strict=True) if owner == index]
        x, y, z = placed.position
        focal = camera.matrix[0, 0]
        u, v = int(camera.width / 2 + focal * x / (4 - z)), int(camera.height / 2 - focal * y / (4 - z))
        box = np.clip([u - HALF, v - HALF, u + HALF, v + HALF], 0, [camera.width, camera.height] * 2)
        place = slice(box[1], box[3]), slice(box[0], box[2])
        rgb[place] = (
            25 * index,
            60 * sum(now * 3**k for k, now in enumerate(own)) % 256,
            80 * max(state.shown[index], 0),
        )
        depth[place] = 3.7
        segmentation[place] = 1 + index
        boxes[index] = box
    return Image(rgb, depth, segmentation, boxes)


def _step(
    board: BoardSpec,
    names: tuple[tuple[int, str], ...],
    link: int,
    before: tuple[tuple[int, ...], DynamicState],
    after: tuple[tuple[int, ...], DynamicState],
) -> Step:
    acted, name = names[link] if link >= 0 else (-1, "")
    position = np.float32(board.objects[max(acted, 0)].position)
    return Step(
        pixel=(80, 60),
        position=(float(position[0]), float(position[1]), float(position[2])),
        direction=0,
        executed=(0,),
        distance=0.09,
        changed_pixels=0,
        reward=0,
        acted_object=acted,
        acted_link=name,
        trigger_states_before=before[0],
        trigger_states_after=after[0],
        responder_states_before=before[1].shown,
        responder_states_after=after[1].shown,
        joint_positions_before=tuple(map(float, before[0])),
        joint_positions_after=tuple(map(float, after[0])),
        success=before[0] != after[0],
        memory_after=after[1].flat,
    )
