"""From a recorded history with a goal picture to what an agent is told before it starts."""

import numpy as np

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import OnlineFeatures
from busybot.plan.contact_proposals import successful_actions
from busybot.plan.interfaces import TaskContext
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import goal_of, observe_episode
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.inputs.state_clusters import threshold_of


def task_context(
    history: Episode, steps: int, encoder: str = "embedded", features: np.ndarray | None = None
) -> TaskContext:
    """What agents are told of a task.

    Args:
        history: the recorded interactions, with a goal.
        steps: so many actions are allowed.
        encoder: of the features.
        features: of the history, (T + 1, N, 256), if they are known already.

    Raises:
        BusybotError: the history has no goal, or there is no such encoder.
    """
    observed, goal, chosen = observe_episode(history), goal_of(history), make_extractor(encoder)
    if goal is None:
        what = f"board {history.board.index} has no goal"
        raise BusybotError(
            what, "make a dataset with tasks: busybot generate OUT --tasks one-to-one, busybot collect OUT"
        )
    worked = np.full(len(history.steps), -1)
    for one in successful_actions(history):
        worked[one.step] = one.direction
    return TaskContext(
        history=sequence_of(observed, chosen.of(observed) if features is None else features),
        pixels=np.array([step.pixel for step in history.steps], int).reshape(-1, 2),
        worked=worked,
        goal=OnlineFeatures(observed, chosen).see(goal),
        threshold=threshold_of(encoder),
        steps=steps,
    )
