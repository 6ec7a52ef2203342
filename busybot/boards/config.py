"""Parameters of drawing boards: every number of protocol "Boards" that the paper leaves open, with its default."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from busybot.common.frozen_model import FrozenModel

Count = Annotated[int, Field(ge=0, le=32)]
Range = tuple[Count, Count]

SPLITS: dict[str, Literal["train", "novel"]] = {"train": "train", "novel-config": "train", "novel-object": "novel"}
"""Which instances stand on the boards of each split."""
TASK_DEFAULTS = {"boards": 50, "group_size": 1}
"""Protocol "Planning": 50 tasks of a kind per split."""


class BoardConfig(FrozenModel):
    """One dataset's boards.

    Attributes:
        split: `train` and `novel-config` share the training objects, `novel-object` has the others.
        relations: `any`; `one-to-one` (single-link two-state triggers only); `one-to-many` (at least one
            multi-direction and one multi-link trigger on each board). With tasks they are of the tasks' kind.
        tasks: give every board a task of this kind (`boards.task`); None for boards without.
        switches, lamps, responders, toys: inclusive ranges of counts; `responders` counts lamps and doors together.
        max_objects: more are never placed.
        boards: how many; 50 by default with tasks.
        group_size: consecutive boards that share their appearance and differ in their relations (paper section 3.2);
            1 by default with tasks, so that every task has its own board.
        uniform: draw every instance with the same probability instead of by the library's weights.
        margin: free space around an object's footprint, object units (scaled with the object).
    """

    split: Literal["train", "novel-config", "novel-object"] = "train"
    boards: Annotated[int, Field(ge=1, le=10_000_000)] = 100
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    tasks: Literal["one-to-one", "one-to-many"] | None = None
    relations: Literal["any", "one-to-one", "one-to-many"] = "any"
    switches: Range = (2, 3)
    lamps: Range = (3, 5)
    responders: Range = (5, 6)
    toys: Range = (1, 1)
    max_objects: Annotated[int, Field(ge=2, le=32)] = 10
    group_size: Annotated[int, Field(ge=1, le=10_000)] = 20
    uniform: bool = False
    margin: Annotated[float, Field(ge=0, le=2)] = 0.2

    @model_validator(mode="before")
    @classmethod
    def _with_tasks(cls, values: Any) -> Any:
        """What is not told follows from the kind of the tasks."""
        if not isinstance(values, dict) or not values.get("tasks"):
            return values
        return {"relations": values["tasks"], **TASK_DEFAULTS, **values}

    @model_validator(mode="after")
    def _fits_together(self) -> "BoardConfig":
        if self.tasks is not None and self.relations != self.tasks:
            what = f"relations {self.relations!r} contradict tasks {self.tasks!r}"
            raise ValueError(f"{what}; leave relations out, they follow from the tasks")
        for name in ("switches", "lamps", "responders", "toys"):
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
