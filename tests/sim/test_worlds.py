"""Boards of every world in the simulator: what is recorded is their law, goes back in every bit, and locks hold."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.directions import DIRECTIONS
from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BODY, BoardSpec, Relation
from busybot.boards.task import REACH, affectable, goal_responders, reachable, start_states, task_of
from busybot.boards.worlds import NOVEL, WORLDS, links_of
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.diff import diff
from busybot.datasets.freeze import freeze
from busybot.datasets.summary import summarise
from busybot.datasets.verify import verify
from busybot.episodes.camera import Rays
from busybot.episodes.digests import episode_digests
from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.episode_diff import compare_episodes, compare_images
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import builtin_factory, direction_to, interior_pixels
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.interaction import Grasp, InteractionConfig, interact, pull
from busybot.sim.recorder import picture_goal, record_episode
from busybot.sim.regenerate import regenerate
from busybot.sim.replay import EpisodeReplay, act_again, shows_effects
from busybot.sim.scene.board_scene import BoardScene, Simulator
from tests.sim.conftest import SMALL, Once

STEPS = 14
REWIRED_AT = 6
CONFIG = InteractionConfig(delta=20)


def boards(simulator: Simulator, world: str, count: int = 1, **options: object) -> list[BoardSpec]:
    values = {"world": world, "boards": count, "group_size": 1, **options}
    return list(generate_boards(BoardConfig.model_validate(values), simulator.library))


def soon_rewired(spec: BoardSpec) -> BoardSpec:
    """The board, rewired early enough for a short episode."""
    early = tuple(one.model_copy(update={"step": REWIRED_AT}) for one in spec.rewirings)
    return spec.model_copy(update={"rewirings": early})


def law_of(spec: BoardSpec, simulator: Simulator) -> Dynamics:
    return Dynamics(spec, links_of([simulator.library.get(placed.key) for placed in spec.objects]))


@pytest.fixture(scope="session")
def episodes(small_simulator: Simulator) -> Callable[[str, str], Episode]:
    """`episodes(world, split)`: what the scripted policy did on a board of the world; recorded once."""
    made: dict[tuple[str, str], Episode] = {}

    def episode(world: str, split: str) -> Episode:
        if (world, split) not in made:
            [spec] = boards(small_simulator, world, split=split, seed=2)
            made[world, split] = record_episode(
                small_simulator, soon_rewired(spec), builtin_factory("scripted"), STEPS, CONFIG, seed=1
            )
        return made[world, split]

    return episode


CASES = [(world, split) for world in WORLDS for split in ("train", NOVEL)]


@pytest.mark.parametrize(("world", "split"), CASES)
def test_what_is_recorded_is_the_law_of_the_board(
    small_simulator: Simulator, episodes: Callable[[str, str], Episode], world: str, split: str
) -> None:
    episode = episodes(world, split)
    law, steps = law_of(episode.board, small_simulator), episode.steps
    states = law.run([start_states(episode.board), *(step.trigger_states_after for step in steps)])
    assert [step.responder_states_after for step in steps] == [state.shown for state in states[1:]]
    assert [step.responder_states_before for step in steps] == [state.shown for state in states[:-1]]
    assert [step.memory_after for step in steps] == [state.flat for state in states[1:]]
    assert any(step.memory_after for step in steps) == any(states[-1].memories)
    moved = 0
    for step, state in zip(steps, states, strict=False):
        there = {n for n, s in enumerate(step.trigger_states_after) if s != step.trigger_states_before[n]}
        assert len(there) == step.success and not any(law.locked(n, state.shown) for n in there)
        moved += len(there)
    assert moved > 2


@pytest.mark.parametrize(("world", "split"), CASES)
def test_every_picture_is_one_of_what_there_is_to_see(
    small_simulator: Simulator, episodes: Callable[[str, str], Episode], world: str, split: str
) -> None:
    """The camera looks when and only when something changed, and a reward says that enough pixels did."""
    episode = episodes(world, split)
    for k, step in enumerate(episode.steps):
        changed = step.success or step.responder_states_after != step.responder_states_before
        assert (episode.frame_of[k + 1] > episode.frame_of[k]) == changed
        assert (step.changed_pixels > 0) <= changed and step.reward == int(step.changed_pixels > CONFIG.delta)


@pytest.mark.parametrize(("world", "split"), CASES)
def test_every_step_goes_back_in_every_bit_and_acts_again(
    small_simulator: Simulator, episodes: Callable[[str, str], Episode], world: str, split: str
) -> None:
    episode = episodes(world, split)
    assert shows_effects(episode, small_simulator.library)
    steps = [*range(STEPS + 1), *np.random.default_rng(0).permutation(STEPS + 1).tolist()]
    replay = EpisodeReplay(small_simulator, episode)
    for step in steps:
        compared = replay.compare(step)
        assert compared.rule == "equal" and compared.states and compared.joints == 0 and compared.image.equal, step
    again = act_again(small_simulator, episode.board, episode)
    assert compare_episodes(episode, again).nothing


@pytest.mark.long
@pytest.mark.parametrize("world", WORLDS)
def test_real_objects_go_back_in_every_bit(real_simulator: Simulator, world: str) -> None:
    for split in ("train", NOVEL):
        [spec] = boards(real_simulator, world, split=split, seed=3)
        spec = soon_rewired(spec)
        episode = record_episode(real_simulator, spec, builtin_factory("scripted"), STEPS, CONFIG, seed=1)
        replay = EpisodeReplay(real_simulator, episode)
        assert all(replay.compare(step).image.equal for step in range(STEPS + 1))
        assert compare_episodes(episode, act_again(real_simulator, episode.board, episode)).nothing


@pytest.mark.parametrize("world", ["mixed", "chance", "rewired", "gates"])
def test_what_follows_a_restored_state_is_what_followed_then(small_simulator: Simulator, world: str) -> None:
    [spec] = boards(small_simulator, world, seed=5)
    scene = small_simulator.board(soon_rewired(spec))

    def play(rng: np.random.Generator, image: Image, count: int) -> tuple[list[Step], Image]:
        steps = []
        for k in range(count):
            step, after = act(scene, image, int(rng.integers(len(scene.triggers))) if k % 3 else None)
            image = after or image
            steps.append(step)
        return steps, image

    _, image = play(np.random.default_rng(0), scene.observe(), 4)
    saved = scene.save()
    steps, last = play(np.random.default_rng(1), image, 8)
    assert scene.save() != saved and any(step.success for step in steps)
    for _ in range(2):
        scene.restore(saved)
        assert scene.save() == saved and np.array_equal(scene.observe().rgb, image.rgb)
        again, end = play(np.random.default_rng(1), image, 8)
        assert again == steps and np.array_equal(end.rgb, last.rgb)


def act(scene: BoardScene, image: Image, number: int | None) -> tuple[Step, Image | None]:
    """Move a trigger link into another state, or miss."""
    assert image.segmentation is not None and image.depth is not None
    if number is None:
        return interact(scene, Grasp(None, np.zeros(3), (0, 0)), 0, CONFIG, image)
    rays, joint, rng = Rays(scene.camera), scene.triggers[number], np.random.default_rng(0)
    code = next(k for k in range(1, len(scene.links) + 1) if scene.trigger_at(k) == number)
    direction = None
    for pixel in interior_pixels(image.segmentation == code, rng, 6):
        point = rays.point(image.depth, pixel)
        direction, _ = direction_to(scene, number, point, joint.state + (1 if joint.state == 0 else -1), CONFIG)
        if direction is not None:
            break
    return interact(scene, Grasp(number, point, pixel), 0 if direction is None else direction, CONFIG, image)


def with_relation(simulator: Simulator, make: Callable[[BoardSpec, Links], Relation], **more: object) -> BoardSpec:
    """A board whose one relation is the one that is made for it."""
    for spec in boards(simulator, "gates", count=20, links=(3, 6)):
        links = links_of([simulator.library.get(placed.key) for placed in spec.objects])
        if links.sizes[0] == 2 and links.sizes[1] == 2:
            return spec.model_copy(update={"relations": (make(spec, links),), **more})
    raise AssertionError("no board has two links with two states")


def single(kind: str, states: tuple[int, ...], count: int = 1, **parameters: object) -> Callable[..., Relation]:
    """A relation of the board's first links to one of its lamps."""

    def make(spec: BoardSpec, links: Links) -> Relation:
        lamp = next(k for k, placed in enumerate(spec.objects) if placed.category == "Lamp")
        inputs = [{"object": index, "link": name} for index, name in links.names[:count]]
        values = {"kind": kind, "triggers": inputs, "responder": lamp, "stage": "single", "states": states}
        return Relation.model_validate({**values, "parameters": parameters})

    return make


