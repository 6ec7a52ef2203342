"""Measures the CPU time of a recorded interaction against one frame of SAPIEN's `minimal` shader pack.

    python -m benchmarks.speed.collection [--assets DIR] [--boards 5] [--out FILE]
    python -m benchmarks.speed.collection --memory 500 [--assets DIR]

The first mode acts on the same boards with our shader pack and, alternating within one process, shows each new state
to a camera with SAPIEN's `minimal` pack. Counted are interactions that moved a link: simulated, rendered, read back,
encoded (RGB, depth, segmentation) and written. The reference is `minimal`'s render and read-back of colour, position
and segmentation alone, lit by ambient light and one sun with shadows (a map of 1024 x 1024); without shadows beside it.
First frames of a board are dropped; figures are medians. Policy time is left out: it is no part of an interaction. CPU
time is the process's, over all threads.

The second mode builds and plays so many boards in one process and reports its memory and open files along the way.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import psutil

from benchmarks.runner import finish, one_of, parser, peak_mb
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.episodes.camera import Rays
from busybot.episodes.mcap.writer import write_episode
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import RandomPolicy, ScriptedFactory, ScriptedPolicy
from busybot.sim.interaction import InteractionConfig, interact
from busybot.sim.policy import Policy, oracle_observation
from busybot.sim.recorder import grasp_at, record_episode
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig, Surroundings

STEPS = 30
SEED = 1
FRAMES = ("minimal frame", "minimal frame without shadows")
Result = TypeVar("Result")
Times = dict[str, list[float]]


def noted(times: Times, name: str, work: Callable[[], Result]) -> Result:
    """Run `work` and note the process's CPU seconds under `name`."""
    began = time.process_time()
    result = work()
    times.setdefault(name, []).append(time.process_time() - began)
    return result


def measure_board(simulators: dict[str, Simulator], board: BoardSpec, folder: Path, times: Times) -> None:
    """Play one board; every moved link is a line in `times["moved"]` and a frame in each reference."""
    config = InteractionConfig()
    scene = noted(times, "build", lambda: simulators["ours"].board(board))
    image = noted(times, "first frame", scene.observe)
    references = {name: simulator.board(board) for name, simulator in simulators.items() if name != "ours"}
    for reference in references.values():
        show(reference)
    rays = Rays(scene.camera)
    policies: tuple[Policy, Policy] = (ScriptedPolicy(scene, rays, config), RandomPolicy(rays))
    rng = np.random.default_rng(board.index)
    episode = record_episode(simulators["ours"], board, ScriptedFactory(), STEPS, config, 0)
    parts: Times = {}
    size = noted(parts, "write", lambda: write_episode(folder / "episode.mcap", episode))
    times.setdefault("bytes per frame", []).append(size / len(episode.images))
    for number in range(2 * STEPS):
        action = policies[number % 2].select_action(oracle_observation(image, scene.camera), rng)
        assert action is not None, "every board has links to move"
        grasp = grasp_at(scene, image, rays, action.pixel)
        step, after = noted(parts, "act", partial(interact, scene, grasp, action.directions[0], config, image))
        seconds = parts["act"][-1]
        if after is None:
            times.setdefault("unchanged interaction", []).append(seconds)
            continue
        image = after
        times.setdefault("moved: simulate, render, read", []).append(seconds)
        times.setdefault("moved: encode, write", []).append(parts["write"][0] / len(episode.images))
        for name, reference in references.items():
            for trigger, state in enumerate(step.trigger_states_after):
                reference.set_trigger(trigger, state)
            noted(times, name, partial(show, reference))


def show(scene: BoardScene) -> None:
    """Render and read back what `minimal` offers; nothing is converted."""
    scene.scene.update_render()
    camera: Any = scene._camera
    camera.take_picture()
    camera.get_picture("Color"), camera.get_picture("PositionSegmentation")


def benchmark(library: Library, boards: int) -> dict[str, Any]:
    """All figures, CPU milliseconds (medians) and ratios."""
    # the shader pack belongs to the camera, so simulators with different packs live side by side
    configs = {"ours": RenderConfig()} | dict.fromkeys(FRAMES, RenderConfig(shader="minimal"))
    simulators = {name: Simulator(library, config) for name, config in configs.items()}
    simulators[FRAMES[1]]._surroundings = Surroundings(lights=True, shadows=False)
    specs = list(generate_boards(BoardConfig(boards=boards, group_size=1, seed=SEED), library))
    times: Times = {}
    with tempfile.TemporaryDirectory() as folder:
        for spec in specs:
            measure_board(simulators, spec, Path(folder), times)
    milliseconds = {
        name: round(1e3 * float(np.median(values)), 2) for name, values in times.items() if "bytes" not in name
    }
    first, second = times["moved: simulate, render, read"], times["moved: encode, write"]
    total = 1e3 * float(np.median(np.add(first, second)))
    return {
        "assets": library.name,
        "boards": boards,
        "moved_interactions": len(first),
        "cpu_ms_per_moved_interaction": round(total, 2),
        "cpu_ms": milliseconds,
        "kilobytes_per_frame": round(float(np.mean(times["bytes per frame"])) / 1e3, 1),
        "ratio_to_minimal_frame": round(total / milliseconds[FRAMES[0]], 3),
        "ratio_to_minimal_frame_without_shadows": round(total / milliseconds[FRAMES[1]], 3),
        "device": simulators["ours"].board(specs[0]).scene.render_system.device.name,
    }


def memory(library: Library, boards: int) -> dict[str, Any]:
    """Resident memory of this process, MB, after every tenth of the boards (each played for 3 actions)."""
    simulator = Simulator(library, RenderConfig())
    process, trace = psutil.Process(), []
    config = BoardConfig(boards=boards, group_size=1, seed=SEED)
    for number, spec in enumerate(generate_boards(config, library), start=1):
        record_episode(simulator, spec, ScriptedFactory(), 3, InteractionConfig(), 0)
        if number % max(1, boards // 10) == 0:
            resident = round(process.memory_info().rss / 1e6)
            trace.append({"boards": number, "rss_mb": resident, "open_files": process.num_fds()})
            print(trace[-1], file=sys.stderr, flush=True)
    return {
        "assets": library.name,
        "memory": trace,
        # until then caches fill
        "growth_mb_over_second_half": trace[-1]["rss_mb"] - trace[len(trace) // 2 - 1]["rss_mb"],
        "peak_mb": peak_mb(),
        "more_open_files_over_second_half": trace[-1]["open_files"] - trace[len(trace) // 2 - 1]["open_files"],
    }


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--boards", type=int, default=5, help="boards to play in the first mode")
    options.add_argument("--memory", type=int, metavar="BOARDS", help="run the second mode over so many boards")
    arguments = options.parse_args(words)
    loading: Times = {}
    library = noted(loading, "objects", lambda: find(arguments.assets))
    result = memory(library, arguments.memory) if arguments.memory else benchmark(library, arguments.boards)
    result["cpu_ms_per_object_loaded"] = round(1e3 * loading["objects"][0] / len(library.objects), 2)
    kind, hashes = "memory" if arguments.memory else "collection", {"data": {"objects": library.sha256}}
    print(json.dumps(finish(kind, arguments, result, hashes=hashes, seed=SEED), indent=1))


if __name__ == "__main__":
    one_of(main)
