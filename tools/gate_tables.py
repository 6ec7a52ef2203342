"""Tables of the gates of worlds: what several seeds reach on the frozen boards, and the model that ships elsewhere.

The gates: links and mechanisms against the exact observer of true states, what if, calibration, and what each world is
about; then how soon curiosity knows, plans, and what is left before a real camera.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from benchmarks.tables.world_gates import digest_of
from busybot.common.errors import BusybotError
from busybot.evaluation.statistics import binomial_interval, widest
from busybot.view.report.page import Grid, markdown, number, plain_grid
from tools.tables import reaching, result, whole

_Judged = dict[tuple[str, str], list[dict[str, Any]]]
"""Figures of each seed, by world and set."""
JUDGED = "validation-gates", "world-gates", "new-kinds-gates"
"""Results about the same models on the sets: those for choices, those of known kinds of mechanisms, of new ones."""


def gates_glance() -> str:
    """How many of the seeds' gates hold, by world, by who acted, and by what is asked."""
    lines = [
        (f"{world}: {words}", _held(world, split, seeds))
        for (world, words), (split, seeds) in _test_sets().items()
        if split != "novel-config"
    ]
    return markdown([plain_grid(ABOUT, lines, "gates that hold")])


def gates_missed() -> str:
    """By how much gates are missed on test sets by seeds that miss them, and why where evaluations tell it."""
    told = _test_sets()
    places = [words for words in PLACES if any(words == one for _, one in told)]
    lines = []
    for world in dict.fromkeys(world for world, _ in told):
        sets = {words: told[world, words] for words in places if (world, words) in told}
        for about in ABOUT:
            short = {words: _short(world, split, seeds, about) for words, (split, seeds) in sets.items()}
            missed = [words for words in places if short.get(words)]
            if missed:
                why = _missed_because([sets[words][1] for words in missed], about)
                lines.append((f"{world}: {about}", [*(short.get(words, "") for words in places), why]))
    return markdown([plain_grid((*places, "of a hundred that are wrong there"), lines, "points short")])


def _test_sets() -> dict[tuple[str, str], tuple[str, list[dict[str, Any]]]]:
    """What is judged on test sets: by world and by what the boards are and who acted, the set and its seeds."""
    judged = {"learned": _judged(), "curious": _judged_curious()}
    return {
        (world, words): (split, judged[who][world, split])
        for world in dict.fromkeys(world for told in judged.values() for world, _ in told)
        for words, (split, who) in PLACES.items()
        if (world, split) in judged[who]
    }


def _short(world: str, split: str, seeds: list[dict[str, Any]], about: str) -> str:
    """How far the seeds that miss a gate are behind it, their mean and the worst, and how many reach it; of several
    gates that which most miss."""
    gates = [[gate for gate in _gates(world, split, one) if gate.about == about] for one in seeds]
    behind = [[gate.short for gate in own if gate.short] for own in zip(*gates, strict=True)]
    missed = max(behind, key=lambda short: (len(short), max(short, default=0.0)), default=[])
    if not missed:
        return ""
    spread = f" ({number(100 * max(missed))})" if len(missed) > 1 else ""
    return f"{number(100 * sum(missed) / len(missed))}{spread} {reaching(len(seeds) - len(missed), len(seeds))}"


def _missed_because(judged: list[list[dict[str, Any]]], about: str) -> str:
    """Of all that is missed on sets, how many for each reason; nothing where evaluations tell none."""
    key = REASONS.get(about)
    rows = [one for seeds in judged for one in seeds]
    return _missed(rows, key) if key and all(one.get(key) for one in rows) else ""  # older rows have none


def _held(world: str, split: str, seeds: list[dict[str, Any]]) -> list[str]:
    """Of each thing that is asked about, how many gates of all seeds hold; nothing where none is asked."""
    gates = [gate for one in seeds for gate in _gates(world, split, one)]
    cells = []
    for about in ABOUT:
        held = [gate.value is not None and gate.reached(gate.value) for gate in gates if gate.about == about]
        cells.append(reaching(sum(held), len(held)) if held else "")
    return cells


def world_gates() -> str:
    """What trainings from several seeds reach on the validation sets and the test sets: each gate."""
    return markdown([_gates_grid(_judged())])


