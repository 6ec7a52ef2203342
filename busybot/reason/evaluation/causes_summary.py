"""Judged causes of many boards to figures, JSON values; shares from 0 to 1, None where nothing is there to be judged.

`KEYS` says what each figure is (docs/reference/measures.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from busybot.boards.spec import BoardSpec
from busybot.common.rng import generator
from busybot.evaluation.statistics import LEAST_PAIRS, Interval, extreme_interval, two_level_interval
from busybot.reason.evaluation import metrics as m
from busybot.reason.evaluation import rewirings
from busybot.reason.evaluation.causes import ACTIONS, JudgedCauses, JudgedMechanism, count_parents
from busybot.reason.evaluation.hypotheses import NOTHING

CALIBRATED = (4, 8, 12, 16, 22, 30)
"""Numbers of images after which probabilities are judged."""
EARLY = tuple(sorted({*(images - 1 for images in CALIBRATED), 10}))
"""After so many actions a model is asked what it believes with no later picture before it."""
SUREST = 0.001
"""Nobody is surer than this where beliefs are compared with the exact observer's."""
FOUND = 0.95
"""Parents count as found from this F1 on."""

KEYS: dict[str, str] = {
    "parent_p, parent_r, parent_f1": "precision, recall and F1 of parents: directed pairs of objects, links collapsed, "
    "pooled over boards. In worlds in which a responder may move another one (`chain`, `mixed`) pairs of responders "
    "count, too: who cannot claim them misses them",
    "parent_f1_bound": "the same F1 of the exact observer, who sees the true states of the same actions",
    "link_parent_p, link_parent_r, link_parent_f1, link_parent_f1_bound": "the same with trigger links in place of "
    "triggers. Null for models that tell a trigger's links apart on no board; their links are clusters of contacts, "
    "matched to the true ones by most common actions (Hungarian method)",
    "shd, shd_bound": "structural Hamming distance, mean over boards: parents to be added, removed or turned round",
    "mechanism_accuracy": "share of the responders with inputs whose every state is foretold on a tour of 40 further "
    "actions without luck, in which the inputs take all combinations that recorded contacts lead to. Null for models "
    "that predict nothing (`count`, `pc`)",
    "mechanism_bound": "share of which the exact observer claims a mechanism (more probable than all others "
    "together) that responds as the true one does",
    "mechanism_accuracy_met, mechanism_bound_met, mechanisms_met": "both of the responders whose inputs were in all "
    "states in which the tour asks about them, and which share of all that is: pictures do not show that a link has "
    "one more state, the exact observer is told",
    "mechanism_missed_because": "how many of these responders are not foretold for each reason; the first that holds "
    "counts. `not asked`: an input moved nowhere on the tour, and nobody is right there, the exact observer neither; "
    "`parents`: it has other ones (links, where a model tells them apart) than the model claims; `never met`: an input "
    "was never met in a state in which the tour asks about it; `otherwise`. Null as `mechanism_accuracy`",
    "mechanism_by_kind": "both by kind of mechanism, with numbers; `rest` are responders that nothing moves",
    "kind_accuracy, kind_bound, lag_accuracy, lag_bound": "share of all responders whose kind of mechanism, and whose "
    "lag, is named rightly. Null for models that tell them on no board",
    "gap": "`pred_a` minus `mechanism_accuracy`: one can predict without understanding",
    "what_if": "share of pairs of questions answered rightly: what the next up to 4 actions showed, and what they "
    "would have shown had one link not been moved. Only pairs with different answers are asked",
    "what_if_factual, what_if_left_out, what_if_pairs": "the two halves by themselves, and how many pairs there are",
    "what_if_bound": "the share that is told rightly by who knows the board's law and all states, and the luck that "
    "showed; where other luck would have decided, he names what is likelier. Null as `what_if`",
    "what_if_missed_because": "how many pairs are told wrongly for each reason, by the responder that is told wrongly; "
    "the first that holds counts. `luck`: the model tells rightly what it showed and wrongly what it would have shown, "
    "and so does who knows the law (the bound); `rewired`: its mechanism was exchanged before the end of what is asked "
    "about; `parents`: it has others than the model claims; `mechanism`: that is not foretold on the tour either, or "
    "was not asked there; `otherwise`. Null as `what_if`, and without pairs",
    "ece_uncertain, uncertain_pairs": "expected calibration error over the pairs with .05 < p < .95, and how many that "
    f"is; null below {LEAST_PAIRS}, which say too little",
    "ece_by_chance": "what `ece_uncertain` would be on average if every probability were right and each pair stood by "
    "itself: who is perfectly calibrated is above it as often as below",
    "belief_bias, belief_divergence": "how far the model's probabilities of pairs are from the exact observer's, "
    "who is as unsure as the recording leaves anybody. Bias: mean difference over the pairs of which either is "
    "unsure (.05 < p < .95). Divergence: mean Kullback-Leibler divergence from his, nats, over all pairs, where "
    f"nobody counts as surer than 1 - {SUREST}. Which way luck fell does not enter, so both differ less from board to "
    "board than calibration does. Null without the observer",
    "uncertain_by_images": f"the same after {', '.join(map(str, CALIBRATED))} images, of a model that has seen no "
    "more (of proposed objects it knows the places from all that it is to observe)",
    "discovery": "`parent_p`, `parent_r`, `parent_f1`, the same of links and the bounds' F1 after 1 to 40 actions, of "
    "the boards with so many; empty for graphs that somebody else inferred, which tell no earlier ones."
    f" After {', '.join(map(str, EARLY))} actions, and when all was observed, the model has seen no more; after other "
    "numbers it tells afterwards what it had believed, and may have found links and looks in later pictures",
    "actions_until_found, actions_until_found_bound": f"after how many of these actions F1 is at least {FOUND}; null "
    "if it never is",
    **rewirings.KEYS,
    "rewired_missed_because": "of how many rewirings that are not placed this is `not determined` (the exact observer "
    "does not place them, either), of how many the responder's `parents` are not those that are claimed in the end, "
    "how many are `not found` in time, or placed elsewhere (`otherwise`); the first of these that holds counts. Of "
    "boards that the exact observer could follow; null if they have no rewirings, and as `rewired_placed`",
    "bound_boards": "boards that the exact observer could follow; bounds are of these alone",
    "cause_intervals": "95 % intervals by a bootstrap over `boards`; over `objects` (the responders') and their "
    "boards; over `mechanisms` (their kinds) and their boards. Shares of 0 or 1 (not F1) have exact binomial bounds, "
    "each board, object or kind being one trial (each board where all are of one object or kind)",
    "cause_boards": "the figures of each board",
    "by_board": "numerators and denominators on each board, of `parent_f1`, `link_parent_f1` and `mechanism_accuracy`, "
    "too, where they are told, for paired tests between models on the same boards",
}
"""What the figures are called, and what they are."""
PARENTS: m.Shares = {"p": ("hits", "claimed"), "r": ("hits", "true"), "f1": ("twice", "both")}


