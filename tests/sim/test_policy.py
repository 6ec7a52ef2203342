"""Policies of whoever wrote them get what a robot would have; only oracles get more, and their episodes say so."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode, Image, Observation, Step
from busybot.objects.model import ObjectModel
from busybot.sim import recorder
from busybot.sim.builtin_policies import RandomFactory, RandomPolicy, ScriptedFactory, ScriptedPolicy, builtin_factory
from busybot.sim.interaction import InteractionConfig, interact
from busybot.sim.policy import Action, AnyPolicyFactory, OracleObservation, Policy, StatelessPolicy
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import BoardScene, Simulator
from tests.reach import reachable

Peek = Callable[[Observation], object]


class Curious(StatelessPolicy):
    """Looks at something before it does nothing in particular; a policy as strangers write them."""

    name = "curious"
    oracle = False  # what a policy says of itself does not count

    def __init__(self, peek: Peek):
        self._peek = peek

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        self._peek(observation)
        return Action((3, 4), (0,))

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        self._peek(after)


class CuriousFactory:
    name = "curious"

    def __init__(self, peek: Peek):
        self.peek = peek

    def make_policy(self, *given: object) -> Policy:
        (rays,) = given  # nothing else is given
        assert isinstance(rays, Rays)
        self.given = rays
        return Curious(self.peek)


class CuriousOracleFactory:
    name = "curious"

    def __init__(self, peek: Peek):
        self.peek = peek

    def make_oracle(self, scene: BoardScene, rays: Rays, config: InteractionConfig) -> Policy:
        assert scene.trigger_states() and rays.camera.width == 160 and not config.strict
        return Curious(self.peek)


def record(simulator: Simulator, factory: AnyPolicyFactory, steps: int = 2) -> Episode:
    board = next(iter(generate_boards(BoardConfig(boards=1, seed=3), simulator.library)))
    return record_episode(simulator, board, factory, steps, InteractionConfig(), 0)


@pytest.mark.parametrize("wanted", ["segmentation", "boxes", "scene", "links", "board", "states"])
def test_a_policy_that_reaches_for_the_truth_fails(small_simulator: Simulator, wanted: str) -> None:
    with pytest.raises(AttributeError, match=f"no attribute '{wanted}'"):
        record(small_simulator, CuriousFactory(lambda seen: getattr(seen, wanted)))


def test_nothing_that_a_policy_is_given_leads_to_the_truth(small_simulator: Simulator) -> None:
    seen: list[Observation] = []
    factory = CuriousFactory(seen.append)
    episode = record(small_simulator, factory)
    assert not episode.oracle and len(seen) == 4 and {type(one) for one in seen} == {Observation}
    assert [field.name for field in fields(Observation)] == ["rgb", "depth", "camera"]
    found = list(reachable(seen, factory.given))
    assert not [one for one in found if isinstance(one, Image | Episode | BoardScene | BoardSpec | ObjectModel)]
    assert {one.dtype.kind for one in found if isinstance(one, np.ndarray)} == {"u", "f"}
    assert {one.dtype for one in found if isinstance(one, np.ndarray) and one.dtype.kind == "u"} == {np.dtype(np.uint8)}


def test_an_observation_is_of_the_frame_and_the_same_while_nothing_changes(small_simulator: Simulator) -> None:
    seen: list[Observation] = []
    episode = record(small_simulator, CuriousFactory(seen.append))
    assert all(one is seen[0] for one in seen) and not any(step.reward for step in episode.steps)
    image = episode.image(0)
    assert seen[0].rgb is image.rgb and seen[0].depth is image.depth and seen[0].camera is episode.camera
    assert np.array_equal(episode.observation(0).depth, seen[0].depth)


@pytest.mark.parametrize("brighter", [0, 1])
def test_what_no_pixel_shows_is_no_new_observation(
    small_simulator: Simulator, monkeypatch: pytest.MonkeyPatch, brighter: int
) -> None:
    def interact_unseen(*given: Any) -> tuple[Step, Image]:
        image: Image = given[-1]
        step, _ = interact(*given)
        return step, replace(image, rgb=image.rgb + np.uint8(brighter))

    monkeypatch.setattr(recorder, "interact", interact_unseen)
    seen: list[Observation] = []
    episode = record(small_simulator, CuriousFactory(seen.append))
    assert len(episode.images) == 3, "what changed is recorded, whether it shows or not"
    assert len({id(one) for one in seen}) == (3 if brighter else 1)


def test_an_oracle_asks_for_the_scene_and_its_episode_says_so(small_simulator: Simulator) -> None:
    seen: list[Observation] = []
    episode = record(small_simulator, CuriousOracleFactory(seen.append))
    assert episode.oracle and episode.policy == "curious"
    assert all(isinstance(one, OracleObservation) and one.segmentation.dtype == np.uint16 for one in seen)


def test_an_oracle_without_the_scene_says_what_it_needs(small_simulator: Simulator) -> None:
    class Disguised:
        name = "disguised"

        def make_policy(self, rays: Rays) -> Policy:
            board = next(iter(generate_boards(BoardConfig(boards=1, seed=3), small_simulator.library)))
            return ScriptedPolicy(small_simulator.board(board), rays, InteractionConfig())

    with pytest.raises(BusybotError, match="needs what only the simulator knows"):
        record(small_simulator, Disguised())


@pytest.mark.parametrize(
    "action", [Action((160, 0), (0,)), Action((0, -1), (0,)), Action((3, 4), ()), Action((3, 4), (18,))]
)
def test_what_is_no_action_is_refused(
    small_simulator: Simulator, action: Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Curious, "select_action", lambda *_: action)
    with pytest.raises(BusybotError, match="the policy 'curious' chose Action") as error:
        record(small_simulator, CuriousFactory(lambda _: None))
    assert "160 x 120" in str(error.value.hint)


def test_built_in_policies_are_known_by_name(small_simulator: Simulator) -> None:
    assert builtin_factory("random") == RandomFactory() and builtin_factory("scripted") == ScriptedFactory()
    assert (RandomPolicy.name, ScriptedPolicy.name) == ("random", "scripted")
    assert not record(small_simulator, RandomFactory()).oracle and record(small_simulator, ScriptedFactory()).oracle
    with pytest.raises(BusybotError, match="unknown policy 'clever'"):
        builtin_factory("clever")


def test_an_episode_without_depth_has_no_observations(small_simulator: Simulator) -> None:
    episode = record(small_simulator, RandomFactory())
    episode.images[0].depth = None
    with pytest.raises(BusybotError, match="board 0: an image without depth"):
        episode.observation(0)