def gate_figures() -> str:
    """The figures that the gates are about, of the same models on the same sets."""
    return markdown([_figures_grid(_judged())])


def calibration() -> str:
    """How far beliefs of the same models are off on the same sets, after each number of images."""
    return markdown([_calibration_grid(_judged())])


def gate_intervals() -> str:
    """How far chance may be in figures of the same models on the same sets, and the rest of what is told of them."""
    told = {place: seeds for place, seeds in _judged().items() if all("cause_intervals" in one for one in seeds)}
    return markdown([_intervals_grid(told)])  # older rows have none


def gate_reasons() -> str:
    """Why the same models miss questions and rewirings, on the sets of which that is told."""
    told = {place: seeds for place, seeds in _judged().items() if all(one.get(WHY["what if"][0]) for one in seeds)}
    return markdown([_reasons_grid(told)])


def curious_gates() -> str:
    """The same gates where the model that ships chose what was done, of the same five models."""
    return markdown([_gates_grid(_judged_curious())])


def curious_figures() -> str:
    """The figures of `curious_gates`, and why what is missed is missed."""
    told = _judged_curious()
    return markdown([_figures_grid(told), _reasons_grid(told)])


def pipeline_gates() -> str:
    """What five seeds of all that is learned reach, each on what its own policy records, beside one policy for all."""
    rows, shared, lines = result("pipeline-gates")["rows"], _judged(), []
    for place in ((world, split) for world, sets in rows.items() for split in sets):
        own, words = list(rows[place[0]][place[1]].values()), ", ".join(place)
        if {digest_of(one["model"]) for one in own} != {digest_of(one["model"]) for one in shared[place]}:
            raise BusybotError(
                f"pipeline-gates, {words}: the models are not those of world-gates", "judge the same ones"
            )
        lines += [(words, _seed_cells(own)), (f"{words}: one policy for all", _seed_cells(shared[place]))]
    heads = ("policies", "P / R at 22", "F1, links (bound)", "mechanism (bound)", "what if", "Pred-A")
    return markdown([plain_grid(heads, lines, "percent after 22 actions")])


def _judged() -> _Judged:
    """The rows of the validation sets and of the test sets, all of the same models."""
    told: _Judged = {}
    files = [result(name)["rows"] for name in JUDGED]
    for world in dict.fromkeys(world for rows in files for world in rows):
        for split, seeds in (cell for rows in files for cell in rows.get(world, {}).items()):
            told[world, split] = list(seeds.values())
    _check_judged(told)
    return told


def _judged_curious() -> _Judged:
    """The rows of the sets on which the model that ships chose what was done."""
    rows = result("curious-gates")["rows"]
    told = {(world, split): list(seeds.values()) for world, sets in rows.items() for split, seeds in sets.items()}
    _check_judged({**_judged(), **{(world, f"curious {split}"): seeds for (world, split), seeds in told.items()}})
    return told


def _check_judged(told: _Judged) -> None:
    """Refuse rows of models, or of recordings by policies, whose weights differ from set to set."""
    for judged in ("model", "policy"):
        weights = {frozenset(digest_of(one[judged]) for one in seeds) for seeds in told.values()}
        if len(weights) > 1:
            what = f"gates of {', '.join(sorted({split for _, split in told}))}: the {judged} is not that of all sets"
            raise BusybotError(what, "judge all of them with the same ones; put one result in the place of the other")


def _gates_grid(told: _Judged) -> Grid:
    """A line for each gate of each world: the mean of the seeds, the worst of them, how many reach the gate."""
    splits = list(dict.fromkeys(split for _, split in told))
    found: dict[tuple[str, str, str], dict[str, str]] = {}
    for (world, split), seeds in told.items():
        for own in zip(*(_gates(world, split, one) for one in seeds), strict=True):
            line = found.setdefault((world, own[0].words, own[0].asked), {})
            line[split] = _seeds_cell([gate.value for gate in own], own[0])
    lines = [
        (f"{world}: {words}", [asked, *(cells.get(split, "") for split in splits)])
        for (world, words, asked), cells in found.items()
    ]
    return plain_grid(("asked", *splits), lines, "percent, or points")


