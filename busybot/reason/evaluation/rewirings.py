"""Mechanisms that change during an episode: who notices it, of which responder, and since when. For evaluators only.

Actions have numbers from 0, as in `Rewiring.step`. A rewiring *happened* with the action after which the new mechanism
decides; it *showed* with the first one after which the old mechanism, given the same inputs and the same luck, would
have shown another state. Between the two nobody can tell. It is *found* by whoever believes in it `WITHIN` actions
after it showed, and *placed* by whoever found it and says, at the end, that it happened at most `BESIDE` actions
outside of that time. (Who took the action of noticing for that of happening would be within `WITHIN` whatever happened:
that places nothing.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from busybot.boards.dynamics import Dynamics, DynamicState
from busybot.boards.spec import BoardSpec
from busybot.reason.evaluation.metrics import mean

WITHIN = 5
"""A rewiring counts as found if it is believed in so many actions after it showed."""
BESIDE = 2
"""It counts as placed with at most so many actions between what is said and what may have been."""
BELIEVED = 0.5
"""What is more probable than this is believed."""


@dataclass(frozen=True)
class Rewired:
    """A responder whose mechanism changed: with the action `happened`, to be seen from the action `showed` on."""

    responder: int
    happened: int
    showed: int


@dataclass(frozen=True)
class ChangeBelief:
    """What somebody says of a board of N objects, as `InferredGraph.changed` (T, N) and `.changed_at` (N,)."""

    changed: np.ndarray
    changed_at: np.ndarray


@dataclass(frozen=True)
class JudgedChanges:
    """A belief beside the truth.

    Attributes:
        found, placed: of each rewiring that can be judged.
        off: how many actions lie between what is said and what may have been; None where nothing is said.
        alarms: responders that were believed to have changed, after any action, when they had not.
    """

    found: tuple[bool, ...]
    placed: tuple[bool, ...]
    off: tuple[int | None, ...]
    alarms: int


@dataclass(frozen=True)
class JudgedRewirings:
    """One board's rewirings as a model tells them, and the exact observer.

    Attributes:
        rewired: those that showed and can be judged.
        calm: whether the board has none at all, judged or not.
        told, bound: None where nothing is said, or there is no observer.
    """

    rewired: tuple[Rewired, ...]
    calm: bool
    told: JudgedChanges | None = None
    bound: JudgedChanges | None = None

    @property
    def outspoken(self) -> "JudgedRewirings":
        """Where nothing is said, the same as said by who believes that nothing changed."""
        nothing = (False,) * len(self.rewired)
        return self if self.told else replace(self, told=JudgedChanges(nothing, nothing, (None,) * len(nothing), 0))


def shown_rewirings(dynamics: Dynamics, triggers: np.ndarray, states: Sequence[DynamicState]) -> list[Rewired]:
    """The first rewiring of each responder that showed, in the board's order.

    Args:
        dynamics: of the board, with its luck.
        triggers: int (T + 1, L), states of the trigger links on the new board and after each action.
        states: the T + 1 states of the board that they led to.
    """
    found = []
    for responder, happened in first_steps(dynamics.board).items():
        others = tuple(one for one in dynamics.board.rewirings if one.relation.responder != responder)
        old = Dynamics(dynamics.board.model_copy(update={"rewirings": others}), dynamics.links, dynamics.lucky)
        memories = states[happened].memories if happened < len(states) else ()
        for action in range(happened, len(states) - 1):
            # the old mechanism reads what truly was there, and remembers what it would remember itself
            before = DynamicState(action, states[action].shown, memories)
            might = old.step(tuple(int(state) for state in triggers[action + 1]), before)
            memories = might.memories
            if might.shown[responder] != states[action + 1].shown[responder]:
                found.append(Rewired(responder, happened, action))
                break
    return found


def first_steps(board: BoardSpec) -> dict[int, int]:
    """When each responder's mechanism changes for the first time: `changed` compares with the one at the start."""
    found: dict[int, int] = {}
    for one in sorted(board.rewirings, key=lambda one: one.step):
        found.setdefault(one.relation.responder, one.step)
    return found


