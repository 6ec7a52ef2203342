"""A board as a game of text: any program acts by lines of JSON, then claims what controls what.

`docs/extending/text-agent.md` has the protocol. Boards move by their law (`boards.dynamics`), without a simulator and
without pictures: contacts are given, three of a hundred actions fail, and a link that is held does not move. The
program is told what could be seen: which object has which links, whether a link moved, and which of a responder's looks
shows, numbered in the order in which they appear.

Another child process is started for each board (`common.line_child`); how many answers it has is bounded here.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import BODY, BoardSpec, LinkRef
from busybot.boards.worlds import links_of
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.line_child import TOLD, Child, NoAnswerError, Reason
from busybot.common.rng import generator
from busybot.common.text import plain
from busybot.objects.library import Library
from busybot.reason.evaluation.causes import (
    CLAIMED,
    candidates_of,
    count_parents,
    parents_at,
    true_links,
)
from busybot.reason.evaluation.hypotheses import board_space
from busybot.reason.evaluation.upper_bound import Observer

PROTOCOL = 1
FAILS = 0.03
"""Share of actions that do not move their link, as in `benchmarks.studies.bounds`."""
MOST_REFUSED = 10
"""A board is over when so many answers were refused."""
MOST_CLAIMS = 4096
STEPS = {"forward": 1, "back": -1}

Pairs = tuple[tuple[int, int], ...]


class _Answer(BaseModel):
    """Keys that are not known are left alone: a program may say why."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Act(_Answer):
    """Moves a link to its next state or the one before; `link` null: waits."""

    link: int | None
    direction: Literal["forward", "back"] = "forward"


class Cause(_Answer):
    """A link, or a responder, that controls a responder."""

    controls: int
    link: int | None = None
    object: int | None = None

    @model_validator(mode="after")
    def _one_cause(self) -> Self:
        if (self.link is None) == (self.object is None):
            raise ValueError("name either `link` or `object` as what controls")
        return self


class Know(_Answer):
    """Claims a graph: the last answer on a board."""

    know: tuple[Cause, ...] = Field(max_length=MOST_CLAIMS, strict=False)


class PlayedBoard(FrozenModel):
    """A judged board, as it is kept in a folder of results.

    Attributes:
        board: its number in the dataset.
        end: how it came to its end; only who knows has claimed something.
        note: what is known of a fault, plain text.
        true, claimed, bound: parents as pairs of objects after the last action; the exact observer's are None where
            none could follow.
        links, links_bound: at the level of links for each object how many parents are rightly claimed, claimed, true.
    """

    board: int
    end: Reason | Literal["knows", "too many refused"]
    note: str
    actions: int
    refused: int
    early: bool
    true: Pairs
    claimed: Pairs
    bound: Pairs | None
    links: tuple[tuple[int, int, int], ...]
    links_bound: tuple[tuple[int, int, int], ...] | None


class RefusedError(Exception):
    """An answer that means nothing here; the message tells the child why."""