def test_what_happens_late_is_pictured_and_earns_the_reward(procedural_simulator: Simulator) -> None:
    """Of an action that moved nothing, with which it has nothing to do."""
    spec = with_relation(procedural_simulator, single("delay", (0, 1), actions=2))
    scene = procedural_simulator.board(spec)
    lamp, image = spec.relations[0].responder, scene.observe()
    before = scene.responder_states()[lamp]
    moved, after = act(scene, image, 0)
    assert moved.success and after is not None and moved.responder_states_after[lamp] == before
    missed, nothing = act(scene, after, None)
    assert not missed.success and nothing is None and missed.reward == 0
    late, shown = act(scene, after, None)
    assert not late.success and late.acted_object == -1 and late.responder_states_after[lamp] == 1 - before
    assert shown is not None and late.reward == 1 and late.changed_pixels > InteractionConfig().delta
    assert shown.segmentation is not None and after.segmentation is not None
    assert np.array_equal(shown.segmentation, after.segmentation)
    rest, nothing = act(scene, shown, None)
    assert nothing is None and rest.reward == 0


def test_what_happens_by_itself_is_pictured_and_earns_the_reward(procedural_simulator: Simulator) -> None:
    spec = with_relation(procedural_simulator, single("flicker", (0, 1), count=0, probability=0.3))
    scene = procedural_simulator.board(spec)
    lamp, image, rewards, shown = spec.relations[0].responder, scene.observe(), 0, []
    for _ in range(20):
        step, after = act(scene, image, None)
        changed = step.responder_states_after[lamp] != step.responder_states_before[lamp]
        assert (after is not None) == changed == bool(step.reward) and not step.success
        rewards, image = rewards + step.reward, after or image
        shown.append(step.responder_states_after[lamp])
    law = law_of(spec, procedural_simulator)
    assert shown == [state.shown[lamp] for state in law.run([start_states(spec)] * 21)][1:]
    assert 2 <= rewards <= 12
    oracle = InteractionConfig(reward="joints")  # the oracle's reward is that of the joints alone
    steps = [interact(scene, Grasp(None, np.zeros(3), (0, 0)), 0, oracle, image)[0] for _ in range(20)]
    assert any(step.changed_pixels for step in steps) and not any(step.reward for step in steps)


