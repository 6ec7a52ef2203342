"""The curious policy: what it sees while it acts is what is recorded, and it does what tells most."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.directions import DIRECTIONS
from busybot.boards.generate import generate_boards
from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import ENDED
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import Candidates
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.policy_factory import LearnedPolicyFactory
from busybot.objects.resolve import find
from busybot.plan.curious import (
    ELSEWHERE,
    NEW,
    CuriousFactory,
    CuriousPolicy,
    Done,
    curious_reasoner,
    on_triggers,
)
from busybot.plan.held_links import HeldLinks
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import observe_episode, trigger_at
from busybot.reason.inputs.sequence import sequence_of
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import Detections
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.real_camera import REAL, CameraConfig
from busybot.sim.scene.render import RenderConfig

STEPS = 14


class Kept(CuriousFactory):
    """Keeps the policy that it made."""

    def make_detecting(self, rays: Rays, detections: Detections) -> CuriousPolicy:
        policy = super().make_detecting(rays, detections)
        object.__setattr__(self, "policy", policy)
        return policy


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(find("procedural"), RenderConfig(width=320, height=240))


def policy_after(actions: int, simulator: Simulator) -> CuriousPolicy:
    """As it is when it has acted so often on a board."""
    [board] = generate_boards(BoardConfig(boards=1, seed=4), simulator.library)
    factory = Kept(LearnedPolicyFactory("procedural", "collect"))
    record_episode(simulator, board, factory, actions, InteractionConfig(), 0)
    policy: CuriousPolicy = vars(factory)["policy"]
    return policy


@pytest.mark.long
@pytest.mark.parametrize("camera", [CameraConfig(), CameraConfig.model_validate(REAL)], ids=["clean", "real"])
def test_it_sees_while_it_acts_what_is_recorded_and_asks_what_tells_most(camera: CameraConfig) -> None:
    simulator = Simulator(find("procedural"), RenderConfig(width=320, height=240, camera=camera))
    [board] = generate_boards(BoardConfig(world="gates", boards=1, seed=4), simulator.library)
    factory = Kept(LearnedPolicyFactory("procedural", "collect"))
    episode = record_episode(simulator, board, factory, STEPS, InteractionConfig(), 0)
    policy: CuriousPolicy = vars(factory)["policy"]
    assert policy._watched is not None
    online, observed = policy._watched.sequence(), observe_episode(episode)
    recorded = sequence_of(observed, make_extractor("embedded").of(observed))
    assert not episode.oracle and episode.policy == "curious" and len(episode.steps) == STEPS
    for name, values in recorded.arrays.items():
        assert np.array_equal(online.arrays[name], values), name
    assert np.array_equal(online.links.states, recorded.links.states)
    assert policy._sequence is not None or camera != CameraConfig()
    assert (policy._inner.triggers is not None) == (camera == CameraConfig())
    tried = [action for place in policy._held.places for action in place.actions]
    assert not any(episode.steps[action].success for action in tried) and (tried or camera != CameraConfig())


def test_nobody_is_certain_while_a_trigger_was_never_seen_moving(simulator: Simulator) -> None:
    [board] = generate_boards(BoardConfig(boards=1, seed=4), simulator.library)
    episode = record_episode(simulator, board, builtin_factory("scripted"), 20, InteractionConfig(), 0)
    observed = observe_episode(episode)
    whole, reasoner = sequence_of(observed, make_extractor("embedded").of(observed)), curious_reasoner("mechanism")
    assert set(whole.links.owners) == set(np.flatnonzero(whole.triggers))
    assert reasoner.certainty(whole) > 0 == reasoner.certainty(whole.first(1))


def test_of_what_it_may_do_it_does_what_is_worth_most(simulator: Simulator) -> None:
    """It moves the link again and again of which a stand-in expects most; when that is sure, it ends the episode."""
    [board] = generate_boards(BoardConfig(boards=1, seed=4), simulator.library)

    class Fond:
        """Of the rightmost place."""

        encoder, sure = "embedded", 0.0

        def expected_information(self, seen: object, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
            return 0.1 * np.exp(5 * actions[:, 0].astype(float))

        def released(self, seen: object, tries: Sequence[Sequence[int]], *of: np.ndarray) -> np.ndarray:
            return np.zeros((*map(len, of[:1]), len(tries)))

        def yields(self, seen: object, tries: Sequence[Sequence[tuple[int, bool, bool]]]) -> np.ndarray:
            return np.ones(len(tries))

        def certainty(self, seen: object) -> float:
            return self.sure

    fond = Fond()

    class Asking(CuriousFactory):
        def make_detecting(self, rays: Rays, detections: Detections) -> CuriousPolicy:
            inner = self.learned.make_policy(rays)
            policy = CuriousPolicy(inner, rays, detections, fond, until_known=True)  # type: ignore[arg-type]
            inner.worth = policy.worth  # type: ignore[attr-defined]
            return policy

    factory = Asking(LearnedPolicyFactory("procedural", "collect"))
    episode = record_episode(simulator, board, factory, 24, InteractionConfig(), 0)
    held = [(step.acted_object, step.acted_link) for step in episode.steps]
    moved = {one for one, step in zip(held, episode.steps, strict=True) if step.reward}
    assert len(moved) > 1 and len(set(held[-4:])) == 1 and ENDED not in episode.settings
    places = [(one, step.position[0]) for one, step in zip(held, episode.steps, strict=True) if one in moved]
    assert max(places, key=lambda place: place[1])[0] == held[-1]
    fond.sure = 1.0
    ended = record_episode(simulator, board, factory, 24, InteractionConfig(), 0)
    assert len(ended.steps) < 24 and ended.settings[ENDED] == {"of": 24}


def test_a_way_is_worth_what_it_leads_to_if_it_works_and_else_what_the_other_does(simulator: Simulator) -> None:
    """Of two candidates on known links; the second goes one way only, so that nobody is asked about the other."""
    policy, asked = policy_after(3, simulator), list[np.ndarray]()

    class Asked:
        def expected_information(self, seen: object, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
            asked.append(actions)
            return np.where(actions[:, 5] > 0, 2.0, 1.0)

        def yields(self, seen: object, tries: Sequence[Sequence[tuple[int, bool, bool]]]) -> np.ndarray:
            return np.ones(len(tries))

    assert policy._inner.memory is not None
    policy._reasoner, policy._inner.memory.failures, policy._held = Asked(), [], HeldLinks()
    assert policy._watched is not None
    boxes = policy._watched.observed.boxes[policy._watched.observed.triggers]
    policy._moving = set(policy._watched.observed.triggers.tolist())
    (u0, v0, u1, v1), off = boxes[0].tolist(), [0, 0]
    up, down = (int(np.flatnonzero(DIRECTIONS[:, 2] * sign > 0.9)[0]) for sign in (1, -1))
    works = np.zeros((5, 18))
    works[0, [up, down]], works[1, [up, down]], works[2:, up] = (0.75, 0.5), (0.0, 1.0), 0.5
    pixels, pairs = np.array([[(u0 + u1) // 2, (v0 + v1) // 2]] * 3 + [off] * 2), np.zeros((5, 9))
    pairs[:, 0] = 0.5
    regions = np.array([1, 2, -1, 3, -2])
    found = Candidates(pixels, np.zeros((5, 3), np.float32), np.ones(5), works, pairs, regions)
    told = policy.worth(found, np.array([[up, down]] * 5))
    either = [0.75 * 2 + 0.25 * 0.5 * 1, 0.5 * 1 + 0.5 * 0.75 * 2]
    assert told.tolist() == [either, [1.0, 1.0], [NEW * 0.5, NEW * 0.5], [-1, -1], [-1, -1]], "two off every trigger"
    assert [action[5] > 0 for action in asked[0][:3]] == [True, False, False]


def test_the_reasoner_is_told_when_a_known_link_moved_and_when_it_did_not(simulator: Simulator) -> None:
    [board] = generate_boards(BoardConfig(boards=1, seed=4), simulator.library)
    factory, told = Kept(LearnedPolicyFactory("procedural", "collect")), list[object]()
    episode = record_episode(simulator, board, factory, STEPS, InteractionConfig(), 0)
    policy: CuriousPolicy = vars(factory)["policy"]
    memory = policy._inner.memory
    assert memory is not None and [one.pixel for one in policy._done] == [step.pixel for step in episode.steps]
    assert [one.moved for one in policy._done] == [step.success for step in episode.steps]

    class Told:
        def yields(self, seen: object, tries: Sequence[Sequence[tuple[int, bool, bool]]]) -> np.ndarray:
            told.extend(tries)
            return np.full(len(tries), 0.25)

    policy._reasoner = Told()
    memory.links[:], memory.pairs = 0, {7: 2, 8: 2}
    memory.links[20, 30], memory.links[20, 40] = 7, 8
    for pixel, pair, moved in (((30, 20), 1, False), ((30, 20), 2, False), ((40, 20), 2, True), ((30, 20), 2, True)):
        policy._done.append(Done(pixel, pair, moved))
    policy._done += [Done((30, 20), 1, False), Done((30, 20), 2, None)]
    moves = [(STEPS, False, False), (STEPS + 1, False, True), (STEPS + 3, True, True), (STEPS + 4, False, False)]
    assert policy._yields(np.array([7, 9])).tolist() == [0.25, 0.25] and told == [moves, []]


def test_it_looks_further_on_triggers_without_a_known_link_and_beside_failures(simulator: Simulator) -> None:
    policy = policy_after(1, simulator)
    watched, memory = policy._watched, policy._inner.memory
    assert watched is not None and memory is not None
    boxes = watched.observed.boxes.copy()
    first, second = watched.observed.triggers[:2].tolist()
    boxes[:], boxes[first], boxes[second] = 0, (10, 10, 60, 60), (50, 10, 100, 60)
    watched.observed = replace(watched.observed, boxes=boxes)
    policy._moving, memory.failures = {second}, []
    within = policy._within((120, 160))
    assert within[10:60, 10:60].all() and within.sum() == 50 * 50, "where boxes overlap, too"
    memory.failures = [Failure((80, 40), {0: 0.5})]
    further = policy._within((120, 160)) & ~within
    assert further[40, 80] and not further[40, 61] and not further[:, 100:].any() and not further[61:].any()


def test_it_looks_for_patches_once_an_action_has_shown_that_the_camera_is_still(simulator: Simulator) -> None:
    assert policy_after(1, simulator)._inner.triggers is None
    policy = policy_after(2, simulator)
    assert policy._watched is not None and policy._inner.triggers is not None
    observed = policy._watched.observed
    assert np.array_equal(policy._inner.triggers, observed.boxes[observed.triggers])


def test_a_link_that_moves_without_a_reward_is_remembered(simulator: Simulator) -> None:
    """Where a reward asks for more pixels than there are, what is known are links all the same; nothing is not."""
    [board] = generate_boards(BoardConfig(boards=1, seed=4), simulator.library)
    factory = Kept(LearnedPolicyFactory("procedural", "collect"))
    episode = record_episode(simulator, board, factory, STEPS, InteractionConfig(delta=10**6), 0)
    memory = vars(factory)["policy"]._inner.memory
    moved = {(step.acted_object, step.acted_link) for step in episode.steps if step.success}
    assert not any(step.reward for step in episode.steps) and len(moved) > 1
    assert len(moved) - 1 <= len(memory.pairs) <= len(moved)


def test_what_may_be_held_is_tried_again_when_something_lets_go_and_else_is_not(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two triggers whose only candidate promised much and failed, on a board where others failed, too; a stand-in
    says what holds them. Another one that was not tried is worth what a link is that nothing holds."""
    policy = policy_after(1, simulator)

    class Told:
        def released(self, seen: object, tries: Sequence[Sequence[int]], *of: np.ndarray) -> np.ndarray:
            return np.array([{0: 0.0, 1: 0.5}[actions[0]] for actions in tries])

    policy._reasoner, policy._held, policy._promised, policy._moving = Told(), HeldLinks(), {}, {1, 2, 3}
    pixels, triggers = np.array([(20, 20), (60, 20), (90, 20)]), np.array([1, 2, 3])
    for action, (pixel, trigger) in enumerate(zip(pixels.tolist()[:2], (1, 2), strict=True)):
        policy._held.tried(action, (pixel[0] + 1, pixel[1]), trigger, (0.9, 0.0), False)
    beliefs, pairs = np.array([0.01, 0.01, 0.9]), np.ones((3, 9))
    found = Candidates(pixels, np.zeros((3, 3), np.float32), beliefs, np.ones((3, 18)), pairs, np.array([-1, -2, -3]))
    still, released, new = policy._of_new(found, triggers)
    place = policy._held.places[1]
    assert new == pytest.approx(NEW * 0.9) and still < 0.05 * new
    locked, share = policy._held.held(place), policy._held.share
    assert released == pytest.approx(NEW / (1 - share) * (locked * 0.9 * 0.5 + (1 - locked) * 0.01))
    assert policy._chances[60, 20] == (0.01, 0.5) and policy._chances[90, 20] == (pytest.approx(0.9), 1.0)
    assert policy._held_at((99, 99)) == 0
    monkeypatch.setattr("busybot.plan.curious.trigger_at", lambda observed, pixel: 2)
    assert policy._held_at((60, 20)) == locked * 0.9


