"""A board without pictures: links that are pulled, looks that follow, and the history of somebody who tried them."""

from dataclasses import dataclass, field

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.interact.policy.direction_pairs import pair_scores
from busybot.plan.interfaces import Act, Agent, Contact, DecisionState, PastAction, Stop, TaskContext
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence

UP = int(np.flatnonzero(DIRECTIONS[:, 2] > 0.99)[0])
DOWN = int(OPPOSITE[UP])
RIGHT = int(np.flatnonzero(DIRECTIONS[:, 0] > 0.99)[0])
THRESHOLD = 0.5


@dataclass
class Link:
    """Pulled along z: two states follow one another whichever direction is first, three states in order.

    Attributes:
        trigger: object that it belongs to.
        responder: object that shows its state.
        pixel: where it was held.
        other: where the interaction model proposes to hold it; None for the same place.
        dead: whether it is stuck where it was held.
        sticky: so many actions on it fail before it moves again.
        direction: that moves it up.
    """

    trigger: int
    responder: int
    pixel: tuple[int, int]
    state: int = 0
    states: int = 2
    sticky: int = 0
    other: tuple[int, int] | None = None
    dead: bool = False
    direction: int = UP


@dataclass
class World:
    """Triggers come first, then responders."""

    links: list[Link]
    triggers: int
    responders: int
    rng: np.random.Generator = field(default_factory=lambda: np.random.Generator(np.random.PCG64(1)))

    def features(self, states: list[int] | None = None) -> np.ndarray:
        """Each state of each responder has an axis of its own."""
        found = np.zeros((self.triggers + self.responders, CHANNELS), np.float32)
        found[self.triggers :, 0] = 1
        for number, link in enumerate(self.links):
            state = link.state if states is None else states[number]
            found[link.responder, 1 + state] = 1
        return found

    def contact(self, number: int, step: int = -1, direction: int = UP) -> Contact:
        link = self.links[number]
        pixel = link.other if link.other is not None and step < 0 else link.pixel
        directions = np.full(18, 0.02)
        directions[[direction, OPPOSITE[direction]]] = 0.9, 0.8
        position = np.array([*pixel, 0], np.float32) / 100
        return Contact(pixel, position, link.trigger, number + 1, 0.9, directions, pair_scores(directions), step)

    def pull(self, pixel: tuple[int, int], direction: int) -> tuple[tuple[int, ...], bool]:
        """Directions executed, and whether something changed."""
        for link in self.links:
            if pixel not in (link.pixel, link.other):
                continue
            if link.dead and pixel == link.pixel:
                break
            if link.sticky:
                link.sticky -= 1
                break
            for number, one in enumerate((direction, int(OPPOSITE[direction]))):
                turn = {link.direction: 1, int(OPPOSITE[link.direction]): -1}.get(one, 0)
                if turn and 0 <= link.state + turn < link.states:
                    link.state += turn
                    return (direction, int(OPPOSITE[direction]))[: number + 1], True
        return (direction, int(OPPOSITE[direction])), False

    def briefing(self, actions: list[tuple[int, int]], goal: list[int]) -> TaskContext:
        """The history of actions (link, direction) from the present states, to which the world then returns."""
        start = [(link.state, link.sticky) for link in self.links]
        features, worked = [self.features()], []
        for number, direction in actions:
            executed, moved = self.pull(self.links[number].pixel, direction)
            worked.append(executed[-1] if moved else -1)
            features.append(self.features())
        for link, (state, sticky) in zip(self.links, start, strict=True):
            link.state, link.sticky = state, sticky
        contacts = [self.contact(number, 0) for number, _ in actions]
        rows = [(*contact.position, *DIRECTIONS[one]) for contact, (_, one) in zip(contacts, actions, strict=True)]
        roles = np.arange(self.triggers + self.responders) < self.triggers
        history = BoardSequence(
            features=np.stack(features),
            positions=np.zeros((len(roles), 3), np.float32),
            actions=np.array(rows, np.float32).reshape(-1, 6),
            acted=np.array([contact.trigger for contact in contacts], int),
            triggers=roles,
            responders=~roles,
        )
        pixels = np.array([contact.pixel for contact in contacts], int).reshape(-1, 2)
        return TaskContext(history, pixels, np.array(worked, int), self.features(goal), THRESHOLD, 8)

    def situation(self, briefing: TaskContext, attempts: list[PastAction], repeat: bool = True) -> DecisionState:
        places = [link.pixel for link in self.links]
        steps = [number for number, one in enumerate(briefing.worked) if one >= 0] if repeat else []
        repeats = tuple(
            self.contact(places.index((int(briefing.pixels[k][0]), int(briefing.pixels[k][1]))), k, briefing.worked[k])
            for k in steps
        )
        offered = tuple(self.contact(number) for number in range(len(self.links)))
        return DecisionState(self.features(), tuple(attempts), repeats, lambda: offered, self.rng)

    def play(self, agent: Agent, briefing: TaskContext, repeat: bool = True) -> tuple[list[Act], Stop | None]:
        """At most eight steps."""
        attempts: list[PastAction] = []
        acts: list[Act] = []
        agent.start(briefing)
        for _ in range(briefing.steps):
            answer = agent.decide(self.situation(briefing, attempts, repeat))
            if isinstance(answer, Stop):
                return acts, answer
            acts.append(answer)
            before = self.features()
            executed, moved = self.pull(answer.contact.pixel, answer.direction)
            attempts.append(PastAction(answer.contact, answer.direction, executed, moved, before, self.features()))
        return acts, None

    def states(self) -> list[int]:
        return [link.state for link in self.links]


def two_buttons_and_a_lever() -> World:
    """Trigger 0 has two buttons for responders 2 and 3, trigger 1 a lever for responder 4; 5 is not controlled."""
    return World([Link(0, 2, (10, 10)), Link(0, 3, (40, 10), state=1), Link(1, 4, (200, 50), state=1, states=3)], 2, 4)
