"""Lists the commands and interrupted works that `same_results` runs, by name, and compares what two checkouts gave.

In commands `data/NAME` is a dataset of `DATASETS`, `tiny` a copy of the one that the repository ships, and `{real}` the
folder of the annotated PartNet-Mobility objects. The comparison is exact, except for what `UNCOMPARED` names, for the
cases of `ROUNDED` and for the tensors of `UNDETERMINED`.
"""

import copy
import fnmatch
import itertools
import json
import math
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from benchmarks.runner import settings

Facts = Any  # JSON values

SPLITS, ASSETS = ("train", "novel-config", "novel-object"), ("procedural", "{real}")
WIRINGS = ("relations one-to-one", "relations one-to-many", "tasks one-to-one", "tasks one-to-many")
BOARDS = {
    f"{split}, {assets.strip('{}')}, {wiring}": f"--split {split} --assets {assets} --{wiring}"
    for split, assets, wiring in itertools.product(SPLITS, ASSETS, WIRINGS)
}
"""Boards alone: what is given to `generate`, by name."""

DATASETS = {
    "random": ("--split train", "--policy random --steps 6"),
    "random, 2 workers": ("--split train", "--policy random --steps 6 --workers 2"),
    "scripted, png": ("--split train --relations one-to-many", "--policy scripted --steps 8 --images png"),
    "learned": ("--split novel-config --relations one-to-one", "--policy learned --steps 6"),
    "learned, 2 workers": ("--split novel-config --relations one-to-one", "--policy learned --steps 6 --workers 2"),
    "learned, strict": ("--split novel-object --relations one-to-many", "--policy learned --steps 6 --strict"),
    "real, random, png": ("--split novel-config --assets {real}", "--policy random --steps 6 --images png"),
    "real, scripted": ("--split train --relations one-to-many --assets {real}", "--policy scripted --steps 10"),
    "real, learned": ("--split novel-object --relations one-to-one --assets {real}", "--policy learned --steps 6"),
    "tasks": ("--split train --tasks one-to-many", "--policy scripted --steps 10"),
    "tasks, novel": ("--split novel-config --tasks one-to-one", "--steps 8"),
    "real, tasks": ("--split novel-object --tasks one-to-many --assets {real}", "--steps 8"),
}
"""Recorded datasets of two boards: what is given to `generate` and to `collect`, by name."""

MODES, REASONERS = ("evaluate", "greedy", "ucb", "collect"), ("event", "count", "pc", "lookup", "persistence")
AGENTS = "search,busybot,predictive,relation,random,noop,oracle,search-true-relations,search-true-contacts"
EVALUATIONS = {
    **{f"interact, {mode}": f"interact 'data/learned, strict' --mode {mode} --set actions=4" for mode in MODES},
    "interact, random": "interact data/learned --model random --set actions=4",
    "interact, scripted": "interact data/learned --model scripted --set actions=4",
    "interact, strict": "interact data/learned --strict --set actions=4",
    "interact, real": "interact 'data/real, learned' --set actions=4",
    "interact, real, ucb, strict": "interact 'data/real, learned' --mode ucb --strict --set actions=4",
    **{f"reason, {model}": f"reason tiny --images 9 --model {model}" for model in REASONERS},
    "reason, event, decoders": "reason 'data/scripted, png' --images 6 --decoders tiny",
    "reason, event, real": "reason 'data/real, scripted' --images 7",
    "reason, lookup, real": "reason 'data/real, scripted' --images 7 --model lookup",
    "plan": f"plan 'data/tasks, novel' --agents {AGENTS}",
    "plan, lookup": "plan data/tasks --model lookup --agents search,busybot,predictive,search-true-both",
    "plan, real": f"plan 'data/real, tasks' --agents {AGENTS}",
}
"""`busybot eval` with shipped models and baselines, by name."""


@dataclass(frozen=True)
class Work:
    """Work that is done three times: at one go; until it is killed; and from there to its end.

    Attributes:
        command: `{out}` stands for its folder.
        killed_at: it is killed when each of these patterns matches a file in its folder that is not empty.
        generate: the folder is a dataset, generated so.
        judged: command that judges the model that comes of it, `{model}`.
    """

    command: str
    killed_at: tuple[str, ...]
    generate: str = ""
    judged: str = ""

    @property
    def evaluates(self) -> bool:
        """Whether it is an evaluation, which only the version that began it continues."""
        return JUDGED_BOARD in self.killed_at


