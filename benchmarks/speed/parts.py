"""Measures where every millisecond of a recorded interaction and of a board goes, and what each part costs by itself.

    python -m benchmarks.speed.parts [--assets DIR] [--boards 20] [--out FILE]
    python -m benchmarks.speed.parts worlds [--assets DIR] [--boards 20] [--out FILE]
    python -m benchmarks.speed.parts drawing [--assets DIR] [--boards 40] [--out FILE]

Boards are built, acted on by the scripted policy, written and read back as `busybot collect` does, in one process,
whose caches are warm: the user's, where meshes are kept, and what a first board brings with it. Each board has objects
and a surface of its own. What is told is processor time, over all threads. A part that another part calls counts for
itself alone; what belongs to no part is `other`, so that all parts together are the whole. Times of an interaction
include its share in the board's first picture, but not in building.

A limit is what the part's result costs by itself, measured in the same run: the same scene drawn by SAPIEN's `minimal`
pack, the same picture through the library's encoder, bytes at the speed of memory, hashing or disk (that alone by the
clock). A part without one is work that could be absent.
"""

import hashlib
import json
import os
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import sapien
from sapien.wrapper.articulation_builder import ArticulationBuilder
from sapien.wrapper.urdf_loader import URDFLoader

from benchmarks.runner import PRODUCT_SIDE, finish, one_of, parser, product_seconds, timed, torch_with
from busybot.boards.config import WORLD_LINKS, BoardConfig
from busybot.boards.generate import Redraws, generate_boards
from busybot.boards.spec import PAPER, BoardSpec
from busybot.boards.worlds import WORLDS
from busybot.episodes import codec, tables
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.writer import write_episode
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim import interaction
from busybot.sim.builtin_policies import ScriptedFactory, ScriptedPolicy
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import record_episode
from busybot.sim.scene import asset_cache, board_scene
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig, Surroundings, add_camera

STEPS = 30
SEED = 1
BLOCK = 64 << 20
"""Bytes that are copied, hashed and written to measure how fast that goes."""
BUILDING = ("reading URDF files", "meshes and their textures", "bodies", "surface", "scene, joints, camera")
TWICE = "picture fetched again"


class Clock:
    """Processor seconds by part, each without the parts that it called.

    Attributes:
        within: the parts that are going on, each called by the one before.
    """

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.within: list[str] = []
        self._inner = [0.0]

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        began = time.process_time()
        self._inner.append(0.0)
        self.within.append(name)
        try:
            yield
        finally:
            spent = time.process_time() - began
            self.within.pop()
            self.seconds[name] += spent - self._inner.pop()
            self._inner[-1] += spent

    def watch(self, owner: Any, attribute: str, name: Callable[..., str] | str) -> Any:
        """While this is entered, calls are parts; their name may follow from the arguments."""
        original = getattr(owner, attribute)

        def watched(*args: Any, **kwargs: Any) -> Any:
            with self.part(name if isinstance(name, str) else name(*args)):
                return original(*args, **kwargs)

        return mock.patch.object(owner, attribute, watched)


class WaitingCamera:
    """A camera whose `take_picture` returns when the picture is there; SAPIEN's would let the next call wait."""

    def __init__(self, camera: Any, clock: Clock) -> None:
        self._camera, self._clock = camera, clock

    def take_picture(self) -> None:
        with self._clock.part("render"):
            self._camera.take_picture()
            self._camera.get_picture("Color")
        with self._clock.part(TWICE):
            self._camera.get_picture("Color")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)


