"""An evaluation on boards: the same result whatever the workers and interruptions; episodes can be kept."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.spec import BoardCamera
from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.verify import verify
from busybot.evaluation.folder import BOARDS, RESULT
from busybot.interact.evaluate import InteractEvaluation, PolicyEvaluation, evaluate_policy
from busybot.interact.policy.config import PolicyConfig
from busybot.objects.resolve import find
from busybot.sim.interaction import InteractionConfig
from tests.interact.fakes import TruthFactory

CONFIG = InteractEvaluation(actions=4)
CHOOSER = TruthFactory(config=PolicyConfig(temperature=1))  # what knows the truth has no doubt about directions
KEYS = {
    "precision", "recall", "recall_objects", "precision_exploring", "off_axis_share", "boards", "macro", "intervals",
    "failures_by_cause", "failures_by_object", "missed_links", "by_step", "provenance", "dataset", "seed", "strict",
    "by_board", "policy", "actions", "config", "versions",
}  # fmt: skip


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path = tmp_path_factory.mktemp("boards") / "data"
    return create_dataset(path, BoardConfig(boards=4, group_size=1, split="novel-object"), find("procedural"))


def run(
    dataset: Dataset,
    workers: int = 1,
    config: InteractEvaluation = CONFIG,
    record: Path | None = None,
    **more: Any,
) -> dict[str, Any]:
    return evaluate_policy(PolicyEvaluation(dataset, find("procedural"), CHOOSER, config, 3, record), workers, **more)


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_a_stopped_evaluation_goes_on(dataset: Dataset, tmp_path: Path) -> None:
    whole, part = tmp_path / "whole", tmp_path / "part"
    told: list[tuple[int, int]] = []
    expected = run(dataset, progress=lambda done, total: told.append((done, total)), out=whole)
    assert set(expected) >= KEYS and expected["boards"] == 4 and expected["precision"] == 1.0
    assert told == [(k, 4) for k in range(1, 5)]
    assert read_json(whole / RESULT) == expected
    run(dataset, out=part)
    lines = (part / BOARDS).read_text().splitlines(keepends=True)
    (part / BOARDS).write_text("".join(lines[:2]) + lines[2][:50])  # killed while writing a line
    (part / RESULT).unlink()
    told.clear()
    assert run(dataset, 2, progress=lambda done, total: told.append((done, total)), out=part) == expected
    assert told == [(3, 4), (4, 4)]
    assert sorted((part / BOARDS).read_text().splitlines()) == sorted((whole / BOARDS).read_text().splitlines())


@pytest.mark.long
def test_worker_processes_measure_what_one_process_does(
    dataset: Dataset, work_here: Callable[[], AbstractContextManager[None]]
) -> None:
    with work_here():
        expected = run(dataset)
    assert run(dataset, 2) == expected


@pytest.mark.usefixtures("in_process")
def test_another_measurement_in_the_same_folder_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    first = CONFIG.model_copy(update={"boards": 1})
    run(dataset, config=first, out=tmp_path / "out")
    with pytest.raises(BusybotError, match="other settings was begun there: .*config"):
        run(dataset, out=tmp_path / "out")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(BusybotError, match="holds no evaluation"):
        run(dataset, out=tmp_path / "other")


@pytest.mark.usefixtures("in_process")
def test_a_board_that_its_camera_does_not_see_is_named(tmp_path: Path) -> None:
    made = create_dataset(tmp_path / "data", BoardConfig(boards=2, group_size=1), find("procedural"))
    camera = BoardCamera(position=(0, 0, 0.5), target=(0, 0, 0), fov_deg=60)
    made.replace_board(made.board(1).model_copy(update={"camera": camera}))
    with pytest.raises(BusybotError, match=r"boards-00000\.jsonl: line 2: .*its camera: the target is 0\.5 away"):
        run(made)


@pytest.mark.usefixtures("in_process")
def test_what_the_pixels_say_is_judged_whatever_the_reward_is(dataset: Dataset) -> None:
    interaction = InteractionConfig(reward="joints", delta=1_000_000)  # which no change of this picture exceeds
    result = run(dataset, config=CONFIG.model_copy(update={"boards": 1, "interaction": interaction}))
    assert (result["precision"], result["precision_reward"], result["reward_agreement"]) == (1.0, 0.0, 0.0)


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_episodes_can_be_recorded(dataset: Dataset, tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"boards": 2})
    result = run(dataset, config=config, out=tmp_path / "out", record=tmp_path / "episodes")
    assert result == run(dataset, config=config)
    recorded = Dataset.open(tmp_path / "episodes")
    assert recorded.finished() == {0, 1} and verify(recorded.path).ok
    assert recorded.hashes().board == dataset.hashes().board
    table = recorded.table("steps")
    assert table.num_rows == 8 and sum(table["success"].to_pylist()) == round(8 * result["precision"])
    recorded.episode_path(1).unlink()
    run(dataset, config=config, out=tmp_path / "out", record=tmp_path / "episodes")
    assert recorded.finished() == {0, 1}