def summarise_causes(
    judged: Sequence[tuple[BoardSpec, JudgedCauses]], images: int, pred_a: float | None, seed: int
) -> dict[str, Any]:
    """All figures of `KEYS`.

    Args:
        images: how many were observed; parents are those claimed then.
        pred_a: of the same boards.
    """
    boards, causes = [board for board, _ in judged], outspoken([one for _, one in judged])
    steps = images - 1
    followed = [one for one in causes if one.bound is not None]
    mechanisms = [one for each in causes for one in each.mechanisms if one.driven]
    everyone = [one for each in causes for one in each.mechanisms]
    accuracy = m.mean([one.right for one in mechanisms])
    told = [one.told.all(-1) for one in causes if one.told is not None]
    pairs = np.concatenate([np.zeros((0, 2), bool), *told])
    asked = [one.unlucky.any(-1) for one in causes if one.unlucky is not None]
    unlucky = np.concatenate([np.zeros(0, bool), *asked])
    rows = [_row(board, one, steps) for board, one in zip(boards, causes, strict=True)]
    return {
        **{
            f"parent_{name}": share for name, share in m.micro([_counts(one, steps) for one in causes], PARENTS).items()
        },
        "parent_f1_bound": m.micro([_counts(one, steps, bound=True) for one in followed], PARENTS)["f1"],
        **_links(causes, steps),
        "shd": m.mean([_distance(one, steps) for one in causes]),
        "shd_bound": m.mean(
            [
                hamming(one.bound[_at(one, steps)], one.true[_at(one, steps)])
                for one in followed
                if one.bound is not None
            ]
        ),
        "mechanism_accuracy": accuracy,
        "mechanism_bound": m.mean([one.bound for one in mechanisms]),
        "mechanism_accuracy_met": m.mean([one.right for one in mechanisms if one.met]),
        "mechanism_bound_met": m.mean([one.bound for one in mechanisms if one.met]),
        "mechanisms_met": m.mean([one.met for one in mechanisms]),
        "mechanism_missed_because": _missed(causes, steps),
        "mechanism_by_kind": _by_kind(everyone),
        "kind_accuracy": m.mean([one.kind_right for one in everyone]),
        "kind_bound": m.mean([one.kind_bound for one in everyone]),
        "lag_accuracy": m.mean([one.lag_right for one in everyone]),
        "lag_bound": m.mean([one.lag_bound for one in everyone]),
        "gap": None if pred_a is None or accuracy is None else pred_a - accuracy,
        "what_if": m.mean(np.asarray(pairs.all(axis=1))),
        "what_if_factual": m.mean(pairs[:, 0]),
        "what_if_left_out": m.mean(pairs[:, 1]),
        "what_if_bound": m.mean(~unlucky),
        "what_if_pairs": len(pairs) if told else None,
        "what_if_missed_because": _missed_pairs(causes, steps),
        **_uncertain(causes, steps),
        "uncertain_by_images": [{"images": number, **_uncertain(causes, number - 1, True)} for number in CALIBRATED],
        **_discovery(causes),
        **rewirings.summarise_rewirings([one.rewired for one in causes if one.rewired is not None]),
        "rewired_missed_because": _missed_changes(causes),
        "bound_boards": len(followed),
        "cause_intervals": _intervals(boards, causes, steps, seed),
        "cause_boards": rows,
        "by_board": _by_board(causes, steps),
    }


