"""What a model thought before every action follows from the recording."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import IMPORTED
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.interact.affordance.fast import AffordanceView
from busybot.interact.affordance.load import load_model
from busybot.interact.policy.board_memory import BoardMemory
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import PAIR_OF
from busybot.interact.policy.learned import LearnedPolicy
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.interact.policy.policy_trace import remember, retrace
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import ScriptedFactory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import Action, Policy
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from tests.episodes.synthetic import make_episode
from tests.interact.scenes import ButtonModel


def test_links_are_known_once_they_moved() -> None:
    library = find("procedural")
    (board,) = generate_boards(BoardConfig(boards=1, seed=2), library)
    simulator = Simulator(library, RenderConfig())
    episode = record_episode(simulator, board, ScriptedFactory(), 6, InteractionConfig(), 0)
    thoughts = list(retrace(episode, ButtonModel()))
    assert [thought.step for thought in thoughts] == list(range(6))
    assert not thoughts[0].links.any() and not thoughts[0].known
    moved = {(step.acted_object, step.acted_link) for step in episode.steps[:5] if step.reward}
    assert thoughts[5].links.max() == len(moved)
    for thought in thoughts:
        assert thought.affordance.shape == (480, 640) and 0 <= thought.affordance.min() <= thought.affordance.max() <= 1


@pytest.mark.parametrize("reward", [0, 1])
def test_where_nobody_says_where_it_acted_nothing_is_learned(reward: int) -> None:
    episode = make_episode()
    nowhere = replace(episode.steps[0], pixel=UNKNOWN_PIXEL, reward=reward)
    thoughts = list(retrace(replace(episode, steps=[nowhere] * len(episode.steps)), ButtonModel()))
    assert thoughts and not any(thought.known or thought.links.any() for thought in thoughts)
    for thought in thoughts[1:]:
        first = thoughts[0].candidates
        assert thought.candidates.beliefs.tolist() == pytest.approx(first.beliefs.tolist())


def test_an_imported_recording_does_not_say_that_actions_failed() -> None:
    episode = make_episode()
    (failed,) = [step for step in episode.steps if not step.reward][:1]
    again = replace(episode, steps=[failed] * len(episode.steps))
    last, imported = (
        list(retrace(one, ButtonModel()))[-1].candidates.beliefs.tolist()
        for one in (again, replace(again, settings={IMPORTED: {}}))
    )
    first = next(iter(retrace(again, ButtonModel()))).candidates.beliefs.tolist()
    assert imported == pytest.approx(first) and last != pytest.approx(first)


def test_where_nobody_says_what_was_executed_it_is_what_was_proposed() -> None:
    episode = make_episode()
    moved = next(step for step in episode.steps if step.reward)
    memories = []
    for executed in ((), (moved.direction,)):
        memory = BoardMemory(Rays(episode.camera).heights(episode.observation(0).depth), PolicyConfig())
        step = replace(moved, executed=executed)
        remember(memory, step, episode.observation(0), episode.observation(1), lambda: np.zeros(9))
        memories.append(memory.pairs)
    assert memories[0] == memories[1] == {1: PAIR_OF[moved.direction]}


@pytest.mark.long
def test_who_acted_by_the_model_thought_the_same() -> None:
    library, model, thought = find("procedural"), load_model(DEFAULT_MODEL), []

    class Remembered(LearnedPolicy[AffordanceView]):
        def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
            thought.append(self.candidates)
            super().observe(action, executed, reward, after)

    class Remembering:
        name = "learned"

        def make_policy(self, rays: Rays) -> Policy:
            return Remembered(model, rays)

    simulator, rewards = Simulator(library, RenderConfig()), set()
    for board in generate_boards(BoardConfig(split="novel-object", boards=8, seed=3), library):
        thought.clear()
        episode = record_episode(simulator, board, Remembering(), 8, InteractionConfig(), 0)
        for acted, again in zip(thought, retrace(episode, model), strict=True):
            assert acted is not None and np.array_equal(acted.pixels, again.candidates.pixels)
            assert np.allclose(acted.beliefs, again.candidates.beliefs)
            assert np.allclose(acted.pairs, again.candidates.pairs)
        rewards |= {step.reward for step in episode.steps}
        if rewards == {0, 1}:
            return
    pytest.fail("of a failure and of a success the memory has to make the same")
