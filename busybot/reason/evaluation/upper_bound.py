"""pred_a_bound: what the observed transitions of a board determine, from the truth; for evaluators only.

A transition of a responder is determined when an action on the same trigger link was *seen* to cause it, or to cause
its reverse: the picture to expect is then one that was seen before. Two variants:

- *not knowing* which actions fail: an action on a link is expected to do what the link was seen to do from the
  responder's current state. A failing action is predicted wrongly where that is anything at all. Where several effects
  were seen from this state, the true one counts as determined (contact and direction may tell).
- *knowing* it: a failing action is predicted rightly, the others as above.

An action that held nothing is taken for one on the link that the nearest observed action at the same trigger held, as
far as boxes tell. A reasoner that learns which actions fail can exceed the first variant.
"""

import numpy as np

from busybot.reason.evaluation.ground_truth import StateTruth


def determined(
    truth: StateTruth, contacts: np.ndarray, acted: np.ndarray, observed: int, knowing: bool = False
) -> np.ndarray:
    """Whether each object's state after each step is determined by the steps before `observed`.

    Args:
        contacts: float (T, 3), the actions' positions, board units.
        acted: int (T,), trigger acted on as far as boxes tell, -1 for none.
        observed: number of steps that were seen, the first ones.
        knowing: whether it is known which actions fail.

    Returns:
        bool (T, N).
    """
    links = [
        int(link) if link >= 0 else _aimed_at(truth, contacts, acted, observed, step)
        for step, link in enumerate(truth.links)
    ]
    before, after = truth.states[:-1], truth.states[1:]
    right = np.ones(before.shape, bool)
    for step in range(len(links)):
        seen = np.flatnonzero((truth.links[:observed] == links[step]) & (links[step] >= 0))
        for responder in range(before.shape[1]):
            start, end = before[step, responder], after[step, responder]
            ends = _ends(before[seen, responder], after[seen, responder], start)
            expected = not knowing and len(ends) > 0
            right[step, responder] = end in ends if end != start else not expected
    return right


def _aimed_at(truth: StateTruth, contacts: np.ndarray, acted: np.ndarray, observed: int, step: int) -> int:
    """The link that an action which held nothing was probably meant for, -1 if unknown."""
    near = np.flatnonzero((acted[:observed] == acted[step]) & (acted[step] >= 0))
    near = near[near != step]
    if not len(near):
        return -1
    return int(truth.links[near[np.linalg.norm(contacts[near] - contacts[step], axis=1).argmin()]])


def _ends(before: np.ndarray, after: np.ndarray, start: int) -> set[int]:
    """States that seen transitions, or their reverses, lead to from `start`."""
    changed = before != after
    forward, backward = after[changed & (before == start)], before[changed & (after == start)]
    return {int(state) for state in (*forward, *backward)}