def outspoken(causes: Sequence[JudgedCauses]) -> list[JudgedCauses]:
    """Who tells of links, kinds, lags or changes on one board is judged by them on all, else a model chose on which: of
    a board on which it is silent it knows nothing."""
    everyone = [each for one in causes for each in one.mechanisms]
    kinds = any(each.kind_right is not None for each in everyone)
    lags = any(each.lag_right is not None for each in everyone)
    links = any(one.links is not None for one in causes)
    changes = any(one.rewired is not None and one.rewired.told is not None for one in causes)

    def named(one: JudgedMechanism) -> JudgedMechanism:
        kind = False if kinds and one.kind_right is None else one.kind_right
        return replace(one, kind_right=kind, lag_right=False if lags and one.lag_right is None else one.lag_right)

    return [
        replace(
            one,
            mechanisms=tuple(map(named, one.mechanisms)),
            links=one.links_silent if links and one.links is None else one.links,
            rewired=one.rewired.outspoken if changes and one.rewired is not None else one.rewired,
        )
        for one in causes
    ]


def hamming(claimed: np.ndarray, true: np.ndarray) -> int:
    """Structural Hamming distance of directed graphs, bool (N, N): edges to be added, removed or turned round, each of
    these one step (Tsamardinos, Brown and Aliferis 2006, for graphs without undirected edges)."""
    wrong, missing = claimed & ~true, true & ~claimed
    turned = wrong & missing.T
    return int(wrong.sum() + missing.sum() - turned.sum())


def _at(one: JudgedCauses, steps: int) -> int:
    return min(steps, len(one.true) - 1)


def _counts(one: JudgedCauses, steps: int, bound: bool = False) -> m.Counts:
    """Of one board after so many actions."""
    number = _at(one, steps)
    claimed = one.bound if bound else one.claimed
    assert claimed is not None
    return _of(count_parents(claimed[number], one.true[number]).sum(0) + (0 if bound else _spurious(one, steps, 0)))


