"""Results about other worlds than the paper's, as rows that can stand beside each other whoever made them.

Models, graphs that somebody else inferred (`eval reason --graph`), programs that play as text (`play`) and planners are
rows alike. Rows about the same boards make a group.
"""

import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from busybot.common.text import unlinked

PAPER = "paper"
AFTER = (10, 22, 30)
"""Parents are told after so many actions."""
OBSERVER = "exact observer"
OBSERVERS = {"observer": f"{OBSERVER}, truth", "observer-detected": f"{OBSERVER}, detected"}
"""Rows of `benchmarks.tables.worlds` that no learner could be."""
MOST_LETTERS, MOST_DIGITS = 60, 6
"""Of a name, and of a number of actions."""
MOST_COUNTED = 10**9
"""On one board."""
Count = Annotated[int, Field(ge=0, le=MOST_COUNTED)]
_Found = TypeVar("_Found")


class ResultFile(BaseModel):
    """Files have more than a report shows."""

    model_config = ConfigDict(frozen=True, extra="allow", populate_by_name=True)


class Evaluation(ResultFile):
    """Of a command of `busybot`, on a dataset."""

    dataset: dict[str, Any]
    seed: int | None = None
    command: str | None = None


class OnBoards(ResultFile):
    """What was counted on each board."""

    part: list[Count]
    whole: list[Count]

    @model_validator(mode="after")
    def _of_the_same_boards(self) -> "OnBoards":
        if len(self.part) != len(self.whole):
            raise ValueError("part and whole are of other numbers of boards")
        return self


class _OfWorld(Evaluation):
    world: str
    commit: str | None = None


class _Parents(ResultFile):
    """Parents claimed, as pairs of objects and as links."""

    parent_p: float | None = None
    parent_r: float | None = None
    parent_f1: float | None = None
    parent_f1_bound: float | None = None
    link_parent_p: float | None = None
    link_parent_r: float | None = None
    link_parent_f1: float | None = None
    link_parent_f1_bound: float | None = None


class _Curve(_Parents):
    """Parents claimed after so many actions."""

    actions: Count


class _Judged(_OfWorld, _Parents):
    boards: int
    shd: float | None = None


class WorldReason(_Judged):
    """Of `busybot eval reason`."""

    model: str | None
    images: int
    given: bool = False
    boxes: str = "given"
    discovery: list[_Curve] = []
    actions_until_found: int | None = None
    actions_until_found_bound: int | None = None
    mechanism_accuracy: float | None = None
    mechanism_bound: float | None = None
    pred_a: float | None = None
    gap: float | None = None
    what_if: float | None = None
    ece_uncertain: float | None = None
    uncertain_pairs: int | None = None
    rewirings: int | None = None
    rewired_found: float | None = None
    rewired_placed: float | None = None
    rewired_false_alarms: float | None = None
    rewired_found_bound: float | None = None
    rewired_placed_bound: float | None = None
    rewired_false_alarms_bound: float | None = None
    proposal_p: float | None = None
    proposal_r: float | None = None
    by_board: dict[str, OnBoards] = {}


class Played(_Judged):
    """Of `busybot play`."""

    agent: str
    most_actions: int
    actions_used: float | None = None
    early_stops: int = 0
    wrong_early_stops: float | None = None
    refused: int = 0
    ends: dict[str, int] = {}


class PlannedAgent(ResultFile):
    """One agent on the tasks."""

    success: float | None
    interval: tuple[float, float] | None = None
    solved: float | None = None
    steps_over_shortest: float | None = None


class WorldPlan(_OfWorld):
    """Of `busybot eval plan`."""

    tasks: int
    reasoner: str
    agents: dict[str, PlannedAgent]
    by_locks: dict[str, dict[str, float | None]] = {}


class _Choice(ResultFile):
    """One way of choosing actions."""

    boards: int
    f1: list[float]
    until: float
    regret: float | None = None


class Curiosity(ResultFile):
    """Of `benchmarks.studies.curiosity`: by world, by kind of boards, by way of choosing."""

    rows: dict[str, dict[str, dict[str, _Choice]]]
    assets: str | None = None


class _Level(ResultFile):
    p: float | None = None
    r: float | None = None
    f1: float | None = None


class _TableRow(ResultFile):
    boards: int
    object: dict[str, _Level]
    link: dict[str, _Level] = {}
    mechanism_accuracy: float | None = None
    pred_a: float | None = None
    what_if: float | None = None
    ece_uncertain: float | None = None
    uncertain_pairs: int | None = None


class _Uncertain(ResultFile):
    """How far doubtful beliefs are off after so many images."""

    ece_uncertain: float | None = None
    uncertain_pairs: int | None = None


