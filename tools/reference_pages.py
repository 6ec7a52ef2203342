"""The reference of all commands, of the dataset format and of measures, from what makes each of them."""

import ast
import inspect
from collections.abc import Iterator
from typing import Any

from busybot.boards.mechanisms import available
from busybot.boards.spec import PAPER
from busybot.boards.worlds import BUILT, WORLDS, World
from busybot.cli.main import COMMANDS, load_command
from busybot.common import limits as file_limits
from busybot.episodes.mcap.channels import SCHEMAS
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS, TABLES, Column, StepField
from busybot.plan import metrics as plan_metrics
from busybot.reason.evaluation import causes_summary, proposed
from busybot.view.report.page import Block, Heading, Text, markdown, plain_grid

COMMON = ("--help", "--json", "--quiet", "--seed", "--workers", "--config", "--set")
"""Options that the page explains once."""
VALUES = """\
Where each value is stored, which hash it enters, and what `dataset diff` calls a difference in it. What enters no hash
follows from other values. Floats are hashed and compared as the table stores them. One list (`schema.STEP_FIELDS`)
makes messages, reader, writer, table, hashes and comparison, and this page."""


def commands() -> str:
    """All commands, in the order of `busybot --help`."""
    found = (pair for name in COMMANDS for pair in _commands(name, load_command(name)))
    return markdown([block for words, command in found for block in _section(words, command)])


def _commands(words: str, command: Any) -> Iterator[tuple[str, Any]]:
    """A command, or all commands of a group, with the words that call them."""
    if not hasattr(command, "commands"):
        yield words, command
        return
    for name, inner in command.commands.items():
        yield from _commands(f"{words} {name}", inner)


def _section(words: str, command: Any) -> list[Block]:
    arguments = [parameter for parameter in command.params if parameter.param_type_name == "argument"]
    options = [parameter for parameter in command.params if parameter.param_type_name == "option"]
    common = [f"`{one.opts[0]}`" for one in options if one.opts[0] in COMMON and one.opts[0] != "--help"]
    call = " ".join(["busybot", words, *map(_place, arguments)])
    rows = [(f"`{_place(one)}`", (_help(one), _default(one))) for one in arguments]
    rows += [(_names(one), (_help(one), _default(one))) for one in options if one.opts[0] not in COMMON]
    blocks: list[Block] = [Heading(words), Text(f"    {call}"), Text(inspect.cleandoc(command.help or ""))]
    blocks += [plain_grid(("", "default"), rows)] if rows else []
    return [*blocks, *([Text(f"Also: {', '.join(common)}.")] if common else [])]


def _place(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def _names(option: Any) -> str:
    return ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))


def _help(parameter: Any) -> str:
    text = " ".join((getattr(parameter, "help", None) or "").split())
    variable = getattr(parameter, "envvar", None)
    return f"{text} Or the environment variable `{variable}`." if variable else text


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    value, said = parameter.default, getattr(parameter, "show_default", None)
    if value is None and isinstance(said, str):
        return said
    if value is None or value is False or value == [] or callable(value):
        return ""
    if isinstance(value, list):
        return ", ".join(f"`{one}`" for one in value)
    return f"`{'on' if value is True else value}`"


def dataset_format() -> str:
    """Tables and channels."""
    blocks: list[Block] = [Text(f"Version of the schema: {SCHEMA_VERSION}."), Heading("Tables")]
    for name, columns in TABLES.items():
        rows = [(f"`{column.name}`", _column(column)) for column in columns]
        blocks += [Heading(f"`tables/{name}`", 3), plain_grid(("type", "unit, frame", "meaning"), rows, "column")]
    blocks += [Heading("Values of a step"), Text(VALUES), _values()]
    channels = [
        (f"`{topic}`", (f"`{schema}`", "privileged" if topic.startswith("/truth") else ""))
        for topic, schema in SCHEMAS.items()
    ]
    channel_grid = plain_grid(("message", ""), channels, "topic")
    return markdown([*blocks, Heading("Channels of an episode's MCAP file"), channel_grid])


def _values() -> Block:
    heads = ("message, number and type", "columns", "hash", "difference", "since")
    return plain_grid(heads, [(f"`{field.name}`", _value(field)) for field in STEP_FIELDS], "value")


