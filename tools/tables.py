"""Tables of the documentation, from the files in benchmarks/results."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from benchmarks.tables.table2 import across
from benchmarks.tables.table3 import OURS
from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import INTERACTION, NOVEL, PLANNING, REASONING, TABLES, ReferenceRow, Table
from busybot.evaluation.results import read_result
from busybot.evaluation.statistics import binomial_interval, widest
from busybot.interact.training.config import PaperConfig
from busybot.view.report.gates import judge
from busybot.view.report.page import Grid, Text, markdown, number, plain_grid, reference, spread
from busybot.view.report.results import INTERVALS, RowFound, Score, TableFile, read_results, rows_of
from busybot.view.report.sections import table_grid

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"
KINDS = ("one-to-one", "one-to-many")


def result(name: str) -> dict[str, Any]:
    """A committed result by the name of its file."""
    return read_result(RESULTS / f"{name}.json")


def _table(number: int) -> TableFile:
    """The committed file of a table."""
    [found] = read_results([RESULTS / f"table{number}.json"]).table_files.values()
    return found


def percent(share: float | None) -> str:
    return "-" if share is None else number(100 * share)


def cell(told: Score | None) -> str:
    """Percent with its intervals."""
    return "-" if told is None else " ".join(filter(None, (number(told.value), told.spread)))


def the_papers(table: Table, row: str, places: Iterable[tuple[str, str]]) -> tuple[str, list[str]]:
    """A line with what the paper has, of so many splits and columns."""
    percents = [table.at(table.paper[row], *place) for place in places]
    return f"*the paper:* {row}", ["" if told is None else reference(told) for told in percents]


@dataclass(frozen=True)
class Line:
    """A line of the overview: which of our rows, and which of their numbers."""

    words: str
    table: Table
    rows: tuple[str, ...]
    key: str


FREE, STRICT = (tuple(row.name for row in INTERACTION.rows if row.gate == mode) for mode in ("free", "strict"))
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
    found = {table.number: _table(table.number).rows for table in TABLES}
    lines = [(one.words, [cell for s in NOVEL for cell in _short(one, found[one.table.number], s)]) for one in LINES]
    heads = [head for words in NOVEL.values() for head in (words, "paper", "gate")]
    return markdown([plain_grid(heads, lines, "percent")])


def _short(line: Line, rows: dict[str, RowFound], split: str) -> tuple[str, str, str]:
    """Ours, the paper's and the gate; a gate that is missed is bold."""
    row = next(row for row in line.table.rows if row.name == line.rows[0])
    assert row.paper is not None and row.gate is not None
    paper = line.table.at(line.table.paper[row.paper], split, line.key)
    gate = line.table.at(line.table.gates[row.gate], split, line.key)
    told = [rows[name].cells.get((split, line.key)) for name in line.rows if name in rows]
    judged = [verdict for one in told if (verdict := judge(line.table, row, split, line.key, one))]
    worst = [one.worst for one in judged if one.worst is not None]
    ours = number(min(worst)) if worst else "missing"
    missed = any(one.reached is False for one in judged)
    return (f"**{ours}**" if missed else ours, f"{paper:g}", f"{gate:g}")


def table1() -> str:
    """Table 1, and what its trainings took."""
    found = _table(1)
    rows = found.rows
    grid = _completed(INTERACTION, rows, "table1-paper", "[a short training](#the-papers-networks)")
    return markdown([grid, Text(trained_in(rows.values(), found.about["machine"]))])


def _completed(table: Table, rows: dict[str, RowFound], name: str, words: str) -> Grid:
    """A table with the rows of another result among them, each with so many words more."""
    others = rows_of(table.number, result(name)["rows"])
    lines = [replace(row, words=f"{row.words}, {words}") if row.name in others else row for row in table.rows]
    return table_grid(replace(table, rows=tuple(lines)), others | rows)


def table1_paper() -> str:
    """The paper's interaction networks as far as they were trained, beside the paper's own, and what that took."""
    told = result("table1-paper")["rows"]
    words = {row.name: row.words for row in INTERACTION.rows}
    places = [*product(NOVEL, INTERACTION.keys)]
    lines = [(words[name], [cell(row.cells[place]) for place in places]) for name, row in rows_of(1, told).items()]
    lines += [the_papers(INTERACTION, name, places) for name in INTERACTION.paper]
    heads = [f"{objects}: {INTERACTION.keys[key]}" for objects, key in product(NOVEL.values(), INTERACTION.keys)]
    training, boards = told["paper"]["training"], told["paper"]["novel-config"]["boards"]
    share = training["config"]["epochs"] / PaperConfig().epochs
    took = (
        f"{training['epochs']} of {training['schedule']} epochs of {percent(share)} % of the schedule each; the first "
        f"row took {training['minutes']:.0f} minutes of {training['machine']['cores']} cores; "
        f"judged on {boards} boards of each set."
    )
    return markdown([plain_grid(heads, lines, "percent"), Text(took)])