def test_moving_a_known_link_is_worth_what_it_opens_too(simulator: Simulator) -> None:
    """Of two moves that tell little the first one lets three held links go, which take an action each; the third one
    tells more than that."""
    policy = policy_after(1, simulator)

    class Told:
        def released(self, seen: object, tries: Sequence[Sequence[int]], *of: np.ndarray) -> np.ndarray:
            return np.array([[0.5] * len(tries), [0.0] * len(tries), [0.0] * len(tries)])

    policy._reasoner, policy._held = Told(), HeldLinks()
    told, works, none = np.array([0.1, 0.1, 3.0]), np.array([0.5, 1.0, 1.0]), np.zeros(0)
    assert policy._with_what_opens(told, works, none, none) is told, "where nothing is held"
    for action in range(4):
        policy._held.tried(action, (20 * action, 20), 1, (0.9, 0.0), False)
    policy._held.tried(4, (60, 20), 1, (0.9, 0.0), True)
    locked, share = policy._held.held(policy._held.places[0]), policy._held.share
    best = 3 * 0.5 * NEW / (1 - share) * locked * 0.9 * 0.5
    assert policy._with_what_opens(told, works, none, none) == pytest.approx([(0.1 + best) / 4, 0.1, 3.0])


def test_who_cannot_tell_is_not_asked() -> None:
    with pytest.raises(BusybotError, match="does not tell") as error:
        curious_reasoner("event")
    assert "--reasoner mechanism" in str(error.value.hint)


