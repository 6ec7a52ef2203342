"""The twin of the paper's real board from its generation to its relations, and the way out and back in."""

from pathlib import Path

import numpy as np
import pytest

from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.importing.images import import_export
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.registry import infer, reasoner_of
from tests.cli.commands import busybot

pytestmark = pytest.mark.long
BOARDS = (0, 4)
"""One wiring of each kind."""


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("twin") / "data"
    assert busybot("generate", folder, "--world", "real-board").returncode == 0
    acting = ("--policy", "scripted", "--steps", 20, "--camera", "real", "--set", "render.camera.hand=0.15")
    done = busybot("collect", folder, *acting, "--workers", 1)
    assert done.returncode == 0, done.stderr
    return Dataset.open(folder)


def graphs(dataset: Dataset, index: int) -> list[InferredGraph]:
    observed = observe_episode(read_episode(dataset.episode_path(index), "lazy"))
    seen = sequence_of(observed, make_extractor("embedded").of(observed))
    return [reasoner_of("event").graph(seen), infer(observed, "count")]


def test_it_is_kept_like_any_other_and_all_relations_are_found(twin: Dataset, tmp_path: Path) -> None:
    for words in (("verify", twin.path), ("regenerate", twin.path, "--out", tmp_path / "again")):
        done = busybot("dataset", *words)
        assert done.returncode == 0, done.stderr
    for index in BOARDS:
        graph = graphs(twin, index)[0]
        assert graph.claimed(20).tolist() == np.array(twin.boards()[index].relation_matrix(), bool).tolist()


def test_exported_as_images_and_imported_again_the_same_graphs_are_inferred(twin: Dataset, tmp_path: Path) -> None:
    export_recordings(twin, "images", tmp_path / "images")
    imported = import_export(tmp_path / "images", tmp_path / "imported")
    for index in BOARDS:
        for one, other in zip(graphs(twin, index), graphs(imported, index), strict=True):
            np.testing.assert_allclose(one.probabilities, other.probabilities, atol=1e-5)