def _seeds_cell(values: list[float | None], gate: "_Gate", more: str = "") -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "-"
    reached = sum(gate.reached(value) for value in known)
    worst = (min if gate.least else max)(known)
    spread = f" ({number(100 * worst)})" if len(known) > 1 else ""
    return f"{number(100 * sum(known) / len(known))}{spread}{more} {reaching(reached, len(values))}"


PARENTS = "parents"
ABOUT = (PARENTS, "rewirings", "mechanisms", "what if", "Pred-A", "calibration")
"""What gates of worlds ask about."""
REASONS = {
    "mechanisms": "mechanism_missed_because",
    "what if": "what_if_missed_because",
    "rewirings": "rewired_missed_because",
}
"""Where evaluations tell why something is wrong."""
BOARDS = {"novel-config": "new configurations", "novel-object": "new objects", "novel-mechanism": "new kinds"}
"""The test sets, and what they are called."""
PLACES = {f"{words}, {who}": (split, who) for split, words in BOARDS.items() for who in ("learned", "curious")}
"""What boards were judged, and who acted on them."""


@dataclass(frozen=True)
class _Gate:
    """A gate of a world, and what a model has there.

    Attributes:
        least: it is to be reached from below.
    """

    words: str
    value: float | None
    limit: float
    least: bool = True

    @property
    def about(self) -> str:
        """What a gate of a world asks about, one of `ABOUT`: its words begin with that, but for parents."""
        return next((one for one in ABOUT if self.words.startswith(one)), PARENTS)

    @property
    def asked(self) -> str:
        return f"{'at least' if self.least else 'at most'} {whole(self.limit)}"

    @property
    def short(self) -> float:
        """How far what a model has is on the wrong side of the limit; 0 on the right one, and where nobody can tell."""
        return 0.0 if self.value is None or self.reached(self.value) else abs(self.limit - self.value)

    def reached(self, value: float) -> bool:
        ahead = round(value - self.limit, 9)  # shares less others are not exact
        return ahead >= 0 if self.least else ahead <= 0


def _gates(world: str, split: str, told: dict[str, Any]) -> list[_Gate]:
    """All that are asked of a world on a set, and what a model has there; each model has the same ones."""
    behind = {int(one): point[BOTH[1]] - (point[BOTH[0]] or 0) for one, point in told["after"].items()}
    found = []
    if world in ("gates", "time") and split != "novel-mechanism":
        found += [_Gate(f"F1 of links behind the bound, {one}", lag, 0.04, False) for one, lag in behind.items()]
        known = told["mechanism_accuracy"]
        lag = None if known is None else told["mechanism_bound"] - known
        found.append(_Gate("mechanisms behind the bound", lag, 0.08, False))
    if split == "novel-mechanism":
        found.append(_Gate("F1 of links behind the bound, 30, novel mechanisms", behind[30], 0.08, False))
    if world == "paper":
        asked = {"P of parents, 22": ("parent_p", 0.99), "R of parents, 22": ("parent_r", 0.99)}
        found += [_Gate(words, told[key], limit) for words, (key, limit) in asked.items()]
        found.append(_Gate("Pred-A", told["pred_a"], 0.92))
    if world == "chance":
        found += [_Gate(f"{name} of parents, 22", told[f"parent_{name[0].lower()}"], 0.95) for name in ("P", "R")]
    if world == "chain":
        found.append(_Gate("F1 of parents, 22", told["after"]["22"]["parent_f1"], 0.9))
    if world == "rewired":
        found.append(_Gate("rewirings found and placed", told["rewired_placed"], 0.9))
    found.append(_Gate("what if", told["what_if"], 0.9))
    worst = _worst(told)
    return [*found, _Gate("calibration at its worst", worst["ece_uncertain"] if worst else None, 0.06, False)]


def _figures_grid(told: _Judged) -> Grid:
    """Means of the seeds; behind F1 after 22 actions and mechanisms stand the lowest and the highest of them."""
    heads = (
        "boards", "seeds", "P / R at 22", "F1, links (bound)", "mechanism (bound)", "of states that were seen (bound)",
        "what if", "Pred-A", "gap", "rewirings found / placed", "false alarms a board", "ECE [by chance] (images)",
    )  # fmt: skip
    lines = [(f"{world}, {split}", _reached(seeds)) for (world, split), seeds in told.items()]
    return plain_grid(heads, lines, "percent after 10 / 22 / 30")