def _spurious(one: JudgedCauses, steps: int, level: int) -> np.ndarray:
    """What is claimed of objects that are not there: rightly claimed, claimed and true parents, int (3,)."""
    return np.array([0, 0 if one.spurious is None else one.spurious[_at(one, steps), level], 0])


def _distance(one: JudgedCauses, steps: int) -> int:
    number = _at(one, steps)
    return hamming(one.claimed[number], one.true[number]) + int(_spurious(one, steps, 0)[1])


def _of(counted: np.ndarray) -> m.Counts:
    """Names of `PARENTS` for hits, claimed and true ones."""
    hits, claimed, true = (int(number) for number in counted)
    return {"hits": hits, "claimed": claimed, "true": true, "twice": 2 * hits, "both": claimed + true}


def _link_counts(one: JudgedCauses, steps: int) -> m.Counts | None:
    """As `_counts`, at the level of links; None where they are not told."""
    return None if one.links is None else _of(one.links[_at(one, steps)].sum(0) + _spurious(one, steps, 1))


def _by_board(causes: Sequence[JudgedCauses], steps: int) -> dict[str, dict[str, list[int]]]:
    """As `statistics.compare_boards` takes them."""
    part, whole = PARENTS["f1"]
    told = {"parent_f1": [_counts(one, steps) for one in causes]} if causes else {}
    if any(one.links is not None for one in causes):
        told["link_parent_f1"] = [_link_counts(one, steps) or _of(np.zeros(3)) for one in causes]
    found = {
        name: {"part": [one[part] for one in own], "whole": [one[whole] for one in own]} for name, own in told.items()
    }
    asked = [[each.right for each in one.mechanisms if each.driven and each.right is not None] for one in causes]
    if any(asked):
        found["mechanism_accuracy"] = {"part": [sum(one) for one in asked], "whole": [len(one) for one in asked]}
    return found


def _links(causes: Sequence[JudgedCauses], steps: int) -> dict[str, float | None]:
    told = [counts for counts in (_link_counts(one, steps) for one in causes) if counts is not None]
    bound = [_of(one.links_bound[_at(one, steps)].sum(0)) for one in causes if one.links_bound is not None]
    shares = m.micro(told, PARENTS)
    found = {f"link_parent_{name}": share if told else None for name, share in shares.items()}
    return {**found, "link_parent_f1_bound": m.micro(bound, PARENTS)["f1"]}


def _missed(causes: Sequence[JudgedCauses], steps: int) -> dict[str, int] | None:
    """Why mechanisms are not known, see `KEYS`."""
    judged = [(one, each) for one in causes for each in one.mechanisms if each.driven and each.right is not None]
    counts = dict.fromkeys(("not asked", "parents", "never met", "otherwise"), 0)
    for one, each in judged:
        reasons = {
            "not asked": not each.asked, "parents": each.responder in _misplaced(one, steps),
            "never met": not each.met, "otherwise": True,
        }  # fmt: skip
        if not each.right:
            counts[_first(reasons)] += 1
    return counts if judged else None


def _missed_pairs(causes: Sequence[JudgedCauses], steps: int) -> dict[str, int] | None:
    """Why questions "what if" are not answered, see `KEYS`."""
    judged = [
        (one, *each)
        for one in causes
        if one.told is not None and one.unlucky is not None and one.exchanged is not None
        for each in zip(one.told, one.unlucky, one.exchanged, strict=True)
    ]
    counts = dict.fromkeys(("luck", "rewired", "parents", "mechanism", "otherwise"), 0)
    for one, (happened, otherwise), unlucky, exchanged in judged:
        wrong = set(np.flatnonzero(~(happened & otherwise)).tolist())
        unknown = {each.responder for each in one.mechanisms if not each.right}
        reasons = {
            "luck": (happened & ~otherwise & unlucky).any(), "rewired": wrong & set(np.flatnonzero(exchanged).tolist()),
            "parents": wrong & _misplaced(one, steps), "mechanism": wrong & unknown, "otherwise": wrong,
        }  # fmt: skip
        if wrong:
            counts[_first(reasons)] += 1
    return counts if judged else None