def setting(*values: str) -> str:
    return shlex.join(settings(*values))


SMALL_PICTURES = setting("render.width=160", "render.height=120")
FAST = setting(
    *("interaction.delta=30", "validation=2", "validation_steps=8", "position.checkpoint=4", "direction.checkpoint=4"),
    "rounds=[{boards: 6, steps: 12, position: 12, direction: 12}, {boards: 3, steps: 6, position: 12, direction: 12}]",
)
PAPER = setting(
    *("epochs=3", "boards=3", "steps=12", "random_epochs=0", "all_directions_epochs=1", "joint_epochs=1", "threads=1"),
    *("checkpoint=1", "interaction.reward=joints", "position.epsilon_epochs=1", "direction.epsilon_epochs=1"),
    *("position.batch=2", "position.iterations=2", "direction.batch=2", "direction.iterations=2"),
)
EVENT = setting("iterations=24", "batch=4", "images=6", "loop.judge=4", "loop.report=4", "loop.held_out=0.2")
WIDTHS = ("embedding", "edge_embedding", "action", "hidden", "convolution", "recurrent")
GRAPH = setting(
    *("images=6", "epochs=4", "batch=4", "threads=1", "loop.judge=2"), *(f"network.{width}=8" for width in WIDTHS)
)
AGENT = setting("iterations=16", "loop.judge=4", "loop.report=4", "net.hidden=16", "net.token=16")
BC, PPO = setting("batch=4"), setting("batch=16", "envs=2", "steps=16")

EPISODE, CHECKPOINT, JUDGED_BOARD = "episodes/000000.mcap", "checkpoints/*.safetensors", "boards.jsonl"
JUDGE_INTERACT = f"eval interact data/learned --model {{model}} --boards 1 --set actions=3 {SMALL_PICTURES}"
JUDGE_REASON = "eval reason tiny --images 9 --model {model}"
WORKS = {
    "collect-random": Work(
        "collect {out} --policy random --steps 6", (EPISODE,), "--split novel-object --boards 4 --group-size 1"
    ),
    "collect-learned": Work(
        "collect {out} --steps 6", (EPISODE,), "--split train --tasks one-to-one --boards 3 --group-size 1"
    ),
    "eval-interact": Work("eval interact data/learned --set actions=4 --out {out}", (JUDGED_BOARD,)),
    "eval-plan": Work("eval plan 'data/tasks, novel' --agents search,busybot,random --out {out}", (JUDGED_BOARD,)),
    "interact-fast": Work(
        f"train interact --out {{out}} {SMALL_PICTURES} {FAST}", ("rounds/01/" + EPISODE,), judged=JUDGE_INTERACT
    ),
    "interact-paper": Work(
        f"train interact --model paper --out {{out}} {SMALL_PICTURES} {PAPER}",
        ("rounds/002/" + EPISODE, CHECKPOINT),
        judged=JUDGE_INTERACT,
    ),
    "reason-event": Work(f"train reason --out {{out}} --data tiny {EVENT}", (CHECKPOINT,), judged=JUDGE_REASON),
    "reason-paper": Work(
        f"train reason --model paper --out {{out}} --data tiny {GRAPH}", (CHECKPOINT,), judged=JUDGE_REASON
    ),
    "bc": Work(
        f"train bc --out {{out}} --data data/tasks {AGENT} {BC}",
        (CHECKPOINT,),
        judged="eval plan 'data/tasks, novel' --boards 1 --agents bc={model}",
    ),
    "ppo": Work(
        f"train ppo --out {{out}} --data data/tasks {AGENT} {PPO}",
        (CHECKPOINT,),
        judged="eval plan 'data/tasks, novel' --boards 1 --agents ppo={model}",
    ),
}
"""Datasets, evaluations and trainings that can be interrupted."""

