"""Parameters of a stage from a YAML file, `--set a.b=c` and a command's own options, in this order of precedence.

YAML that others wrote: plain values, nothing that takes long to parse, no short text for a huge one.
"""

import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from busybot.common.atomic_io import read_text
from busybot.common.errors import BusybotError, UsageError

Config = TypeVar("Config", bound=BaseModel)
Key = TypeVar("Key", int, str)
MAX_BYTES = 1 << 20
MAX_TOKENS = 200_000
MAX_DEPTH = 16
_BELIED = (LookupError, AttributeError, TypeError)
"""What reading a YAML text raises where a value is not what its tag says, as of `!!bool maybe` or `!!int ""`."""
DAMAGED_YAML = (yaml.YAMLError, RecursionError, ValueError, *_BELIED)
"""What reading a YAML text raises; ValueError of numbers with thousands of digits."""
_OPENING = (
    yaml.FlowSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.BlockMappingStartToken,
)
_CLOSING = (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken, yaml.BlockEndToken)


def build(
    model: type[Config],
    file: Path | None,
    settings: list[str],
    options: dict[str, Any],
    usual: dict[str, Any] | None = None,
) -> Config:
    """Make a stage's parameters.

    Args:
        file: YAML with (some of) the model's fields; later sources override it.
        settings: `name=value` or `outer.inner=value`, the value in YAML.
        options: values of command line options; None means that the option was not given.
        usual: fields, by dotted names, whose default differs here from the model's.

    Raises:
        UsageError: naming the setting or option, the parameter and what is wrong with it.
        BusybotError: the same of the file.
    """
    values = _values(file, settings, options, usual or {})
    for name, field in model.model_fields.items():
        if isinstance(given := values.get(name), dict) and isinstance(field.default, BaseModel):
            values[name] = _completed(given, field.default)
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        what, hint = _explained(model, first, options)
        if file is None or _typed(first["loc"], settings, options):
            raise UsageError(what, hint) from None
        raise BusybotError(f"{file}: {what}", hint) from None


def asked(name: str, file: Path | None, settings: list[str], options: dict[str, Any]) -> Any:
    """What `build` is asked to take for a parameter, whatever that is; None where nobody says. Errors as there."""
    return _values(file, settings, options, {}).get(name)


def _values(file: Path | None, settings: list[str], options: dict[str, Any], usual: dict[str, Any]) -> dict[str, Any]:
    values = parse_yaml(read_text(file, MAX_BYTES, "name a YAML file"), str(file)) if file else {}
    if not isinstance(values, dict):
        raise BusybotError(f"{file}: not a mapping of parameters", "write lines like `boards: 100`")
    for name, value in usual.items():
        _assign_default(values, name.split("."), value)
    for setting in settings:
        _set(values, setting)
    for name, value in options.items():
        if value is not None:
            _assign(values, name.split("."), value, name)
    return values


def _completed(given: dict[str, Any], usual: BaseModel) -> dict[str, Any]:
    """What is given of a group, and what its default sets otherwise than the group itself does."""
    completed = {name: getattr(usual, name) for name in usual.model_fields_set} | given
    for name, value in given.items():
        if isinstance(value, dict) and isinstance(inner := getattr(usual, name, None), BaseModel):
            completed[name] = _completed(value, inner)
    return completed


def _set(values: dict[str, Any], setting: str) -> None:
    """Take one `--set`."""
    path, separator, text = setting.partition("=")
    if not separator or not path:
        raise UsageError(f"--set {setting}: not of the form name=value", "for example --set interaction.delta=1000")
    try:
        _assign(values, path.split("."), parse_yaml(text, f"--set {setting}"), setting)
    except BusybotError as error:
        raise UsageError(error.what, error.hint) from None


def _typed(place: tuple[Any, ...], settings: list[str], options: dict[str, Any]) -> bool:
    """Whether the value there was typed, not read from the file."""
    words = [str(part) for part in place]
    names = [setting.partition("=")[0] for setting in settings]
    names += [name for name, value in options.items() if value is not None]
    return any(words[: name.count(".") + 1] == name.split(".") for name in names)


def flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings with dotted names, as `--set` takes them."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def changes(first: Mapping[Key, Any], second: Mapping[Key, Any]) -> dict[Key, tuple[Any, Any]]:
    """What two mappings say differently: (in the first, in the second) by name, None where one says nothing."""
    pairs = {name: (first.get(name), second.get(name)) for name in sorted(first.keys() | second.keys())}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _explained(model: type[BaseModel], first: Any, options: dict[str, Any]) -> tuple[str, str]:
    """What is wrong with a parameter, by its option's name and value where an option gave it, and how to mend it."""
    place = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    group, field = _field(model, [str(part) for part in first["loc"]])
    if first["type"] == "extra_forbidden":
        return f"parameter {place}: {message}", _known(group, str(first["loc"][-1]))
    if field is None:
        what, _, own = message.partition("; ")
        return f"parameter {place}: {what}" if place else what, own or _defaults_of(model, what) or _known(model)
    given = repr(first["input"]) if isinstance(first["input"], str | int | float) else ""
    if options.get(place) is not None:
        given = f"--{place.replace('_', '-').split('.')[-1]} {given}"
    if first["type"] == "literal_error":
        return f"parameter {place}: {given} is none of its values", f"choose {first['ctx']['expected']}"
    what = f"parameter {place}: {message}{f' (given: {given})' if given else ''}"
    if field.is_required():
        return what, f"give another value of {place}"
    default = field.get_default(call_default_factory=True)
    if isinstance(default, BaseModel):
        return what, _known(type(default))
    shown = list(default) if isinstance(default, tuple) else default
    return what, "leave it out, it has no default" if default is None else f"the default is {shown}"


