"""Judges an episode's actions by the simulator's states, in the terms of the metrics."""

from collections.abc import Mapping, Sequence

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.episode import Episode, Image, Step
from busybot.interact.metrics import JudgedAction, JudgedBoard, JudgedLink, Target

AnnotatedDirections = Mapping[str, Sequence[Sequence[float]]]
"""Object key to its annotated effective directions, not normalised, board frame."""
OFF_AXIS_DEG = 30.0
"""`off_axis_share` counts successes farther off, whatever angle a veto has (protocol "Interaction")."""


def judge_episode(episode: Episode, annotated: AnnotatedDirections, delta: int) -> JudgedBoard:
    """Put the truth beside every action.

    Args:
        episode: with segmentation.
        annotated: of every trigger object on the board.
        delta: more changed pixels than this are a reward, whatever the policy was rewarded by.
    """
    keys = [placed.key for placed in episode.board.objects]
    first = episode.image(0).segmentation
    assert first is not None, "a simulator's images have a segmentation"
    visible = np.bincount(first.ravel(), minlength=len(episode.links) + 1)
    movable = [index for index, link in enumerate(episode.links) if link.trigger]
    numbers = {(episode.links[i].object, episode.links[i].name): number for number, i in enumerate(movable)}
    links = tuple(
        JudgedLink(
            object=episode.links[i].object,
            key=keys[episode.links[i].object],
            link=episode.links[i].name,
            pixels=int(visible[i + 1]),
        )
        for i in movable
    )
    actions = []
    for index, step in enumerate(episode.steps):
        on, key = _target(episode, episode.image(index), step)
        off = None
        if step.success:
            off = off_axis(step.executed[-1], annotated[keys[step.acted_object]])
        actions.append(
            JudgedAction(
                pixel=step.pixel,
                direction=step.direction,
                executed=step.executed,
                on=on,
                key=key,
                link=numbers.get((step.acted_object, step.acted_link), -1),
                success=step.success,
                reward=step.changed_pixels > delta,
                changed_pixels=step.changed_pixels,
                off_axis=off,
                vetoed=step.vetoed,
            )
        )
    return JudgedBoard(board=episode.board.index, links=links, actions=tuple(actions))


def off_axis(direction: int, annotated: Sequence[Sequence[float]]) -> bool:
    """Whether one of the 18 directions is more than `OFF_AXIS_DEG` off every annotated one; true if there is none."""
    known = np.array(annotated, float).reshape(-1, 3)
    if not len(known):
        return True
    known /= np.linalg.norm(known, axis=1, keepdims=True)
    return bool((known @ DIRECTIONS[direction]).max() <= np.cos(np.deg2rad(OFF_AXIS_DEG)))


def _target(episode: Episode, image: Image, step: Step) -> tuple[Target, str]:
    """What the chosen pixel showed, and of which object."""
    assert image.segmentation is not None
    code = int(image.segmentation[step.pixel[1], step.pixel[0]])
    if code == 0:
        return "board", ""
    link = episode.links[code - 1]
    placed = episode.board.objects[link.object]
    if link.trigger:
        return "link", placed.key
    return ("trigger" if placed.role == "trigger" else "responder"), placed.key
