"""The base of configurations and of what files hold: values that stay as they are, and no others than those named."""

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

DEEPEST = 100
"""Levels of free values; more than 255 could be read, but never be written again."""


def _shallow(values: dict[str, Any]) -> dict[str, Any]:
    level: list[Any] = [values]
    for _ in range(DEEPEST):
        inner = (each.values() if isinstance(each, dict) else each for each in level)
        level = [one for each in inner for one in each if isinstance(one, dict | list | tuple)]
        if not level:
            return values
    raise ValueError(f"it has more than {DEEPEST} levels of values in values")


Values = Annotated[dict[str, Any], AfterValidator(_shallow)]
"""Values of any kind by name, that JSON can tell."""


class FrozenModel(BaseModel):
    """A pydantic model that cannot be changed once it is made, and refuses unknown keys and what JSON has no number
    for."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class GivenModel(BaseModel):
    """What a stranger's file holds: values of the right type; keys that nobody knows are left alone."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


def first_fault(error: ValidationError) -> str:
    """The first of a validation's complaints, with the place that it is about."""
    first = error.errors()[0]
    place = ".".join(str(part)[:80] for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    return f"{place}: {message}" if place else message
