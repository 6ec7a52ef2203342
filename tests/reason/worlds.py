"""Recordings of boards of other worlds without a simulator, and a reasoner that knows the truth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.boards.dynamics import Dynamics, Links, Triggers
from busybot.boards.spec import BoardSpec, LinkRef, Relation
from busybot.episodes.episode import Episode
from busybot.reason.evaluation.decoders import NearestState
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.base import InferredGraph
from tests.episodes.synthetic import make_episode

SWITCHES, LINKS = (0, 3), Links(((0, "link_0"), (3, "link_0")), (2, 2))
"""On the synthetic board; its responders are the lamp 1, the door 2 and the toy 4."""
PUSH = 0
"""Direction that brings a link into its second state; the opposite brings it back."""
TOUCH = {0: (0.1, 0.0, 0.0), 3: (0.9, 0.0, 0.0)}
"""Where each switch is touched."""


def relation(
    kind: str, triggers: Sequence[int], responder: int, states: Sequence[int], **parameters: object
) -> Relation:
    refs = tuple(LinkRef(object=one, link="link_0" if one in SWITCHES else "body") for one in triggers)
    return Relation(
        kind=kind, triggers=refs, responder=responder, stage="single", states=tuple(states), parameters=parameters
    )


def play(relations: Sequence[Relation], presses: Sequence[int | None], world: str = "gates", **more: object) -> Episode:
    """A recording in which these switches, 0 or 3, are pressed one after the other; None touches nothing."""
    episode = make_episode(0, steps=len(presses))
    objects = [
        one.model_copy(update={"states": (0,)}) if one.role == "trigger" else one for one in episode.board.objects
    ]
    board = BoardSpec.model_validate(
        {**dict(episode.board), "objects": objects, "relations": tuple(relations), "world": world, **more}
    )
    dynamics, now = Dynamics(board, LINKS), [0, 0]
    state, steps = dynamics.start(tuple(now)), []
    for step, pressed in zip(episode.steps, presses, strict=True):
        before, shown = tuple(now), state.shown
        if pressed is not None and not dynamics.locked(SWITCHES.index(pressed), state.shown):
            now[SWITCHES.index(pressed)] ^= 1
        state = dynamics.step(tuple(now), state)
        rising = sum(now) > sum(before)
        steps.append(
            replace(
                step, trigger_states_before=before, trigger_states_after=tuple(now), responder_states_before=shown,
                responder_states_after=state.shown, acted_object=-1 if pressed is None else pressed,
                acted_link="" if pressed is None else "link_0", success=tuple(now) != before,
                executed=(PUSH if rising else OPPOSITE[PUSH],), memory_after=state.flat,
                position=TOUCH.get(pressed if pressed is not None else -1, (9.0, 0.0, 0.0)),
            )
        )  # fmt: skip
    return replace(episode, board=board, steps=steps)


def sequence_of(episode: Episode) -> BoardSequence:
    """What a reasoner is given of it: looks are one number that tells the state."""
    first = episode.steps[0]
    states = np.array([first.responder_states_before, *(step.responder_states_after for step in episode.steps)])
    roles = np.array([one.role for one in episode.board.objects])
    actions = [(*step.position, *DIRECTIONS[step.executed[-1]]) for step in episode.steps]
    return BoardSequence(
        looks_of(states) * (roles == "responder")[None, :, None],
        np.zeros((len(roles), 3), np.float32),
        np.array(actions, np.float32),
        np.array([step.acted_object for step in episode.steps]),
        roles == "trigger",
        roles == "responder",
    )


def looks_of(states: np.ndarray) -> np.ndarray:
    """float32 (..., CHANNELS) of states."""
    looks = np.zeros((*states.shape, CHANNELS), np.float32)
    looks[..., 0] = 1 + states
    return looks


def judge_of(sequence: BoardSequence) -> NearestState:
    states = np.where(sequence.responders, sequence.features[..., 0] - 1, -1).astype(int)
    return NearestState(sequence.features, np.maximum(states, 0), states, sequence.responders)


class Knower:
    """Foretells what a board with these relations would show; its links toggle wherever they are touched."""

    name, encoder = "knower", "embedded"

    def __init__(self, episode: Episode, relations: Sequence[Relation] | None = None):
        update = {} if relations is None else {"relations": tuple(relations), "rewirings": ()}
        self._law, self._episode = Dynamics(episode.board.model_copy(update=update), LINKS), episode

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return InferredGraph(self.name, np.zeros((max(1, seen.steps), 5, 5)))

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        raise AssertionError("it is asked what if")

    def what_if(self, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        return np.stack([self._answer(*one) for one in zip(steps, acted, strict=True)])

    def _answer(self, steps: int, acted: np.ndarray) -> np.ndarray:
        recorded = self._episode.steps
        path: list[Triggers] = [
            recorded[0].trigger_states_before,
            *(one.trigger_states_after for one in recorded[:steps]),
        ]
        state, now, told = self._law.run(path)[-1], list(path[-1]), []
        for trigger in acted:
            if trigger >= 0:
                now[SWITCHES.index(trigger)] ^= 1
            state = self._law.step(tuple(now), state)
            told.append(state.shown)
        return looks_of(np.array(told))
