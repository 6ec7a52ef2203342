"""Defines what a policy is: what it gets, what it answers, and who makes it.

A policy gets an `Observation`: what a robot would have. Whether it gets more depends on the kind of factory that makes
it: a `DetectingFactory` is told where the objects are in the first picture; an `OracleFactory` is given the scene, its
policies get an `OracleObservation`, their episodes are marked oracle.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Camera, Image, Observation

if TYPE_CHECKING:
    from busybot.sim.interaction import InteractionConfig
    from busybot.sim.scene.board_scene import BoardScene


@dataclass(frozen=True)
class Action:
    """A pixel (u, v) to take hold of and the indices of the directions to try, one in the usual case."""

    pixel: tuple[int, int]
    directions: tuple[int, ...]


class Policy(Protocol):
    """Selects actions on one board from what the camera shows, and observes what comes of them."""

    name: str

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action | None:
        """The next action; None to end the episode here.

        Args:
            observation: the same object as long as no pixel changes.
        """
        ...

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        """What the agent perceives of its own action: the directions executed, the pixel reward, what it sees then."""


@runtime_checkable
class PolicyFactory(Protocol):
    """Makes a board's policy. It is handed to worker processes: plain data that loads what it needs at first use."""

    @property
    def name(self) -> str: ...

    def make_policy(self, rays: Rays) -> Policy:
        """A policy for one board, seen by the camera of these rays."""
        ...


@dataclass(frozen=True)
class Detections:
    """What a detector tells of the first picture: N objects, as recordings tell them to reasoners.

    Attributes:
        roles: "trigger" or "responder".
        boxes: int16 (N, 4), u0, v0, u1, v1 (exclusive); -1 where not visible.
        positions: float32 (N, 3), visible centre, board frame, board units; NaN if not visible.
    """

    roles: tuple[str, ...]
    boxes: np.ndarray
    positions: np.ndarray


@runtime_checkable
class DetectingFactory(Protocol):
    """Makes a policy that knows where objects are in the first picture, as reasoners do."""

    @property
    def name(self) -> str: ...

    def make_detecting(self, rays: Rays, detections: Detections) -> Policy:
        """A policy for one board, seen by the camera of these rays."""
        ...


@runtime_checkable
class OracleFactory(Protocol):
    """Makes a policy that knows what only the simulator knows, for bounds and tests."""

    @property
    def name(self) -> str: ...

    def make_oracle(self, scene: "BoardScene", rays: Rays, config: "InteractionConfig") -> Policy:
        """A policy for one board; it may try actions in the scene if it undoes them."""
        ...


AnyPolicyFactory = PolicyFactory | DetectingFactory | OracleFactory


class StatelessPolicy:
    """A policy whose actions do not depend on what came of earlier ones."""

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        pass


@dataclass(frozen=True, eq=False)
class OracleObservation(Observation):
    """An observation for oracles, with the image's segmentation: uint16 (H, W), see `Image`."""

    segmentation: np.ndarray


def oracle_observation(image: Image, camera: Camera) -> OracleObservation:
    """What an oracle gets of a rendered image."""
    assert image.depth is not None and image.segmentation is not None
    return OracleObservation(image.rgb, image.depth, camera, image.segmentation)


def privileged(observation: Observation) -> OracleObservation:
    """The observation as oracles get it.

    Raises:
        BusybotError: it is not one of those.
    """
    if not isinstance(observation, OracleObservation):
        raise BusybotError("this policy needs what only the simulator knows", "make it with an OracleFactory")
    return observation