def _missed_changes(causes: Sequence[JudgedCauses]) -> dict[str, int] | None:
    """Why rewirings are not placed, see `KEYS`."""
    counts = dict.fromkeys(("not determined", "parents", "not found", "otherwise"), 0)
    judged = [
        (_misplaced(one, len(one.true) - 1), *each)
        for one in causes
        if one.rewired and one.rewired.told and one.rewired.bound
        for each in zip(
            one.rewired.rewired,
            one.rewired.bound.placed,
            one.rewired.told.found,
            one.rewired.told.placed,
            strict=True,
        )
    ]
    for wrong, change, known, found, placed in judged:
        reasons = {
            "not determined": not known, "parents": change.responder in wrong, "not found": not found,
            "otherwise": True,
        }  # fmt: skip
        if not placed:
            counts[_first(reasons)] += 1
    return counts if judged else None


def _first(reasons: dict[str, Any]) -> str:
    return next(name for name, holds in reasons.items() if holds)


def _misplaced(one: JudgedCauses, steps: int) -> set[int]:
    """Responders whose parents (links, where a model tells them apart) are not those that are claimed."""
    place = _at(one, steps)
    links = count_parents(one.claimed[place], one.true[place]) if one.links is None else one.links[place]
    right, claimed, true = links.T
    return set(np.flatnonzero((right != claimed) | (claimed != true)).tolist())


def _by_kind(mechanisms: Sequence[JudgedMechanism]) -> dict[str, dict[str, Any]]:
    found = {}
    for kind in sorted({one.kind for one in mechanisms}):
        own = [one for one in mechanisms if one.kind == kind]
        shares = {"accuracy": m.mean([one.right for one in own]), "bound": m.mean([one.bound for one in own])}
        found[kind] = {**shares, "responders": len(own)}
    return found


def _uncertain(causes: Sequence[JudgedCauses], steps: int, long_enough: bool = False) -> dict[str, Any]:
    """Calibration of the uncertain pairs after so many actions, if asked only of boards with so many."""
    own = [one for one in causes if len(one.true) > steps or not long_enough]
    said = np.concatenate([np.zeros(0), *(one.probabilities[_at(one, steps)][one.candidates] for one in own)])
    true = np.concatenate([np.zeros(0), *(one.true[_at(one, steps)][one.candidates] for one in own)])
    unsure = m.are_uncertain(said)
    enough, rng = unsure.sum() >= LEAST_PAIRS, generator(0, "evaluation", steps, "reason/calibration by chance")
    return {
        "ece_uncertain": m.calibration_error(said[unsure], true[unsure]) if enough else None,
        "ece_by_chance": m.calibration_error_by_chance(said[unsure], rng) if enough else None,
        "uncertain_pairs": int(unsure.sum()),
        **_beside_observer([one for one in own if one.observed is not None], steps),
    }


def _beside_observer(causes: Sequence[JudgedCauses], steps: int) -> dict[str, float | None]:
    """How far beliefs are from the exact observer's, of boards that he could follow."""
    said, best = (
        np.concatenate([np.zeros(0), *(getattr(one, told)[_at(one, steps)][one.candidates] for one in causes)])
        for told in ("probabilities", "observed")
    )
    unsure = m.are_uncertain(said) | m.are_uncertain(best)
    p, q = best.clip(SUREST, 1 - SUREST), said.clip(SUREST, 1 - SUREST)
    return {
        "belief_bias": m.mean((said - best)[unsure]),
        "belief_divergence": m.mean(p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q))),
    }