def judge_rewirings(
    board: BoardSpec,
    shown: Sequence[Rewired],
    judged: np.ndarray,
    actions: int,
    told: ChangeBelief | None,
    bound: ChangeBelief | None,
) -> JudgedRewirings:
    """Compare beliefs with what happened.

    Args:
        shown: rewirings that showed.
        judged: bool (N,), responders that show in the first frame.
        actions: how many were followed. Rewirings that showed less than `WITHIN` actions before their end are left
            out, whoever found them.
    """
    asked = tuple(one for one in shown if judged[one.responder] and one.showed + WITHIN < actions)
    started = first_steps(board)

    def compare(belief: ChangeBelief | None) -> JudgedChanges | None:
        return None if belief is None else _compared(belief, asked, started, judged, actions)

    return JudgedRewirings(asked, not board.rewirings, compare(told), compare(bound))


def _compared(
    belief: ChangeBelief, asked: Sequence[Rewired], started: dict[int, int], judged: np.ndarray, actions: int
) -> JudgedChanges:
    believed = belief.changed[:actions] > BELIEVED
    found, off = [], []
    for one in asked:
        said = int(belief.changed_at[one.responder])
        row = min(one.showed + WITHIN, len(believed) - 1)
        found.append(bool(believed[row, one.responder]))
        off.append(None if said < 0 else max(one.happened - said, said - one.showed, 0))
    alarms = sum(bool(believed[: started.get(int(one), actions), one].any()) for one in np.flatnonzero(judged))
    placed = tuple(hit and far is not None and far <= BESIDE for hit, far in zip(found, off, strict=True))
    return JudgedChanges(tuple(found), placed, tuple(off), alarms)


KEYS: dict[str, str] = {
    "rewirings": f"mechanisms that changed, so that the old one would have shown another state, at least {WITHIN} "
    "actions before the end. The following are of these",
    "rewired_found, rewired_found_bound": f"share of them that the model, and the exact observer, believes in (p > .5) "
    f"{WITHIN} actions after they first showed, as it tells at the end. Null for models that tell of "
    "changes (`InferredGraph.changed`) on no board; of a board on which it is silent a model says that nothing changed",
    "rewired_placed, rewired_placed_bound": "share of them that are found, and said to have happened at most "
    f"{BESIDE} actions before they did or after they first showed",
    "rewired_off, rewired_off_bound": "of those found, how many actions before or after that time they are said to "
    "have happened, mean",
    "rewired_false_alarms, rewired_false_alarms_bound": "responders that were believed, after any action, to have "
    "another mechanism than at the start while they had not; mean over boards",
    "rewired_false_alarms_calm, rewired_false_alarms_calm_bound": "the same over boards on which nothing is rewired",
}
"""What the figures are called, and what they are."""


def summarise_rewirings(judged: Sequence[JudgedRewirings]) -> dict[str, float | int | None]:
    """All figures of `KEYS`; None where nobody was asked."""
    found: dict[str, float | int | None] = {"rewirings": sum(len(one.rewired) for one in judged)}
    for end, said in (("", [(one, one.told) for one in judged]), ("_bound", [(one, one.bound) for one in judged])):
        known = [(one.calm, changes) for one, changes in said if changes is not None]
        hits = [hit for _, changes in known for hit in changes.found]
        off = [far for _, changes in known for hit, far in zip(changes.found, changes.off, strict=True) if hit]
        found |= {
            f"rewired_found{end}": mean(hits),
            f"rewired_placed{end}": mean([hit for _, changes in known for hit in changes.placed]),
            f"rewired_off{end}": mean([far for far in off if far is not None]),
            f"rewired_false_alarms{end}": mean([changes.alarms for _, changes in known]),
            f"rewired_false_alarms_calm{end}": mean([changes.alarms for calm, changes in known if calm]),
        }
    return found
