"""Plausible episodes without a simulator: coloured rectangles on a textured board, with depth and segmentation."""

from dataclasses import replace

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.boards.spec import BoardSpec, LinkRef, PlacedObject, Relation, Task
from busybot.episodes.episode import Camera, Episode, Image, Link, Step

KEYS = (
    ("Switch/s1", "trigger"),
    ("Lamp/l1", "responder"),
    ("Door/d1", "responder"),
    ("Switch/s2", "trigger"),
    ("Toy/t1", "responder"),
)
DELTA = 20


def make_board(index: int = 0, seed: int = 0, split: str = "train") -> BoardSpec:
    """Two switches, a lamp, a door and a toy in a row; switch 0 drives the lamp, switch 3 the door."""
    rng = np.random.default_rng([seed, index])
    objects = tuple(
        PlacedObject(
            key=key,
            role=role,
            position=(-1.6 + 0.8 * i, float(rng.uniform(-1, 1)), 0.1),
            yaw=0.5 * i,
            scale=0.3 + i / 10,
            states=(int(rng.integers(2)),) if role == "trigger" else (),
        )
        for i, (key, role) in enumerate(KEYS)
    )
    relations = tuple(
        Relation(
            kind="one-to-one",
            triggers=(LinkRef(object=trigger, link="link_0"),),
            responder=responder,
            stage="single",
            states=(0, 1),
        )
        for trigger, responder in ((0, 1), (3, 2))
    )
    return BoardSpec(
        index=index,
        seed=seed,
        split=split,
        appearance_group=index // 20,
        texture="oak",
        color=(0.8, 0.6, 0.4),
        objects=objects,
        relations=relations,
    )


def make_camera(width: int = 160, height: int = 120) -> Camera:
    """Above the board's centre, looking down, up in the picture being +y."""
    focal = 0.72 * width
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    pose = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 4], [0, 0, 0, 1]])
    return Camera(width, height, matrix, pose)