@dataclass
class Game:
    """A board that is acted on by name, and what can be seen of it. L trigger links, N objects.

    Attributes:
        trace: states of the trigger links and of all objects, on the new board and after each action.
    """

    board: BoardSpec
    library: Library
    actions: int
    seed: int = 0
    trace: list[tuple[tuple[int, ...], tuple[int, ...]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._models = [self.library.get(placed.key) for placed in self.board.objects]
        self._links = links_of(self._models)
        self._dynamics = Dynamics(self.board, self._links)
        self._triggers = tuple(state for placed in self.board.objects for state in placed.states)
        self._state = self._dynamics.start(self._triggers)
        self._rng = generator(self.seed, self.board.split, self.board.index, "play")
        self._touched: set[int] = set()
        self._responders = [number for number, one in enumerate(self.board.objects) if one.role == "responder"]
        self._looks: dict[int, list[int]] = {number: [] for number in self._responders}
        self.trace.append((self._triggers, self._state.shown))

    @property
    def used(self) -> int:
        """Actions so far."""
        return len(self.trace) - 1

    def opening(self) -> dict[str, Any]:
        """The first observation."""
        objects = []
        for number, placed in enumerate(self.board.objects):
            told: dict[str, Any] = {"object": number, "name": f"{placed.category} {number}", "role": placed.role}
            if placed.role == "responder":
                told["look"] = self._look(number)
            else:
                told["links"] = [k for k, (owner, _) in enumerate(self._links.names) if owner == number]
            objects.append(told)
        return {"event": "board", "protocol": PROTOCOL, "objects": objects, **self.budget()}

    def budget(self) -> dict[str, Any]:
        """What every observation ends with."""
        return {"touched": sorted(self._touched), "actions_left": self.actions - self.used}

    def act(self, answer: Act) -> dict[str, Any]:
        """Execute an action and observe.

        Raises:
            RefusedError: there is no such link, or no action is left.
        """
        link, before = answer.link, self._state.shown
        if self.used >= self.actions:
            raise RefusedError("no action is left: answer with what you know")
        if link is not None and not 0 <= link < len(self._links.sizes):
            raise RefusedError(f"there is no such link: they are 0 to {len(self._links.sizes) - 1}")
        works, moved = self._rng.random() >= FAILS, False
        if link is not None:
            self._touched.add(link)
            there = self._triggers[link] + STEPS[answer.direction]
            moved = works and 0 <= there < self._links.sizes[link] and not self._dynamics.locked(link, before)
            if moved:
                self._triggers = (*self._triggers[:link], there, *self._triggers[link + 1 :])
        self._state = self._dynamics.step(self._triggers, self._state)
        self.trace.append((self._triggers, self._state.shown))
        changed = [number for number in self._responders if self._state.shown[number] != before[number]]
        seen = [{"object": number, "look": self._look(number)} for number in changed]
        did = {"link": link, "direction": answer.direction if link is not None else None, "moved": moved}
        return {"event": "acted", **did, "changed": seen, **self.budget()}

    def claimed(self, know: Know) -> np.ndarray:
        """The claim as bool (I, N): links and responders, as `_inputs` names them, in the rows.

        Raises:
            RefusedError: it names something that is not there.
        """
        links = len(self._links.sizes)
        found = np.zeros((links + len(self._responders), len(self.board.objects)), bool)
        for one in know.know:
            if one.controls not in self._responders or one.object not in (None, *self._responders):
                raise RefusedError(f"`controls` and `object` name responders: {self._responders}")
            if one.object is not None:
                found[links + self._responders.index(one.object), one.controls] = True
            elif one.link is not None and 0 <= one.link < links:
                found[one.link, one.controls] = True
            else:
                raise RefusedError(f"there is no such link: they are 0 to {links - 1}")
        return found

    def judged(self, claimed: np.ndarray, **told: Any) -> PlayedBoard:
        """The claim, bool (I, N), beside the truth and what the same actions told the exact observer."""
        board, last = self.board, max(0, self.used - 1)
        candidates, inputs = candidates_of(board), self._inputs()
        owners = [one.object for one in inputs]
        truth = true_links(board, inputs, last)
        claimed = claimed & candidates[owners]
        pairs = np.zeros_like(candidates)
        np.logical_or.at(pairs, np.array(owners, int), claimed)
        seen = self._observed(owners)
        return PlayedBoard(
            board=board.index,
            actions=self.used,
            true=_pairs(parents_at(board, last) & candidates),
            claimed=_pairs(pairs),
            bound=None if seen is None else _pairs(seen[0] & candidates),
            links=_rows(count_parents(claimed, truth)),
            links_bound=None if seen is None else _rows(count_parents(seen[1], truth)),
            **told,
        )

    def _look(self, number: int) -> int:
        """Number of the look that a responder has, in the order in which its looks appeared."""
        known, shown = self._looks[number], self._state.shown[number]
        if shown not in known:
            known.append(shown)
        return known.index(shown)

    def _inputs(self) -> tuple[LinkRef, ...]:
        names = [*self._links.names, *((number, BODY) for number in self._responders)]
        return tuple(LinkRef(object=number, link=name) for number, name in names)

    def _observed(self, owners: Sequence[int]) -> tuple[np.ndarray, np.ndarray] | None:
        """What the exact observer claims, bool (N, N) and (I, N); None where its space does not explain the board."""
        effects = [model.effect for model in self._models if model.effect is not None]
        stages = [(effect.single is not None, effect.multi is not None) for effect in effects]
        objects = len(self.board.objects)
        pairs, links = np.zeros((objects, objects), bool), np.zeros((len(owners), objects), bool)
        try:
            space, responders = board_space(self.board, self._links.sizes, stages)
            (triggers, shown), *after = [(one, tuple(two[n] for n in responders)) for one, two in self.trace]
            observer = Observer(space, triggers, shown)
            for triggers, shown in after:
                observer.see(triggers, shown)
            belief = observer.belief()
        except BusybotError:
            return None
        pairs[:, responders] = belief.object_parents(owners, objects) > CLAIMED
        links[:, responders] = belief.parents() > CLAIMED
        return pairs, links


def understood(line: bytes) -> Act | Know:
    """What an answer says.

    Raises:
        RefusedError: nothing that is known here.
    """
    try:
        value = json.loads(line)
        return (Know if isinstance(value, dict) and "know" in value else Act).model_validate(value)
    except ValidationError as error:
        raise RefusedError(plain(first_fault(error))[:TOLD]) from None
    except (ValueError, RecursionError):
        raise RefusedError("this is no line of JSON") from None


def play(game: Game, words: Sequence[str], timeout_s: float) -> PlayedBoard:
    """Let a program play a board to its end, and judge what it claims.

    Raises:
        BusybotError: the program cannot be started.
    """
    refused, early, note = 0, False, ""
    end: Reason | Literal["knows", "too many refused"] = "knows"
    claimed = game.claimed(Know(know=()))
    message = game.opening()
    try:
        child = Child(words, timeout_s)
    except OSError as error:
        raise BusybotError(f"{words[0]}: it cannot be started: {error.strerror}", "name a program: --agent") from None
    try:
        while refused < MOST_REFUSED:
            try:
                answer = understood(child.ask(message))
                if isinstance(answer, Know):
                    claimed, early = game.claimed(answer), game.used < game.actions
                    break
                message = game.act(answer)
            except RefusedError as why:
                refused, note = refused + 1, str(why)
                message = {"event": "refused", "why": str(why), **game.budget()}
        else:
            end = "too many refused"
    except NoAnswerError as over:
        end = over.end
    finally:
        said = child.close()
    note = "" if end == "knows" else note if end == "too many refused" else said
    return game.judged(claimed, end=end, note=note, refused=refused, early=early)


def _pairs(matrix: np.ndarray) -> Pairs:
    return tuple((int(cause), int(effect)) for cause, effect in np.argwhere(matrix))


def _rows(counts: np.ndarray) -> tuple[tuple[int, int, int], ...]:
    return tuple((int(right), int(claimed), int(true)) for right, claimed, true in counts)
