"""Compares the rules of `objects.importing.auto_annotation` with the authors' annotation of the paper's objects.

    python -m benchmarks.studies.import_rules --assets DIR --out benchmarks/results/import_rules.json

Each of the 58 annotated objects is treated as if it were raw: its `object_meta_info.json` is not read by the rules. The
objects come without `semantics.txt`, `mobility_v2.json` and `meta.json`, so the rules go without names, and take the
category from the packaged catalogue. A second pass withholds the category too: then they judge by sizes alone.

The rules' constants were chosen on these very objects, so the figures say how well simple rules can describe what the
authors did, not how well they will do elsewhere; agreement is given for the paper's training and novel objects apart.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runner import finish, one_of, parser
from busybot.common.errors import BusybotError
from busybot.evaluation.results import package_versions
from busybot.objects.importing.auto_annotation import RULES_VERSION, decide
from busybot.objects.importing.importer import annotate
from busybot.objects.importing.raw import read_raw
from busybot.objects.library import Library
from busybot.objects.model import Effect, ObjectModel, catalogue

ANGLE_DEG = 30.0
TURN_DEG = 5.0
STAGES = ("single", "multi")


def angle_deg(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    a, b = np.array(first), np.array(second)
    return float(np.rad2deg(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))))


def turn_deg(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    """Angle of the turn between two unit quaternions, degrees."""
    return float(np.rad2deg(2 * np.arccos(np.clip(abs(np.dot(first, second)), 0, 1))))


def near(directions: tuple[tuple[float, ...], ...], others: tuple[tuple[float, ...], ...]) -> bool:
    """Whether each direction has another one within `ANGLE_DEG`."""
    return all(any(angle_deg(one, other) <= ANGLE_DEG for other in others) for one in directions)


def moved(effect: Effect) -> set[str]:
    """What the effect changes: the painted link, or the joints whose positions differ between its states."""
    if effect.type == "color":
        return {effect.link or ""}
    values = [*(effect.single or ()), *(effect.multi or ())]
    return {joint for index, joint in enumerate(effect.joints) if len({value[index] for value in values}) > 1}


def amounts(effect: Effect, stage: str) -> np.ndarray | None:
    """Values of the joints that move in the stage's states, (states, joints); None if it lacks the stage."""
    values = getattr(effect, stage)
    if values is None or effect.type == "color":
        return None
    columns = [index for index, joint in enumerate(effect.joints) if joint in moved(effect)]
    return np.array([[value[index] for index in columns] for value in values])


def same_amounts(rule: Effect, truth: Effect) -> bool:
    """Whether joints take the same positions in every stage that the annotation has (within 1e-3)."""
    pairs = [(amounts(rule, stage), amounts(truth, stage)) for stage in STAGES]
    return all(
        there is None or (here is not None and here.shape == there.shape and np.allclose(here, there, atol=1e-3))
        for here, there in pairs
    )


Judge = Callable[[ObjectModel, ObjectModel], bool | None]
"""(by the rules, by the annotation) -> agreement; None where the question does not arise."""


def of_triggers(judge: Callable[[ObjectModel, ObjectModel], bool]) -> Judge:
    return lambda rule, truth: (rule.role == "trigger" and judge(rule, truth)) if truth.role == "trigger" else None


def of_effects(judge: Callable[[Effect, Effect], bool], kind: str | None = None) -> Judge:
    def judged(rule: ObjectModel, truth: ObjectModel) -> bool | None:
        if truth.effect is None or kind not in (None, truth.effect.type):
            return None
        return rule.effect is not None and judge(rule.effect, truth.effect)

    return judged


