"""The part of a report about worlds whose causes are hard: who finds what causes what, and who plans with it."""

from collections.abc import Sequence
from pathlib import Path

from busybot.view.figures.discovery import discovery_figure
from busybot.view.report.page import Block, Entry, Fold, Grid, Heading, Items, Picture, Text, number, spread
from busybot.view.report.sections import compared
from busybot.view.report.world_results import (
    AFTER,
    PlannedAgent,
    Played,
    WorldPlan,
    WorldResults,
    WorldRow,
    boards_of,
    digest,
    is_count,
    short,
)

ABOUT = (
    "Boards on which an effect needs two switches, comes late, fails by chance, or is held back. "
    "Rows of one section are about the same boards, which their hash tells; the exact observer is told "
    "the true states that the same actions led to. What nobody was asked is left out (-)."
)
PARENTS = (
    "F1 of parents after so many actions; P and R after {0}. Links are told apart by some models only. A graph from a "
    "file is judged as it stands."
)
GAP = (
    "Who predicts need not understand: Pred-A (what the next action changes) beside the share of mechanisms whose "
    "every response is foretold, and the gap between the two, in points. What if: pairs of questions answered rightly. "
    "ECE: over pairs that are neither sure nor ruled out, their number behind it; of fewer than 500 nothing is said. "
    "Objects found: by who was not given boxes."
)
PLANNING = (
    "Success is the mean share of responders in their goal state; steps over the shortest plan are those of solved "
    "tasks. Mechanisms: the share that the agent's reasoner knows in this world, as far as a result above tells it; "
    "beside it success minus this share."
)
PLAYED = (
    "Programs that play boards as text: contacts and looks are given to them, so these rows compare among themselves."
)
REGRET = (
    "How far F1 stays behind the exact greedy experimenter's, points, mean over the first 30 actions; after it the "
    "number of actions until F1 is 95."
)
REASONED = ("relation", "predictive", "busybot", "search", "mechanism")
"""Agents that ask the reasoner."""
NONE = Entry("-", tone="reference")
MOST_PANELS = 12


def world_blocks(results: WorldResults, figures: Path) -> list[Block]:
    """Everything that was given about other worlds; nothing if nothing was."""
    if not results:
        return []
    blocks: list[Block] = [Heading("Worlds whose causes are hard"), Text(ABOUT)]
    groups = results.groups()
    if groups:
        blocks += [Heading("Relations", 3), Text(PARENTS.format(AFTER[1])), _parents(groups), *_curves(groups, figures)]
        blocks += [Heading("Success and understanding", 3), Text(GAP), _understanding(groups)]
        blocks += _rewired(groups)
        blocks += compared(results.reason)
    if results.played:
        blocks += [Heading("Played as text", 3), Text(PLAYED), _played(results.played)]
    if results.plans or results.plan_tables:
        blocks += [Heading("Planning in worlds", 3), Text(PLANNING), _planned(results), *_locks(results.plans)]
    if any(choice.regret is not None for choice in _choices(results)):
        blocks += [Heading("Regret", 3), Text(REGRET), *_regret(results)]
    return [*blocks, _origins(results)]


def _entry(share: float | None, small: str = "", sign: bool = False) -> Entry:
    if share is None:
        return NONE
    return Entry(f"{100 * share:+.1f}" if sign else number(100 * share), small)


def _plain(value: float | None, digits: int = 0) -> Entry:
    return NONE if value is None else Entry(f"{value:.{digits}f}")


def _lines(groups: dict[str, list[WorldRow]], cells: list[list[tuple[Entry, ...]]]) -> tuple:
    """Sections of a grid, one for each group."""
    lines: list[tuple[str, tuple[Entry, ...]]] = []
    for (words, rows), own in zip(groups.items(), cells, strict=True):
        lines += [(words, ()), *((row.name, entries) for row, entries in zip(rows, own, strict=True))]
    return tuple(lines)