def _reached(rows: list[dict[str, Any]]) -> list[str]:
    """The cells of a set's line, of one row for each seed."""
    first, points = rows[0], [list(told["after"].values()) for told in rows]
    found, bound = ([_mean([one[key] for one in after]) for after in zip(*points, strict=True)] for key in BOTH)
    middle = _range([after[1][BOTH[0]] for after in points])
    worst = [one for one in map(_worst, rows) if one]
    shown = max(worst, key=lambda one: one["ece_uncertain"], default=None)
    mean = {key: whole(_mean([told[key] for told in rows])) for key in AVERAGED}
    known = _range([told["mechanism_accuracy"] for told in rows])
    alarms = _mean([told["rewired_false_alarms"] for told in rows])
    known_both = [told for told in rows if None not in (told["pred_a"], told["mechanism_accuracy"])]
    gap = _mean([told["pred_a"] - told["mechanism_accuracy"] for told in known_both])
    return [
        str(first["boards"]),
        str(len(rows)),
        f"{mean['parent_p']} / {mean['parent_r']}",
        f"{whole(found[0])} / {whole(found[1])}{middle} / {whole(found[2])} ({' / '.join(map(whole, bound))})",
        f"{mean['mechanism_accuracy']}{known} ({mean['mechanism_bound']})",
        f"{mean['mechanism_accuracy_met']} ({mean['mechanism_bound_met']})",
        mean["what_if"],
        mean["pred_a"],
        "-" if gap is None else f"{100 * gap:+.0f}",
        f"{mean['rewired_found']} / {mean['rewired_placed']}" if first["rewirings"] else "-",
        "-" if alarms is None else f"{alarms:.2f}",
        f"{whole(shown['ece_uncertain'])}{_by_chance(shown)} ({shown['images']})" if shown else "-",
    ]


def _intervals_grid(told: _Judged) -> Grid:
    """Means of the seeds after 22 actions, and from the lowest to the highest end of the seeds' intervals over
    boards, over objects and their boards, and over kinds of mechanisms and their boards."""
    heads = (
        "F1, pairs (over boards / objects)", "mechanism (over boards / objects / kinds)", "mechanisms missed",
        "SHD (bound)", "kinds (bound)", "lags (bound)", "Pred-A of successful actions",
    )  # fmt: skip
    lines = [(f"{world}, {split}", _spread_cells(seeds)) for (world, split), seeds in told.items()]
    return plain_grid(heads, lines, "percent")


def _spread_cells(rows: list[dict[str, Any]]) -> list[str]:
    mean = {key: _mean([told[key] for told in rows]) for key in TOLD}
    found = whole(_mean([told["after"][OBSERVED]["parent_f1"] for told in rows]))
    shares = [f"{whole(mean[f'{key}_accuracy'])} ({whole(mean[f'{key}_bound'])})" for key in ("kind", "lag")]
    return [
        f"{found} ({' / '.join(_ends(rows, over, 'parent_f1') for over in OVER[:2])})",
        f"{whole(mean['mechanism_accuracy'])} ({' / '.join(_ends(rows, over, 'mechanism_accuracy') for over in OVER)})",
        _missed(rows),
        f"{mean['shd']:.2f} ({mean['shd_bound']:.2f})",
        *shares,
        whole(mean["pred_a_successful"]),
    ]


def _ends(rows: list[dict[str, Any]], over: str, key: str) -> str:
    ends = widest(told["cause_intervals"][over][key] for told in rows)
    return "-" if ends is None else f"{whole(ends[0])}-{whole(ends[1])}"


def _missed(rows: list[dict[str, Any]], key: str = "mechanism_missed_because") -> str:
    """Of a hundred things that are missed, how many for each reason; of all seeds together."""
    reasons = {name: sum(told[key][name] for told in rows) for name in rows[0][key]}
    total, named = sum(reasons.values()), {"otherwise": "else"}
    parts = (f"{named.get(name, name)} {whole(count / total)}" for name, count in reasons.items() if total)
    return ", ".join(parts) or "-"


