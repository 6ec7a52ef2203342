"""Tables of the documentation, from the files in benchmarks/results."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.studies.disturbances import DISTURBANCES
from busybot.evaluation.reference_tables import INTERACTION, NOVEL, PLANNING, REASONING, TABLES, Table
from busybot.evaluation.results import read_result
from busybot.view.figures.curves import BASELINES, strength_words
from busybot.view.report.page import Entry, Grid, Items, Text, markdown, number, plain_grid, spread
from busybot.view.report.results import Results, RowFound, read_results, rows_of
from busybot.view.report.sections import table_grid

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"
KINDS = ("one-to-one", "one-to-many")


def result(name: str) -> dict[str, Any]:
    """A committed result by the name of its file."""
    return read_result(RESULTS / f"{name}.json")


def _table(number: int, name: str = "") -> tuple[Results, dict[str, RowFound]]:
    found = read_results([RESULTS / f"{name or f'table{number}'}.json"])
    return found, found.tables[number]


def _percent(share: float | None) -> str:
    return "-" if share is None else number(100 * share)


@dataclass(frozen=True)
class Line:
    """A line of the overview: which of our rows, and which of their numbers."""

    words: str
    table: Table
    rows: tuple[str, ...]
    key: str


FREE, STRICT = (tuple(f"{mode}-{seed}" for seed in range(3)) for mode in ("free", "strict"))
LINES = (
    Line("actions that move something", INTERACTION, FREE, "precision"),
    Line("links found", INTERACTION, FREE, "recall"),
    Line("actions that move something, *strict*", INTERACTION, STRICT, "precision"),
    Line("links found, *strict*", INTERACTION, STRICT, "recall"),
    Line("relations: precision", REASONING, ("event",), "edge_p"),
    Line("relations: recall", REASONING, ("event",), "edge_r"),
    Line("predicted steps, all responders right", REASONING, ("event",), "pred_a"),
    Line("goals reached, one-to-one", PLANNING, ("search",), "one-to-one"),
    Line("goals reached, one-to-many", PLANNING, ("search",), "one-to-many"),
)


def overview() -> str:
    """Our rows of Tables 1 to 3, each with the worst of its training seeds, beside the paper's and the gates."""
    found = {table.number: _table(table.number)[1] for table in TABLES}
    lines = [(one.words, [cell for s in NOVEL for cell in _short(one, found[one.table.number], s)]) for one in LINES]
    heads = [head for words in NOVEL.values() for head in (words, "paper", "gate")]
    return markdown([plain_grid(heads, lines, "percent")])


def _short(line: Line, rows: dict[str, RowFound], split: str) -> tuple[str, str, str]:
    """Ours, the paper's and the gate; a gate that is missed is bold."""
    told = [rows[name].cells.get((split, line.key)) for name in line.rows if name in rows]
    values = [one.low if one.several and one.low is not None else one.value for one in told if one is not None]
    row = next(row for row in line.table.rows if row.name == line.rows[0])
    assert row.paper is not None and row.gate is not None
    paper = line.table.at(line.table.paper[row.paper], split, line.key)
    gate = line.table.at(line.table.gates[row.gate], split, line.key)
    ours = number(min(values)) if values else "missing"
    missed = values and gate is not None and round(min(values), 6) < gate
    return (f"**{ours}**" if missed else ours, f"{paper:g}", f"{gate:g}")


def table1() -> str:
    """Table 1, and what its trainings took."""
    found, rows = _table(1)
    return markdown([table_grid(INTERACTION, rows), Text(trained_in(rows.values(), found.about[1]["machine"]))])


def further_boards() -> str:
    """Rows of Table 1 that were judged on other boards, too."""
    return markdown([table_grid(INTERACTION, _table(1, "further-boards")[1], beside=False)])


def table2() -> str:
    """Table 2, and what our trainings took."""
    found, rows = _table(2)
    return markdown([table_grid(REASONING, rows), Text(trained_in([rows["event"]], found.about[2]["machine"]))])


