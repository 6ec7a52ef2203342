"""What a dataset says of itself, `dataset.json`: how its boards were drawn, with which objects, how it was recorded."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from busybot.boards.spec import IMPORTED
from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, Values
from busybot.common.limits import MAX_JSON_BYTES
from busybot.episodes.digests import Sha256
from busybot.episodes.schema import SCHEMA_VERSION

LONGEST_NAME = 200

Version = Annotated[str, Field(pattern=r"^\d+\.\d+$")]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class GeneratorInfo(FrozenModel):
    """What drew the boards.

    Attributes:
        version: of the generator, its own.
        config: all its parameters, JSON values.
    """

    version: str
    config: Values = {}

    @property
    def imported(self) -> bool:
        """Whether nobody drew them: their recordings came from elsewhere."""
        return self.version == IMPORTED


class AssetsInfo(FrozenModel):
    """Which objects stand on the boards.

    Attributes:
        source: `procedural`, or `folder` for objects that the user named; never a path.
        name: of the library.
        seed: of a procedural library, in files of earlier versions.
        sha256: object key to the hash over the object's files.
    """

    source: Literal["procedural", "folder"]
    name: Annotated[str, Field(max_length=200)]
    seed: int | None = None
    sha256: dict[str, Sha256] = {}


class CollectInfo(FrozenModel):
    """How the episodes were recorded; all that decides their content, so that collecting can continue.

    Attributes:
        steps: proposed actions per episode; of imported recordings, which differ in length, those of the longest.
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
    settings: Values = {}

    def group(self, name: str) -> dict[str, Any]:
        """A group of the settings; empty where there is none, for anybody may have written the file."""
        found = self.settings.get(name)
        return found if isinstance(found, dict) else {}

    def look(self) -> dict[str, Any]:
        """How the simulator's boards were looked at, with what JSON leaves out; empty for what was not simulated."""
        found = self.group("render")
        return with_unsaid(found) if found else {}


SETTABLE = {
    "settings.interaction.": "interaction.",
    "settings.render.": "render.",
    "settings.chooser.policy.": "learned.",
}
"""Under which names of a recording are the parameters of `collect`, and what `--set` calls them."""
UNSAID: dict[str, Any] = {"camera": {}, "randomise": {}}
"""Groups that are left out of the JSON of render settings where they say nothing."""


def with_unsaid(render: dict[str, Any]) -> dict[str, Any]:
    """The JSON of render settings with what is left out of it."""
    return UNSAID | render


class DatasetInfo(FrozenModel):
    """The dataset.

    Attributes:
        schema_version: of the episodes and tables.
        seed: from which boards were drawn.
        boards: how many there are; every board gets one episode.
        collect: None until the first episode is recorded.
    """

    schema_version: Version = SCHEMA_VERSION
    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
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


def name_of(folder: str) -> str:
    """What a dataset in a folder of this name is called; the folder's may be longer, or not be text in UTF-8."""
    return folder.encode(errors="replace").decode()[:LONGEST_NAME]


def collect_command(
    path: Path, info: DatasetInfo, program: str = "busybot", differing: Mapping[str, Any] | None = None
) -> str:
    """The command that records the missing episodes with the recorded settings; where nothing is recorded, by a policy
    that moves something, which is the default with tasks alone. What was imported nobody here can record.

    A learned model is recorded by its fingerprint, not by name: `--model` and `--reasoner` are left to the user.

    Args:
        program: how it is called.
        differing: what is recorded of settings that a command named otherwise, by dotted names: the usual ones are not
            known in this room, so that those of interaction, pictures and policy are not among the others.
    """
    command, collect = f"{program} collect {shlex.quote(str(path))}", info.collect
    if info.generator.imported:
        return "import the recordings again, into a new folder: busybot dataset import"
    if collect is None:
        return command if info.tasks else f"{command} --policy learned"
    if collect.policy not in ("random", "learned", "curious", "scripted"):
        return f"repeat the command that began {shlex.quote(str(path))}; its policy was {collect.policy!r}"
    command += f" --steps {collect.steps} --policy {collect.policy}"
    command += f" --image-format {collect.images}" if collect.images != "jpeg" else ""
    command += f" --seed {collect.seed}" if collect.seed != info.seed else ""
    command += " --strict" if collect.strict else ""
    command += " --until-known" if collect.group("chooser").get("until_known") else ""
    command += f" --set interaction.delta={collect.delta}" if collect.delta != 500 else ""
    look = collect.look()
    for group in UNSAID:
        command += f" --set {shlex.quote(f'render.{group}={json.dumps(look[group])}')}" if look.get(group) else ""
    for name, value in _parameters(differing or {}).items():
        command += f" --set {shlex.quote(f'{name}={json.dumps(value)}')}"
    responders = collect.settings.get("responders", True)
    return command + ("" if responders else f" --set responders={json.dumps(responders)}")


def _parameters(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """What `--set` can say of what was recorded, by its names."""
    return {
        name.replace(place, parameter, 1): value
        for name, value in recorded.items()
        for place, parameter in SETTABLE.items()
        if name.startswith(place) and name.removeprefix("settings.render.").split(".")[0] not in UNSAID
        if "policy" not in recorded or not name.startswith("settings.chooser.")  # the policy's own, as ever
    }


def read_description(
    file: Path, kind: Literal["manifest", "schema"], version: str, max_bytes: int = MAX_JSON_BYTES
) -> Any:
    """The JSON of a file that says of which version it is; those of another major one than `version` are refused."""
    values = read_json(file, max_bytes)
    found = str(values.get(f"{kind}_version"))[:20] if isinstance(values, dict) else ""
    if found.split(".")[0] != version.split(".")[0]:
        what = f"{file}: {kind} version {found or 'missing'}; this installation reads {version}"
        raise BusybotError(what, "use the busybot version that wrote it, or make it again")
    return values
