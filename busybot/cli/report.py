"""`busybot report`: results as tables and plots beside the paper's."""

from pathlib import Path
from typing import Annotated

import typer

from busybot.cli.common import print_json, say, tell
from busybot.cli.options import DeviceOption, JsonOption, interaction_models, offering, reasoners
from busybot.common.errors import UsageError


def report(
    results: Annotated[
        list[Path],
        typer.Argument(metavar="RESULT...", help="Files of `busybot eval` or of benchmarks/; folders of them."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for report.html, report.md and figures.")],
    episode: Annotated[
        Path | None, typer.Option(help="An episode's .mcap file: draw affordances and the growing graph of it.")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="With --episode: interaction model, a name or a folder.", autocompletion=offering(interaction_models)
        ),
    ] = None,
    reasoner: Annotated[
        str | None,
        typer.Option(
            help="With --episode: who infers relations, as in `eval reason`.",
            autocompletion=offering(reasoners),
            show_default="count",
        ),
    ] = None,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Tables 1 to 3 with plots, beside the paper's numbers, trivial baselines and gates, as one HTML file.

    What is missing is shown as missing. Pictures in the folders are put in, too.
    """
    from busybot.view.report.report import Shown, write_report

    for option, name in (("--model", model), ("--reasoner", reasoner)):
        if name is not None and episode is None:
            raise UsageError(f"{option} {name} is about an episode", "name one with --episode, or leave it out")
    shown = None if episode is None else Shown(episode, model, reasoner or "count")
    done = write_report(results, out, shown)
    gates = {"reached": done.count(True), "missed": done.count(False), "not_measured": done.count(None)}
    if json:
        print_json({"html": done.html, "markdown": done.markdown, "figures": done.figures, "gates": gates})
    else:
        say(f"gates: {gates['reached']} reached, {gates['missed']} missed, {gates['not_measured']} not measured")
        tell(done.html)
