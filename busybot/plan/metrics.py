"""Metrics of agents (paper section 5.3, Table 3), from judged rollouts; imports neither torch nor sapien.

Success is the share of the affectable responders that are in their goal state at the end: by the true state, and beside
it by features, as the paper's authors judge it. Over tasks it is averaged (macro) and pooled (micro).
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np

from busybot.common.frozen_model import FrozenModel
from busybot.evaluation.statistics import (
    Interval,
    binomial_interval,
    interval_over_boards,
    interval_over_objects,
    mcnemar_test,
    percentile_interval,
    sign_flip_test,
)

DRAWS = 2000

Cause = Literal[
    "", "no candidate", "wrong relation", "wrong prediction", "physical failure", "not noticed", "not tried"
]
CAUSES: tuple[Cause, ...] = get_args(Cause)[1:]
"""Why a responder is not in its goal state: nothing was offered on its link; the inferred graph lacks its relation;
an action on its link, or one that was meant for it, changed something else than wanted; its actions changed nothing; by
features it looked as in the goal; none of these."""

KEYS: dict[str, str] = {
    "least_steps": "mean number of actions of the shortest plans: in the paper's world by counting, in others as a "
    "search found it when the task was drawn",
    "by_locks": "success by the number of links that are held one behind the other, with the number of tasks",
    "by_unmoved": "success by the number of links that stand elsewhere in the goal and moved in no action of the "
    "history: nothing there tells what they do",
    "agents.NAME.steps_over_shortest": "of solved tasks, steps used divided by those of the shortest plan, mean",
    "agents.NAME.solved_interval": "exact binomial bounds of `solved`, 95 %",
    "agents.NAME.micro_intervals": "of `micro`, by a bootstrap over `objects` (responders) and their boards, and over "
    "`mechanisms` (their kinds) and their boards; where all or none is reached exact bounds, each of them one trial",
    "agents.NAME.object_interval": "of `success`, by a bootstrap over objects (responders) and their tasks; where all "
    "or none is reached exact bounds, each object being one trial",
    "compared.NAME": "against the first agent named, on the same tasks: `difference` of success and its "
    "`difference_interval` by a bootstrap over tasks (where all differ alike, by the bound on the share that may not), "
    "the number of tasks `differing`, `p_success` by a sign-flip test, `p_solved` by McNemar's test",
}
"""What the figures are called that every world has beside the paper's."""


class JudgedResponder(FrozenModel):
    """An affectable responder at the end of a rollout.

    Attributes:
        object: its index.
        key: of the object.
        kind: of the relation that drives it.
        asked: whether the start differs from the goal here.
        reached: it is in its goal state.
        looks_reached: its features are those of the goal.
        cause: why it was not reached, empty if it was.
    """

    object: int
    key: str
    kind: str
    asked: bool
    reached: bool
    looks_reached: bool
    cause: Cause = ""


class JudgedRollout(FrozenModel):
    """An agent on a task.

    Attributes:
        steps: actions.
        succeeded: of these, how many changed a trigger's state.
        stopped: the reason that the agent gave, empty if its steps were used up.
        cpu_ms: of each decision, the one to stop included, all but simulation and rendering.
        model_ms: of that, the interaction model's.
        start_ms: before the first decision.
    """

    agent: str
    steps: int
    succeeded: int
    stopped: str
    responders: tuple[JudgedResponder, ...]
    cpu_ms: tuple[float, ...] = ()
    model_ms: tuple[float, ...] = ()
    start_ms: float = 0.0

    @property
    def success(self) -> float:
        """Share of affectable responders in their goal state; 1 where there is none."""
        return sum(one.reached for one in self.responders) / len(self.responders) if self.responders else 1.0

    @property
    def solved(self) -> bool:
        """Whether all of them are."""
        return all(one.reached for one in self.responders)


