"""The policy's logic with models that know the truth: what it finds, what it repeats, what it may not read."""

from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.episodes.episode import Observation
from busybot.interact.evaluate import judge_episode
from busybot.interact.metrics import micro
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.learned import LearnedPolicy, Mode, mode_named
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import Action
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from tests.interact.fakes import TruthFactory
from tests.interact.scenes import BODY, BUTTON, PRESSED, RAYS, ButtonModel, picture

SWITCH = ((40, 40, 80, 60), BODY)
PLACES = [(45, 45, 53, 53), (60, 45, 68, 53)]


class Toy:
    """Two buttons that toggle whenever they are held and pulled along z; nothing else ever happens."""

    def __init__(self) -> None:
        self.heights = [BUTTON, BUTTON]

    def image(self) -> Observation:
        return picture(SWITCH, *zip(PLACES, self.heights, strict=True))

    def act(self, action: Action) -> int:
        """The button that was moved, -1 for none."""
        for number, (u0, v0, u1, v1) in enumerate(PLACES):
            if u0 <= action.pixel[0] < u1 and v0 <= action.pixel[1] < v1:
                self.heights[number] = PRESSED if self.heights[number] == BUTTON else BUTTON
                return number
        return -1


def play(mode: Mode, actions: int, config: PolicyConfig | None = None, seed: int = 0) -> list[int]:
    """Buttons moved by each action."""
    toy, policy = Toy(), LearnedPolicy(ButtonModel(), RAYS, config, mode)
    rng, image, moved = generator(seed, "", 0, "test"), toy.image(), []
    for _ in range(actions):
        action = policy.select_action(image, rng)
        moved.append(toy.act(action))
        image = toy.image() if moved[-1] >= 0 else image
        policy.observe(action, action.directions, int(moved[-1] >= 0), image)
    return moved


def test_new_links_come_first_then_known_ones_are_repeated() -> None:
    moved = play("evaluate", 6)
    assert sorted(moved[:2]) == [0, 1] and min(moved) >= 0


def test_greedy_stays_with_the_best() -> None:
    assert len(set(play("greedy", 6))) == 1


def test_ucb_goes_on_when_a_place_was_picked() -> None:
    toy, policy = Toy(), LearnedPolicy(ButtonModel(), RAYS, None, "ucb")
    image, rng = toy.image(), generator(0, "", 0, "test")
    pixels = []
    for _ in range(4):
        action = policy.select_action(image, rng)
        pixels.append(action.pixel)
        policy.observe(action, action.directions, 0, image)
    first, second = np.array(pixels[:2])
    assert np.abs(first - second).max() >= 5  # outside of the 10 x 10 window


def test_collecting_visits_links_evenly() -> None:
    moved = play("collect", 60, seed=3)
    assert min(moved) >= 0 and 20 <= moved.count(0) <= 40
    assert set(play("collect", 20, PolicyConfig(candidates="kmeans", clusters=2))) == {0, 1}


def test_collecting_tries_everything_before_it_repeats() -> None:
    assert all(sorted(play("collect", 2, seed=seed)) == [0, 1] for seed in range(8))
    at_random = PolicyConfig(untried_first=False)
    assert any(len(set(play("collect", 2, at_random, seed))) == 1 for seed in range(8))


def test_collecting_tries_every_place_before_one_again() -> None:
    policy = LearnedPolicy(ButtonModel(), RAYS, PolicyConfig(), "collect")
    image, rng = Toy().image(), generator(0, "", 0, "test")
    pixels = []
    for _ in range(2):
        action = policy.select_action(image, rng)
        pixels.append(action.pixel)
        policy.observe(action, action.directions, 0, image)
    assert sorted(policy.memory.tried_here(np.array(pixels)) if policy.memory else []) == [True, True]
    assert np.abs(np.subtract(*pixels)).max() > PolicyConfig().peak_radius


def test_persistence_spreads_over_objects_whatever_they_promise() -> None:
    """Failures take the belief in two things that never give; they are tried in turn all the same."""
    things = picture(((30, 40, 50, 60), BUTTON), ((90, 40, 110, 60), BUTTON))
    for persist, tried in ((1.0, {True: 6, False: 6}), (0.0, None)):
        policy = LearnedPolicy(ButtonModel(), RAYS, PolicyConfig(persist=persist, collect=0.3), "collect")
        rng, sides = generator(0, "", 0, "test"), []
        for _ in range(12):
            action = policy.select_action(things, rng)
            sides.append(action.pixel[0] < 70)
            policy.observe(action, action.directions, 0, things)
        assert ({side: sides.count(side) for side in (True, False)} == tried) == (persist == 1.0)


def test_an_empty_board_is_guessed_at() -> None:
    policy = LearnedPolicy(ButtonModel(), RAYS)
    action = policy.select_action(picture(), generator(0, "", 0, "test"))
    assert policy.choice is not None and policy.choice.why == "guess" and len(action.directions) == 1


def test_modes_are_known_by_name() -> None:
    assert mode_named("ucb") == "ucb"
    with pytest.raises(BusybotError, match="no mode 'clever'"):
        mode_named("clever")


def shares(library: Library, boards: int, split: str, strict: bool = False) -> dict[str, float]:
    """Metrics of the policy with a noisy model that knows the truth."""
    config = BoardConfig.model_validate({"split": split, "boards": boards, "group_size": 1, "seed": 5})
    annotated = {key: model.directions for key, model in library.objects.items()}
    simulator, interaction = Simulator(library, RenderConfig()), InteractionConfig(strict=strict)
    factory = TruthFactory(noise=1.0)
    judged = [
        judge_episode(record_episode(simulator, board, factory, 10, interaction, 0), annotated, interaction.delta)
        for board in generate_boards(config, library)
    ]
    return {name: value for name, value in micro(judged).items() if value is not None}


@pytest.mark.long
def test_a_model_that_knows_the_truth_finds_everything() -> None:
    values = shares(find("procedural"), 4, "novel-config")
    assert values["precision"] == 1.0 and values["recall"] == 1.0
    assert values["reward_agreement"] == 1.0


@pytest.mark.long
@pytest.mark.parametrize("strict", [False, True], ids=["free", "strict"])
@pytest.mark.parametrize("split", ["novel-config", "novel-object"])
def test_a_model_that_knows_the_truth_finds_everything_on_real_objects(partnet: Path, split: str, strict: bool) -> None:
    values = shares(Library.load(partnet), 6, split, strict)
    assert values["precision"] >= 0.99 and values["recall"] >= 0.99
