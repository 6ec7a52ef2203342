"""Episodes that others recorded in our schema: no segmentation, no depth, fewer objects, fewer steps, beside ours."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from busybot.boards.spec import LinkRef
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.writer import write_episode
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, judge_episode
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.event.config import EventConfig
from busybot.reason.models.event.networks import EventNet
from busybot.reason.models.registry import ReasonerInfo
from busybot.training.checkpoint import save_model
from tests.episodes.folders import COLLECT, make_dataset
from tests.episodes.synthetic import make_episode, make_real_episode

KEPT = (0, 1, 4)


def without(episode: Episode, *what: str) -> Episode:
    """Pictures without `depth` or `segmentation`, or boxes in the first frame alone (`boxes`)."""
    gone: dict[str, Any] = dict.fromkeys(name for name in what if name != "boxes")
    images = [replace(image, **gone) for image in episode.images]
    if "boxes" in what:
        images[1:] = [replace(image, boxes=np.full_like(image.boxes, -1)) for image in images[1:]]
    return replace(episode, images=images)


def smaller(episode: Episode) -> Episode:
    """Switch 0, the lamp that it drives, and the toy alone; what was done to the other switch now misses."""
    board = episode.board
    relations = tuple(
        relation.model_copy(update={"triggers": (LinkRef(object=0, link="link_0"),), "responder": 1})
        for relation in board.relations
        if relation.responder == 1
    )
    steps = []
    for step in episode.steps:
        changes: dict = {}
        for when in ("before", "after"):
            changes[f"trigger_states_{when}"] = getattr(step, f"trigger_states_{when}")[:1]
            changes[f"joint_positions_{when}"] = getattr(step, f"joint_positions_{when}")[:1]
            shown = getattr(step, f"responder_states_{when}")
            changes[f"responder_states_{when}"] = tuple(shown[index] for index in KEPT)
        if step.acted_object != 0:
            changes |= {"acted_object": -1, "acted_link": "", "success": False}
        steps.append(replace(step, **changes))
    objects = tuple(board.objects[index] for index in KEPT)
    return replace(
        episode,
        board=board.model_copy(update={"objects": objects, "relations": relations}),
        links=(replace(episode.links[0]),),
        positions=episode.positions[list(KEPT)],
        images=[replace(image, segmentation=None, boxes=image.boxes[list(KEPT)]) for image in episode.images],
        steps=steps,
    )


OTHERS: dict[str, Callable[[], Episode]] = {
    "no segmentation": lambda: without(make_episode(0), "segmentation"),
    "no depth": lambda: without(make_episode(0), "segmentation", "depth"),
    "first boxes alone": lambda: without(make_episode(0), "segmentation", "boxes"),
    "three objects": lambda: smaller(make_episode(0)),
    "two steps": lambda: make_episode(0, steps=2),
    "no steps": lambda: make_episode(0, steps=0),
    "a real board": lambda: make_real_episode(0),
}


def dataset_of(path: Path, episode: Episode) -> Dataset:
    """The toy dataset, whose first board is another one."""
    template = make_dataset(path.with_name("template"), boards=2, finished=())
    info = template.info.model_copy(update={"name": "others", "boards": 2, "collect": None})
    dataset = Dataset.create(path, info, [episode.board, template.board(1)])
    dataset.begin_collecting(COLLECT)
    write_episode(dataset.episode_path(0), episode)
    write_episode(dataset.episode_path(1), make_episode(1))
    dataset.write_tables()
    return dataset


@pytest.fixture(scope="module")
def event(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder, config = tmp_path_factory.mktemp("event"), EventConfig()
    torch.manual_seed(0)
    info = ReasonerInfo(model="event", encoder="embedded", config=config.model_dump(mode="json"))
    save_model(folder, info, EventNet(config.net).state_dict())
    return str(folder)


@pytest.mark.parametrize("name", OTHERS)
def test_they_are_judged_beside_ours(name: str, tmp_path: Path, event: str) -> None:
    dataset = dataset_of(tmp_path / "others", OTHERS[name]())
    for model in ("count", "lookup", "persistence", event):
        result = evaluate_dataset(dataset, ReasonEvaluation(model, images=4), workers=1)
        assert result["boards"] == 2 and 0 <= result["edge_r"] <= 1 and result["edge_acc"] > 0


@pytest.mark.parametrize("name", ["no segmentation", "no depth", "first boxes alone", "three objects"])
def test_counting_finds_their_relations(name: str) -> None:
    judged = judge_episode(OTHERS[name](), ReasonEvaluation("count", images=7))
    assert judged.counts(6)["hits"] == judged.truth.shown.astype(bool).sum() > 0  # type: ignore[union-attr]
    assert judged.counts(6)["claimed"] == judged.counts(6)["hits"]


def test_without_depth_the_pixels_of_the_box_are_taken() -> None:
    plain, flat = make_episode(0), without(make_episode(0), "depth")
    np.testing.assert_array_equal(
        make_extractor("embedded").of_episode(flat), make_extractor("embedded-box").of_episode(plain)
    )
    assert not np.array_equal(make_extractor("embedded").of_episode(flat), make_extractor("embedded").of_episode(plain))


def test_segmentation_and_later_boxes_change_no_feature(tmp_path: Path) -> None:
    ours = make_dataset(tmp_path / "ours", boards=2, finished=(0, 1))
    theirs = dataset_of(tmp_path / "theirs", without(make_episode(0), "segmentation", "boxes"))
    np.testing.assert_array_equal(features_of(ours, workers=1)[0], features_of(theirs, workers=1)[0])


def test_a_picture_that_lost_its_depth_is_no_error() -> None:
    """Objects are taken to be where the first picture shows them."""
    episode = make_episode(0)
    episode.images = [replace(image, depth=None if k == 1 else image.depth) for k, image in enumerate(episode.images)]
    features = make_extractor("embedded").of_episode(episode)
    assert np.isfinite(features).all()
    assert judge_episode(episode, ReasonEvaluation("count", images=7)).counts(6)["hits"] == 2
