"""What an oblique camera sees, drawn from above."""

import numpy as np
import pytest

from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.affordance.plan_view import ELEVATED, PlanView, oblique
from busybot.sim.scene.render import RenderConfig, camera_model
from tests.interact.affordance.test_fast import untrained

PLATE, HEIGHT = ((-0.6, 0.2), (-0.2, 0.5)), 0.2
"""x and y of a plate that floats above the board, from and to, and how high, board units."""


def on_plate(points: np.ndarray, less: float = 0.0) -> np.ndarray:
    """Which points (..., 3) lie within the plate's sides, bool (...,); without so much at its border."""
    sides = [
        (points[..., axis] > low + less) & (points[..., axis] < high - less) for axis, (low, high) in enumerate(PLATE)
    ]
    return np.asarray(sides[0] & sides[1])


def seen_from(x: float, y: float, z: float) -> tuple[Observation, Rays]:
    """The plate as a camera sees it that looks at the board's middle."""
    camera = camera_model(RenderConfig(position=(x, y, z)))
    rays = Rays(camera)
    board, plate = ((height - rays.origin[2]) / rays.directions[..., 2] for height in (0.0, HEIGHT))
    depth = np.where(on_plate(rays.points(plate)), plate, board).astype(np.float32)
    return Observation(np.zeros((480, 640, 3), np.uint8), depth, camera), rays


@pytest.mark.parametrize("place", [(0.0, -3.6, 3.9), (-2.7, -0.8, 4.0), (1.5, -3.0, 3.0)])
def test_things_stand_where_they_stand_whoever_looks(place: tuple[float, float, float]) -> None:
    seen, rays = seen_from(*place)
    plan = PlanView(rays, seen)
    drawn, cells = plan.of(seen)
    points = plan.above.points(drawn.depth)
    inner = on_plate(points, 0.05)
    assert inner.sum() > 0.7 * 0.6 * 115**2 * 0.99
    assert np.abs(points[inner, 2] - HEIGHT).max() < 0.005
    outside = ~on_plate(points, -0.05)
    assert np.abs(points[outside, 2]).max() < ELEVATED
    shown, there = rays.points(seen.depth), points[cells[..., 1], cells[..., 0]]
    raised = on_plate(shown, 0.05) & (shown[..., 2] > ELEVATED)
    assert raised.any() and np.abs(there - shown)[raised].max() < 0.02


def test_only_pictures_of_oblique_cameras_are_drawn() -> None:
    model = untrained()
    assert not oblique(camera_model(RenderConfig())) and model.look(*seen_from(0.0, -0.1, 4.0)).drawn is None
    seen, rays = seen_from(0.0, -3.6, 3.9)
    view = model.look(seen, rays)
    assert oblique(seen.camera) and view.drawn is not None
    raised = rays.heights(seen.depth) > ELEVATED
    assert view.affordance.shape == seen.depth.shape
    assert (view.affordance[raised] > -10).mean() > 0.95 and (view.affordance[~raised] <= -20).all()
    pixels = np.argwhere(raised)[::500, ::-1]
    above = view.drawn.cells[pixels[:, 1], pixels[:, 0]]
    for told, own in zip(model.directions(view, pixels), model.directions(view.drawn.view, above), strict=True):
        assert np.array_equal(told, own)
    again = model.look(seen, rays, view)
    assert again.drawn is not None and again.drawn.plan is view.drawn.plan
    assert np.array_equal(again.affordance, view.affordance)