@pytest.mark.long
def test_it_is_collected_continued_and_told_by_what_it_chose(tmp_path: Path) -> None:
    from tests.cli.commands import busybot

    out = tmp_path / "data"
    small = ("--set", "render.width=160", "--set", "render.height=120", "--steps", "3", "--workers", "1")
    busybot("generate", out, "--boards", "1", "--seed", "4")
    wrong = busybot("collect", out, "--policy", "learned", "--until-known")
    assert wrong.returncode == 2 and "goes with --policy curious" in wrong.stderr
    other = busybot("collect", out, "--policy", "curious", "--reasoner", "lookup")
    assert other.returncode == 2 and "does not tell" in other.stderr
    done = busybot("collect", out, "--policy", "curious", *small)
    assert done.returncode == 0, done.stderr
    again = busybot("collect", out, "--policy", "curious", "--until-known", *small)
    assert again.returncode == 1 and "until_known" in again.stderr


def test_every_trigger_has_a_link_so_that_its_candidates_promise_more_while_none_is_known() -> None:
    """Trigger 4 has a known link, 5 two candidates that promise little, 6 a nearly sure one."""
    scores, triggers = np.array([0.01, 0.002, 0.004, 0.95]), np.array([4, 5, 5, 6])
    any_of_5 = 1 - 0.998 * 0.996
    told = on_triggers(scores, triggers, {4, 9}, {5: any_of_5, 6: 0.95})
    one = 1 - (1 - ELSEWHERE * any_of_5) * 0.998 * 0.996
    assert told[0] == 0.01 and 0.95 < told[3] < 1
    assert told[1:3] == pytest.approx([0.002 / one, 0.004 / one])
    assert told[1:3].sum() == pytest.approx(1 / (1 + ELSEWHERE), abs=0.01), "little is promised, but something is there"
    failed = on_triggers(scores / 1000, triggers, {4}, {5: any_of_5, 6: 0.95})
    assert 0 < failed[1:3].sum() < 0.06 and failed[3] < 0.06, "what promised more has failed: it is elsewhere, or held"
    assert on_triggers(np.zeros(2), np.array([1, 1]), (), {1: 0.0}).tolist() == [0, 0]