JUDGES: dict[str, Judge] = {
    "role": lambda rule, truth: rule.role == truth.role,
    "category": lambda rule, truth: rule.category == truth.category,
    "scale within 10 %": lambda rule, truth: abs(rule.scale / truth.scale - 1) <= 0.1,
    "scale within 25 %": lambda rule, truth: abs(rule.scale / truth.scale - 1) <= 0.25,
    "upright pose within 5 degrees": lambda rule, truth: turn_deg(rule.orientation, truth.orientation) <= TURN_DEG,
    "triggers: movable links": of_triggers(
        lambda rule, truth: {link.name for link in rule.trigger_links} == {link.name for link in truth.trigger_links}
    ),
    "triggers: two-state or multi-direction": of_triggers(
        lambda rule, truth: [link.kind for link in rule.trigger_links] == [link.kind for link in truth.trigger_links]
    ),
    "triggers: every rule direction within 30 degrees of an annotated one": of_triggers(
        lambda rule, truth: near(rule.directions, truth.directions)
    ),
    "triggers: every annotated direction within 30 degrees of a rule's": of_triggers(
        lambda rule, truth: near(truth.directions, rule.directions)
    ),
    "responders: what changes (painted link, moved joints)": of_effects(
        lambda rule, truth: moved(rule) == moved(truth)
    ),
    "responders: single-stage, multi-stage": of_effects(
        lambda rule, truth: all((getattr(rule, it) is None) == (getattr(truth, it) is None) for it in STAGES)
    ),
    "responders: joint positions (doors, toys)": of_effects(same_amounts, "joint"),
}


def compare(truth: ObjectModel, category_known: bool) -> dict[str, Any]:
    """One object's row: what the rules say, and where they agree."""
    raw = read_raw(truth.folder)
    if not category_known:
        raw = replace(raw, category=None, source="withheld")
    try:
        decision = decide(raw)
        rule = annotate(raw, decision)[1]
    except BusybotError as error:
        reason = error.what.replace(str(truth.folder), truth.key)
        return {"key": truth.key, "refused": reason, "agrees": {name: False for name in JUDGES}}
    verdicts = {name: judge(rule, truth) for name, judge in JUDGES.items()}
    row: dict[str, Any] = {"key": truth.key, "split": catalogue()[truth.key].split, "category": rule.category}
    row |= {"scale": [rule.scale, truth.scale], "notes": list(decision.notes)}
    return row | {"agrees": {name: verdict for name, verdict in verdicts.items() if verdict is not None}}


def shares(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Per question how many of the objects that it concerns agree."""
    verdicts = {name: [row["agrees"][name] for row in rows if name in row["agrees"]] for name in JUDGES}
    return {name: f"{sum(found)} of {len(found)}" for name, found in verdicts.items()}


def brief(row: dict[str, Any]) -> dict[str, Any]:
    """The row with the questions in which it disagrees in place of all verdicts."""
    disagrees = sorted(name for name, verdict in row["agrees"].items() if not verdict)
    return {name: value for name, value in row.items() if name != "agrees"} | {"disagrees": disagrees}


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--assets", type=Path, required=True, help="the 58 annotated objects")
    arguments = options.parse_args(words)
    library = Library.load(arguments.assets)
    known = [compare(model, True) for model in library.objects.values()]
    blind = [compare(model, False) for model in library.objects.values()]
    splits = {split: [row for row in known if catalogue()[row["key"]].split == split] for split in ("train", "novel")}
    result = {
        "objects": len(known),
        "instead_of": {
            "meta.json": "category from the packaged catalogue",
            "semantics.txt, mobility_v2.json": "no names: all moving links of a Switch, the deepest link of a Lamp",
        },
        "agreement": shares(known),
        "agreement_by_split": {split: shares(rows) for split, rows in splits.items()},
        "agreement_without_category": shares(blind),
        "rows": [brief(row) for row in known],
        "rows_without_category": [brief(row) for row in blind if not all(row["agrees"].values())],
    }
    versions = {**package_versions(("numpy",)), "rules": RULES_VERSION}
    finish("import-rules", arguments, result, versions, {"data": {"objects": library.sha256}})
    print(json.dumps({name: result[name] for name in ("agreement", "agreement_without_category")}, indent=2))


if __name__ == "__main__":
    one_of(main)
