"""Judges rollouts by the true states. For evaluators only."""

from collections.abc import Sequence

import numpy as np

from busybot.boards.spec import Relation
from busybot.boards.task import affectable, reached, responder_states, start_states
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import AgentPolicy, Decision
from busybot.plan.interfaces import Act, Stop, TaskContext
from busybot.plan.metrics import Cause, JudgedResponder, JudgedRollout


def judge_rollout(rollout: Episode, policy: AgentPolicy, briefing: TaskContext, edges: np.ndarray) -> JudgedRollout:
    """Put the truth beside what an agent did.

    Args:
        rollout: on a board with a task, with segmentation.
        policy: that acted.
        edges: bool (N, N), relations that the reasoner claims.
    """
    board, steps = rollout.board, rollout.steps
    start = responder_states(board, start_states(board))
    right = reached(board, steps[-1].responder_states_after if steps else start)
    asked = reached(board, start)
    differing = set(briefing.differing(policy.features).tolist())
    relations = {relation.responder: relation for relation in board.relations}
    last = policy.decisions[-1].answer if policy.decisions else None
    responders = []
    for index in affectable(board):
        cause: Cause = ""
        if not right[index]:
            cause = _cause(rollout, policy.decisions, relations[index], edges, index not in differing)
        responders.append(
            JudgedResponder(
                object=index,
                key=board.objects[index].key,
                kind=relations[index].kind,
                asked=not asked[index],
                reached=right[index],
                looks_reached=index not in differing,
                cause=cause,
            )
        )
    return JudgedRollout(
        agent=policy.name,
        steps=len(steps),
        succeeded=sum(step.success for step in steps),
        stopped=last.why if isinstance(last, Stop) else "",
        responders=tuple(responders),
        cpu_ms=tuple(round(one.cpu_ms, 3) for one in policy.decisions),
        model_ms=tuple(round(one.model_ms, 3) for one in policy.decisions),
        start_ms=round(policy.start_ms, 3),
    )


def _cause(
    rollout: Episode, decisions: Sequence[Decision], relation: Relation, edges: np.ndarray, looks_reached: bool
) -> Cause:
    """Why a responder is not in its goal state; the first of the reasons that applies."""
    link = (relation.triggers[0].object, relation.triggers[0].link)
    responder = relation.responder
    steps = rollout.steps
    meant = [isinstance(one.answer, Act) and one.answer.responder == responder for one in decisions[: len(steps)]]
    if any(step.success and (step.acted_object, step.acted_link) == link for step in steps):
        return "not noticed" if looks_reached else "wrong prediction"
    if not edges[link[0], responder]:
        return "wrong relation"
    if any(one and step.success for one, step in zip(meant, steps, strict=True)):
        return "wrong prediction"
    on_link = [(step.acted_object, step.acted_link) == link for step in steps]
    if any(one or on for one, on in zip(meant, on_link, strict=True)):
        return "physical failure"
    if looks_reached:
        return "not noticed"
    return "not tried" if _offered(rollout, decisions, link) else "no candidate"


def _offered(rollout: Episode, decisions: Sequence[Decision], link: tuple[int, str]) -> bool:
    """Whether the interaction model proposed a contact on a link, or was not even asked."""
    codes = [number + 1 for number, one in enumerate(rollout.links) if (one.object, one.name) == link]
    for number, decision in enumerate(decisions):
        segmentation = rollout.image(number).segmentation
        assert segmentation is not None
        if decision.proposed is None:
            return True
        if any(int(segmentation[v, u]) in codes for u, v in (contact.pixel for contact in decision.proposed)):
            return True
    return False
