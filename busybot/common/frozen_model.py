"""The base of configurations and of what files hold: values that stay as they are, and no others than those named."""

from pydantic import BaseModel, ConfigDict, ValidationError


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
