"""Prints the results of `busybot eval` for people; shares are told in percent."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from busybot.cli.common import console, counted, say, tell

if TYPE_CHECKING:
    from rich.table import Table

    from busybot.reason.evaluation.summary import JudgedGraph

MOST_LINES = 40
PREDICTIONS = ("pred_a", "pred_a_successful", "pred_a_responder", "pred_a_changed", "pred_a_unchanged")
ACTIONS = {
    "precision": "precision",
    "recall": "recall",
    "recall_objects": "  of objects",
    "precision_exploring": "  new links only",
    "precision_reward": "  as pixels tell",
    "off_axis_share": "successes off axis",
}


@dataclass
class ToldGraphs:
    """Takes what was inferred of each board.

    Attributes:
        folder: to write it into, if that was asked for.
        unjudged: lines for people about the first boards whose relations nobody knows.
    """

    folder: Path | None
    unjudged: list[str] = field(default_factory=list)

    def keep(self, file: Path, judged: "JudgedGraph") -> None:
        """Write a board's graph; remember it for people where it cannot be judged."""
        from busybot.episodes.mcap.reader import read_episode
        from busybot.reason.evaluation.graph_files import graph_lines, graph_values, write_graph

        if self.folder is None and (judged.board.relations_known or len(self.unjudged) > MOST_LINES):
            return
        values = graph_values(read_episode(file, "lazy"), judged.graph, judged.steps)
        if self.folder is not None:
            write_graph(self.folder, values)
        if not judged.board.relations_known and len(self.unjudged) <= MOST_LINES:
            self.unjudged += [f"board {judged.board.index}: {line}" for line in graph_lines(values)]


def answers(result: dict[str, Any]) -> None:
    """How many pairs of questions "what if" were answered rightly."""
    low, high = (100 * end for end in result["intervals"]["what_if"])
    share = f"{_percent(result['what_if'])} % (95 % over boards: {low:.1f} to {high:.1f})"
    tell(f"{result['right']} of {counted(result['pairs'], 'pair')} answered rightly: {share}")


def reasoning(result: dict[str, Any], unjudged: Sequence[str] = ()) -> None:
    """The relations, then what was predicted, each with what stands beside it."""
    for line in unjudged[:MOST_LINES]:
        tell(line)
    if len(unjudged) > MOST_LINES:
        tell("and more; --graphs DIR writes all of them")
    if unjudged and not result["counts"]["pairs"]:
        say("nobody told the relations of these boards: nothing is judged")
        return
    screen = console()
    screen.print(_edges(result))
    if result["boxes"] == "proposed":
        roles = " / ".join(_percent(result[f"proposal_r_{role}"]) for role in ("triggers", "responders"))
        told = f"{_percent(result['proposal_r'])} % of the objects ({roles}: triggers, responders)"
        screen.print(f"objects proposed: {told}, {_percent(result['proposal_p'])} % of the proposed are there")
    screen.print(_parents(result))
    if result["predicted_boards"]:
        screen.print(_predictions(result))
    elif used := result["images_used"]:
        why = f"the recordings have at most {counted(used - 1, 'step')}, so no step is left to predict"
        hint = "use a smaller --images, or record more with collect --steps"
        if used == result["images"]:  # what follows may be there, without states
            why = f"no recording tells the states of a step after its first {counted(used, 'image')}"
            hint = "it takes recordings that go on, and whose states are known"
        screen.print(f"no Pred-A: {why}; {hint}", soft_wrap=True)


def _edges(result: dict[str, Any]) -> "Table":
    asked, used = result["images"], result["images_used"]
    images = f"{used} of {asked} images" if used and used < asked else counted(asked, "image")
    oracle = " (an oracle)" if result["oracle"] else ""
    table = _table(
        f"{_origin(result)}: relations of {counted(result['boards'], 'board')}, first "
        f"{images}, actions by {result['policy'] or 'nobody'}{oracle}",
        ("Edge-P", "Edge-R", "Edge-Acc", "ECE, doubted", "Brier"),
    )
    keys, edges = ("edge_p", "edge_r", "edge_acc"), ("precision", "recall", "accuracy")
    shares = (_percent(result[key]) for key in keys)
    table.add_row(result["model"], *shares, _doubted(result["calibration"]), _percent(result["brier"]), style="bold")
    for name, kind in (("boards", "intervals"), ("triggers", "object_intervals")):
        table.add_row(f"  95 % over {name}", *(_span(result[kind].get(key)) for key in edges))
    table.add_row("  mean over boards", *(_percent(result["macro"][key]) for key in edges))
    table.add_row("  effect was visible", "", _percent(result["edge_r_bound"]), end_section=True)
    for kind, scores in result["by_kind"].items():
        name = f"  {kind} ({scores['relations']})"
        table.add_row(name, _percent(scores["edge_p"]), _percent(scores["edge_r"]))
    table.add_section()
    for name, scores in result["baselines"].items():
        table.add_row(name, *(_percent(scores[key]) for key in keys), "", _percent(scores["brier"]))
    return table


def _doubted(told: dict[str, Any]) -> str:
    """The calibration error over what is doubted, with the number of pairs; of few of them nothing is said."""
    from busybot.evaluation.statistics import LEAST_PAIRS

    pairs = told["pairs_uncertain"]
    return f"{_percent(told['ece_uncertain'] if pairs >= LEAST_PAIRS else None)} ({pairs})"