def table3() -> str:
    """Table 3, and how the learned agents were trained."""
    rows = _table(3)[1]
    told = [Text(f"`{name}`: {_practised(one)}") for name, row in rows.items() for one in row.trainings]
    return markdown([table_grid(PLANNING, rows), *told])


def plan_procedural() -> str:
    """The agents of Table 3 with what ships with busybot."""
    rows = rows_of(3, result("plan-procedural")["agents"])
    return markdown([table_grid(PLANNING, rows, beside=False)])


def trained_in(rows: Iterable[RowFound], machine: dict[str, Any]) -> str:
    """A sentence on time and memory of the trainings that nothing interrupted; empty if there is none."""
    trainings = [training for row in rows for training in row.trainings]
    costs = [training["cost"] for training in trainings if training.get("cost")]
    if not costs:
        return ""
    least, most = (f"{end(cost['seconds'] for cost in costs) / 60:.0f}" for end in (min, max))
    return (
        f"From nothing to a trained model: {least if least == most else f'{least} to {most}'} minutes and at most "
        f"{max(cost['megabytes'] for cost in costs) / 1000:.1f} GB of memory on {machine['cores']} cores "
        f"({len(costs)} of {len(trainings)} trainings; what was interrupted is not timed)."
    )


def _practised(told: dict[str, Any]) -> str:
    """What a learned agent was trained on and for how long."""
    held_out = f"{100 * told['held_out']['success']:.1f} % on {told['boards_held_out']} boards held out"
    return (
        f"{told['minutes']:.0f} of {told['minutes_allowed']:.0f} minutes, {told['iterations']:,} iterations on "
        f"{told['boards']} boards of training objects with {told['states_explored']:,} states, seed {told['seed']}; "
        f"{held_out}, at its best iteration, {told['best_iteration']:,}."
    )


def changed_pixels() -> str:
    """Of the moves on each kind of board, how many pixels change, and the share above each threshold."""
    splits, words = result("changed_pixels")["splits"], {"train": "training objects", "novel-object": "novel objects"}
    deltas = sorted(splits["train"]["with"]["exceeding"], key=int)
    moves, alone, named = [], [], []
    for split, objects in words.items():
        for name, told in splits[split].items():
            pixels = [f"{told['pixels'][key]:.0f}" for key in ("least", "median", "most")]
            shares = [f"{_percent(told['exceeding'][delta]['share_of_moves'])} %" for delta in deltas]
            moves.append((f"{objects}, {name} responders", [*pixels, *shares]))
        without = splits[split]["without"]
        above = {delta: without["exceeding"][delta] for delta in deltas}
        cells = [f"{len(one['ever'])} ({len(one['mostly'])})" for one in above.values()]
        alone.append((f"{objects}, {len(without['triggers'])} switches", cells))
        names = {delta: ", ".join(name.removeprefix("Switch/") for name in one["ever"]) for delta, one in above.items()}
        named += [Text(f"Above {delta}, {objects}: {which}.") for delta, which in names.items() if which]
    heads = ["least", "median", "most", *(f"above {delta}" for delta in deltas)]
    switches = "switches above it without responders: ever (in most moves)"
    return markdown([plain_grid(heads, moves, "changed pixels"), plain_grid(deltas, alone, switches), *named])


def policy_constants() -> str:
    """A line for each setting: which constant, its default, the other value, and what it brings in percent.

    The second table is without the veto, on objects that were held out, on those that the model knows, and with another
    model on all that it knows.
    """
    told, keys = result("policy_constants"), INTERACTION.keys
    strict = [_setting(name, told["default_strict"], [row]) for name, row in told["rows"].items()]
    places = {"novel-object": "held out", "novel-config": "known", "other": "free seed 0"}
    columns = [f"{words}: {keys[key]}" for words in places.values() for key in ("precision", "recall")]
    free = [
        _setting(name, told["default"], [row.get(place) for place in places], ("precision", "recall"))
        for name, row in told["free"].items()
    ]
    first = plain_grid(("default", "here", *keys.values()), strict, "under the veto")
    return markdown([first, plain_grid(("default", "here", *columns), free, "without")])


