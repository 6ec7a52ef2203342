"""The command `busybot`: one module per subcommand, imported when it is used.

A module `busybot.cli.NAME` offers either a typer application `app` (a command with subcommands, as `dataset info`) or a
function called NAME (a command of its own).
"""

import importlib
import inspect
import io
import sys
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command as command_of
from typer.main import get_group as group_of

from busybot.cli.common import CONTEXT, native_output_on_stderr, report_errors
from busybot.cli.options import RENAMED, quiet_option, refusing_addresses, with_new_names

COMMANDS = (
    "doctor",
    "assets",
    "generate",
    "collect",
    "features",
    "train",
    "eval",
    "play",
    "view",
    "annotate",
    "replay",
    "dataset",
    "models",
    "report",
    "demo",
)


class LazyGroup(TyperGroup):
    """Imports a subcommand's module at its first use, so that `busybot NAME` pays for NAME alone.

    The types of typer's own copy of click are private, hence `Any`.
    """

    def __init__(self, **given: Any):
        super().__init__(**given)
        self.commands: Any = dict.fromkeys(COMMANDS)  # typer looks for names like a misspelt one among these

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        return load_command(cmd_name) if cmd_name in COMMANDS else None

    def invoke(self, ctx: Any) -> Any:
        with report_errors(ctx):
            return super().invoke(ctx)


def load_command(name: str) -> Any:
    """The command `name` for typer, or None if this installation has no module for it."""
    module_name = f"busybot.cli.{name}"
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name != module_name:
            raise
        return None
    if hasattr(module, "app"):
        group = group_of(module.app)
        group.name = name
        return _finished(group, name)
    single = typer.Typer(add_completion=False, context_settings=CONTEXT)
    single.command(name)(getattr(module, name))
    return _finished(command_of(single), name)


def _finished(command: Any, words: str) -> Any:
    """What all commands have: `--quiet`, old names of options, and every paragraph of the help on one line.

    Terminals break lines where they need to.
    """
    if command.help:
        paragraphs = inspect.cleandoc(command.help).split("\n\n")
        command.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
    if hasattr(command, "commands"):
        for name, inner in command.commands.items():
            _finished(inner, f"{words} {name}")
        return command
    refusing_addresses(command)
    command.params.append(quiet_option())
    if words in RENAMED:
        command.parse_args = with_new_names(command.parse_args, RENAMED[words])
    return command


app = typer.Typer(
    cls=LazyGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=CONTEXT,
    help="Learn to interact, to reason about cause and effect, and to plan on toy boards.",
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from busybot import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(False, "--version", help="Print the version.", callback=_show_version, is_eager=True),
) -> None:
    pass


def run() -> None:
    """Run the command that stands in `sys.argv`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # whatever the locale, a name that it lacks is written as an escape
            stream.reconfigure(errors="backslashreplace")
    with native_output_on_stderr("--json" in sys.argv[1:]):
        app(prog_name="busybot")