OTHERS = {
    "tiny, verify": "dataset verify tiny --workers 1",
    "tiny, info": "dataset info tiny",
    "tiny, replay": "replay tiny/episodes/000003.mcap --step 5",
    "tiny, regenerate": "dataset regenerate tiny --out tiny-again --workers 1",
    "tiny, info of what is regenerated": "dataset info tiny-again",
    **{
        name.format(version): command.format(version)
        for version in ("1.0", "1.1")
        for name, command in (
            ("schema {}, verify", "dataset verify fixtures/{}/dataset --workers 1"),
            ("schema {}, info", "dataset info fixtures/{}/dataset"),
            ("schema {}, recording without simulator", "view fixtures/{0}/real.mcap --save {0}.rrd"),
        )
    },
    "diff": "dataset diff data/random 'data/random, 2 workers' --workers 1",
    "freeze": "dataset freeze 'data/scripted, png' --workers 1",
    "verify what is frozen": "dataset verify 'data/scripted, png' --workers 1",
    **{
        f"features, {encoder}": f"features tiny --encoder {encoder} --parquet {encoder}.parquet --workers 1"
        for encoder in ("embedded", "random-box", "random-mask")
    },
    "models, list": "models list",
    "models, verify": "models verify",
    "models, verify old ones": f"models verify {' '.join(f'old/straight/{one}' for one in WORKS if WORKS[one].judged)}",
    "report": "report results --out report",
    "report of old results": "report old/results --out old-report",
}
"""Other commands, in the order in which they need each other."""

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
MEANT = {"other/report of old results": "results name their kind since, and a report does not guess it"}
"""Cases that are not compared, and why."""
UNDETERMINED = {"*/reason-event": "effects.attend.bias"}
"""A tensor of a newly trained model, by case: it adds the same to all scores of a softmax, which ignores that, so its
gradient is nothing but rounding. Its shape is compared, its values are not."""
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


def undetermined(case: str, place: str) -> bool:
    """Whether a number of a case may be any: it is a value of a tensor that training does not determine."""
    tensors = [tensor for pattern, tensor in UNDETERMINED.items() if fnmatch.fnmatchcase(case, pattern)]
    return may_round(case) and any(place.startswith(f".weights.weights.safetensors.{tensor}.") for tensor in tensors)


def stripped(facts: Facts) -> Facts:
    """Without what is not compared."""
    if isinstance(facts, dict):
        return {key: stripped(value) for key, value in facts.items() if key not in UNCOMPARED}
    return [stripped(value) for value in facts] if isinstance(facts, list) else facts


def differences(first: Facts, second: Facts, place: str = "", scale: float = 0.0) -> Iterator[tuple[str, float]]:
    """What differs: the place with both values, and by how much (relative; infinite where one is not a float, or none
    that is a number).

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
    elif isinstance(first, float) and isinstance(second, float):
        if first != second and not (math.isnan(first) and math.isnan(second)):
            by = abs(first - second) / (scale or max(abs(first), abs(second)))
            yield f"{place}: {first!r} and {second!r}", math.inf if math.isnan(by) else by
    elif first != second or type(first) is not type(second):
        yield f"{place}: {json.dumps(first)[:300]} and {json.dumps(second)[:300]}", math.inf


def tell(case: str, first: Facts, second: Facts) -> int:
    """Print what differs in a case; returns how many differences are too many."""
    found = [
        (place, by)
        for place, by in differences(stripped(first), stripped(second))
        if not (by < math.inf and undetermined(case, place))
    ]
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
    """Print all differences; returns the number of those that are not `MEANT`."""
    for case, why in MEANT.items():
        if first.get(case) != second.get(case):
            print(f"{case}: differs, as it should: {why}")
    first, second = ({case: value for case, value in facts.items() if case not in MEANT} for facts in (first, second))
    wrong = within(first) + within(second)
    for case in (*first, *(case for case in second if case not in first)):
        if case in first and case in second:
            wrong += tell(case, first[case], second[case])
        else:
            print(f"{case}: only in the {'first' if case in first else 'second'}")
            wrong += 1
    print(f"{len(first)} and {len(second)} cases, {wrong} differences")
    return wrong
