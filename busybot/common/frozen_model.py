"""The base of configurations and of what files hold: values that stay as they are, and no others than those named."""

from pydantic import BaseModel, ConfigDict


class FrozenModel(BaseModel):
    """A pydantic model that cannot be changed once it is made, and refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")