@contextmanager
def watching(clock: Clock, count: Counter[str]) -> Iterator[None]:
    """While this is entered, the clock notes what collecting consists of, and physics steps are counted."""
    urdf, meshes, bodies, surface, rest = BUILDING
    step = sapien.Scene.step

    def counted(scene: Any) -> None:
        count["physics"] += clock.within[-1:] == ["physics"]
        step(scene)

    def png(values: np.ndarray) -> str:
        return "segmentation" if values.dtype == np.uint8 else "depth"

    with ExitStack() as stack:
        for owner, attribute, name in (
            (Simulator, "board", rest),
            (URDFLoader, "load_file_as_articulation_builder", urdf),
            (asset_cache, "meshes_of", meshes),
            (asset_cache, "component", meshes),
            (ArticulationBuilder, "build", bodies),
            (Surroundings, "add", surface),
            (sapien.Scene, "update_render", "render"),
            (board_scene, "read_picture", "read-back"),
            (BoardScene, "observe", "codes and boxes"),
            (ScriptedPolicy, "select_action", "policy"),
            (interaction, "_execute", "physics"),
            (interaction, "changed_pixels", "change detection"),
            (codec, "encode_rgb", "JPEG"),
            (codec, "encode_plain", png),
            (codec.DepthScale, "quantise", "depth"),
            (codec.DepthScale, "covering", "depth"),
            (codec.LazyImages, "_decode", "decoding"),
            (tables, "episode_digests", "hashing"),
        ):
            stack.enter_context(clock.watch(owner, attribute, name))
        camera = mock.patch.object(board_scene, "add_camera", lambda *args: WaitingCamera(add_camera(*args), clock))
        stack.enter_context(camera)
        stack.enter_context(mock.patch.object(sapien.Scene, "step", counted))
        yield


def collect(simulator: Simulator, board: BoardSpec, file: Path, clock: Clock) -> Episode:
    """What a worker does with a board."""
    episode = record_episode(simulator, board, ScriptedFactory(), STEPS, InteractionConfig(), 0)
    with clock.part("write"):
        write_episode(file, episode)
    with clock.part("reading back, tables"):
        tables.episode_rows(file, board.index)
    return episode


@dataclass
class Played:
    """What boards that were collected took, in processor seconds.

    Attributes:
        clock: by part; `acting` and `building` leave out what the clock itself brings with it.
        count: of boards, physics steps, actions (`steps`), pictures (`images`) and bytes.
    """

    clock: Clock = field(default_factory=Clock)
    count: Counter[str] = field(default_factory=Counter)
    whole: float = 0.0

    def play(self, simulator: Simulator, specs: list[BoardSpec], file: Path) -> Episode:
        """Collect boards into a file, one after the other; returns the last one's episode."""
        with watching(self.clock, self.count):
            began = time.process_time()
            for spec in specs:
                episode = collect(simulator, spec, file, self.clock)
                self.count.update(boards=1, steps=len(episode.steps), images=len(episode.images))
                self.count.update(bytes=file.stat().st_size)
            self.whole += time.process_time() - began
        return episode

    @property
    def building(self) -> dict[str, float]:
        """Seconds of a board, by part."""
        return {name: self.clock.seconds[name] / self.count["boards"] for name in BUILDING}

    @property
    def acting(self) -> dict[str, float]:
        """Seconds of an interaction, by part."""
        spent = {name: one for name, one in self.clock.seconds.items() if name not in (*BUILDING, TWICE)}
        spent["render"] -= self.clock.seconds[TWICE]
        return {name: one / self.count["steps"] for name, one in spent.items()}

    @property
    def interaction(self) -> float:
        """Seconds of an interaction, with what belongs to no part."""
        building = sum(self.building.values()) * self.count["boards"]
        return (self.whole - 2 * self.clock.seconds[TWICE] - building) / self.count["steps"]


def seconds(work: Callable[[], object], times: int = 20) -> float:
    """Median processor seconds."""
    return float(np.median(timed(work, times)[1]))


def speeds(folder: Path) -> dict[str, float]:
    """Bytes a second: read and written in memory, hashed, and written to disk (by the clock)."""
    block, other = np.ones(BLOCK, np.uint8), np.zeros(BLOCK, np.uint8)

    def write() -> None:
        with open(folder / "block", "wb") as file:
            file.write(block.data)
            os.fsync(file.fileno())

    disk = float(np.median(timed(write, 5)[0]))
    memory, hashed = seconds(partial(np.copyto, other, block)), seconds(partial(hashlib.sha256, block.data), 5)
    return {"memory": 2 * BLOCK / memory, "SHA-256": BLOCK / hashed, "disk": BLOCK / disk}