def _reasons_grid(told: _Judged) -> Grid:
    """What is reached and what somebody who knows the board would reach, and why what is missed is missed."""
    heads = tuple(head for words in WHY for head in (f"{words} (bound)", "missed"))
    lines = []
    for (world, split), rows in told.items():
        cells = []
        for reasons, key in WHY.values():
            bound = _mean([one[f"{key}_bound"] for one in rows])
            cells.append(f"{whole(_mean([one[key] for one in rows]))} ({whole(bound)})" if bound is not None else "-")
            cells.append(_missed(rows, reasons) if bound is not None else "-")
        lines.append((f"{world}, {split}", cells))
    return plain_grid(heads, lines, "percent")


def _seed_cells(rows: list[dict[str, Any]]) -> list[str]:
    """Means of the seeds, the lowest and the highest in brackets."""
    points = [told["after"][OBSERVED] for told in rows]

    def cell(values: list[float | None], bound: list[float | None] | None = None) -> str:
        known = f" ({_ranged(bound)})" if bound else ""
        return f"{_ranged(values)}{known}"

    return [
        str(len({digest_of(told["policy"]) for told in rows})),
        " / ".join(cell([told[key] for told in rows]) for key in ("parent_p", "parent_r")),
        cell([point[BOTH[0]] for point in points], [point[BOTH[1]] for point in points]),
        cell([told["mechanism_accuracy"] for told in rows], [told["mechanism_bound"] for told in rows]),
        *(cell([told[key] for told in rows]) for key in ("what_if", "pred_a")),
    ]


def _ranged(values: list[float | None]) -> str:
    """Their mean, and the lowest and the highest where they differ."""
    ends = _range(values) if len({whole(one) for one in values}) > 1 else ""
    return f"{whole(_mean(values))}{ends}"


def _calibration_grid(told: _Judged) -> Grid:
    """After each number of images the error over doubtful pairs: mean and worst of the seeds, and the fewest pairs that
    one of them has; none where there are too few to tell."""
    first = next(iter(told.values()))[0]
    heads = tuple(f"{one['images']} images" for one in first["uncertain"])
    lines = []
    for (world, split), seeds in told.items():
        cells = [_calibrated(list(after)) for after in zip(*(one["uncertain"] for one in seeds), strict=True)]
        lines.append((f"{world}, {split}", cells))
    return plain_grid(heads, lines, "points: mean (worst) of pairs")


def _calibrated(after: list[dict[str, Any]]) -> str:
    """Of the seeds after as many images, if all of them have doubtful pairs enough to have an error."""
    fewest = min(one["uncertain_pairs"] for one in after)
    errors = [100 * one["ece_uncertain"] for one in after if one["ece_uncertain"] is not None]
    told = f"{number(sum(errors) / len(errors))} ({number(max(errors))})" if len(errors) == len(after) else "-"
    return f"{told} of {fewest:,}"


def _by_chance(told: dict[str, Any]) -> str:
    """What chance alone would make of it, on average; older results do not tell it."""
    error = told.get("ece_by_chance")
    return "" if error is None else f" [{whole(error)}]"