class JudgedTask(FrozenModel):
    """All agents on one task.

    Attributes:
        board: its number in the dataset.
        kind: of the task.
        least_steps: in which it can be solved.
        locks: how many links something holds, each until the one before has been moved.
        unmoved: how many links stand elsewhere in the goal and moved in no action of the history; None where that was
            not counted.
    """

    board: int
    kind: str
    least_steps: int
    locks: int = 0
    unmoved: int | None = None
    rollouts: tuple[JudgedRollout, ...]

    def of(self, agent: str) -> JudgedRollout:
        """An agent's rollout."""
        return next(rollout for rollout in self.rollouts if rollout.agent == agent)


def summarise(tasks: Sequence[JudgedTask], agents: Sequence[str], rng: np.random.Generator) -> dict[str, Any]:
    """All metrics, JSON values; shares from 0 to 1, None where there is no task.

    Args:
        rng: of the intervals; tasks are drawn with replacement, the same ones for every agent.
    """
    chosen = rng.integers(max(1, len(tasks)), size=(DRAWS, len(tasks)))
    rows = {agent: _row(tasks, [task.of(agent) for task in tasks], chosen) for agent in agents}
    for agent, row in rows.items():
        row |= _more(tasks, [task.of(agent) for task in tasks], rng)
    kinds = sorted({task.kind for task in tasks})
    return {
        "success": {agent: row["success"] for agent, row in rows.items()},
        "tasks": len(tasks),
        "kinds": {kind: sum(task.kind == kind for task in tasks) for kind in kinds},
        "by_kind": {
            kind: {agent: _mean([task.of(agent).success for task in tasks if task.kind == kind]) for agent in agents}
            for kind in kinds
        },
        "least_steps": _mean([task.least_steps for task in tasks]),
        "by_locks": _by_number([task.locks for task in tasks], tasks, agents),
        "by_unmoved": _by_number([task.unmoved for task in tasks], tasks, agents),
        "agents": rows,
        "compared": {
            agent: _compared([task.of(agents[0]) for task in tasks], [task.of(agent) for task in tasks], chosen, rng)
            for agent in agents[1:]
        },
    }


def _by_number(numbers: Sequence[int | None], tasks: Sequence[JudgedTask], agents: Sequence[str]) -> dict[str, Any]:
    """Success of all tasks of which a number is the same; those without are left out."""
    groups = {
        str(number): [task for task, own in zip(tasks, numbers, strict=True) if own == number]
        for number in sorted({number for number in numbers if number is not None})
    }
    return {
        number: {"tasks": len(own), **{agent: _mean([task.of(agent).success for task in own]) for agent in agents}}
        for number, own in groups.items()
    }


def _more(tasks: Sequence[JudgedTask], rollouts: Sequence[JudgedRollout], rng: np.random.Generator) -> dict[str, Any]:
    """What an agent's row has in every world beside the paper's figures."""
    solved = [(task, one) for task, one in zip(tasks, rollouts, strict=True) if one.solved]
    records = [(task.board, each) for task, one in zip(tasks, rollouts, strict=True) for each in one.responders]
    right, boards = np.array([each.reached for _, each in records], int), [board for board, _ in records]
    whole = np.ones(len(records), int)
    weights = np.array([1 / len(one.responders) for one in rollouts for _ in one.responders])  # every task counts alike
    objects = [each.key for _, each in records]
    return {
        "steps_over_shortest": _mean([one.steps / task.least_steps for task, one in solved if task.least_steps]),
        "solved_interval": binomial_interval(len(solved), len(tasks)),
        "micro_intervals": {
            "objects": interval_over_objects(right, whole, objects, boards, rng),
            "mechanisms": interval_over_objects(right, whole, [each.kind for _, each in records], boards, rng),
        },
        "object_interval": interval_over_objects(weights * right, weights, objects, boards, rng),
    }