def test_it_acts_on_triggers_alone_and_sooner_or_later_on_each() -> None:
    simulator = Simulator(find("procedural"), RenderConfig(width=320, height=240))
    for board in generate_boards(BoardConfig(world="gates", boards=2, seed=6, group_size=1), simulator.library):
        factory = CuriousFactory(LearnedPolicyFactory("procedural", "collect"))
        episode = record_episode(simulator, board, factory, STEPS, InteractionConfig(), 0)
        observed = observe_episode(episode)
        acted = [trigger_at(observed, step.pixel) for step in episode.steps]
        assert set(acted) == set(observed.triggers.tolist())


def test_what_only_chance_would_read_is_refused() -> None:
    factory = CuriousFactory(LearnedPolicyFactory("procedural", "collect", {"persist": 0.5}))
    with pytest.raises(BusybotError, match="learned.persist changes nothing"):
        factory.provenance()


def test_what_changes_late_is_no_link_that_moved(simulator: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rewarded action that held nothing: something else had changed meanwhile."""
    policy = policy_after(1, simulator)
    assert policy._watched is not None and policy._seen is not None
    before = policy._watched._latest
    u0, v0, u1, v1 = policy._watched.observed.boxes[policy._watched.observed.triggers][0].tolist()
    here = (u0 + u1) // 2, (v0 + v1) // 2
    lit, moved = before.rgb.copy(), before.depth.copy()
    lit[:20] = 255
    moved[v0:v1, u0:u1] -= 0.05
    assert not policy._moved(here, before, replace(before, rgb=lit), True), "only a lamp shines"
    assert policy._moved(here, before, replace(before, depth=moved), False), "it moved, and nothing responded"
    assert policy._moved(here, before, before, True) is False
    assert policy._inner.memory is not None
    monkeypatch.setattr(policy._inner.memory, "moved_at", lambda *_: None)
    assert policy._moved(here, before, replace(before, rgb=lit), True)
    told = policy._moved(here, before, replace(before, rgb=lit), False)
    assert told is None, "before a noisy camera it may have moved without a reward"


def test_a_failure_that_was_expected_tells_little_of_other_places() -> None:
    memory = BoardMemory(np.full((60, 60), 0.5, np.float32), PolicyConfig())
    far, logits, pairs = np.array([(50, 50)]), np.zeros(1), np.full((1, 9), 0.5)
    beliefs = []
    for weight in (0.0, 0.1, 1.0):
        memory.failures = [Failure((5, 5), {0: 0.5}, weight=weight)]
        beliefs.append(float(memory.doubted(far, logits, pairs)[0][0]))
    assert beliefs[0] == 0.5 > beliefs[1] > beliefs[2] and 0.5 - beliefs[1] < 0.2 * (0.5 - beliefs[2])