def new_switches() -> str:
    """Switches that a seed drew, beside those that were looked at; recall by how they move, and relations."""
    told = result("new-switches")
    heads = ("precision (boards, switches)", "recall (boards, switches)", "switches found")
    rows = []
    real = result("new-switches-real")["rows"]["new"]
    named = {f"trained on real objects, seed {seed}": one for seed, one in enumerate(real.values())}
    for name, policies in (*told["rows"].items(), ("new", named)):
        for policy, one in policies.items():
            cells = [
                _within(
                    one[key], exact(one[key], one["intervals"][key], one["boards"]), one["switches"]["intervals"][key]
                )
                for key in _SHARES
            ]
            rows.append((f"{name}: {policy}", [*cells, percent(one["recall_objects"])]))
    new = told["rows"]["new"]
    motions = list(new["free"]["switches"]["motions"])
    shares = {
        policy: [percent(one[0] / one[1]) for one in new[policy]["switches"]["motions"].values()] for policy in new
    }
    found = [(name, [percent(one["edge_p"]), percent(one["edge_r"])]) for name, one in told["relations"].items()]
    return markdown(
        [
            plain_grid(heads, rows, "percent (95 %)"),
            plain_grid(motions, list(shares.items()), "recall on new switches"),
            plain_grid(("precision", "recall"), found, "relations, new switches"),
        ]
    )


_SHARES = ("precision", "recall")


def _within(share: float, *intervals: Sequence[float]) -> str:
    """A share with its intervals; of one of 0 or 1 a bootstrap says nothing, and nor does this."""
    ranges = ", ".join(f"{whole(low)}-{whole(high)}" if low < high else "-" for low, high in intervals)
    return f"{percent(share)} ({ranges})"


def exact(share: float, interval: Sequence[float], trials: int) -> Sequence[float]:
    """The interval, of a share of 0 or 1 exact bounds, if each of so many boards, tasks or objects is one trial."""
    return binomial_interval(round(share * trials), trials) or interval if share in (0, 1) else interval


def table2() -> str:
    """Table 2, and what our trainings took."""
    found = _table(2)
    rows = found.rows
    grid = _completed(REASONING, rows, "table2-gpu", "[on a GPU](#on-a-gpu)")
    return markdown([grid, Text(trained_in([rows["event"]], found.about["machine"]))])


def table2_gpu() -> str:
    """Rows of the paper's graph networks that were trained on a GPU, what they took, and what is trivial there."""
    told = result("table2-gpu")["rows"]
    words = {row.name: row.words for row in REASONING.rows}
    places = [*product(REASONING.splits, ("edge_p", "edge_r", "pred_a"))]
    lines, took = [], []
    for name, row in rows_of(REASONING.number, told).items():
        lines.append((words[name], [cell(row.cells[place]) for place in places]))
        took.append(Text(_on_a_gpu(words[name], told[name]["training"][0]["training"])))
    for name, row in told.items():
        of = {split: one["seeds"][0] for split, one in row["splits"].items()}
        still = [percent(of[split]["persistence"].get(key)) for split, key in places]
        lines.append((f"{words['persistence']}, on the boards of {words[name]}", still))
    lines += [the_papers(REASONING, name, places) for name in ("without exploration", "BusyBot")]
    heads = [f"{REASONING.splits[split]}: {REASONING.keys[key]}" for split, key in places]
    return markdown([plain_grid(heads, lines, "percent"), *took])


def _on_a_gpu(words: str, training: dict[str, Any]) -> str:
    """What a training on a GPU took."""
    machine, minutes, iterations = (training[key] for key in ("machine", "minutes", "iterations"))
    return (
        f"{words}: {iterations:,} iterations on {training['boards']:,} boards took {minutes:.1f} minutes of an "
        f"{machine['gpu']}, {60 * minutes / iterations:.2f} s each, and {machine['gpu_peak_bytes'] / 1e9:.1f} GB of "
        "its memory."
    )


def table3() -> str:
    """Table 3, and how the learned agents were trained."""
    rows = _table(3).rows
    told = [Text(f"`{name}`: {_practised(one)}") for name, row in rows.items() for one in row.trainings]
    return markdown([table_grid(PLANNING, rows), *told])