def _setting(
    setting: str, default: dict[str, Any], judged: list[Any], keys: Iterable[str] = tuple(INTERACTION.keys)
) -> tuple[str, list[str]]:
    """Name, default and value of a varied constant; rows that vary none or several have a name."""
    name, _, value = setting.partition("=")
    cells = [_with_interval(one, key) for one in judged for key in keys]
    if not value:
        return f"*{name}*", ["", "", *cells]
    return f"`{name}`", [f"{default[name]:g}", f"{float(value):g}", *cells]


def _with_interval(judged: dict[str, Any] | None, key: str) -> str:
    if judged is None or judged[key] is None:
        return "missing" if judged is None else "-"
    low, high = (100 * end for end in judged["intervals"][key] or (judged[key], judged[key]))
    return f"{_percent(judged[key])} {spread(low, high)}"


def interact_speed() -> str:
    """Milliseconds of what training and acting consist of."""
    told = result("interact")
    rows = []
    for kind, one in told["iteration"].items():
        limit = f"{one['ratio_to_limit']:.1f} times as long as one matrix product of as many operations takes"
        rows.append((f"iteration of the {kind} network, {one['batch']} crops ({limit})", one["milliseconds"]))
    for threads, milliseconds in told["milliseconds_per_look"].items():
        counted = f"{threads} thread{'s' if int(threads) > 1 else ''}"
        rows.append((f"affordance of a whole picture, {counted}, by the clock", milliseconds))
    rows.append(("decision, from the first picture of a board", told["milliseconds_per_decision"]))
    for policy, milliseconds in told["milliseconds_per_recorded_action"].items():
        rows.append((f"recorded action, policy `{policy}`: simulated, rendered, written", milliseconds))
    corner = f"milliseconds, {told['machine']['processor']}, one thread"
    return markdown([plain_grid([""], [(words, [f"{value:.0f}"]) for words, value in rows], corner)])


def waiting() -> str:
    """What commands, boards and actions cost before and after, in matrix products."""
    told = result("waiting")
    names = list(told["commits"])
    rows = []
    for what, one in told["rows"].items():
        rows.append((what, [*(f"{one[name]:.1f}" for name in names), f"{one['ratio']:.2f}"]))
    heads = [f"{name} (`{commit[:7]}`)" for name, commit in told["commits"].items()]
    words = (
        f"One product takes {told['product_milliseconds']:.1f} ms on the machine where this was measured "
        f"({told['machine']['processor']}, one thread)."
    )
    return markdown([plain_grid([*heads, "ratio"], rows, told["unit"]), Text(words)])


def paper_interact_speed() -> str:
    """What an iteration of each of the paper's interaction networks costs, and the whole schedule by extrapolation."""
    told = result("paper_interact")
    machine, total = told["machine"], told["extrapolated"]
    heads = ("parameters", "batch", "measured iterations", "seconds each", "of CPU", "iterations of the schedule")
    rows = []
    for kind, one in told["networks"].items():
        size = [f"{one['parameters'] / 1e6:.1f} million", str(one["batch"]), str(one["iterations"])]
        seconds = [f"{one['seconds_median']:.1f}", f"{one['cpu_seconds_median']:.1f}"]
        rows.append((kind, [*size, *seconds, str(total["iterations"][kind])]))
    hours, cpu = total["hours"], total["cpu_hours"]
    where = f"{machine['processor']}, {machine['threads']} thread{'s' if machine['threads'] > 1 else ''}"
    whole = (
        f"By extrapolation ({where}) the {total['epochs']} epochs take {hours['both']:.0f} hours, of CPU "
        f"{cpu['both']:.0f}: {cpu['training']:.0f} for training and at least {cpu['collecting']:.0f} for collecting."
    )
    return markdown([plain_grid(heads, rows, "network"), Text(whole)])


def paper_reason_speed() -> str:
    """What an iteration of the paper's graph networks costs in each of their forms, and the whole schedule."""
    forms = result("paper_reason")["forms"]
    rows = [(name, [f"{one['cpu_seconds']:.1f}", f"{one['schedule_cpu_hours']:.0f}"]) for name, one in forms.items()]
    return markdown([plain_grid(("CPU seconds an iteration", "CPU hours for the schedule"), rows, "form")])


