"""Compare what two checkouts gave: exactly, except for what `UNCOMPARED` names and for the cases of `ROUNDED`."""

import copy
import fnmatch
import json
import math
from collections.abc import Iterator
from typing import Any

from benchmarks.reliability.same_results_cases import WORKS

Facts = Any  # JSON values

UNCOMPARED = {
    "seconds": "time",
    "minutes": "time",
    "timing": "time",
    "machine": "the machine",
    "versions": "of other software",
    "commit": "the checkout",
    "kind": "of a result file; older ones have none",
    "bytes": "size on disk: cards are prose, headers may be written in another order",
    "folder": "where a model or a store of features lies",
    "card": "of a model: prose, and parameters that its hash tells already",
    "README.md": "hash of a model's card",
    "hashes": "of models, tasks, histories and data: results say more of themselves than they did",
    "provenance": "policy parameters and hashes of cards; what they do is what the figures say",
    "figures": "names of pictures in a report; of a model, what its hash tells already",
    "html": "where a report lies",
    "markdown": "where a report lies",
    "mend": "advice in an error, as it was called before",
    "exploring_cpu_minutes": "a time",
    "hint": "advice in an error",
}
"""Keys that are neither recorded nor compared, with the reason."""
ROUNDED = ("*/reason-event", "*/reason-paper")
"""Cases whose floats may differ by rounding, because graph networks are trained in them, but not in `old model/...`."""
ROUNDING = 1e-5
"""Relative to the number, for weights to the largest of their tensor."""
FAILED = "the command failed"
"""Key of what a command said that failed."""
TWICE = [
    ("data/random", "data/random, 2 workers"),
    ("data/learned", "data/learned, 2 workers"),
    *((f"straight/{name}", f"continued/{name}") for name in WORKS),
]
"""Pairs of cases that must give the same on one checkout."""


def may_round(case: str) -> bool:
    """Whether floats of a case may differ by rounding."""
    return not case.startswith("old model/") and any(fnmatch.fnmatchcase(case, pattern) for pattern in ROUNDED)


def stripped(facts: Facts) -> Facts:
    """Without what is not compared."""
    if isinstance(facts, dict):
        return {key: stripped(value) for key, value in facts.items() if key not in UNCOMPARED}
    return [stripped(value) for value in facts] if isinstance(facts, list) else facts


def differences(first: Facts, second: Facts, place: str = "", scale: float = 0.0) -> Iterator[tuple[str, float]]:
    """What differs: the place with both values, and by how much (relative; infinite where one is not a float).

    Args:
        scale: floats are compared relative to it; 0 for relative to the larger one of the two.
    """
    if isinstance(first, dict) and isinstance(second, dict):
        scale = float(first.get("largest", 0.0))  # of a tensor
        for key in (*first, *(key for key in second if key not in first)):
            if (key in first) != (key in second):
                yield f"{place}.{key}: only in the {'first' if key in first else 'second'}", math.inf
            else:
                yield from differences(first[key], second[key], f"{place}.{key}", scale)
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for number, (one, two) in enumerate(zip(first, second, strict=True)):
            yield from differences(one, two, f"{place}[{number}]", scale)
    elif isinstance(first, float) and isinstance(second, float) and first != second:
        by = abs(first - second) / (scale or max(abs(first), abs(second)))
        yield f"{place}: {first!r} and {second!r}", by
    elif first != second or type(first) is not type(second):
        yield f"{place}: {json.dumps(first)[:300]} and {json.dumps(second)[:300]}", math.inf


def tell(case: str, first: Facts, second: Facts) -> int:
    """Print what differs in a case; returns how many differences are too many."""
    found = list(differences(stripped(first), stripped(second)))
    allowed = ROUNDING if may_round(case) else 0.0
    wrong = [place for place, by in found if by > allowed]
    for place in wrong[:20]:
        print(f"{case}: {place}")
    if len(wrong) > 20:
        print(f"{case}: and {len(wrong) - 20} more")
    if numbers := [by for _, by in found if by < math.inf]:
        print(f"{case}: {len(numbers)} floats differ, the most by {max(numbers):.1e}; {allowed} is allowed")
    return len(wrong)


def within(facts: dict[str, Facts]) -> int:
    """Print what is wrong in one file: commands that failed, and pairs that are not the same; returns how much."""
    failed = {case: one[FAILED] for case, one in facts.items() if FAILED in one}
    for case, said in failed.items():
        print(f"{case}: failed: {said[:1000]}")
    wrong = len(failed)
    for first, second in TWICE:
        if first in facts and second in facts:
            both = [copy.deepcopy(facts[name]) for name in (first, second)]
            for one in both:
                one.get("info", {}).pop("name", None)  # a folder's
                one.pop("budget", None)  # what a killed run did after its last checkpoint is done again
            wrong += tell(second, *both)
    return wrong


def compare(first: dict[str, Facts], second: dict[str, Facts]) -> int:
    """Print all differences; returns their number."""
    wrong = within(first) + within(second)
    for case in (*first, *(case for case in second if case not in first)):
        if case in first and case in second:
            wrong += tell(case, first[case], second[case])
        else:
            print(f"{case}: only in the {'first' if case in first else 'second'}")
            wrong += 1
    print(f"{len(first)} and {len(second)} cases, {wrong} differences")
    return wrong