class _Gate(ResultFile):
    """Of `benchmarks.tables.world_gates`: a model on a set of a world."""

    boards: int
    after: dict[str, _Parents]
    uncertain: list[_Uncertain] = []
    parent_p: float | None = None
    parent_r: float | None = None
    mechanism_accuracy: float | None = None
    mechanism_bound: float | None = None
    pred_a: float | None = None
    what_if: float | None = None
    rewirings: int | None = None
    rewired_found: float | None = None
    rewired_placed: float | None = None
    rewired_false_alarms: float | None = None
    rewired_found_bound: float | None = None
    rewired_placed_bound: float | None = None

    @property
    def _worst(self) -> _Uncertain:
        """Where doubtful beliefs are off most."""
        return max(self.uncertain, key=lambda one: one.ece_uncertain or 0.0, default=_Uncertain())

    @property
    def ece_uncertain(self) -> float | None:
        return self._worst.ece_uncertain

    @property
    def uncertain_pairs(self) -> int | None:
        return self._worst.uncertain_pairs


class _TableParts(ResultFile):
    """Of a world in a file of `benchmarks.tables.worlds`; what has no pairs of objects is no row of a report's."""

    rows: dict[str, dict[str, Any]] = {}
    discovery: dict[str, dict[str, Any]] = {}
    learned: dict[str, dict[str, Any]] = {}


class _Tables(ResultFile):
    rows: dict[str, _TableParts] | None = None


class _Gates(ResultFile):
    camera: str = "clean"
    rows: dict[str, dict[str, dict[str, _Gate]]] | None = None


class _PlannedWorld(ResultFile):
    """Of `benchmarks.tables.world_plans`: the tasks of a world."""

    tasks: int
    agents: dict[str, PlannedAgent]
    by_locks: dict[str, dict[str, float | None]] = {}


class WorldPlans(ResultFile):
    """Of `benchmarks.tables.world_plans`, by world."""

    history: str = "scripted"
    rows: dict[str, _PlannedWorld]


@dataclass(frozen=True)
class WorldRow:
    """Who found what on the boards of a group; shares from 0 to 1, None where nobody was asked.

    Attributes:
        objects, links: precision, recall and F1 of parents by number of actions.
        curve: F1 of parents (pairs of objects) by number of actions.
        bound: whether this is no learner, but what the recordings determine.
        found: the result, for what else it tells.
    """

    name: str
    boards: int
    objects: Mapping[int, tuple[float | None, float | None, float | None]]
    links: Mapping[int, tuple[float | None, float | None, float | None]]
    curve: tuple[tuple[int, float], ...] = ()
    bound: bool = False
    found: WorldReason | _TableRow | _Gate | None = None


