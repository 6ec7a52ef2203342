"""Options that mean the same in every subcommand that has them, what shells offer for them, and their old names.

`--model` is a model of interaction, by name or folder; `--reasoner` one that infers relations; `--variant` the kind of
networks to train; `--images` a number of images; `--image-format` how they are stored.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.main import get_command

from busybot.cli.common import JSON_WANTED, warn
from busybot.common.device import CHOICE, choose, gpus
from busybot.common.errors import UsageError
from busybot.common.quiet import be_quiet
from busybot.common.remote import SCHEME, RemotePath

RENAMED = {
    "collect": {"--images": "--image-format"},
    "train interact": {"--model": "--variant"},
    "train reason": {"--model": "--variant"},
    "eval reason": {"--model": "--reasoner"},
    "eval plan": {"--model": "--reasoner"},
}
"""Options that were called otherwise before version 0.2."""
UNTIL = "0.3"
"""The version in which old names work no more."""
HINT_ADDRESS = (
    "name a folder of this machine, and copy a dataset into one before; `busybot dataset info` and, in Python, "
    "`load_dataset` read addresses"
)


def with_new_names(parse: Callable[[Any, list[str]], Any], renamed: dict[str, str]) -> Callable[[Any, list[str]], Any]:
    """A command's `parse_args` that takes the old names of options for the new ones, and says so."""

    def parse_args(context: Any, words: list[str]) -> Any:
        end = words.index("--") if "--" in words else len(words)
        for place, word in enumerate(words[:end]):
            old, separator, value = word.partition("=")
            if old in renamed:
                warn(f"{old} is called {renamed[old]} now; the old name works until version {UNTIL}")
                words[place] = f"{renamed[old]}{separator}{value}"
        return parse(context, words)

    return parse_args


def refusing_addresses(command: Any) -> None:
    """Let the command refuse an address (`s3://...`) where it takes a path, which would be read as a folder `s3:`."""

    def checked(process: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def processed(context: Any, value: Any) -> Any:
            found = process(context, value)
            several = isinstance(found, list | tuple) and isinstance(value, list | tuple)
            for path, word in zip(found, value, strict=False) if several else ((found, value),):
                if isinstance(path, Path) and isinstance(word, str) and SCHEME.match(word):
                    what = f"{RemotePath(word)}: an address, and this is a path of this machine"
                    raise UsageError(what, HINT_ADDRESS)
            return found

        return processed

    for parameter in command.params:
        parameter.process_value = checked(parameter.process_value)


def quiet_option() -> Any:
    """`--quiet`, which `cli.main` gives to every command."""
    alone = typer.Typer(add_completion=False)

    @alone.command()
    def _(
        quiet: Annotated[
            bool,
            typer.Option(
                "--quiet",
                "-q",
                help="No progress and no explanations on standard error.",
                callback=be_quiet,
                expose_value=False,
                is_eager=True,
            ),
        ] = False,
    ) -> None: ...

    return get_command(alone).params[0]


def offering(list_them: Callable[[], list[str]]) -> Callable[[str], list[str]]:
    """What a shell completes: the names that begin as the word does; `list_them` is asked when Tab is pressed."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in list_them() if name.startswith(incomplete)]

    return complete


def worlds() -> list[str]:
    """Names that `--world` takes, mechanisms alone among them."""
    from busybot.boards.mechanisms import available
    from busybot.boards.spec import PAPER
    from busybot.boards.worlds import BUILT, WORLDS

    return list(dict.fromkeys([PAPER, *WORLDS, *BUILT, *(name for name, kind in available().items() if kind.arity[1])]))


def interaction_models() -> list[str]:
    """Shipped models that `--model` takes."""
    return _shipped("interact")


def trained_reasoners() -> list[str]:
    """Shipped models that `--from` takes."""
    return _shipped("reason")


def reasoners() -> list[str]:
    """Names that `--reasoner` takes."""
    from busybot.reason.models.registry import GRAPHS, without_training

    return [*_shipped("reason"), *without_training(), *GRAPHS]


def models() -> list[str]:
    """Names of all shipped models."""
    return [*_shipped("interact"), *_shipped("reason")]


def _shipped(skill: str) -> list[str]:
    from busybot.models import shipped_models

    return [folder.name for folder in shipped_models() if folder.parent.name == skill]


def encoders() -> list[str]:
    """Names that `--encoder` takes, without the pixels that they may be given."""
    from busybot.common import plugins
    from busybot.reason.encoders.registry import ENCODERS

    return [*ENCODERS, *plugins.names("encoders")]


def _devices() -> list[str]:
    return ["auto", "cpu", *(["cuda"] if gpus() else []), *(f"cuda:{number}" for number in range(gpus()))]


def _remember_json(context: typer.Context, wanted: bool) -> bool:
    context.meta[JSON_WANTED] = wanted
    return wanted


def _take_device(name: str) -> str:
    choose(name)
    return name


JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object on standard output.", callback=_remember_json, is_eager=True),
]
DeviceOption = Annotated[
    str,
    typer.Option(
        "--device",
        envvar=CHOICE,
        callback=_take_device,
        autocompletion=offering(_devices),
        help="For networks and pictures: auto (GPUs for networks, if there are any), cpu, cuda or cuda:N.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything that is drawn.")]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        envvar="BUSYBOT_WORKERS",
        help="Number of processes that share the work; by default one per core.",
    ),
]
AssetsOption = Annotated[str | None, typer.Option(help="Objects, if they are not found by their hashes.")]
StrictOption = Annotated[bool, typer.Option("--strict", help="Refuse moves far off the annotated directions.")]
