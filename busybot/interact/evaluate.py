"""Measure an interaction policy on a dataset's boards (protocol "Interaction", Table 1).

The boards alone are needed: every evaluation acts on them anew. The result of a board depends on the board, the policy
and the seed.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.episodes.mcap.writer import write_episode
from busybot.evaluation.bootstrap import LEVEL
from busybot.evaluation.folder import BoardWork, EvaluationRecording, Progress, conclude, judge_boards, versions
from busybot.evaluation.results import stamp
from busybot.interact import metrics as m
from busybot.interact.outcomes import judge_episode
from busybot.objects.library import Library
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import AnyPolicyFactory
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig


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


def evaluate_policy(
    dataset: Dataset,
    library: Library,
    factory: AnyPolicyFactory,
    config: InteractEvaluation,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
    out: Path | None = None,
    record: Path | None = None,
    provenance: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Act on every board and compute the metrics; JSON values, see `summarise`.

    Args:
        dataset: its boards are used, its episodes are not.
        seed: of the policy's draws.
        out: folder for the results, with which a stopped evaluation goes on.
        record: folder of a new dataset for the episodes.
        provenance: what decides the policies' actions, JSON values, as `LearnedPolicyFactory.provenance` tells it.

    Raises:
        BusybotError: `out` or `record` hold something else, or a worker is at fault.
    """
    settings = _settings(dataset, factory.name, config, seed, provenance or {})
    count = min(config.boards or dataset.info.boards, dataset.info.boards)
    work = BoardWork(m.JudgedBoard, make_work, (dataset.path, library, config, seed, factory, record), workers)
    recordings = [EvaluationRecording(record, dataset, _collected(settings))] if record else []
    judged = judge_boards(range(count), work, settings, progress, out, recordings)
    summary = summarise(judged, seed, dataset.info.split)
    return conclude(out, {**stamp("interact", hashes=_hashes(settings)), **summary, **settings})


def make_work(
    path: Path, library: Library, config: InteractEvaluation, seed: int, factory: AnyPolicyFactory, record: Path | None
) -> Callable[[int], m.JudgedBoard]:
    """What a worker does with a board's index: act on it, record it if wanted, judge it."""
    dataset = Dataset.open(path)
    recorded = Dataset.open(record) if record else None
    simulator = Simulator(library, config.render, config.responders)
    annotated = {key: model.directions for key, model in library.objects.items()}

    def work(index: int) -> m.JudgedBoard:
        board = dataset.board(index)
        episode = record_episode(simulator, board, factory, config.actions, config.interaction, seed)
        if recorded is not None:
            write_episode(recorded.episode_path(index), episode, "jpeg", recorded.path)
        judged = judge_episode(episode, annotated, config.interaction.delta)
        # a board's number in its dataset, which is where results are looked up
        return judged.model_copy(update={"board": index})

    return work


def summarise(boards: Sequence[m.JudgedBoard], seed: int, split: str = "") -> dict[str, Any]:
    """All metrics of protocol "Interaction" over judged boards, JSON values; shares from 0 to 1."""
    rng = generator(seed, split, 0, "interact/bootstrap")
    return {
        **m.micro(boards),
        "boards": len(boards),
        "macro": m.macro(boards),
        "intervals": {"level": LEVEL, **m.intervals(boards, rng)},
        "counts": {
            name: dict(zip(("part", "whole"), counts, strict=True)) for name, counts in m.counts(boards).items()
        },
        "failures_by_cause": m.failures_by_cause(boards),
        "failures_by_object": m.failures_by_object(boards),
        "missed_links": m.missed_links(boards),
        "by_step": m.by_step(boards),
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
        settings={name: config[name] for name in ("responders", "interaction", "render")}
        | {"chooser": settings["provenance"]},
    )


def _settings(
    dataset: Dataset, policy: str, config: InteractEvaluation, seed: int, provenance: dict[str, Any]
) -> dict[str, Any]:
    """What is measured; two results are comparable as far as these agree."""
    info = dataset.info
    origin = {"name": info.name, "split": info.split, "boards": info.boards, "board_hash": dataset.hashes().board}
    return {
        "policy": policy,
        "actions": config.actions,
        "strict": config.interaction.strict,
        "provenance": provenance,
        "config": config.model_dump(mode="json"),
        "dataset": origin | {"assets": info.assets.name, "seed": info.seed},
        "seed": seed,
        "versions": versions(),
    }
