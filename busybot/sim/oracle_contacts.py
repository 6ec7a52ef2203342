"""True contacts of every trigger link and the directions that move it: for oracles only."""

from dataclasses import dataclass

import numpy as np

from busybot.episodes.camera import Rays
from busybot.sim.builtin_policies import TRIES, direction_to, interior_pixels, visible_links
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import OracleObservation
from busybot.sim.scene.board_scene import BoardScene


@dataclass(frozen=True)
class TrueContact:
    """A pixel at which a trigger link can be moved.

    Attributes:
        number: of the trigger joint in the scene.
        pixel: (u, v), well inside of the link.
        position: float32 (3,), board frame.
        directions: state to a direction that leads there from the present state.
    """

    number: int
    pixel: tuple[int, int]
    position: np.ndarray
    directions: dict[int, int]


def true_contacts(
    scene: BoardScene, seen: OracleObservation, rays: Rays, config: InteractionConfig, rng: np.random.Generator
) -> list[TrueContact]:
    """One contact for every visible link that can be moved, from which most neighbouring states can be reached.

    Args:
        seen: what the scene shows now.
    """
    found = []
    for number, mask in visible_links(scene, seen.segmentation):
        state, states = scene.triggers[number].state, scene.triggers[number].link.states
        wanted = [other for other in (state - 1, state + 1) if 0 <= other < states]
        best: TrueContact | None = None
        for pixel in interior_pixels(mask, rng, TRIES):
            point = rays.point(seen.depth, pixel)
            directions = {}
            for other in wanted:
                direction, reached = direction_to(scene, number, point, other, config)
                if direction is not None:
                    directions[reached] = direction
            if directions and (best is None or len(directions) > len(best.directions)):
                best = TrueContact(number, pixel, point, directions)
            if len(directions) == len(wanted):
                break
        if best is not None:
            found.append(best)
    return found
