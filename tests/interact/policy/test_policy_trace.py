"""What a model thought before every action follows from the recording."""

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.affordance.fast import AffordanceView
from busybot.interact.affordance.load import load_model
from busybot.interact.policy.learned import LearnedPolicy
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.interact.policy.policy_trace import retrace
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import ScriptedFactory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import Action, Policy
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
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
