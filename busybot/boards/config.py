"""Parameters of drawing boards: every number that the paper leaves open, with its default."""

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from busybot.boards.scenes import SCENES
from busybot.boards.spec import PAPER, without
from busybot.boards.worlds import BUILT, NOVEL, REAL_BOARD, world_named
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel

MOST = 32
"""Of anything that is counted on a board."""
Count = Annotated[int, Field(ge=0, le=MOST)]
Range = tuple[Count, Count]


def _key(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z]+/[A-Za-z0-9_.-]{1,64}", text):
        raise ValueError("no key of an object, as Lamp/cone-01 is one: `busybot assets list` tells them")
    return text


Keys = Annotated[tuple[Annotated[str, AfterValidator(_key)], ...], Field(max_length=32)]

Instances = Literal["train", "novel"]
SPLITS: dict[str, Instances] = {"train": "train", "novel-config": "train", "novel-object": "novel", NOVEL: "train"}
"""Which instances stand on the boards of each split."""
USUAL_LINKS = 6
"""Boards have up to so many links unless more are asked for."""
WORLD_LINKS = (4, USUAL_LINKS)
"""Fewer would be told apart by counting."""
ROOM = 18
"""More are not asked of switches that are drawn by default: two links on each of nine, with ten responders and a toy,
fill a board."""
SCENE_GROUP = 2
"""Boards of a scene that differ in wiring alone: the orderly one and another."""
TASK_DEFAULTS = {"boards": 50, "group_size": 1}
"""Tasks of a kind in a split, as in the paper (section 5.3)."""