def _value(field: StepField) -> tuple[str, ...]:
    columns = ", ".join(f"`{column.name}`" for column in field.columns)
    compared = (field.compared or "") + (f", beyond {field.tolerance:g}" if field.tolerance else "")
    return _wire(field), columns, field.hashed.digest if field.hashed else "", compared, str(field.since)


def _wire(field: StepField) -> str:
    if field.wire is None:
        return ""
    several = len(field.wire_names) - 1
    numbers = f"{field.wire.number}-{field.wire.number + several}" if several else str(field.wire.number)
    repeated = "repeated " if field.shape and not field.wire.each else ""
    return f"`{'StepTruth' if field.privileged else 'Step'}` {numbers}, {repeated}{field.wire.type}"


def _column(column: Column) -> tuple[str, str, str]:
    kind = str(column.type).replace("list<element: ", "list of ").replace(">", "")
    measure = ", ".join(filter(None, (column.unit, column.frame.split(":")[0])))
    told = "**privileged**: " if column.privileged else ""
    return kind, measure, f"{told}{column.description}{'; may be null' if column.nullable else ''}"


def worlds() -> str:
    """The worlds, from their definitions."""
    rows: list[tuple[str, tuple[str, str]]] = [(f"`{PAPER}`", ("the paper's relations", "nothing: it is the control"))]
    rows += [(f"`{name}`", (_drawn_from(world), world.about)) for name, world in (WORLDS | BUILT).items()]
    return markdown([plain_grid(("drawn from", "what is hard"), rows, "world")])


def _drawn_from(world: World) -> str:
    """Kinds of mechanisms by their weight, then what else there is, with its share."""
    total = sum(world.kinds.values())
    kinds = [f"{name} {weight / total:.0%}" for name, weight in world.kinds.items()]
    others = {
        "two inputs": world.two,
        "flicker": world.flickers,
        "reads a responder": world.follows,
        "idle links": world.idle,
        "boards with a clock": world.clock,
        "with locks": world.locked,
        "rewired": world.rewired,
    }
    return "; ".join([", ".join(kinds), *(f"{what} {share:.0%}" for what, share in others.items() if share)])


def mechanisms() -> str:
    """The kinds of mechanisms, from their docstrings and classes."""
    rows = []
    for name, kind in available().items():
        file = kind.__module__.replace(".", "/")
        link = f"[`{kind.__module__.rsplit('.', 1)[1]}`](../../{file}.py)"
        rows.append((f"`{name}`", (inspect.cleandoc(kind.__doc__ or "").split("\n")[0], _inputs(kind.arity), link)))
    return markdown([plain_grid(("", "inputs", "specification"), rows, "mechanism")])


def _inputs(arity: tuple[int, int]) -> str:
    least, most = arity
    return str(least) if least == most else f"{least} to {most}"


def reason_measures() -> str:
    """The figures of `eval reason` in every world."""
    return _keys({**causes_summary.KEYS, **proposed.KEYS})


def plan_measures() -> str:
    """The figures of `eval plan` in every world."""
    return _keys(plan_metrics.KEYS)


def _keys(told: dict[str, str]) -> str:
    rows = [(", ".join(f"`{name}`" for name in names.split(", ")), (text,)) for names, text in told.items()]
    return markdown([plain_grid(("what",), rows, "key")])


def limits() -> str:
    """What a file may cost, from the constants and what is said below each of them."""
    tree = ast.parse(inspect.getsource(file_limits)).body
    rows = []
    for constant, told in zip(tree, tree[1:], strict=False):
        if isinstance(constant, ast.Assign) and isinstance(told, ast.Expr) and isinstance(told.value, ast.Constant):
            name = ast.unparse(constant.targets[0])
            rows.append(
                (f"`{name}`", (_amount(name, getattr(file_limits, name)), " ".join(str(told.value.value).split())))
            )
    return markdown([plain_grid(("at most", "of what"), rows, "limit")])


def _amount(name: str, value: float) -> str:
    if name.endswith("_BYTES"):
        return f"{value // file_limits.MIB:,.0f} MiB"
    return f"{value:g} s" if name.endswith("_SECONDS") else f"{value:,}"
