"""`busybot play DATASET --agent COMMAND`: any program is judged on boards, by lines of text."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from busybot.cli.common import console, counted, episode_progress, print_json, processes, tell, warn
from busybot.cli.options import AssetsOption, JsonOption, SeedOption, WorkersOption
from busybot.common.text import one_line

MOST_NOTES = 5


def play(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset; only its boards are used.")],
    agent: Annotated[str, typer.Option(help="Command that is started for each board, without a shell.")],
    actions: Annotated[int, typer.Option(min=0, max=1000, help="On each board, at most.")] = 22,
    timeout: Annotated[int, typer.Option(min=1, max=3600, help="Seconds for each answer.")] = 60,
    boards: Annotated[int | None, typer.Option(min=1, help="Only so many, the first ones; by default all.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; continues an evaluation stopped under this version.")
    ] = None,
    assets: AssetsOption = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Which link controls what, as any program finds out that speaks lines of JSON: docs/extending/text-agent.md.

    Boards move by their law, without simulator and pictures; contacts are given. The program is not shut in: it may
    read what you may read. Shares in JSON lie between 0 and 1, in the table they are percent.
    """
    from busybot.common.line_child import command_words
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.reason.evaluation.play import TextGames, play_boards

    target, words = Dataset.open(dataset), command_words(agent)
    games = TextGames(target, library_of(target, assets), words, actions, timeout, boards, seed)
    given = {"actions": actions, "timeout": timeout, "boards": boards, "seed": seed}
    again = [f"--{name}={value}" for name, value in given.items() if value is not None]
    command = shlex.join(["busybot", "play", str(dataset), "--agent", agent, *again])
    with episode_progress("playing") as progress:
        result = play_boards(games, processes(workers), progress, out, command)
    if json:
        print_json(result)
    else:
        _show(result)
    if _is_silent(result["cause_boards"]):
        what = f"error: the program gave no answer on any board: {', '.join(result['ends'])}"
        warn(f"{what}\n  hint: try its command by itself: {agent}")
        raise typer.Exit(1)


def _is_silent(boards: list[dict[str, Any]]) -> bool:
    """Whether nothing came from the program, not even what had to be refused: the figures are about nobody."""
    answered = (one["end"] == "knows" or one["actions"] or one["refused"] for one in boards)
    return bool(boards) and not any(answered)


def _show(result: dict[str, Any]) -> None:
    """Parents beside what the same actions told the exact observer, then how boards ended."""
    from rich.table import Table

    screen, origin = console(), result["dataset"]
    title = f"{origin['name']} ({origin['split']}): {counted(result['boards'], 'board')}, world {result['world']}"
    table = Table(title=title, title_justify="left")
    table.add_column("percent", no_wrap=True)
    for name in ("parents P", "R", "F1", "of links P", "R", "F1", "distance"):
        table.add_column(name, justify="right", no_wrap=True)
    shares = [result[f"{level}parent_{name}"] for level in ("", "link_") for name in ("p", "r", "f1")]
    table.add_row("the program", *map(_percent, shares), _number(result["shd"]), style="bold")
    for name, end in (("  95 % interval from", 0), ("  to", 1)):
        table.add_row(name, *(_percent(ends and ends[end]) for ends in result["intervals"].values()))
    bounds = ("", "", _percent(result["parent_f1_bound"]), "", "", _percent(result["link_parent_f1_bound"]))
    table.add_row("exact observer", *bounds, _number(result["shd_bound"]))
    screen.print(table)
    tell(
        f"{_number(result['actions_used'])} of {result['most_actions']} actions on a board, "
        f"{result['early_stops']} early stops, {_percent(result['wrong_early_stops'])} % of the boards wrongly; "
        f"{counted(result['refused'], 'answer')} refused"
    )
    tell("boards ended: " + ", ".join(f"{end} {count}" for end, count in result["ends"].items()))
    for row in [row for row in result["cause_boards"] if row["end"] != "knows"][:MOST_NOTES]:
        tell(f"board {row['board']}: {row['end']}" + (f": {one_line(row['note'])}" if row["note"] else ""))
    if result["agent_changed"]:
        names = one_line(", ".join(result["agent_changed"]))
        tell(f"changed since the evaluation began, not counted as the agent: {names}")


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
