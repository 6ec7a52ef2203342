"""The paper's schedule (protocol "Fidelity checklist"): every number, and which epoch does what."""

import pytest

from busybot.common.config import build
from busybot.common.errors import BusybotError
from busybot.interact.training.config import PaperConfig, RecordConfig, TrainConfig

PAPER = PaperConfig()


def test_the_defaults_are_the_papers() -> None:
    assert (PAPER.epochs, PAPER.boards, PAPER.steps, PAPER.buffer) == (400, 16, 10, 6400)
    assert (PAPER.position.batch, PAPER.direction.batch) == (16, 32)
    assert (PAPER.position.iterations, PAPER.direction.iterations) == (8, 24)
    assert (PAPER.position.learning_rate, PAPER.direction.learning_rate) == (5e-4, 1e-4)
    assert (PAPER.ucb_c, PAPER.ucb_window) == (0.5, 10)


def test_epochs_have_phases() -> None:
    trained = [PAPER.trained(epoch) for epoch in range(400)]
    assert trained[:10] == [()] * 10  # random data only
    assert trained[10:100] == [("position",)] * 90
    assert trained[100:120] == [()] * 20  # random directions, as negatives
    assert trained[120:] == [("position", "direction")] * 280
    assert [PAPER.rules(epoch).all_directions for epoch in range(400)] == [True] * 100 + [False] * 300


def test_epsilon_falls_linearly_from_where_the_training_starts() -> None:
    position = {0: 1, 9: 1, 10: 1, 20: 0.775, 30: 0.55, 49: 0.1225, 50: 0.1, 399: 0.1}
    direction = {0: 1, 119: 1, 120: 1, 140: 0.775, 160: 0.55, 200: 0.1, 399: 0.1}
    for epoch, expected in position.items():
        assert PAPER.epsilon("position", epoch) == pytest.approx(expected)
    for epoch, expected in direction.items():
        assert PAPER.epsilon("direction", epoch) == pytest.approx(expected)


def test_learning_rates_fall_as_the_authors_have_it() -> None:
    position = {0: 5e-4, 10: 5e-4, 99: 5e-4, 100: 1e-6, 120: 1e-6, 399: 1e-6}
    direction = {120: 1e-4, 194: 1e-4, 195: 0.7e-4, 270: 0.49e-4, 345: 0.343e-4, 399: 0.343e-4}
    assert [PAPER.rate("position", epoch) for epoch in position] == pytest.approx(list(position.values()))
    assert [PAPER.rate("direction", epoch) for epoch in direction] == pytest.approx(list(direction.values()))
    longer = build(PaperConfig, None, ["all_directions_epochs=300", "joint_epochs=300"], {})
    assert [longer.rate("position", epoch) for epoch in (99, 100, 190, 280)] == pytest.approx(
        [5e-4, 2.5e-4, 1.25e-4, 0.625e-4]
    )


def test_who_collects_an_epoch() -> None:
    assert not PAPER.rules(10).needs_model()
    first = PAPER.rules(50)
    assert (first.epsilon_position, first.all_directions, first.needs_model()) == (pytest.approx(0.1), True, True)
    between = PAPER.rules(110)
    assert (between.all_directions, between.epsilon_direction) == (False, 1)
    last = PAPER.rules(399)
    assert (last.epsilon_position, last.epsilon_direction) == (pytest.approx(0.1), pytest.approx(0.1))
    assert (last.ucb_c, last.ucb_window) == (0.5, 10)


def test_some_values_of_a_network_can_be_set() -> None:
    config = build(PaperConfig, None, ["position.batch=4", "epochs=3"], {"variant": "paper"})
    assert (config.position.batch, config.position.iterations, config.epochs) == (4, 8, 3)
    assert config.direction == PAPER.direction
    for setting, word in (
        ("joint_epochs=50", "must not fall"),
        ("position.batch=5", "multiple of 2"),
        ("render.height=63", "pictures of 64 pixels a side"),
    ):
        with pytest.raises(BusybotError, match=word):
            build(PaperConfig, None, [setting], {})


@pytest.mark.parametrize("config", [PaperConfig, TrainConfig])
@pytest.mark.parametrize("drawn", ["pose", "fov"])
def test_a_camera_for_each_board_is_refused_before_anything_is_recorded(config: type[RecordConfig], drawn: str) -> None:
    with pytest.raises(BusybotError, match="networks know of one"):
        build(config, None, [f"render.randomise.{drawn}=0.3"], {})
    assert build(config, None, ["render.randomise.lights=0.3"], {}).render.randomise.lights == 0.3