def _parents(groups: dict[str, list[WorldRow]]) -> Grid:
    def level(told: dict) -> list[Entry]:
        p, r, _ = told.get(AFTER[1], (None,) * 3)
        return [*(_entry(told.get(n, (None,) * 3)[2]) for n in AFTER), _entry(p), _entry(r)]

    cells = [
        [(Entry(str(row.boards)), *level(dict(row.objects)), *level(dict(row.links))) for row in rows]
        for rows in groups.values()
    ]
    heads = (*(f"F1 {n}" for n in AFTER), f"P {AFTER[1]}", f"R {AFTER[1]}")
    return Grid((("", 1), ("objects", 5), ("links", 5)), ("boards", *heads, *heads), _lines(groups, cells), "percent")


def _understanding(groups: dict[str, list[WorldRow]]) -> Grid:
    cells = [[_understood(row) for row in rows] for rows in groups.values()]
    heads = ("Pred-A", "mechanisms", "gap", "what if", "ECE", "actions until 95", "objects found")
    return Grid((), heads, _lines(groups, cells), "percent")


def _understood(row: WorldRow) -> tuple[Entry, ...]:
    one = row.found
    if one is None:
        return (NONE,) * 7
    pairs = "" if one.uncertain_pairs is None else f"({one.uncertain_pairs})"
    known = None not in (one.pred_a, one.mechanism_accuracy)
    gap = (one.pred_a or 0) - (one.mechanism_accuracy or 0) if known else None
    return (
        _entry(one.pred_a),
        _entry(one.mechanism_accuracy),
        _entry(gap, sign=True),
        _entry(one.what_if),
        Entry("-", pairs, "reference") if one.ece_uncertain is None else _entry(one.ece_uncertain, pairs),
        _plain(getattr(one, "actions_until_found", None)),
        _entry(getattr(one, "proposal_r", None)),
    )


def _rewired(groups: dict[str, list[WorldRow]]) -> list[Block]:
    """Only where something was rewired and somebody says so, or might have."""
    own = {words: [row for row in rows if getattr(row.found, "rewirings", 0)] for words, rows in groups.items()}
    own = {words: rows for words, rows in own.items() if rows}
    if not own:
        return []
    cells: list[list[tuple[Entry, ...]]] = [
        [
            (
                _plain(getattr(row.found, "rewirings", None)),
                _entry(getattr(row.found, "rewired_found", None)),
                _entry(getattr(row.found, "rewired_placed", None)),
                _plain(getattr(row.found, "rewired_false_alarms", None), 2),
            )
            for row in rows
        ]
        for rows in own.values()
    ]
    heads = ("rewirings", "found", "placed", "false alarms a board")
    words = "Mechanisms that changed: found within 5 actions after it showed, and said when."
    return [Heading("Rewired", 3), Text(words), Grid((), heads, _lines(own, cells), "percent")]


def _curves(groups: dict[str, list[WorldRow]], figures: Path) -> list[Block]:
    shown = {words: rows for words, rows in groups.items() if any(row.curve for row in rows)}
    if not shown:
        return []
    chosen = dict(list(shown.items())[:MOST_PANELS])
    caption = "F1 of parents (pairs of objects) after so many actions; dotted: what the recordings determine."
    return [Picture(discovery_figure(figures / "worlds.png", chosen, figures.parent), caption)]


def _played(played: dict[str, Played]) -> Grid:
    lines: list[tuple[str, tuple[Entry, ...]]] = []
    for words in dict.fromkeys(map(boards_of, played.values())):
        lines.append((words, ()))
        for one in played.values():
            if boards_of(one) == words:
                lines.append((short(one.agent), _game(one)))
    heads = ("boards", "P", "R", "F1", "links P", "R", "F1", "actions", "early", "wrongly", "refused", "said it knows")
    return Grid((), heads, tuple(lines), "percent")


def _game(one: Played) -> tuple[Entry, ...]:
    bounds = [
        f"bound {number(100 * x)}" if x is not None else "" for x in (one.parent_f1_bound, one.link_parent_f1_bound)
    ]
    return (
        Entry(str(one.boards)),
        *map(_entry, (one.parent_p, one.parent_r)),
        _entry(one.parent_f1, bounds[0]),
        *map(_entry, (one.link_parent_p, one.link_parent_r)),
        _entry(one.link_parent_f1, bounds[1]),
        Entry("-" if one.actions_used is None else f"{one.actions_used:.1f}", f"of {one.most_actions}"),
        Entry(str(one.early_stops)),
        _entry(one.wrong_early_stops),
        Entry(str(one.refused)),
        _entry(one.ends.get("knows", 0) / one.boards if one.boards else None),
    )


