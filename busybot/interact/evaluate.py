"""Measure an interaction policy on a dataset's boards (paper section 5.1, Table 1).

The boards alone are needed: every evaluation acts on them anew, and judges the actions by the simulator's states. The
result of a board depends on the board, the policy and the seed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from busybot.boards.directions import DIRECTIONS, annotated_directions
from busybot.common.errors import naming
from busybot.common.frozen_model import FrozenModel
from busybot.common.process_pool import Progress
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.mcap.writer import write_episode
from busybot.evaluation.folder import BoardWork, EvaluationRecording, conclude, judge_boards
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import stamp
from busybot.evaluation.statistics import LEVEL
from busybot.interact import metrics as m
from busybot.objects.library import Library
from busybot.sim.collect import episode_seconds
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import AnyPolicyFactory
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

AnnotatedDirections = Mapping[str, Sequence[Sequence[float]]]
"""Object key to its annotated effective directions, not normalised, as of `annotated_directions`."""
SIMULATED = ("responders", "interaction", "render")
"""Parameters that decide how episodes come about."""
OFF_AXIS_DEG = 30.0
"""`off_axis_share` counts successes farther off, whatever angle a veto has."""


def judge_episode(episode: Episode, annotated: AnnotatedDirections, delta: int) -> m.JudgedBoard:
    """Put the truth beside every action.

    Args:
        episode: with segmentation.
        annotated: of every trigger object on the board.
        delta: more changed pixels than this are a reward, whatever the policy was rewarded by.
    """
    objects = episode.board.objects
    keys = [placed.key for placed in objects]
    permitted = [annotated_directions(annotated.get(placed.key, ()), placed.yaw) for placed in objects]
    first = episode.image(0).segmentation
    assert first is not None, "a simulator's images have a segmentation"
    visible = np.bincount(first.ravel(), minlength=len(episode.links) + 1)
    movable = [(code, link) for code, link in enumerate(episode.links, start=1) if link.trigger]
    numbers = {(link.object, link.name): number for number, (_, link) in enumerate(movable)}
    links = tuple(
        m.JudgedLink(object=link.object, key=keys[link.object], link=link.name, pixels=int(visible[code]))
        for code, link in movable
    )
    actions = []
    for index, step in enumerate(episode.steps):
        on, key = _target(episode, episode.image(index), step)
        actions.append(
            m.JudgedAction(
                pixel=step.pixel,
                direction=step.direction,
                executed=step.executed,
                on=on,
                key=key,
                link=numbers.get((step.acted_object, step.acted_link), -1),
                success=step.success,
                reward=step.changed_pixels > delta,
                changed_pixels=step.changed_pixels,
                off_axis=off_axis(step.executed[-1], permitted[step.acted_object]) if step.success else None,
                vetoed=step.vetoed,
            )
        )
    return m.JudgedBoard(board=episode.board.index, links=links, actions=tuple(actions))


def off_axis(direction: int, known: np.ndarray) -> bool:
    """Whether one of the 18 directions is more than `OFF_AXIS_DEG` off all of `annotated_directions`, (n, 3); true if
    there is none."""
    if not len(known):
        return True
    return bool((known @ DIRECTIONS[direction]).max() <= np.cos(np.deg2rad(OFF_AXIS_DEG)))


def _target(episode: Episode, image: Image, step: Step) -> tuple[m.Target, str]:
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


class InteractEvaluation(FrozenModel):
    """How a policy is measured.

    Attributes:
        actions: proposed on each board.
        boards: only so many, the first ones; None for all.
        responders: whether effects show.
        learned: constants of the learned policy that take precedence over those on the model's card.
    """

    actions: Annotated[int, Field(ge=1, le=100_000)] = 10
    boards: Annotated[int, Field(ge=1)] | None = None
    responders: bool = True
    learned: dict[str, Any] = {}
    interaction: InteractionConfig = InteractionConfig()
    render: RenderConfig = RenderConfig()


@dataclass(frozen=True)
class PolicyEvaluation:
    """A policy on the boards of a dataset; plain data for worker processes.

    Attributes:
        dataset: its boards are used, its episodes are not.
        library: the objects on them.
        factory: makes the policy.
        config: how it is measured.
        seed: of the policy's draws.
        record: folder of a new dataset for the episodes.
        provenance: what decides the policy's actions, JSON values, as `LearnedPolicyFactory.provenance` tells it.
    """

    dataset: Dataset
    library: Library
    factory: AnyPolicyFactory
    config: InteractEvaluation
    seed: int = 0
    record: Path | None = None
    provenance: dict[str, Any] = field(default_factory=dict)


def evaluate_policy(
    evaluation: PolicyEvaluation, workers: int = 1, progress: Progress | None = None, out: Path | None = None
) -> dict[str, Any]:
    """Act on every board and compute the metrics; JSON values, see `summarise`.

    Args:
        out: folder for the results, with which a stopped evaluation goes on.

    Raises:
        BusybotError: `out` or the folder for the episodes hold something else, or a worker is at fault.
    """
    dataset, record, settings = evaluation.dataset, evaluation.record, _settings(evaluation)
    count = min(evaluation.config.boards or dataset.info.boards, dataset.info.boards)
    seconds = episode_seconds(evaluation.config.actions)
    work = BoardWork(m.JudgedBoard, make_work, (evaluation,), workers, seconds)
    recordings = [EvaluationRecording(record, dataset, _collected(settings))] if record else []
    judged = judge_boards(range(count), work, settings, progress, out, recordings)
    summary = summarise(judged, evaluation.seed, dataset.info.split)
    result = {**stamp("interact", hashes=_hashes(settings)), **summary, **settings}
    result["logged"] = log_judgement(dataset, range(count), str(settings["policy"]), result)
    return conclude(out, result)


def make_work(evaluation: PolicyEvaluation) -> Callable[[int], m.JudgedBoard]:
    """What a worker does with a board's index: act on it, record it if wanted, judge it."""
    config, library = evaluation.config, evaluation.library
    recorded = Dataset.open(evaluation.record) if evaluation.record else None
    simulator = Simulator(library, config.render, config.responders)
    annotated = {key: model.directions for key, model in library.objects.items()}

    def work(index: int) -> m.JudgedBoard:
        board, factory = evaluation.dataset.board(index), evaluation.factory
        with naming(evaluation.dataset.board_place(index)):
            episode = record_episode(simulator, board, factory, config.actions, config.interaction, evaluation.seed)
        if recorded is not None:
            write_episode(recorded.episode_path(index), episode, "jpeg", recorded.path)
        judged = judge_episode(episode, annotated, config.interaction.delta)
        # a board's number in its dataset, which is where results are looked up
        return judged.model_copy(update={"board": index})

    return work


