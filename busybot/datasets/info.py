"""The typed content of `dataset.json`, which describes the files in a dataset's folder."""

import json
import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from busybot.common.frozen_model import FrozenModel
from busybot.episodes.digests import Sha256
from busybot.episodes.schema import SCHEMA_VERSION

Version = Annotated[str, Field(pattern=r"^\d+\.\d+$")]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class GeneratorInfo(FrozenModel):
    """What drew the boards.

    Attributes:
        version: of the generator, its own.
        config: all its parameters, JSON values.
    """

    version: str
    config: dict[str, Any] = {}


class AssetsInfo(FrozenModel):
    """Which objects stand on the boards.

    Attributes:
        source: `procedural`, or `folder` for objects that the user named; never a path.
        name: of the library.
        seed: of a procedural library.
        sha256: object key to the hash over the object's files.
    """

    source: Literal["procedural", "folder"]
    name: Annotated[str, Field(max_length=200)]
    seed: int | None = None
    sha256: dict[str, Sha256] = {}


class CollectInfo(FrozenModel):
    """How the episodes were recorded; all that decides their content, so that collecting can continue.

    Attributes:
        steps: proposed actions per episode.
        images: encoding of RGB.
        delta: changed pixels that a reward must exceed.
        settings: everything else, JSON values.
    """

    policy: Annotated[str, Field(min_length=1, max_length=200)]
    steps: Annotated[int, Field(ge=0, le=100_000)]
    images: Literal["jpeg", "png"] = "jpeg"
    strict: bool = False
    delta: Annotated[int, Field(ge=0)] = 500
    seed: Seed = 0
    settings: dict[str, Any] = {}


class DatasetInfo(FrozenModel):
    """The dataset.

    Attributes:
        schema_version: of the episodes and tables.
        seed: from which boards were drawn.
        boards: how many there are; every board gets one episode.
        collect: None until the first episode is recorded.
    """

    schema_version: Version = SCHEMA_VERSION
    name: Annotated[str, Field(min_length=1, max_length=200)]
    split: Annotated[str, Field(min_length=1, max_length=64)]
    seed: Seed
    boards: Annotated[int, Field(ge=0, le=10_000_000)]
    generator: GeneratorInfo
    assets: AssetsInfo
    collect: CollectInfo | None = None

    @property
    def tasks(self) -> str | None:
        """Kind of the tasks that the boards have, None if they were generated without."""
        kind = self.generator.config.get("tasks")
        return kind if isinstance(kind, str) else None


def collect_command(path: Path, info: DatasetInfo) -> str:
    """The command that records the missing episodes with the recorded settings.

    A learned model is recorded by its fingerprint, not by name: `--model` is left to the user.
    """
    command, collect = f"busybot collect {shlex.quote(str(path))}", info.collect
    if collect is None:
        return command
    if collect.policy not in ("random", "learned", "scripted"):
        return f"repeat the command that began {shlex.quote(str(path))}; its policy was {collect.policy!r}"
    command += f" --steps {collect.steps} --policy {collect.policy}"
    command += f" --images {collect.images}" if collect.images != "jpeg" else ""
    command += f" --seed {collect.seed}" if collect.seed != info.seed else ""
    command += " --strict" if collect.strict else ""
    command += f" --set interaction.delta={collect.delta}" if collect.delta != 500 else ""
    responders = collect.settings.get("responders", True)
    return command + ("" if responders else f" --set responders={json.dumps(responders)}")