PIPELINE = (
    ("actions that move something", INTERACTION, "free-0", "precision"),
    ("links found", INTERACTION, "free-0", "recall"),
    ("relations: precision", REASONING, "event", "edge_p"),
    ("relations: recall", REASONING, "event", "edge_r"),
    ("predicted steps, all responders right", REASONING, "event", "pred_a"),
    *(
        (f"goals reached, {kind}: `{agent}`", PLANNING, agent, kind)
        for agent in ("search", "busybot")
        for kind in KINDS
    ),
)
"""Lines of the whole pipeline: words, and whose gate counts for which number."""


def learned_agents() -> str:
    """Success of learned agents on boards practised on and on others, by boards and by how they remember."""
    lines = []
    for name, row in result("learned-agents")["rows"].items():
        runs = row["seeds"]
        cells = []
        for weights in ("held_out", "imitating_best", "held_out_last"):
            found = [one[weights] for one in runs if one[weights]]
            cells += [_mean(one[key] for one in found) if found else "-" for key in ("success_seen", "success")]
        lines.append((f"{name} boards", [*cells, " / ".join(f"{one['best_iteration']:,}" for one in runs)]))
    which = ("kept", "imitating best", "last")
    heads = (*(f"{one}: {on}" for one in which for on in ("practised on", "others")), "kept after")
    return markdown([plain_grid(heads, lines, "percent")])


REMEMBERING = {
    "bc": "behaviour cloning, LSTM",
    "bc-attention": "behaviour cloning, attention",
    "ppo": "PPO, LSTM",
    "ppo-attention": "PPO, attention",
}
"""What trainings of learned agents are called that play Table 3's tasks."""


def learned_plans() -> str:
    """What learned agents reach on Table 3's tasks, by how they remember."""
    found = rows_of(PLANNING.number, result("plan-learned")["agents"])
    places = [*product(PLANNING.splits, KINDS)]
    heads = [f"{PLANNING.splits[split]}: {PLANNING.keys[kind]}" for split, kind in places]
    lines = [(words, [cell(found[name].cells[place]) for place in places]) for name, words in REMEMBERING.items()]
    lines += [the_papers(PLANNING, agent, places) for agent in ("BC", "PPO")]
    told = [Text(f"{REMEMBERING[name]}: {_practised(one)}") for name, row in found.items() for one in row.trainings]
    return markdown([plain_grid(heads, lines, "percent"), *told])


def _mean(shares: Iterable[float]) -> str:
    """Percent, with the extremes where seeds differ."""
    found = [100 * one for one in shares]
    spread = f" ({min(found):.1f} to {max(found):.1f})" if min(found) != max(found) else ""
    return f"{sum(found) / len(found):.1f}{spread}"


def whole_pipeline() -> str:
    """What each seed reaches with a policy, recordings, a reasoner and histories of its own.

    Raises:
        BusybotError: a seed's policy is not that of Table 1's row.
    """
    told, free = result("whole-pipeline")["rows"], result("table1")["rows"]
    for seed, one in told.items():
        if one["policy"]["model_sha256"] != free[f"free-{seed}"]["policy"]["model_sha256"]:
            raise BusybotError(f"whole-pipeline: seed {seed} has another policy than Table 1", "run it again with that")
    found = [_of_one_seed(free[f"free-{seed}"], one) for seed, one in told.items()]
    lines = []
    for (split, words), (what, table, name, key) in product(NOVEL.items(), PIPELINE):
        row = next(row for row in table.rows if row.name == name)
        lines.append((f"{words}: {what}", _seeds_cells(table, row, split, key, [one[name] for one in found])))
    return markdown([plain_grid((*(f"seed {seed}" for seed in told), "mean", "gate"), lines, "percent")])


def _of_one_seed(policy: dict[str, Any], seed: dict[str, Any]) -> dict[str, RowFound]:
    """The rows of the three tables, of one seed's policy, reasoner and agents."""
    relations = {split: {**across([one]), "seeds": [one]} for split, one in seed["relations"].items()}
    agents = {
        name: {"splits": {split: {kind: cell[name] for kind, cell in kinds.items()} for split, kinds in plans.items()}}
        for plans in [seed["plans"]]
        for name in OURS
    }
    return rows_of(1, {"free-0": policy}) | rows_of(2, {"event": {"splits": relations}}) | rows_of(3, agents)


def _seeds_cells(table: Table, row: ReferenceRow, split: str, key: str, found: list[RowFound]) -> list[str]:
    """Each seed, their mean with the widest interval over objects, and the gate with how many seeds reach it."""
    scores = [one.cells[split, key] for one in found]
    known = [one for one in scores if one is not None]
    if not known:
        return [*("-" for _ in (*scores, "mean")), ""]
    mean = Score(sum(one.value for one in known) / len(known), objects=widest(one.objects for one in known))
    verdicts = [verdict for one in scores if (verdict := judge(table, row, split, key, one))]
    reached = reaching(sum(one.reached is True for one in verdicts), len(scores))
    gate = f"{verdicts[0].gate:g} {reached}" if verdicts else ""
    return [
        *("-" if one is None else number(one.value) for one in scores),
        f"{number(mean.value)} {mean.spread}".rstrip(),
        gate,
    ]