def _defaults_of(model: type[BaseModel], message: str) -> str:
    """The defaults of the parameters that a message is about; nothing if they have none."""
    named = [name for name in re.findall(r"[a-z_]+", message) if name in model.model_fields]
    fields = {name: model.model_fields[name] for name in named if not model.model_fields[name].is_required()}
    defaults = {name: field.get_default(call_default_factory=True) for name, field in fields.items()}
    told = {name: value for name, value in defaults.items() if value is not None}
    shown = (f"{name} {list(value) if isinstance(value, tuple) else value}" for name, value in told.items())
    return f"the defaults are {', '.join(shown)}" if told else ""


def _field(model: type[BaseModel], path: list[str]) -> tuple[type[BaseModel], Any]:
    """The group of parameters that a place lies in, and the parameter; None if the group has none of that name."""
    field = None
    for place, name in enumerate(path, start=1):
        if name not in model.model_fields:
            break  # a place within a value, as in a list, or no parameter at all
        field = model.model_fields[name]
        inner = field.annotation
        if place < len(path) and isinstance(inner, type) and issubclass(inner, BaseModel):
            model, field = inner, None
    return model, field


def _known(model: type[BaseModel], name: str = "") -> str:
    near = get_close_matches(name, model.model_fields, 1)
    meant = f"did you mean {near[0]}? " if near else ""
    return f"{meant}the parameters are {', '.join(model.model_fields)}" if model.model_fields else "it has none"


def _assign_default(values: dict[str, Any], path: list[str], value: Any) -> None:
    for name in path[:-1]:
        values = values.setdefault(name, {})
        if not isinstance(values, dict):
            return  # the file has a value where a group should be, which is refused with the others
    values.setdefault(path[-1], value)


def _assign(values: dict[str, Any], path: list[str], value: Any, where: str) -> None:
    for name in path[:-1]:
        inner = values.setdefault(name, {})
        if not isinstance(inner, dict):
            raise BusybotError(f"{where}: {name} is a value, not a group of parameters", f"give {name} alone")
        values = inner
    values[path[-1]] = value


def check_tokens(where: str, text: str) -> None:
    """Refuse a text before it is parsed: the parser is quadratic in the depth of brackets, and aliases multiply.

    Args:
        where: file or option, for the message.

    Raises:
        BusybotError: it has aliases, is nested too deeply or is too long; names the line.
        yaml.YAMLError: it is no YAML.
    """
    depth = 0
    for count, token in enumerate(yaml.scan(text, Loader=yaml.SafeLoader)):
        line = f"{where}, line {token.start_mark.line + 1}"
        if isinstance(token, yaml.AliasToken):
            raise BusybotError(f"{line}: has an alias", "write the values out")
        depth += isinstance(token, _OPENING)
        depth -= isinstance(token, _CLOSING)
        if depth > MAX_DEPTH:
            raise BusybotError(f"{line}: nested more than {MAX_DEPTH} deep", "write it with fewer brackets")
        if count > MAX_TOKENS:
            raise BusybotError(f"{where}: more than the {MAX_TOKENS} words and signs allowed", "divide the file")


def parse_yaml(text: str, where: str, words: bool = False) -> Any:
    """The value of a YAML text.

    Args:
        words: take every value for a word. Programs disagree on which words are numbers, times or truth values.

    Raises:
        BusybotError: naming `where`, the line and what is wrong.
    """
    try:
        check_tokens(where, text)
        return yaml.load(text, yaml.BaseLoader if words else yaml.SafeLoader)  # neither makes objects
    except DAMAGED_YAML as error:
        raise BusybotError(f"{where}{yaml_fault(error)}", "compare with the examples in the documentation") from None


def yaml_fault(error: Exception) -> str:
    """`, line 3: not valid YAML: why`."""
    mark = getattr(error, "problem_mark", None)
    line = f", line {mark.line + 1}" if mark else ""
    problem = getattr(error, "problem", None) or str(error) or type(error).__name__
    if isinstance(error, _BELIED):
        problem = "a value is not of the kind that its tag names"
    return f"{line}: not valid YAML: {problem[:200]}"