def summarise(boards: Sequence[m.JudgedBoard], seed: int, split: str = "") -> dict[str, Any]:
    """All metrics over judged boards, JSON values; shares from 0 to 1."""
    rng = generator(seed, split, 0, "interact/bootstrap")
    return {
        **m.micro(boards),
        "boards": len(boards),
        "macro": m.macro(boards),
        "intervals": {"level": LEVEL, **m.intervals(boards, rng)},
        "object_intervals": m.object_intervals(boards, generator(seed, split, 0, "interact/bootstrap/objects")),
        "counts": {name: {"part": part, "whole": whole} for name, (part, whole) in m.counts(boards).items()},
        "failures_by_cause": m.failures_by_cause(boards),
        "failures_by_object": m.failures_by_object(boards),
        "missed_links": m.missed_links(boards),
        "by_step": m.by_step(boards),
        "by_board": m.by_board(boards),
    }


def _hashes(settings: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Of the boards, and of the files of the model that acted."""
    model, origin = settings["provenance"].get("model", {}), settings["dataset"]
    models = {model["name"]: model["sha256"]} if "sha256" in model else {}
    return {"models": models, "data": {origin["name"]: {"board_hash": origin["board_hash"]}}}


def _collected(settings: dict[str, Any]) -> CollectInfo:
    config = settings["config"]
    return CollectInfo(
        policy=settings["policy"],
        steps=settings["actions"],
        strict=settings["strict"],
        delta=config["interaction"]["delta"],
        seed=settings["seed"],
        settings={name: config[name] for name in SIMULATED} | {"chooser": settings["provenance"]},
    )


def _settings(evaluation: PolicyEvaluation) -> dict[str, Any]:
    """What is measured; two results are comparable as far as these agree."""
    dataset, config, info = evaluation.dataset, evaluation.config, evaluation.dataset.info
    origin = {"name": info.name, "split": info.split, "boards": info.boards, "board_hash": dataset.hashes().board}
    return {
        "policy": evaluation.factory.name,
        "actions": config.actions,
        "strict": config.interaction.strict,
        "provenance": evaluation.provenance,
        "config": config.model_dump(mode="json"),
        "dataset": origin | {"assets": info.assets.name, "seed": info.seed},
        "seed": evaluation.seed,
    }