def reaching(seeds: int, of: int) -> str:
    """How many seeds reach a gate."""
    return "✓" if seeds == of else "✗" if not seeds else f"{seeds} of {of}"


def plan_procedural() -> str:
    """The agents of Table 3 with what ships with busybot."""
    told = result("plan-procedural")
    for agent in told["agents"].values():
        for split in agent["splits"].values():
            for one in split.values():  # made before evaluations told exact bounds themselves
                one["interval"] = exact(one["success"], one["interval"], told["tasks"])
    return markdown([table_grid(PLANNING, rows_of(3, told["agents"]), beside=False)])


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
            shares = [f"{percent(told['exceeding'][delta]['share_of_moves'])} %" for delta in deltas]
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
    boards = {place: one["boards"] for place, one in told["boards"].items()}
    strict = [
        _setting(name, told["default_strict"], [(row, boards["novel-object"])]) for name, row in told["rows"].items()
    ]
    places = {"novel-object": "held out", "novel-config": "known", "other": "free seed 0"}
    columns = [f"{words}: {keys[key]}" for words in places.values() for key in ("precision", "recall")]
    free = [
        _setting(name, told["default"], [(row.get(place), boards[place]) for place in places], ("precision", "recall"))
        for name, row in told["free"].items()
    ]
    first = plain_grid(("default", "here", *keys.values()), strict, "under the veto")
    return markdown([first, plain_grid(("default", "here", *columns), free, "without")])


def _setting(
    setting: str, default: dict[str, Any], judged: list[tuple[Any, int]], keys: Iterable[str] = tuple(INTERACTION.keys)
) -> tuple[str, list[str]]:
    """Name, default and value of a varied constant; rows that vary none or several have a name.

    Args:
        judged: what was found, and on how many boards.
    """
    name, _, value = setting.partition("=")
    cells = [_with_interval(one, key, boards) for one, boards in judged for key in keys]
    if not value:
        return f"*{name}*", ["", "", *cells]
    return f"`{name}`", [f"{default[name]:g}", f"{float(value):g}", *cells]


def _with_interval(judged: dict[str, Any] | None, key: str, boards: int) -> str:
    if judged is None or judged[key] is None:
        return "missing" if judged is None else "-"
    told = judged["intervals"][key] or (judged[key], judged[key])
    low, high = (100 * end for end in exact(judged[key], told, boards))
    return f"{percent(judged[key])} {spread(100 * judged[key], low, high)}"


def reason_procedural() -> str:
    """What the shipped model of relations does on procedural objects."""
    rows = []
    for split, told in result("reason-procedural")["splits"].items():
        names = {key: INTERVALS.get(key, key) for key in ("edge_p", "edge_r", "pred_a")}
        within = {key: _over_objects(told.get("object_intervals", {}).get(name)) for key, name in names.items()}
        bounded = [
            f"{percent(told[key])}{within[key]} ({percent(told[f'{key}_bound'])})" for key in ("edge_r", "pred_a")
        ]
        rest = [percent(told[key]) for key in ("pred_a_successful", "failing")]
        rows.append((split, [f"{percent(told['edge_p'])}{within['edge_p']}", *bounded, *rest]))
    heads = ("Edge-P", "Edge-R (bound)", "Pred-A (bound)", "successful", "steps that fail")
    return markdown([plain_grid(heads, rows, "percent")])


def _over_objects(ends: list[float] | None) -> str:
    return f" [{percent(ends[0])}-{percent(ends[1])}]" if ends else ""


def whole(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f}"


def hostile() -> str:
    """Hostile files by class: how many were tried, how reading them ended, and how many led to something else."""
    classes: dict[str, list[dict[str, Any]]] = {}
    for kind in result("hostile")["kinds"].values():
        classes.setdefault(kind["class"], []).append(kind)
    ends = ("refused", "noticed", "same answer", "another answer")
    rows = []
    for name, kinds in classes.items():
        told = [sum(kind["results"].get(end, 0) for kind in kinds) for end in ends]
        counts = (sum(kind["cases"] for kind in kinds), *told, sum(len(kind["findings"]) for kind in kinds))
        rows.append((name, tuple(f"{count:,}" for count in counts)))
    return markdown([plain_grid(("tried", *ends, "failed"), rows, "class")])