def features() -> str:
    """How large the smallest change is for each encoder, and what decoders read from objects that they never saw."""
    rows = []
    for name, told in result("features")["encoders"].items():
        known, novel = (told["splits"][split] for split in NOVEL)
        least = " / ".join(f"{one['changed_distance']['least']:.2f}" for one in (known, novel))
        decoded = [one["decoders"] for one in (known, novel)]
        read = [", ".join(_percent(shares[kind]) for kind in ("Lamp", "Door", "Toy")) for shares in decoded]
        oracle = " (oracle)" if told["oracle"] else ""
        rows.append((f"`{name}`{oracle}", [least, *read, _percent(novel["decoders"]["all of a frame"])]))
    heads = ("smallest change, novel config / object", *(f"lamp, door, toy of {words}" for words in NOVEL.values()))
    return markdown([plain_grid((*heads, "whole board, new objects"), rows, "encoder")])


def reason_procedural() -> str:
    """What the shipped model of relations does on procedural objects."""
    rows = []
    for split, told in result("reason-procedural")["splits"].items():
        bounded = [f"{_percent(told[key])} ({_percent(told[f'{key}_bound'])})" for key in ("edge_r", "pred_a")]
        rest = [_percent(told[key]) for key in ("pred_a_successful", "failing")]
        rows.append((split, [_percent(told["edge_p"]), *bounded, *rest]))
    heads = ("Edge-P", "Edge-R (bound)", "Pred-A (bound)", "successful", "steps that fail")
    return markdown([plain_grid(heads, rows, "percent")])


def robustness() -> str:
    """Edge-P / Edge-R, and Pred-A behind a comma of those that predict; "-" for who does not see a disturbance."""
    told = result("reason_robustness")
    trained = list(told["models"])
    columns = [*trained, *BASELINES]
    lines = []
    for name, rows in told["rows"].items():
        for row in rows:
            cells = [_scores(row["models"].get(column)) for column in columns]
            lines.append((_disturbance(told, name, row), [*cells, _percent(row["known"])]))
    heads = [f"`{name}`" if name in trained else name for name in columns]
    done = [
        (DISTURBANCES[name].title, told["disturbances"][name]["what"]) for name in told["rows"] if name in DISTURBANCES
    ]
    what = Items(tuple(f"*{title}*: {words}." for title, words in done))
    return markdown([plain_grid((*heads, "known"), lines, "percent"), what])


def _disturbance(told: dict[str, Any], name: str, row: dict[str, Any]) -> str:
    if name not in DISTURBANCES:
        return f"{name}, {row['boards']} boards"
    return f"{DISTURBANCES[name].title}, {strength_words(told, name, row['strength'])}"


def _scores(scores: dict[str, Any] | None) -> str:
    if scores is None:
        return "-"
    told = f"{_percent(scores['edge_p'])} / {_percent(scores['edge_r'])}"
    return told if scores["pred_a"] is None else f"{told}, {_percent(scores['pred_a'])}"


def decision_time() -> str:
    """Milliseconds of every agent: the mean, and what 95 % of its decisions stay below; the gate is for the mean."""
    told = result("decision_time")
    rows = [
        (row.words, _times([told["decisions"][row.name][kind] for kind in KINDS], told["gate_ms"]))
        for row in PLANNING.rows
        if row.name in told["decisions"]
    ]
    return markdown(
        [Grid((), ("1-1", "1-many"), tuple(rows), f"CPU-ms for each decision, at most {told['gate_ms']:g}")]
    )


def _times(timings: list[dict[str, Any]], gate: float) -> tuple[Entry, ...]:
    entries = []
    for timing in timings:
        mean = timing["cpu_ms"]
        if mean is None:
            entries.append(Entry("-"))
            continue
        model = mean - timing["cpu_ms_without_model"]
        small = f"(95 %: {timing['cpu_ms_p95']:.1f}; model {model:.1f})"
        entries.append(Entry(f"{mean:.1f}", small, "reached" if mean <= gate else "missed"))
    return tuple(entries)