def limits(
    library: Library, board: BoardSpec, episode: Episode, size: float, speed: dict[str, float]
) -> dict[str, Any]:
    """Of a picture's parts, of a step's and of a board's: words and seconds.

    Args:
        size: of a file with an episode, bytes.
        speed: see `speeds`.
    """
    scene = Simulator(library, RenderConfig(shader="minimal"))
    scene._surroundings = Surroundings(lights=True, shadows=False)
    shown = scene.board(board)
    picture = episode.images[0].rgb
    quality = [cv2.IMWRITE_JPEG_QUALITY, codec.JPEG_QUALITY]
    jpeg = cv2.imencode(".jpg", picture, quality)[1]
    pixels = picture.shape[0] * picture.shape[1]
    files = {file for model in shown.models for file in model.folder.rglob("*") if file.is_file()}

    def render() -> None:
        shown.scene.update_render()
        shown._camera.take_picture()
        shown._camera.get_picture("Color")

    def moved(bytes_each: float) -> tuple[str, float]:
        return f"{bytes_each * pixels / 1e6:.1f} MB in memory", bytes_each * pixels / speed["memory"]

    return {
        "picture": {
            "render": ("`minimal` pack, no shadows", seconds(render)),
            "read-back": moved(4 + 8 + 4),
            "codes and boxes": moved(2 + 2),
            "change detection": moved(3 + 3),
            "JPEG": ("OpenCV's JPEG", seconds(lambda: cv2.imencode(".jpg", picture, quality))),
            "depth": moved(4 + 2),
            "segmentation": moved(2 + 1),
            "decoding": ("OpenCV's JPEG", seconds(lambda: cv2.imdecode(jpeg, cv2.IMREAD_COLOR))),
            "hashing": (f"SHA-256 of {9 * pixels / 1e6:.1f} MB", 9 * pixels / speed["SHA-256"]),
        },
        "step": ("steps of the board at rest", seconds(shown.scene.step)),
        "file": (f"{size / 1e3:.0f} kB on disk", size / speed["disk"]),
        "board": {
            "meshes and their textures": (
                f"{(read := sum(file.stat().st_size for file in files)) / 1e6:.1f} MB of files in memory",
                read / speed["memory"],
            ),
            "surface": ("1.0 MB in memory", (1 << 20) / speed["memory"]),
        },
    }


def table(parts: dict[str, float], whole: float, limit: dict[str, tuple[str, float]]) -> dict[str, Any]:
    """Rows of milliseconds, the largest first, `other` and the whole last."""
    named = dict(sorted(parts.items(), key=lambda item: -item[1])) | {"other": whole - sum(parts.values())}
    rows: dict[str, Any] = {}
    for name, spent in (named | {"all": whole}).items():
        rows[name] = {"ms": round(1e3 * spent, 3), "share": round(spent / whole, 4)}
        if name in limit:
            words, least = limit[name]
            rows[name] |= {
                "limit": words,
                "limit_ms": round(1e3 * least, 3),
                "ratio": round(spent / least, 2),
            }
    return rows


def benchmark(library: Library, boards: int) -> dict[str, Any]:
    """Milliseconds of an interaction and of building a board, by part."""
    first, *specs = generate_boards(BoardConfig(boards=boards + 1, group_size=1, seed=SEED), library)
    for spec in specs:
        Simulator(library, RenderConfig(width=64, height=48)).board(spec).observe()
    sapien.render.clear_cache(models=True, images=True)
    simulator, played = Simulator(library, RenderConfig()), Played()
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary) / "episode.mcap"
        collect(simulator, first, file, Clock())
        episode = played.play(simulator, specs, file)
        speed = speeds(Path(temporary))
    count = played.count
    least = limits(library, specs[-1], episode, count["bytes"] / boards, speed)
    share = count["images"] / count["steps"]
    limit = {name: (words, share * one) for name, (words, one) in least["picture"].items()}
    limit["physics"] = least["step"][0], least["step"][1] * count["physics"] / count["steps"]
    limit["write"] = least["file"][0], least["file"][1] * boards / count["steps"]
    return {
        "assets": library.name,
        "boards": boards,
        "interactions": count["steps"],
        "interaction": table(played.acting, played.interaction, limit),
        "board": table(played.building, sum(played.building.values()), least["board"]),
        "megabytes_a_second": {name: round(one / 1e6) for name, one in speed.items()},
    }


