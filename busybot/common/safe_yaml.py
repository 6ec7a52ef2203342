"""YAML that others wrote: plain values, nothing that takes long to parse, no short text for a huge one."""

from typing import Any

import yaml

from busybot.common.errors import BusybotError

MAX_TOKENS = 200_000
MAX_DEPTH = 16
_OPENING = (
    yaml.FlowSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.BlockMappingStartToken,
)
_CLOSING = (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken, yaml.BlockEndToken)


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


def parse_yaml(text: str, where: str) -> Any:
    """The value of a YAML text.

    Raises:
        BusybotError: naming `where`, the line and what is wrong.
    """
    try:
        check_tokens(where, text)
        return yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:  # of numbers with thousands of digits
        raise BusybotError(f"{where}{describe(error)}", "compare with the examples in the documentation") from None


def describe(error: Exception) -> str:
    """`, line 3: not valid YAML: why`."""
    mark = getattr(error, "problem_mark", None)
    line = f", line {mark.line + 1}" if mark else ""
    problem = getattr(error, "problem", None) or str(error) or type(error).__name__
    return f"{line}: not valid YAML: {problem[:200]}"