def _parents(result: dict[str, Any]) -> "Table":
    """What is judged in every world, beside what the recordings determine."""
    table = _table(
        f"causes, world {result['world']}; bounds of {counted(result['bound_boards'], 'board')}",
        ("parents P", "R", "F1", "of links", "distance", "mechanisms", "what if"),
    )
    for name, end in ((result["model"], ""), ("exact observer", "_bound")):
        parents = [_percent(result.get(f"parent_{score}{end}")) for score in ("p", "r", "f1")]
        distance = result[f"shd{end}"]
        table.add_row(
            name,
            *parents,
            _percent(result[f"link_parent_f1{end}"]),
            "-" if distance is None else f"{distance:.2f}",
            _percent(result["mechanism_bound" if end else "mechanism_accuracy"]),
            "" if end else _percent(result["what_if"]),
        )
    return table


def _predictions(result: dict[str, Any]) -> "Table":
    table = _table(
        f"Pred-A: {counted(result['predicted_steps'], 'later step')} on "
        f"{counted(result['predicted_boards'], 'board')}, "
        f"{_percent(result['failing'])} % of them without success",
        ("all", "success", "each", "changed", "same"),
    )
    rows = {
        result["model"]: result,
        "  by decoders": result["decoded"],
        "nothing changes": result["persistence"],
        "bound, failures unknown": result["bounds"]["not_knowing"],
        "bound, failures known": result["bounds"]["knowing"],
        **{f"  {kind} ({scores['steps']})": scores for kind, scores in result["pred_by_kind"].items()},
    }
    for name, scores in rows.items():
        if scores is not None:
            table.add_row(name, *(_percent(scores[key]) for key in PREDICTIONS))
    for judge, shares in result["decoder_accuracy"].items():
        if shares is not None:
            accuracies = ", ".join(f"{name} {_percent(share)}" for name, share in shares.items())
            table.caption = f"{table.caption or 'true features read rightly'}; {judge}: {accuracies}"
    return table


def interaction(result: dict[str, Any]) -> None:
    """Shares with their 95 % intervals and their mean over boards, then what failed and what was missed."""

    veto, screen = ", strict" if result["strict"] else "", console()
    table = _table(
        f"{_origin(result)}: {counted(result['actions'], 'action')} on each of "
        f"{counted(result['boards'], 'board')}{veto}",
        ("all", "boards", "objects", "by board", "counted", "of"),
        f"percent (95 % over), {result['policy']}",
    )
    for key, name in ACTIONS.items():
        spans = [_span(result[kind].get(key)) for kind in ("intervals", "object_intervals")]
        count = result["counts"][key]
        mean = _percent(result["macro"][key])
        table.add_row(name, _percent(result[key]), *spans, mean, str(count["part"]), str(count["whole"]))
    screen.print(table)
    objects = list(result["failures_by_object"].items())[:6]
    failed = (f"{key} ({row['position'] + row['direction']} of {row['actions']})" for key, row in objects)
    links = list(result["missed_links"].items())[:6]
    missed = (f"{name} ({row['missed']} of {row['boards']})" for name, row in links)
    told = {"failed because of": _causes(result), "failed most on": ", ".join(failed), "missed most": ", ".join(missed)}
    for what, which in told.items():
        if which:
            screen.print(what, which)


def planning(result: dict[str, Any]) -> None:
    """Success with its 95 % interval and what stands beside it, then why responders were missed."""

    screen = console()
    kinds = ", ".join(f"{count} {kind}" for kind, count in result["kinds"].items())
    tasks = "task" if sum(result["kinds"].values()) == 1 else "tasks"
    table = _table(
        f"{_origin(result)}: {kinds} {tasks}, at most {counted(result['steps'], 'step')}",
        ("success", "95 %", "pooled", "looks", "solved", "steps", "CPU ms"),
    )
    for agent, row in result["agents"].items():
        shares = (_percent(row[key]) for key in ("micro", "by_features", "solved"))
        cpu = result["timing"][agent]["cpu_ms"]
        steps = "-" if row["steps"] is None else f"{row['steps']:.1f}"
        first = (_percent(row["success"]), _span(row["interval"]), *shares, steps)
        table.add_row(
            f"{agent}*" if agent in result["oracles"] else agent, *first, "-" if cpu is None else f"{cpu:.0f}"
        )
    if result["oracles"]:
        table.caption = "* knows what only the simulator knows"
    screen.print(table)
    for agent, row in result["agents"].items():
        if causes := _causes(row):
            screen.print(f"{agent} missed because of", causes)


def _causes(judged: dict[str, Any]) -> str:
    return ", ".join(f"{cause} ({count})" for cause, count in judged["failures_by_cause"].items() if count)


def _origin(result: dict[str, Any]) -> str:
    return f"{result['dataset']['name']} ({result['dataset']['split']})"


def _table(title: str, columns: Iterable[str], corner: str = "percent") -> "Table":
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    table.add_column(corner, no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _span(ends: tuple[float, float] | None) -> str:
    """An interval, in whole percent."""
    return "-".join(f"{100 * end:.0f}" for end in ends or ())


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