def _mean(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def _range(values: list[float | None]) -> str:
    """The lowest and the highest of several seeds."""
    known = [value for value in values if value is not None]
    return f" [{whole(min(known))}-{whole(max(known))}]" if len(known) > 1 else ""


def _worst(told: dict[str, Any]) -> dict[str, Any] | None:
    """Where doubtful pairs are calibrated worst."""
    uncertain = [one for one in told["uncertain"] if one["ece_uncertain"] is not None]
    return max(uncertain, key=lambda one: one["ece_uncertain"], default=None)


AVERAGED = (
    "parent_p", "parent_r", "mechanism_accuracy", "mechanism_bound", "mechanism_accuracy_met", "mechanism_bound_met",
    "what_if", "pred_a", "rewired_found", "rewired_placed",
)  # fmt: skip
TOLD = (
    "mechanism_accuracy", "shd", "shd_bound", "kind_accuracy", "kind_bound", "lag_accuracy", "lag_bound",
    "pred_a_successful",
)  # fmt: skip
OVER = ("boards", "objects", "mechanisms")
WHY = {
    "what if": ("what_if_missed_because", "what_if"),
    "rewirings placed": ("rewired_missed_because", "rewired_placed"),
}
OBSERVED = "22"
"""After so many actions a recording is judged as a whole."""
BOTH = ("link_parent_f1", "link_parent_f1_bound")


def further_gates() -> str:
    """Of acting and planning with the model that ships, and of the frozen boards before a real camera."""
    return markdown([plain_grid(("asked", "there"), [*_curious(), *_plans(), *_before_a_camera()], "gate")])


_Line = tuple[str, tuple[str, str]]


def _line(words: str, gate: _Gate, shown: str) -> _Line:
    """What is asked, and what is there with its verdict."""
    return words, (gate.asked, f"{shown} {_mark(gate.value is not None and gate.reached(gate.value))}")


def _mark(reached: bool) -> str:
    return "✓" if reached else "✗"


def _curious() -> Iterator[_Line]:
    """How soon curiosity knows, against the exact observer's choice and against chance, and what is then wrong.

    Of drawn boards, whose states are told, and of recorded ones, where all choices act by the policy that finds links.
    """
    rows, recorded = result("curiosity")["rows"], result("curiosity-recorded")["rows"]
    for world, parts in rows.items():
        for other, part, most in (("greedy", "greedy", 1.25), ("random", "drawn", 0.7)):
            words = f"{world}, states told: actions until 95, to those of {other} choice"
            yield words, (_asked_times(most), _times_of_seeds(parts, part, "curious", other, most))
    for world, parts in recorded.items():
        words = f"{world}, pictures: actions until 95, to those of a draw among known links"
        yield words, (_asked_times(0.7), _times_of_seeds(parts, "recorded", "curious", "learned", 0.7))
    found = {"drawn": rows, "stopping": result("curiosity-stops")["rows"]}
    played = [(world, part) for part, worlds in found.items() for world in worlds.values()]
    stops = [world[part]["curious"]["stops"] for world, part in played]
    words = f"said to know and wrong, of what was said in {len(rows)} worlds, states told"
    share, shown = _said_wrongly(stops)
    others = [one[part]["curious"]["stops"] for world, part in played for one in _seeds(world, part)]
    told = f"{shown}; other seeds {_said_wrongly(others)[1]}" if others else shown
    yield _line(words, _Gate("", share, 0.03, False), told)
    spent = [parts["recorded"]["curious"]["cpu_ms"] for parts in recorded.values()]
    dearest = None if None in spent else max(spent)
    told = "-" if dearest is None else f"{dearest:.0f} {_mark(dearest <= 150)}"
    yield (
        "CPU-ms of a curious action, pictures, simulation and all, the dearer of `gates` and `time`",
        ("at most 150 a decision", told),
    )


def _said_wrongly(stops: list[dict[str, Any]]) -> tuple[float | None, str]:
    """Which share of what was said to be known was wrong, and the same with its bounds for people."""
    count, wrong = (sum(one[key] for one in stops) for key in ("boards", "wrong"))
    low, high = binomial_interval(wrong, count) or (0.0, 1.0)
    return wrong / count if count else None, f"{wrong} of {count} ({100 * low:.0f}-{100 * high:.0f})"


def _seeds(world: dict[str, Any], part: str) -> list[dict[str, Any]]:
    """What trainings from other seeds have of a part, where they were asked."""
    return [one for one in world.get("seeds", {}).values() if part in one]


def _times_of_seeds(world: dict[str, Any], part: str, choice: str, other: str, limit: float) -> str:
    """`_times` of the model that ships; and how many of all seeds reach the limit, if others were asked, too."""
    told = [
        _times(one[part][choice]["until"], one[part][other]["until"], len(one[part][choice]["f1"]), limit)
        for one in (world, *_seeds(world, part))
    ]
    reached = sum(one.endswith("✓") for one in told)
    return f"{told[0]}; {reached} of {len(told)} seeds" if len(told) > 1 else told[0]


def _asked_times(most: float) -> str:
    return f"at most {most:g} times"


def _times(own: int, other: int, most: int, limit: float) -> str:
    """How many times as many actions one choice needs as another. Who did not come there in `most` has one more."""
    ratio = own / other
    if own > most:  # it needs at least so many
        verdict = "-" if other > most or ratio <= limit else f"at least {ratio:.2f} ✗"
    elif other > most:  # it needs at most so many times as many
        verdict = f"at most {ratio:.2f} ✓" if ratio <= limit else f"at most {ratio:.2f}, undecided"
    else:
        verdict = f"{ratio:.2f} {_mark(ratio <= limit)}"
    told = " to ".join(f"over {most}" if one > most else str(one) for one in (own, other))
    return f"{told}: {verdict}"


def _plans() -> Iterator[_Line]:
    """Success of plans through mechanisms and how long they are."""
    for file, history in (("world-plans-curious", "curious"), ("world-plans", "scripted")):
        rows = result(file)["rows"]
        for world in ("gates", "time", "chain"):
            played = _played(rows[world])
            place = f"{world}, {history} histories"
            moved = _where_all_moved(rows[world]) if history == "curious" else ""
            yield _goals(f"{place}: goals reached", 0.93, played, moved)
            gates = [_Gate("", one["steps_over_shortest"], 1.3, False) for one in played]
            yield f"{place}: steps over the shortest plan", ("at most 1.3", _times_cell(gates))
    for file in ("lock-plans", "lock-plans-curious", "lock-plans-longer"):
        found = result(file)
        history = f"{found.get('history', 'scripted')} histories"
        history += f" of {found['steps']} actions" if file == "lock-plans-longer" else ""
        for name, limit in (("lock-1-to-4", 0.9), ("lock-5-to-8", 0.7)):
            told = found["rows"][name]
            words = f"{name.replace('-', ' ').replace('lock', 'lock, depth', 1)}, {history}: goals reached"
            yield _goals(words, limit, _played(told), _where_all_moved(told))


def _played(told: dict[str, Any]) -> list[dict[str, Any]]:
    """What `mechanism` reached, and what its trainings from other seeds did, where they played."""
    return [told["agents"]["mechanism"], *told.get("seeds", {}).values()]


def _goals(words: str, limit: float, played: list[dict[str, Any]], more: str) -> _Line:
    gates = [_Gate("", one["success"], limit) for one in played]
    return words, (gates[0].asked, _seeds_cell([gate.value for gate in gates], gates[0], more))


def _times_cell(gates: list[_Gate]) -> str:
    """As `_seeds_cell`, of how many times as much at most."""
    known = [gate.value for gate in gates if gate.value is not None]
    if not known:
        return "-"
    worst = f" ({max(known):.2f})" if len(known) > 1 else ""
    reached = sum(gate.reached(gate.value) for gate in gates if gate.value is not None)
    return f"{sum(known) / len(known):.2f}{worst} {reaching(reached, len(gates))}"


def _where_all_moved(told: dict[str, Any]) -> str:
    """Success on the tasks all of whose links moved in the history; older results do not tell it."""
    seen = told.get("by_unmoved", {}).get("0")
    return f" ({number(100 * seen['mechanism'])} of the {seen['tasks']} whose links had all moved)" if seen else ""


BEFORE_A_CAMERA = {"camera-gates": "a real camera", "camera-curious-gates": "a real camera, curious policy"}
"""Results by the policy that acted, and what they are called."""


def _before_a_camera() -> Iterator[_Line]:
    """Means of the seeds, the worst in brackets, on the frozen boards before a real camera."""
    asked = {"P": ("parent_p", 0.97), "R": ("parent_r", 0.97), "Pred-A": ("pred_a", 0.85)}
    for name, called in BEFORE_A_CAMERA.items():
        rows = result(name)["rows"]
        for split, seeds in rows["paper"].items():
            for words, (key, limit) in asked.items():
                gates = [_Gate(words, one[key], limit) for one in seeds.values()]
                shown = _seeds_cell([gate.value for gate in gates], gates[0])
                yield f"paper, {called}, {split}, {_boards(seeds)} boards: {words}", (gates[0].asked, shown)
        for split, seeds in rows.get("mixed", {}).items():
            points = [one["after"]["30"] for one in seeds.values()]
            gates = [_Gate("", point[BOTH[1]] - (point[BOTH[0]] or 0), 0.1, False) for point in points]
            shown = _seeds_cell([gate.value for gate in gates], gates[0])
            place = f"mixed, {called}, {split}, {_boards(seeds)} boards"
            yield f"{place}: F1 of links behind the bound, 30", (gates[0].asked, shown)


def _boards(seeds: dict[str, Any]) -> int:
    """On how many boards the seeds were judged."""
    [boards] = {one["boards"] for one in seeds.values()}
    return int(boards)
