"""The reference of all commands, from the commands themselves.

    python -m busybot.cli.reference docs/commands.md

Writes everything below the line that begins with `<!-- from here on`; a test compares.
"""

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from busybot.cli.main import COMMANDS, load_command

MARK = "<!-- from here on made by `python -m busybot.cli.reference`: change the commands, not this text -->"
COMMON = ("--help", "--json", "--seed", "--workers", "--config", "--set")
"""Options that the page explains once."""


def reference() -> str:
    """All commands as Markdown, in the order of `busybot --help`."""
    parts = []
    for name in COMMANDS:
        for words, command in _commands(name, load_command(name)):
            parts.append(_section(words, command))
    return "\n\n".join(parts) + "\n"


def _commands(words: str, command: Any) -> Iterator[tuple[str, Any]]:
    """A command, or all commands of a group, with the words that call them."""
    if not hasattr(command, "commands"):
        yield words, command
        return
    for name, inner in command.commands.items():
        yield from _commands(f"{words} {name}", inner)


def _section(words: str, command: Any) -> str:
    arguments = [parameter for parameter in command.params if parameter.param_type_name == "argument"]
    options = [parameter for parameter in command.params if parameter.param_type_name == "option"]
    own = [option for option in options if option.opts[0] not in COMMON]
    common = [f"`{option.opts[0]}`" for option in options if option.opts[0] in COMMON and option.opts[0] != "--help"]
    call = " ".join(["busybot", words, *map(_place, arguments)])
    parts = [f"## {words}", f"    {call}", inspect.cleandoc(command.help or "")]
    if arguments or own:
        lines = ["| | | default |", "|---|---|---|"]
        lines += [f"| `{_place(one)}` | {_help(one)} | {_default(one)} |" for one in arguments]
        lines += [f"| {_names(one)} | {_help(one)} | {_default(one)} |" for one in own]
        parts.append("\n".join(lines))
    if common:
        parts.append(f"Also: {', '.join(common)}.")
    return "\n\n".join(parts)


def _place(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def _names(option: Any) -> str:
    names = [f"`{name}`" for name in (*option.opts, *option.secondary_opts)]
    return ", ".join(names)


def _help(parameter: Any) -> str:
    text = " ".join((getattr(parameter, "help", None) or "").split())
    variable = getattr(parameter, "envvar", None)
    return f"{text} Or the environment variable `{variable}`." if variable else text


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    value = parameter.default
    return "" if value is None or value is False or value == [] or callable(value) else f"`{_plain(value)}`"


def _plain(value: Any) -> str:
    return "on" if value is True else str(value)


def page(text: str) -> str:
    """The page with its generated part renewed."""
    from busybot.pages import renewed

    return renewed(text, MARK, reference())


def main() -> None:
    from busybot.pages import renew

    renew(Path(sys.argv[1]), page)


if __name__ == "__main__":
    main()