def worlds(words: list[str]) -> None:
    """An interaction in each world, milliseconds, and its ratio to the paper's."""
    options = parser(__doc__, out=False)
    options.add_argument("--boards", type=int, default=20, help="of each world")
    arguments = options.parse_args(words)
    library = find(arguments.assets)
    rows = world_rows(library, arguments.boards)
    hashes = {"data": {"objects": library.sha256}}
    figures = {"assets": library.name, "boards": arguments.boards, "steps": STEPS, "rows": rows}
    print(json.dumps(finish("world-costs", arguments, figures, hashes=hashes, seed=SEED), indent=1))


def world_rows(library: Library, boards: int) -> dict[str, Any]:
    """A row for each world; the first board of each, which warms caches, does not count."""
    drawn = {
        world: list(
            generate_boards(
                BoardConfig(world=world, links=WORLD_LINKS, boards=boards + 1, group_size=1, seed=SEED), library
            )
        )
        for world in (PAPER, *WORLDS)
    }
    simulator, played = Simulator(library, RenderConfig()), {world: Played() for world in drawn}
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary) / "episode.mcap"
        for number in range(boards + 1):
            for world, specs in drawn.items():
                (played[world] if number else Played()).play(simulator, [specs[number]], file)
    usual = played[PAPER].interaction - played[PAPER].acting["policy"]
    rows = {}
    for world, one in played.items():
        policy = one.acting["policy"]
        rows[world] = {
            "ms": round(1e3 * (one.interaction - policy), 2),
            "ratio": round((one.interaction - policy) / usual, 3),
            "pictures": round(one.count["images"] / one.count["steps"], 3),
            "policy_ms": round(1e3 * policy, 2),
            "building_ms": round(1e3 * sum(one.building.values()), 2),
        }
    return rows


def drawing(words: list[str]) -> None:
    """Boards a second of processor time, objects being loaded, and how often a draw was thrown away."""
    options = parser(__doc__, out=False)
    options.add_argument("--boards", type=int, default=40, help="of each row")
    arguments = options.parse_args(words)
    library, rows = find(arguments.assets), {}
    drawn: dict[str, dict[str, Any]] = {world: {"world": world} for world in (PAPER, *WORLDS)}
    for depth in range(1, 9):
        links = {} if depth < WORLD_LINKS[1] - 1 else {"links": (depth + 1, 12)}
        drawn[f"lock, depth {depth}"] = {"world": "lock", "depth": (depth, depth), **links}
    drawn["lock, depth 1 to 8"] = {"world": "lock", "depth": (1, 8), "links": (WORLD_LINKS[0], 12)}
    for name, values in drawn.items():
        config = BoardConfig.model_validate({"boards": arguments.boards, "group_size": 1, "seed": SEED, **values})
        redraws = Redraws()
        _, (spent,) = timed(partial(list, generate_boards(config, library, redraws)), 1, warm_up=0, label=name)
        rows[name] = {"boards_per_second": round(arguments.boards / spent, 1), "redraws": redraws.total()}
    figures = {"assets": library.name, "boards": arguments.boards, "rows": rows}
    hashes = {"data": {"objects": library.sha256}}
    print(json.dumps(finish("drawing", arguments, figures, hashes=hashes, seed=SEED), indent=1))


def main(words: list[str]) -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--boards", type=int, default=20)
    arguments = options.parse_args(words)
    library = find(arguments.assets)
    figures = benchmark(library, arguments.boards)
    torch_with(1)
    product = 1e3 * product_seconds(20)
    for row in (*figures["interaction"].values(), *figures["board"].values()):
        row["products"] = round(row["ms"] / product, 4)
    figures |= {
        "unit": f"products of two {PRODUCT_SIDE} x {PRODUCT_SIDE} matrices of float32, one thread",
        "product_milliseconds": round(product, 2),
    }
    hashes = {"data": {"objects": library.sha256}}
    print(json.dumps(finish("collection-parts", arguments, figures, hashes=hashes, seed=SEED), indent=1))


if __name__ == "__main__":
    one_of(main, worlds=worlds, drawing=drawing)