def _compared(
    first: Sequence[JudgedRollout], other: Sequence[JudgedRollout], chosen: np.ndarray, rng: np.random.Generator
) -> dict[str, Any]:
    """An agent against the first one, on the same tasks."""
    more = np.array([two.success - one.success for one, two in zip(first, other, strict=True)])
    solved = [np.array([rollout.solved for rollout in rollouts], bool) for rollouts in (first, other)]
    return {
        "difference": _mean(more),
        "difference_interval": _difference_interval(more, chosen),
        "differing": int((more != 0).sum()),
        "p_success": sign_flip_test(more, rng),
        "p_solved": mcnemar_test(*solved),
    }


def _difference_interval(more: np.ndarray, chosen: np.ndarray) -> Interval:
    """Of a mean difference over tasks. Where all have the same, often none, a bootstrap would see no other ever: by
    the exact bound on the share of tasks that may have another, of which none can count for more than 1."""
    if not len(more):
        return None
    if (more == more[0]).all():
        _, most = binomial_interval(0, len(more)) or (0.0, 1.0)
        same = float(more[0]) * (1 - most)
        return same - most, same + most
    return percentile_interval(more[chosen].mean(1))


def _success_interval(success: np.ndarray, chosen: np.ndarray) -> Interval:
    """Of mean success over tasks. Where all have the same, a bootstrap would see no other ever: by the exact bound on
    the share of tasks that may have another, which of 0 and 1 gives the exact binomial bounds."""
    if not len(success):
        return None
    if 0 < success[0] < 1 and (success == success[0]).all():
        _, most = binomial_interval(0, len(success)) or (0.0, 1.0)
        least = float(success[0]) * (1 - most)
        return least, least + most
    return interval_over_boards(success, np.ones(len(success)), chosen)


def timing(tasks: Sequence[JudgedTask], agents: Sequence[str]) -> dict[str, Any]:
    """Processor milliseconds per decision, by agent; apart from the metrics because it differs from run to run."""
    found = {}
    for agent in agents:
        rollouts = [task.of(agent) for task in tasks]
        everything = [value for rollout in rollouts for value in rollout.cpu_ms]
        model = [value for rollout in rollouts for value in rollout.model_ms]
        found[agent] = {
            "decisions": len(everything),
            "cpu_ms": _mean(everything),
            "cpu_ms_p95": float(np.quantile(everything, 0.95)) if everything else None,
            "cpu_ms_without_model": _mean([a - b for a, b in zip(everything, model, strict=True)]),
            "asked_model": _mean([value > 0 for value in model]),
            "start_ms": _mean([rollout.start_ms for rollout in rollouts]),
        }
    return found


def _row(tasks: Sequence[JudgedTask], rollouts: Sequence[JudgedRollout], chosen: np.ndarray) -> dict[str, Any]:
    responders = [one for rollout in rollouts for one in rollout.responders]
    causes = Counter(one.cause for one in responders if not one.reached)
    success = np.array([rollout.success for rollout in rollouts])
    looks = [_mean([one.looks_reached for one in rollout.responders]) for rollout in rollouts]
    steps = sum(one.steps for one in rollouts)
    return {
        "success": _mean(success),
        "interval": _success_interval(success, chosen),
        "micro": _mean([one.reached for one in responders]),
        "by_features": _mean([share for share in looks if share is not None]),
        "asked": _mean([one.reached for one in responders if one.asked]),
        "kept": _mean([one.reached for one in responders if not one.asked]),
        "solved": _mean([rollout.solved for rollout in rollouts]),
        "steps": _mean([rollout.steps for rollout in rollouts]),
        "steps_more": _mean([r.steps - task.least_steps for r, task in zip(rollouts, tasks, strict=True)]),
        "step_success": sum(one.succeeded for one in rollouts) / steps if steps else None,
        "stopped": dict(Counter(rollout.stopped or "steps used up" for rollout in rollouts).most_common(8)),
        "failures_by_cause": {cause: causes[cause] for cause in CAUSES},
        "by_relation": {
            kind: _mean([one.reached for one in responders if one.kind == kind])
            for kind in sorted({one.kind for one in responders})
        },
    }


def _mean(values: Sequence[float] | np.ndarray) -> float | None:
    return float(np.mean(values)) if len(values) else None