@pytest.mark.long
def test_looking_while_it_moves_is_not_deceived_by_what_happens_late(procedural_simulator: Simulator) -> None:
    spec = with_relation(procedural_simulator, single("delay", (0, 1), actions=1))
    looking = InteractionConfig(stop="pixels")
    scene = procedural_simulator.board(spec)
    moved, image = act(scene, scene.observe(), 0)
    assert moved.success and image is not None
    saved, rays = scene.save(), Rays(scene.camera)
    assert image.segmentation is not None and image.depth is not None
    code = next(k for k in range(1, len(scene.links) + 1) if scene.trigger_at(k) == 1)
    pixel = interior_pixels(image.segmentation == code, np.random.default_rng(0), 1)[0]
    grasp = Grasp(1, rays.point(image.depth, pixel), pixel)
    for direction in range(len(DIRECTIONS)):
        results = []
        for config in (looking, InteractionConfig()):
            scene.restore(saved)
            results.append(interact(scene, grasp, direction, config, image)[0])
        assert results[0] == results[1], direction


def test_a_lock_holds_its_joint_and_lets_it_go(small_simulator: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    strong = InteractionConfig(force_limit=30.0, stiffness=2000.0)
    held = 0
    for spec in boards(small_simulator, "lock", count=4, seed=1):
        scene = small_simulator.board(spec)
        law, image = scene.dynamics, scene.observe()
        assert image.segmentation is not None and image.depth is not None
        for lock in spec.locks:
            number = law.number(lock.link)
            joint, rays = scene.triggers[number], Rays(scene.camera)
            code = next(k for k in range(1, len(scene.links) + 1) if scene.trigger_at(k) == number)
            if not (image.segmentation == code).any():
                continue
            pixel = interior_pixels(image.segmentation == code, np.random.default_rng(0), 1)[0]
            point, seen = rays.point(image.depth, pixel), []

            def watched(position: float, real: Callable[[float], int], seen: list[float] = seen) -> int:
                seen.append(position)
                return real(position)

            with monkeypatch.context() as patch:
                patch.setattr(joint, "state_at", partial(watched, real=joint.state_at))
                for direction in DIRECTIONS:
                    assert pull(scene, number, point, direction, strong, None)[1] == joint.state
            assert len(seen) == len(DIRECTIONS) * strong.increments
            away = max(abs(position - joint.rest(joint.state)) for position in seen)
            assert away < 1e-3 * (joint.upper - joint.lower), (lock, away)
            step, after = interact(scene, Grasp(number, point, pixel), 0, CONFIG, image)
            assert not step.success and after is None and np.array_equal(scene.observe().rgb, image.rgb)
            held += 1
        saved = scene.save()
        walk = [triggers for _, triggers, _ in reachable(law, start_states(spec), 30, most=50_000)]
        for lock in spec.locks:
            number = law.number(lock.link)
            opened = next(there for there in walk if not law.locked(number, law.start(there).shown))
            for link, state in enumerate(opened):
                scene.set_trigger(link, state)
            step, _ = act(scene, scene.observe(), number)
            assert step.success, lock
            scene.restore(saved)
    assert held > 2


def test_without_responders_nothing_shows_and_nothing_holds(small_simulator: Simulator) -> None:
    blind = Simulator(small_simulator.library, small_simulator.render, responders=False)
    for world in ("mixed", "lock"):
        [spec] = boards(small_simulator, world, seed=2)
        episode = record_episode(blind, spec, builtin_factory("scripted"), 8, CONFIG, seed=1)
        shown = {step.responder_states_after for step in episode.steps}
        assert len(shown) == 1 and max(next(iter(shown))) == 0 and not shows_effects(episode, blind.library)
        assert all(
            step.success == (step.joint_positions_after != step.joint_positions_before) for step in episode.steps
        )
        replay = EpisodeReplay(blind, episode)
        assert all(replay.compare(step).holds for step in range(9))
    scene = blind.board(spec)
    assert spec.locks and not any(scene.locked(number) for number in range(len(scene.triggers)))


def shortest_way(law: Dynamics, spec: BoardSpec) -> list[tuple[int, ...]]:
    """States of the trigger links on the way to the task's goal."""
    judged, wanted = affectable(spec), goal_responders(spec)
    start = start_states(spec)
    ways = [([start], law.start(start))]
    seen = {(start, ways[0][1].shown, ways[0][1].memories)}
    while True:
        following = []
        for way, state in ways:
            if all(state.shown[index] == wanted[index] for index in judged):
                return way
            for triggers in law.moves(way[-1], state):
                after = law.step(triggers, state)
                key = (triggers, after.shown, after.memories)
                if key not in seen:
                    seen.add(key)
                    following.append(([*way, triggers], after))
        ways = following


@pytest.mark.parametrize("world", ["gates", "time", "lock", "rewired"])
def test_the_goal_picture_shows_what_acting_leads_to(small_simulator: Simulator, world: str) -> None:
    for spec in boards(small_simulator, world, count=2, tasks=REACH):
        scene = small_simulator.board(spec)
        before, start = scene.observe(), scene.save()
        [goal] = picture_goal(scene)
        assert compare_images(scene.observe(), before).equal and scene.save() == start
        way = shortest_way(scene.dynamics, spec)
        assert len(way) - 1 == task_of(spec).shortest
        for triggers in way[1:]:
            for number, state in enumerate(triggers):
                if state != scene.triggers[number].state:
                    scene.set_trigger(number, state)
            scene.tick()
        judged = affectable(spec)
        assert [scene.responder_states()[k] for k in judged] == [goal_responders(spec)[k] for k in judged]
        if scene.trigger_states() == task_of(spec).goal:  # another way of the same length may end elsewhere
            scene.rest(scene.save())
            assert compare_images(goal, scene.observe()).equal
        assert not compare_images(goal, before).equal


@pytest.fixture(scope="session")
def recorded_world(once: Once, work_here: Callable[[], AbstractContextManager[None]]) -> Iterator[Dataset]:
    """Three boards of the world `mixed` with goals and what the scripted policy did on them; not to be changed."""

    def record(path: Path) -> None:
        config = BoardConfig(world="mixed", tasks="reach", boards=3, seed=4)
        with work_here():
            collect(create_dataset(path, config, find("procedural")), find("procedural"), COLLECT, 1)

    dataset = Dataset.open(once("recorded-world", record))
    before = dataset.hashes()
    yield dataset
    assert dataset.hashes() == before


COLLECT = CollectConfig(policy="scripted", steps=6, render=SMALL)


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_a_dataset_of_a_world_is_verified_made_again_frozen_and_compared(
    recorded_world: Dataset, tmp_path: Path
) -> None:
    info = summarise(recorded_world.path)
    assert (info["boards"], info["episodes"], info["tasks"]) == (3, 3, "reach")
    assert recorded_world.info.generator.config["world"] == "mixed"
    assert verify(recorded_world.path).problems == ()
    done = regenerate(recorded_world.path, tmp_path / "again", find("procedural"))
    assert done.ok and (done.boards_from, done.boards_unlike) == ("configuration", [])
    again = Dataset.open(tmp_path / "again")
    assert again.hashes() == recorded_world.hashes() and diff(recorded_world.path, again.path).equal
    again.episode_path(1).unlink()
    collect(Dataset.open(again.path), find("procedural"), COLLECT, 1)  # continued
    assert again.hashes() == recorded_world.hashes()
    freeze(again.path, find("procedural"))
    report = verify(again.path)
    assert report.ok and report.frozen and diff(recorded_world.path, again.path).equal
    assert again.table("steps")["memory_after"].to_pylist() == [
        list(step.memory_after)
        for index in sorted(again.finished())
        for step in read_episode(again.episode_path(index)).steps
    ]


def test_what_a_mechanism_remembers_counts_in_the_trace(recorded_world: Dataset) -> None:
    episode = read_episode(recorded_world.episode_path(0))
    k = next(k for k, step in enumerate(episode.steps) if step.memory_after)
    other = replace(episode, steps=list(episode.steps))
    other.steps[k] = replace(other.steps[k], memory_after=(9, *other.steps[k].memory_after[1:]))
    assert episode_digests(other).trace != episode_digests(episode).trace
    assert episode_digests(other).content != episode_digests(episode).content
    assert not compare_episodes(episode, other).same_states


def test_keys_of_later_versions_are_kept_and_refused_by_name(small_simulator: Simulator) -> None:
    [spec] = boards(small_simulator, "mixed")
    later = BoardSpec.model_validate(spec.model_dump(mode="json") | {"magnets": [1]})
    assert BoardSpec.model_validate_json(later.model_dump_json()) == later
    assert later.model_dump(mode="json")["magnets"] == [1] and later.digest() != spec.digest()
    with pytest.raises(BusybotError, match="'magnets', unknown here") as error:
        small_simulator.board(later)
    assert "later version" in str(error.value.hint)


def test_a_responder_that_is_read_shows_what_is_read(small_simulator: Simulator) -> None:
    [spec] = boards(small_simulator, "chain")
    scene = small_simulator.board(spec)
    follower = next(one for one in spec.relations if any(ref.link == BODY for ref in one.triggers))
    assert follower.responder in scene.responders and scene.dynamics.remembers