class BoardConfig(FrozenModel):
    """One dataset's boards.

    Attributes:
        split: `train` and `novel-config` share the training objects, `novel-object` has the others; `novel-mechanism`
            has the training objects and mechanisms that the other splits do not have.
        world: what decides the responders: `paper`, one of `boards.worlds.WORLDS` or the name of a mechanism; or one of
            `boards.worlds.BUILT`, whose boards have objects of their own.
        relations: `any`; `one-to-one` (single-link two-state triggers only); `one-to-many` (at least one
            multi-direction and one multi-link trigger on each board). With tasks they are of the tasks' kind.
        tasks: give every board a task of this kind (`boards.task`), `reach` in all worlds but the paper's; None for
            boards without.
        links: inclusive range of the number of trigger links on a board; None for what the switches have, in other
            worlds than the paper's 4 to 6. Above six, more switches and responders are drawn by default.
        depth: least and most number of locks behind each other, in worlds that have them.
        plan: tasks of kind `reach` take at most so many actions.
        switches, lamps, responders, toys: inclusive ranges of counts; `responders` counts lamps and doors together.
            Where fewer of these are drawn than the least number of lamps, all are lamps.
        max_objects: more are never placed.
        boards: how many; 50 by default with tasks, 6 in `real-board`.
        group_size: consecutive boards that share their appearance and differ in their relations (paper section 4.2);
            1 by default with tasks, so that every task has its own board (2 in scenes), 6 in `real-board`.
        uniform: draw every instance with the same probability instead of by the library's weights.
        include: keys of objects that stand on every board.
        only: keys of objects beside which no other ones of their categories are drawn.
        margin: free space around an object's footprint, object units (scaled with the object).
    """

    split: Literal["train", "novel-config", "novel-object", "novel-mechanism"] = "train"
    world: Annotated[str, Field(max_length=64)] = PAPER
    boards: Annotated[int, Field(ge=1, le=10_000_000)] = 100
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    tasks: Literal["one-to-one", "one-to-many", "reach"] | None = None
    relations: Literal["any", "one-to-one", "one-to-many"] = "any"
    switches: Range = (2, 3)
    lamps: Range = (3, 5)
    responders: Range = (5, 6)
    toys: Range = (1, 1)
    max_objects: Annotated[int, Field(ge=2, le=32)] = 10
    group_size: Annotated[int, Field(ge=1, le=10_000)] = 20
    uniform: bool = False
    include: Keys = ()
    only: Keys = ()
    margin: Annotated[float, Field(ge=0, le=2)] = 0.2
    links: Range | None = None
    depth: Range = (1, 8)
    plan: Annotated[int, Field(ge=1, le=100)] = 8

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """JSON without keys that say nothing: as before there were worlds."""
        silent: dict[str, Any] = {"world": PAPER, "depth": [1, 8], "plan": 8, "include": [], "only": []}
        # where links have a default, that they are not limited must be said
        silent |= {"links": None} if self.world in (PAPER, *BUILT) else {}
        return without(handler(self), silent)

    @model_validator(mode="before")
    @classmethod
    def _with_tasks(cls, values: Any) -> Any:
        """What is not told follows from the kind of the tasks."""
        if not isinstance(values, dict):
            return values
        found = dict(values)
        if values.get("world") in tuple(SCENES):  # whatever it is: not all that YAML has can be a key
            found = {"group_size": SCENE_GROUP, "links": None, **found}
        match values.get("links"):
            case [int(least), int(most)] if most >= least and most > USUAL_LINKS:
                if least > ROOM and "switches" not in values:
                    what = f"links: at least {least} are more than the {ROOM} for which boards have switches by default"
                    own = "switches (of one to three links each), responders and max_objects"
                    raise ValueError(f"{what}; ask for fewer, or give {own}, too")
                found = {**_room_for(least, most), **found}
        if found.get("world") == REAL_BOARD:
            found = {"boards": 6, "group_size": 6, **found}
        elif found.get("world", PAPER) != PAPER:
            found = {"links": WORLD_LINKS, **found}
        if not values.get("tasks"):
            return found
        return {**({} if values["tasks"] == "reach" else {"relations": values["tasks"]}), **TASK_DEFAULTS, **found}

    @model_validator(mode="after")
    def _fits_together(self) -> "BoardConfig":
        self._world_fits()
        if self.tasks not in (None, "reach") and self.relations != self.tasks:
            what = f"relations {self.relations!r} contradict tasks {self.tasks!r}"
            raise ValueError(f"{what}; leave relations out, they follow from the tasks")
        for name in ("switches", "lamps", "responders", "toys", *(("links",) if self.links else ()), "depth"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name}: the range {low}..{high} is empty")
        if self.switches[0] < 1:
            raise ValueError("switches: a board needs at least one")
        if self.lamps[0] > self.responders[1]:
            raise ValueError(f"lamps: at least {self.lamps[0]} do not fit into at most {self.responders[1]} responders")
        smallest = self.switches[0] + self.responders[0] + self.toys[0]
        if smallest > self.max_objects:
            raise ValueError(f"max_objects: the ranges ask for at least {smallest} objects, {self.max_objects} allowed")
        return self

    @property
    def least_links(self) -> int:
        """Number of trigger links that a board has at the least: each lock holds one, another one opens the first."""
        return max(self.links[0] if self.links else 0, self.depth[0] + 1 if self._always_locked else 0)

    @property
    def _always_locked(self) -> bool:
        return self.world != PAPER and world_named(self.world, self.split == NOVEL).locked == 1

    def _world_fits(self) -> None:
        try:
            paper = self.world == PAPER or not world_named(self.world, self.split == NOVEL)
        except BusybotError as error:
            raise ValueError(f"{error.what}; {error.hint}") from None
        if not paper and self.tasks not in (None, "reach"):
            hint = "leave tasks out" if self.world == REAL_BOARD else "it has --tasks reach"
            raise ValueError(f"the world {self.world!r} has no tasks {self.tasks!r}; {hint}")
        if self.world == REAL_BOARD and self.split == "novel-object":
            raise ValueError(f"the world {self.world!r} has objects of its own; take --split train or novel-config")
        if self.world in BUILT:
            fields = type(self).model_fields
            free = {"split", "world", "boards", "seed", "group_size"}
            free |= {"tasks", "plan"} if self.world in SCENES else set()
            others = [name for name in fields if name not in free and getattr(self, name) != fields[name].default]
            if others:
                raise ValueError(f"the world {self.world!r} has boards of its own; leave {', '.join(others)} out")
        if paper and (self.split == NOVEL or self.tasks == "reach"):
            given = f"split {NOVEL!r}" if self.split == NOVEL else "tasks 'reach'"
            raise ValueError(f"the paper's world has no {given}; name another one: --world gates")
        if not paper and self._always_locked and self.depth[0] <= self.depth[1] < 1:
            raise ValueError(
                f"depth: a board of the world {self.world!r} has at least one lock, {self.depth[1]} allowed"
            )
        if self.links and not paper and self.links[0] <= self.links[1] < self.least_links:
            what = f"{self.depth[0]} locks behind each other need {self.least_links} links"
            raise ValueError(f"{what}, at most {self.links[1]} allowed: give --links {self.least_links}-12")
        if not paper and self.relations != "any":
            raise ValueError(f"the world {self.world!r} has no kinds of relations; leave relations out")


def _room_for(least: int, most: int) -> dict[str, Any]:
    """Counts of objects with so many links: a switch has one to three, and every link has a responder of its own."""
    fewest = max(2, -(-least // 2))
    switches, responders = (fewest, max(fewest, min(most, 6))), (max(5, min(least, 9)), max(6, min(most, 10)))
    return {"switches": switches, "responders": responders, "lamps": (3, 8), "max_objects": 20, "margin": 0.05}