def _discovery(causes: Sequence[JudgedCauses]) -> dict[str, Any]:
    curve = []
    for number in range(1, min(ACTIONS + 1, max((len(one.true) for one in causes), default=1))):
        own = [one for one in causes if len(one.true) > number]
        scores = m.micro([_counts(one, number) for one in own], PARENTS)
        bound = m.micro([_counts(one, number, bound=True) for one in own if one.bound is not None], PARENTS)
        told = {f"parent_{name}": share for name, share in scores.items()}
        told |= {"parent_f1_bound": bound["f1"], **_links(own, number)}
        curve.append({"actions": number, "boards": len(own), **told})

    def until(key: str) -> int | None:
        return next((number for number, point in enumerate(curve, start=1) if (point[key] or 0) >= FOUND), None)

    return {
        "discovery": curve,
        "actions_until_found": until("parent_f1"),
        "actions_until_found_bound": until("parent_f1_bound"),
    }


def _intervals(
    boards: Sequence[BoardSpec], causes: Sequence[JudgedCauses], steps: int, seed: int
) -> dict[str, dict[str, Interval]]:
    """By what is drawn anew, then by figure."""
    records: dict[str, list[tuple[int, int, str, str, int]]] = {
        name: [] for name in ("parent_p", "parent_r", "parent_f1")
    }
    records["mechanism_accuracy"] = []
    for number, (board, one) in enumerate(zip(boards, causes, strict=True)):
        place, kinds = _at(one, steps), {each.responder: each.kind for each in one.mechanisms}
        columns = [*count_parents(one.claimed[place], one.true[place]), _spurious(one, steps, 0)]
        for index, counted in enumerate(columns):
            key = board.objects[index].key if index < len(board.objects) else NOTHING
            named, counts = (key, kinds.get(index, NOTHING), number), _of(counted)
            for name, (part, whole) in PARENTS.items():
                records[f"parent_{name}"].append((counts[part], counts[whole], *named))
        for each in one.mechanisms:
            if each.driven and each.right is not None:
                named = (board.objects[each.responder].key, each.kind, number)
                records["mechanism_accuracy"].append((int(each.right), 1, *named))
    split = boards[0].split if boards else ""
    groupings: dict[str, Callable[[tuple[int, int, str, str, int]], str]] = {
        "boards": lambda _: "",
        "objects": lambda record: record[2],
        "mechanisms": lambda record: record[3],
    }
    found: dict[str, dict[str, Interval]] = {}
    for grouping, name_of in groupings.items():
        rng = generator(seed, split, 0, f"reason/bootstrap-causes/{grouping}")
        over = records
        if grouping != "boards":  # an object that nobody claims a parent of has no share
            over = {name: [one for one in rows if one[1]] for name, rows in records.items()}
        found[grouping] = {
            name: (name != "parent_f1" and _exact(rows, name_of)) or _interval(rows, name_of, rng)
            for name, rows in over.items()
        }
    return found


def _interval(
    records: Sequence[tuple[int, int, str, str, int]],
    name_of: Callable[[tuple[int, int, str, str, int]], str],
    rng: np.random.Generator,
) -> Interval:
    part, whole = np.array([one[0] for one in records], int), np.array([one[1] for one in records], int)
    return two_level_interval(part, whole, [name_of(one) for one in records], [one[4] for one in records], rng)


def _exact(
    records: Sequence[tuple[int, int, str, str, int]], name_of: Callable[[tuple[int, int, str, str, int]], str]
) -> Interval:
    """Of a share that is 0 or 1: each group, or each board if all are of one, is a trial."""
    part, whole, boards = (np.array([one[column] for one in records], int) for column in (0, 1, 4))
    groups = np.unique([name_of(one) for one in records], return_inverse=True)[1]
    trials = groups if groups.any() else boards
    return extreme_interval(np.bincount(trials, part), np.bincount(trials, whole)) if len(records) else None


def _row(board: BoardSpec, one: JudgedCauses, steps: int) -> dict[str, Any]:
    driven = [each.right for each in one.mechanisms if each.driven]
    return {
        "board": board.index,
        "parent_f1": m.micro([_counts(one, steps)], PARENTS)["f1"],
        "parent_f1_bound": None if one.bound is None else m.micro([_counts(one, steps, bound=True)], PARENTS)["f1"],
        "shd": _distance(one, steps),
        "mechanism_accuracy": m.mean(driven),
        "what_if": None if one.told is None else m.mean(np.asarray(one.told.all(axis=(1, 2)))),
    }