@dataclass
class WorldResults:
    """All that was given, by file.

    Attributes:
        tables: of `benchmarks.tables.worlds`, by file, by world in words, by name of the row.
        gates: of `benchmarks.tables.world_gates`, by file, by world and set in words, by name of the model.
        plan_tables: of `benchmarks.tables.world_plans`, by file.
    """

    reason: dict[str, WorldReason] = field(default_factory=dict)
    played: dict[str, Played] = field(default_factory=dict)
    plans: dict[str, WorldPlan] = field(default_factory=dict)
    curiosity: dict[str, Curiosity] = field(default_factory=dict)
    tables: dict[str, dict[str, dict[str, _TableRow]]] = field(default_factory=dict)
    gates: dict[str, dict[str, dict[str, _Gate]]] = field(default_factory=dict)
    plan_tables: dict[str, WorldPlans] = field(default_factory=dict)

    def __bool__(self) -> bool:
        known = (self.reason, self.played, self.plans, self.curiosity, self.tables, self.gates, self.plan_tables)
        return any(known)

    def take(self, file: str, value: dict[str, Any]) -> bool:
        """Keep a file's content if it is about other worlds.

        Raises:
            pydantic.ValidationError: it is not what results of its kind are.
        """
        other = value.get("world", PAPER) not in ("", PAPER)
        match value["kind"]:
            case "reason" if other:
                self.reason[file] = WorldReason.model_validate(value)
            case "plan" if other:
                self.plans[file] = WorldPlan.model_validate(value)
            case "play":
                self.played[file] = Played.model_validate(value)
            case "curiosity":
                self.curiosity[file] = Curiosity.model_validate(value)
            case "worlds":
                self.tables[file] = _table_rows(value)
            case "world-gates":
                self.gates[file] = _gate_rows(value)
            case "world-plans":
                self.plan_tables[file] = WorldPlans.model_validate(value)
            case _:
                return False
        return True

    def groups(self) -> dict[str, list[WorldRow]]:
        """Rows about the same boards, in the order in which they were given; what recordings determine comes last.

        Where several files have rows of such words, each file's rows stand for themselves.
        """
        found: dict[str, list[WorldRow]] = {}
        for words, results in self._by_recording().items():
            found[words] = [_row(result) for result in results]
            followed = max(results, key=lambda result: len(result.discovery))
            if followed.parent_f1_bound is not None:
                found[words].append(_bound_row(followed))
        for words, rows in _by_file(self.tables):
            found.setdefault(words, []).extend(_rows(rows))
        for words, models in _by_file(self.gates):
            found.setdefault(words, []).extend(_judged_rows(models))
        return found

    def _by_recording(self) -> dict[str, list[WorldReason]]:
        """Evaluations by what was recorded, in words: who acted is told where others acted on the same boards."""
        recordings: dict[str, dict[str, list[WorldReason]]] = {}
        for result in self.reason.values():
            recordings.setdefault(boards_of(result), {}).setdefault(_content(result), []).append(result)
        found: dict[str, list[WorldReason]] = {}
        for words, own in recordings.items():
            for content, results in own.items():
                name = f"{words}, {_who_acted(results[0], content)}" if len(own) > 1 else words
                found.setdefault(name, []).extend(results)
        return found

    def understood(self, world: str, reasoner: str, board_hash: object) -> float | None:
        """The mechanism accuracy of a reasoner in a world, given boxes; on these boards if it was measured there."""
        known = [
            (one.dataset.get("board_hash") == board_hash, one.mechanism_accuracy)
            for one in self.reason.values()
            if (one.world, one.model, one.boxes) == (world, reasoner, "given") and one.mechanism_accuracy is not None
        ]
        same = [share for same, share in known if same] or [share for _, share in known]
        return sum(same) / len(same) if same else None

    def files(self) -> Iterator[tuple[str, WorldReason | Played | WorldPlan]]:
        """What says on which boards it was measured."""
        yield from self.reason.items()
        yield from self.played.items()
        yield from self.plans.items()


def told_apart(files: Collection[str]) -> dict[str, str]:
    """A name for each file that is as short as can be: its place in the folder that all of them lie in."""
    folders = [os.path.dirname(os.path.abspath(file)) for file in files]
    common = os.path.commonpath(folders) if folders else ""
    return {file: _code(os.path.relpath(os.path.abspath(file), common)) for file in files}


def _code(name: str) -> str:
    """A file's name as it may stand in code: it ends no code, and is no link."""
    return str(unlinked(Path(name).as_posix())).replace("`", "")


def _by_file(given: Mapping[str, Mapping[str, _Found]]) -> Iterator[tuple[str, _Found]]:
    """What files have under some words; where several have the same words, their files tell them apart."""
    names, told = told_apart(given), Counter(words for own in given.values() for words in own)
    for file, own in given.items():
        for words, one in own.items():
            yield f"{words}, `{names[file]}`" if told[words] > 1 else words, one


def boards_of(result: _OfWorld) -> str:
    """World and dataset in words; other boards of the same name have another hash."""
    told = result.dataset
    return f"{short(result.world)}: {short(told.get('name'))} ({short(told.get('split'))}), `{digest(told)}`"


def _content(result: WorldReason) -> str:
    return short(str(result.dataset.get("content_hash")).replace("`", ""))


def _who_acted(result: WorldReason, content: str) -> str:
    """Who acted on the boards, and the recording's hash."""
    extra = result.model_extra or {}
    return f"recorded by {short(extra.get('policy') or '?')}, `{content[:8]}`"


def digest(dataset: Mapping[str, Any]) -> str:
    return short(str(dataset.get("board_hash") or "?").replace("`", "")[:8])


def short(name: object) -> str:
    """A name that anybody gave, as long as a column bears."""
    text = " ".join(str(name).split())
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 3]}..."


def name_of(result: WorldReason) -> str:
    """Who is judged, by the name that it gives itself."""
    seen = "" if result.boxes == "given" else f", {short(result.boxes)} boxes"
    return f"{short(result.model)}{' (graphs from files)' if result.given else ''}{seen}"


def _row(result: WorldReason) -> WorldRow:
    points = {one.actions: one for one in result.discovery}
    objects = {n: (one.parent_p, one.parent_r, one.parent_f1) for n, one in points.items()}
    links = {n: (one.link_parent_p, one.link_parent_r, one.link_parent_f1) for n, one in points.items()}
    if not points:  # a graph as it stands at the end
        objects = {result.images - 1: (result.parent_p, result.parent_r, result.parent_f1)}
        links = {result.images - 1: (result.link_parent_p, result.link_parent_r, result.link_parent_f1)}
    curve = tuple((n, one.parent_f1) for n, one in points.items() if one.parent_f1 is not None)
    return WorldRow(name_of(result), result.boards, objects, links, curve, False, result)


