"""`busybot dataset`: look at a dataset, check it."""

from pathlib import Path
from typing import Annotated, Any

import typer

from busybot.cli.common import JsonOption, WorkersOption, episode_progress, print_json, say

app = typer.Typer(add_completion=False, no_args_is_help=True, help="Look at a dataset, check it.")

DatasetArgument = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of the dataset.", show_default=False)]


@app.command()
def info(dataset: DatasetArgument, json: JsonOption = False) -> None:
    """What is in a dataset, with the hashes over its boards, traces and content."""
    from busybot.episodes.summary import summarise

    summary = summarise(dataset)
    if json:
        print_json(summary)
    else:
        _print_table(dataset, summary)


@app.command()
def verify(dataset: DatasetArgument, workers: WorkersOption = None, json: JsonOption = False) -> None:
    """Check structure, checksums and boards, and tables against episodes. Exits with 1 if something is wrong."""
    from busybot.episodes.verify import verify as verify_dataset
    from busybot.workers import default_workers

    with episode_progress("verifying") as progress:
        report = verify_dataset(dataset, workers or default_workers(), progress)
    for problem in report.problems:
        say(f"{problem.file}: {problem.what}\n  mend: {problem.mend}")
    if json:
        print_json({"ok": report.ok, "episodes": report.episodes, "problems": report.problems})
    else:
        verdict = "nothing is wrong" if report.ok else f"{len(report.problems)} problems"
        print(f"{dataset}: {report.episodes} episodes checked, {verdict}")
    if not report.ok:
        raise typer.Exit(1)


def _print_table(dataset: Path, summary: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=str(dataset), show_header=False, title_justify="left")
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for key, value in summary.items():
        table.add_row(key.replace("_", " "), _readable(key, value))
    Console().print(table)


def _readable(key: str, value: Any) -> str:
    if value is None:
        return "-"
    if key == "bytes":
        return f"{value:,} ({value / 1e6:.1f} MB)"
    if key.endswith("_share"):
        return f"{value:.1%}"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) and key != "seed" else str(value)
