"""Traces a model through a recorded episode: affordance, candidates and known links before every action.

A function of the episode and the model: whoever acted, the memory is told what the recorded actions led to.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from busybot.boards.spec import IMPORTED
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode, Observation, Step
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import ActionModel, Candidates, V, find_candidates, pairs_at, prior_shift
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import PAIR_OF, sigmoid
from busybot.interact.policy.noisy_pictures import least_depth


@dataclass(frozen=True)
class PolicyTrace:
    """What a model believed before the action of index `step`.

    Attributes:
        affordance: float (H, W), probability that acting at the pixel works, before any memory.
        candidates: with the memory's doubts.
        links: int32 (H, W), number of the known link at the pixel, 0 for none.
        known: whether the action was on a link that had moved before.
    """

    step: int
    affordance: np.ndarray
    candidates: Candidates
    links: np.ndarray
    known: bool


def retrace(episode: Episode, model: ActionModel[V], config: PolicyConfig | None = None) -> Iterator[PolicyTrace]:
    """What a model believes before every action of an episode, in order.

    Args:
        config: the policy's constants; a model's own are `policy_factory.policy_config(model.info, {})`.

    Raises:
        BusybotError: the episode was recorded without depth.
    """
    config = config or PolicyConfig()
    rays = Rays(episode.camera)
    memory: BoardMemory | None = None
    for index, step in enumerate(episode.steps):
        before, after = episode.observation(index), episode.observation(index + 1)
        view = model.look(before, rays)
        memory = memory or BoardMemory(view.height, config, least_depth(before.depth))
        found = find_candidates(model, before, rays, memory, config, view)
        affordance = sigmoid(view.affordance + prior_shift(config))
        known = step.pixel != UNKNOWN_PIXEL and bool(memory.links[step.pixel[1], step.pixel[0]])
        yield PolicyTrace(index, affordance, found, memory.links.copy(), known)
        if IMPORTED not in episode.settings:  # there nobody told whether it moved
            remember(memory, step, before, after, partial(pairs_at, model, view, step.pixel, memory, config))


def remember(
    memory: BoardMemory, step: Step, before: Observation, after: Observation, pairs: Callable[[], np.ndarray]
) -> None:
    """Tell a memory what came of a recorded action, if the recording says where it was.

    Args:
        before, after: what was seen.
        pairs: `candidates.pairs_at` the action's pixel, (9,); asked for when the action failed.
    """
    if step.pixel == UNKNOWN_PIXEL:
        return
    executed = step.executed or (step.direction,)
    if step.reward:
        memory.succeeded(step.pixel, executed[-1], before, after)
        return
    believed = pairs()
    tried = {int(PAIR_OF[one]) for one in executed}
    memory.failed(Failure(step.pixel, {pair: float(believed[pair]) for pair in sorted(tried)}))