def _bound_row(result: WorldReason) -> WorldRow:
    points = {one.actions: one for one in result.discovery}
    objects = {n: (None, None, one.parent_f1_bound) for n, one in points.items()}
    links = {n: (None, None, one.link_parent_f1_bound) for n, one in points.items()}
    if not points:
        objects = {result.images - 1: (None, None, result.parent_f1_bound)}
        links = {result.images - 1: (None, None, result.link_parent_f1_bound)}
    curve = tuple((n, one.parent_f1_bound) for n, one in points.items() if one.parent_f1_bound is not None)
    told = {"mechanism_accuracy": result.mechanism_bound}
    bounds = ("rewired_found", "rewired_placed", "rewired_false_alarms", "actions_until_found")
    told |= {key: getattr(result, f"{key}_bound") for key in bounds}
    empty = dict.fromkeys(("gap", "pred_a", "what_if", "ece_uncertain", "uncertain_pairs", "proposal_r"))
    found = result.model_copy(update={**empty, **told})
    return WorldRow(OBSERVER, result.boards, objects, links, curve, True, found)


def _table_rows(value: dict[str, Any]) -> dict[str, dict[str, _TableRow]]:
    """By world in words, rows of all parts but for what was chosen and counted on the way."""
    found: dict[str, dict[str, _TableRow]] = {}
    for world, parts in (_Tables.model_validate(value).rows or {}).items():
        rows = parts.rows | parts.discovery | parts.learned
        own = {name: _TableRow.model_validate(row) for name, row in rows.items() if "object" in row}
        found[f"{world}: benchmarks.tables.worlds"] = own
    return found


def _gate_rows(value: dict[str, Any]) -> dict[str, dict[str, _Gate]]:
    """By world and set in words; what was seen by another camera says so."""
    told = _Gates.model_validate(value)
    seen = "" if told.camera == "clean" else f", camera {short(told.camera)}"
    return {
        f"{short(world)}: {short(name)}, frozen{seen}": models
        for world, sets in (told.rows or {}).items()
        for name, models in sets.items()
    }


def is_count(name: str) -> bool:
    """Whether a name in a file is a number of something."""
    return name.isdecimal() and len(name) <= MOST_DIGITS


def _by_actions(told: Mapping[str, _Found]) -> dict[int, _Found]:
    """By the numbers that names are; others are left out."""
    return {int(n): one for n, one in told.items() if is_count(n)}


def _judged_rows(models: Mapping[str, _Gate]) -> list[WorldRow]:
    """A row for each model, and what the recordings determine."""
    found = []
    for name, one in models.items():
        points = _by_actions(one.after)
        objects = {
            n: (*((one.parent_p, one.parent_r) if n == AFTER[1] else (None, None)), told.parent_f1)
            for n, told in points.items()
        }
        links = {n: (None, None, told.link_parent_f1) for n, told in points.items()}
        found.append(WorldRow(short(name), one.boards, objects, links, found=one))
    if models:
        first = next(iter(models.values()))
        points = _by_actions(first.after)
        objects = {n: (None, None, told.parent_f1_bound) for n, told in points.items()}
        links = {n: (None, None, told.link_parent_f1_bound) for n, told in points.items()}
        known = {"mechanism_accuracy": first.mechanism_bound, "rewirings": first.rewirings, "boards": first.boards}
        known |= {"rewired_found": first.rewired_found_bound, "rewired_placed": first.rewired_placed_bound}
        bound = _Gate.model_validate({**known, "after": {}})
        found.append(WorldRow(OBSERVER, first.boards, objects, links, bound=True, found=bound))
    return found


def _rows(rows: Mapping[str, _TableRow]) -> list[WorldRow]:
    def level(told: Mapping[str, _Level]) -> dict[int, tuple[float | None, float | None, float | None]]:
        return {n: (one.p, one.r, one.f1) for n, one in _by_actions(told).items()}

    found = []
    for name, row in rows.items():
        objects = level(row.object)
        curve = tuple((n, f1) for n, (_, _, f1) in objects.items() if f1 is not None)
        words, bound = OBSERVERS.get(name, short(name)), name in OBSERVERS
        found.append(WorldRow(words, row.boards, objects, level(row.link), curve, bound, row))
    return sorted(found, key=lambda row: row.bound)