def _planned(results: WorldResults) -> Grid:
    lines: list[tuple[str, tuple[Entry, ...]]] = []
    for plan in results.plans.values():
        lines.append((f"{boards_of(plan)}, {plan.tasks} tasks, reasoner {short(plan.reasoner)}", ()))
        known = results.understood(plan.world, plan.reasoner, plan.dataset.get("board_hash"))
        for name, told in plan.agents.items():
            own = known if name in REASONED else None
            low, high = told.interval or (None, None)
            interval = "" if low is None or high is None else spread(100 * (told.success or 0), 100 * low, 100 * high)
            gap = None if own is None or told.success is None else told.success - own
            lines.append((short(name), (*_reached(told, interval), _entry(own), _entry(gap, sign=True))))
    for file in results.plan_tables.values():
        for world, table in file.rows.items():
            lines.append((f"{short(world)}: {table.tasks} tasks, {short(file.history)} histories", ()))
            lines += [(short(name), (*_reached(told), NONE, NONE)) for name, told in table.agents.items()]
    heads = ("success", "tasks solved", "steps over shortest", "mechanisms", "success minus these")
    return Grid((), heads, tuple(lines), "percent")


def _reached(told: PlannedAgent, interval: str = "") -> tuple[Entry, ...]:
    return _entry(told.success, interval), _entry(told.solved), _plain(told.steps_over_shortest, 2)


def _locks(plans: dict[str, WorldPlan]) -> list[Block]:
    """Success by the number of links that are held one behind the other, where any is."""
    own = [plan for plan in plans.values() if any(depth != "0" for depth in plan.by_locks)]
    depths = sorted({int(depth) for plan in own for depth in plan.by_locks if is_count(depth)})
    if not depths:
        return []
    lines: list[tuple[str, tuple[Entry, ...]]] = []
    for plan in own:
        told = [plan.by_locks.get(str(depth), {}) for depth in depths]
        lines.append((boards_of(plan), ()))
        lines.append(("tasks", tuple(_plain(one.get("tasks")) for one in told)))
        lines += [(short(name), tuple(_entry(one.get(name)) for one in told)) for name in plan.agents]
    heads = tuple(f"{depth} locks" if depth != 1 else "1 lock" for depth in depths)
    return [Text("Success by locks that lie behind each other."), Grid((), heads, tuple(lines), "percent")]


def _choices(results: WorldResults) -> list:
    return [
        choice
        for told in results.curiosity.values()
        for parts in told.rows.values()
        for choices in parts.values()
        for choice in choices.values()
    ]


def _regret(results: WorldResults) -> list[Block]:
    blocks: list[Block] = []
    for told in results.curiosity.values():
        own = {
            world: choices
            for world, parts in told.rows.items()
            for choices in parts.values()
            if any(choice.regret is not None for choice in choices.values())
        }
        names = list(dict.fromkeys(name for choices in own.values() for name in choices))
        lines = []
        for world, choices in own.items():
            entries = []
            for name in names:
                one = choices.get(name)
                until = (
                    "" if one is None else f"({one.until:.0f})" if one.until <= len(one.f1) else f"(over {len(one.f1)})"
                )
                entries.append(NONE if one is None or one.regret is None else Entry(number(100 * one.regret), until))
            lines.append((short(world), tuple(entries)))
        if lines:
            blocks.append(Grid((), tuple(map(short, names)), tuple(lines), "points of F1"))
    return blocks


def _origins(results: WorldResults) -> Fold:
    items = []
    for name, one in results.files():
        seed = "" if one.seed is None else f", seed {one.seed}"
        made = "" if one.command is None else f", `{one.command.replace('`', '')}`"
        code = "" if one.commit is None else f", code of commit `{one.commit.replace('`', '')}`"
        items.append(f"file `{name}`: boards `{digest(one.dataset)}`{seed}{made}{code}")
    files: Sequence[str] = [*results.tables, *results.curiosity, *results.gates, *results.plan_tables]
    items += [f"file `{name}`" for name in files]
    return Fold("Commands, seeds, hashes", (Items(tuple(items)),))