def make_episode(
    index: int = 0, seed: int = 0, steps: int = 6, width: int = 160, height: int = 120, split: str = "train"
) -> Episode:
    """Every third action misses and changes nothing; the others toggle a switch and what it drives."""
    board, camera = make_board(index, seed, split), make_camera(width, height)
    rng = np.random.default_rng([seed, index, 1])
    background = 120 + 30 * np.kron(rng.random((height // 8, width // 8, 1)), np.ones((8, 8, 3)))
    states = {0: board.objects[0].states[0], 3: board.objects[3].states[0]}
    images, frame_of, done = [_draw(board, camera, states, background)], [0], []
    for k in range(steps):
        before = dict(states)
        acted = -1 if k % 3 == 2 else (0, 3)[int(rng.integers(2))]
        if acted >= 0:
            states[acted] = 1 - states[acted]
            images.append(_draw(board, camera, states, background))
        frame_of.append(len(images) - 1)
        changed = _changed(images[frame_of[-2]], images[frame_of[-1]])
        done.append(_step(board, images[frame_of[-2]], acted, before, states, changed, rng))
    return Episode(
        board=board,
        camera=camera,
        links=tuple(Link(i, "link_0", role == "trigger") for i, (_, role) in enumerate(KEYS)),
        positions=np.array([o.position for o in board.objects], np.float32),
        images=images,
        frame_of=frame_of,
        steps=done,
        policy="random",
        oracle=False,
        settings={"delta": DELTA, "strict": False, "stop": "physical"},
        renderer={"device": "numpy", "driver": "none"},
        versions={"busybot": "0.0", "numpy": "2"},
    )


def make_task_episode(index: int = 0, steps: int = 6) -> Episode:
    """The same with a task: both switches in state 1."""
    episode = make_episode(index, steps=steps)
    links = tuple(LinkRef(object=trigger, link="link_0") for trigger in (0, 3))
    task = Task(kind="one-to-one", links=links, goal=(1, 1))
    background = np.full((episode.camera.height, episode.camera.width, 3), 130.0)
    goal = _draw(episode.board, episode.camera, {0: 1, 3: 1}, background)
    return replace(episode, board=episode.board.model_copy(update={"task": task}), goals=[goal])


def make_real_episode(index: int = 0, steps: int = 4) -> Episode:
    """As from a real board: a camera without depth, no segmentation, no joints, states unknown."""
    episode = make_episode(index, steps=steps, split="real")
    nowhere = np.full((len(KEYS), 4), -1, np.int16)
    episode.images = [replace(image, depth=None, segmentation=None, boxes=nowhere) for image in episode.images]
    unknown: dict = {
        f"{name}_{when}": ()
        for name in ("trigger_states", "responder_states", "joint_positions")
        for when in ("before", "after")
    }
    unknown |= {"memory_after": (), "acted_object": -1, "acted_link": "", "success": False, "pixel": (-1, -1)}
    episode.steps = [replace(step, **unknown) for step in episode.steps]
    return replace(
        episode,
        links=(),
        positions=np.full((len(KEYS), 3), np.nan, np.float32),
        policy="human",
        settings={},
        renderer={},
    )


def _draw(board: BoardSpec, camera: Camera, states: dict[int, int], background: np.ndarray) -> Image:
    height, width = camera.height, camera.width
    rgb = background.astype(np.uint8)
    depth = np.full((height, width), 4.0, np.float32)
    depth[:, :4] = 0
    segmentation = np.zeros((height, width), np.uint16)
    boxes = np.full((len(board.objects), 4), -1, np.int16)
    driven = {r.responder: states[r.triggers[0].object] for r in board.relations}
    for i, placed in enumerate(board.objects):
        state = states.get(i, driven.get(i, 0))
        u, v = _pixel(placed, camera)
        half = width // 16
        half_v = half // 2 if placed.category == "Door" and state else half
        rows, columns = slice(v - half_v, v + half_v), slice(u - half, u + half)
        rgb[rows, columns] = (40 * i, 250 * state, 200 - 30 * i)
        depth[rows, columns] = 3.7 - 0.05 * i - 0.01 * state
        segmentation[rows, columns] = i + 1
        boxes[i] = (u - half, v - half_v, u + half, v + half_v)
    return Image(rgb, depth, segmentation, boxes)


def _pixel(placed: PlacedObject, camera: Camera) -> tuple[int, int]:
    x, y, z = placed.position
    focal, depth = camera.matrix[0, 0], 4 - z
    return int(camera.width / 2 + focal * x / depth), int(camera.height / 2 - focal * y / depth)


def _changed(before: Image, after: Image) -> int:
    return int((before.rgb != after.rgb).any(-1).sum())


def _step(
    board: BoardSpec,
    before: Image,
    acted: int,
    states_before: dict[int, int],
    states_after: dict[int, int],
    changed: int,
    rng: np.random.Generator,
) -> Step:
    u0, v0, u1, v1 = (int(x) for x in before.boxes[max(acted, 0)])
    direction = int(rng.integers(len(DIRECTIONS)))
    position = np.float32(board.objects[max(acted, 0)].position)

    def responders(states: dict[int, int]) -> tuple[int, ...]:
        driven = {r.responder: states[r.triggers[0].object] for r in board.relations}
        return tuple(-1 if o.role == "trigger" else driven.get(i, 0) for i, o in enumerate(board.objects))

    ordered_before, ordered_after = tuple(states_before.values()), tuple(states_after.values())
    return Step(
        pixel=((u0 + u1) // 2, (v0 + v1) // 2),
        position=(float(position[0]), float(position[1]), float(position[2])),
        direction=direction,
        executed=(direction,) if acted >= 0 else (direction, int(OPPOSITE[direction])),
        distance=0.09 if acted >= 0 else 0.21,
        changed_pixels=changed,
        reward=int(changed > DELTA),
        acted_object=acted,
        acted_link="link_0" if acted >= 0 else "",
        trigger_states_before=ordered_before,
        trigger_states_after=ordered_after,
        responder_states_before=responders(states_before),
        responder_states_after=responders(states_after),
        joint_positions_before=tuple(0.1 + 0.7 * s for s in ordered_before),
        joint_positions_after=tuple(0.1 + 0.7 * s for s in ordered_after),
        memory_after=ordered_after,
        success=acted >= 0,
    )
