"""Results that belong to none of the three tables: what `busybot eval plan`, `benchmarks/reason_robustness.py` and
`pipelines/tables.py` write. Shares are from 0 to 1, as in the files.
"""

from typing import Any

from pydantic import BaseModel, ConfigDict


class Lenient(BaseModel):
    """Files have more than a report shows."""

    model_config = ConfigDict(frozen=True, extra="allow", populate_by_name=True)


class AgentScores(Lenient):
    """One agent on the tasks of a dataset."""

    success: float | None
    interval: tuple[float, float] | None = None
    solved: float | None = None
    steps: float | None = None


class PlanResult(Lenient):
    """What `busybot eval plan` tells.

    Attributes:
        agents: by name.
        kinds: number of tasks by the kind of their relations.
    """

    agents: dict[str, AgentScores]
    kinds: dict[str, int]
    tasks: int
    dataset: dict[str, Any]
    seed: int | None = None
    command: str = ""


class Scores(Lenient):
    """A model on disturbed recordings."""

    edge_f1: float | None
    pred_a: float | None = None


class Disturbed(Lenient):
    """One strength of a disturbance.

    Attributes:
        known: share of steps that could be known in spite of it.
        models: scores by name.
    """

    strength: float
    boards: int
    known: float
    models: dict[str, Scores]


class Disturbance(Lenient):
    """What is done to recordings; older files have no title."""

    what: str
    unit: str
    title: str = ""


class Robustness(Lenient):
    """What `benchmarks/reason_robustness.py` tells.

    Attributes:
        models: the trained ones, by name.
        rows: by disturbance, `undisturbed` among them, in growing strength.
    """

    boards: int
    models: dict[str, Any]
    disturbances: dict[str, Disturbance]
    rows: dict[str, list[Disturbed]]


class Stage(Lenient):
    """One stage of a pipeline."""

    seconds: float
    done: bool


class Stages(Lenient):
    """What the stages of a run took, by their output."""

    machine: dict[str, Any] = {}
    stages: dict[str, Stage]


def training_of(entry: dict[str, Any]) -> dict[str, Any]:
    """A training's provenance with its cost; Table 2 keeps the two beside each other."""
    inner = entry.get("training")
    return {**inner, "cost": entry.get("cost")} if isinstance(inner, dict) else entry


def about(value: dict[str, Any]) -> dict[str, Any]:
    """What a table's file tells of all its rows: assets, machine, commands."""
    commands = value.get("commands")
    told = [one for one in commands if isinstance(one, str)] if isinstance(commands, list) else []
    return {"assets": value.get("assets"), "machine": value.get("machine") or {}, "commands": told}


Other = PlanResult | Robustness | Stages


def other_kind(value: dict[str, Any]) -> type[PlanResult] | type[Robustness] | type[Stages] | None:
    """Which of these kinds a file's content is."""
    if "disturbances" in value and "rows" in value:
        return Robustness
    if isinstance(value.get("stages"), dict):
        return Stages
    return PlanResult if "agents" in value and "kinds" in value and "dataset" in value else None
