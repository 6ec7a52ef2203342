"""The values of a profile, checked before anything runs.

    python -m pipelines.profile laptop [--assets DIR]

reads `pipelines/laptop/*.yaml` as strictly as the stages will, checks that the objects are there, and makes the values
the pipeline's: `params.yaml`, from which dvc.yaml takes them, with one more that says where the objects lie. `--assets`
names other objects than the profile does.
"""

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from busybot.common import plugins
from busybot.common.atomic_io import write_atomically
from busybot.common.config import build, flat
from busybot.common.errors import BusybotError, naming
from busybot.evaluation.reference_tables import INTERACTION
from busybot.objects.resolve import find

FOLDER = Path(__file__).resolve().parent
PARAMS = "params.yaml"
PROCEDURAL = "busybot/objects/procedural"
"""What the procedural objects are made from."""
OBJECTS = """
# Where these objects lie, for DVC to notice when they change; pipelines/profile.py says it.
objects: {}
"""

OTHER_ROWS = ("inputs", "responders", "interaction.reward", "interaction.strict")
"""Parameters of `interact.yaml` with other values than the default in other rows of Table 1 than ours of free mode."""

FREE_SEEDS = sum(row.gate == "free" for row in INTERACTION.rows)
"""Table 1 has a row of ours for each seed below it; those of strict mode are fewer, and no profile's."""

Count = Annotated[int, Field(ge=1)]
Seed = Annotated[int, Field(ge=0)]
Name = Annotated[str, Field(pattern=r"^[a-z0-9-]{1,32}$")]
Split = Literal["train", "novel-config", "novel-object"]
Kind = Literal["one-to-one", "one-to-many"]
Novel = Literal["novel-config", "novel-object"]
Judged = Literal["validation", "novel-config", "novel-object"]


class _Plain(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Interact(_Plain):
    """Learning to act.

    Attributes:
        model: variant of `busybot train interact`; its parameters are in `interact.yaml`.
    """

    model: Literal["fast", "paper"]


class Judge(_Plain):
    """Boards on which the policy is judged.

    Attributes:
        boards: of each split.
        group: consecutive boards that look alike.
        seed: of the boards.
    """

    splits: Annotated[list[Novel], Field(min_length=1)]
    boards: Count
    group: Count
    seed: Seed


class Recorded(_Plain):
    """A set of recordings; the fields are those of `Judge`."""

    split: Split
    boards: Count
    group: Count
    seed: Seed


class Data(_Plain):
    """Recordings for reasoning.

    Attributes:
        steps: actions on each board.
        images: so many are seen before relations are judged and steps predicted.
        sets: by name; `train` is learned from.
    """

    steps: Count
    images: Annotated[int, Field(ge=2)]
    sets: dict[Name, Recorded]


class Reason(_Plain):
    """Learning relations.

    Attributes:
        model: variant of `busybot train reason`; its parameters are in `reason.yaml`.
        encoder: features that it reads.
    """

    model: Literal["event", "paper"]
    encoder: str


class Relations(_Plain):
    """Judging relations.

    Attributes:
        sets: of the recordings, those that are judged.
        baselines: models that learn nothing, judged beside.
    """

    sets: Annotated[list[Judged], Field(min_length=1)]
    baselines: Annotated[list[Literal["lookup", "count", "persistence", "pc"]], Field(min_length=1)]


class Tasks(_Plain):
    """Boards with goals.

    Attributes:
        boards: of each split and kind.
        steps: of the history that agents are given.
        seed: of the boards.
        agents: who plays, with commas between.
        shown: of them, whose rollouts are recorded to be looked at.
        recorded: of so many tasks.
    """

    splits: Annotated[list[Split], Field(min_length=1)]
    kinds: Annotated[list[Kind], Field(min_length=1)]
    boards: Count
    steps: Count
    seed: Seed
    agents: str
    shown: str
    recorded: Count

    @property
    def cells(self) -> dict[str, tuple[Split, Kind]]:
        """Split and kind by the name of their outputs."""
        return {f"{split}-{kind}": (split, kind) for split in self.splits for kind in self.kinds}


class Profile(_Plain):
    """All of `params.yaml`.

    Attributes:
        profile: its name, that of its folder.
        assets: `procedural`, or a folder of annotated objects.
        seed: of the trainings and of the draws while judging; Table 1 has rows of ours in free mode for 0 to 4, and
            Tables 2 and 3 name no row by a seed.
    """

    profile: Name
    assets: Annotated[str, Field(pattern=r'^[^"$`\\\x00-\x1f]+$')]
    seed: Annotated[int, Field(ge=0, lt=FREE_SEEDS)]
    interact: Interact
    judge: Judge
    data: Data
    reason: Reason
    relations: Relations
    tasks: Tasks

    @model_validator(mode="after")
    def _belong_together(self) -> "Profile":
        sets = self.data.sets
        for name in ("train", "novel-object", *self.relations.sets):
            if name not in sets:
                raise ValueError(f"data.sets lacks {name}")
            if sets[name].split != ("train" if name == "validation" else name):
                raise ValueError(f"data.sets.{name}: its boards are of another split")
        drawn = [(one.split, one.seed) for one in sets.values()]
        if len(set(drawn)) < len(drawn):
            raise ValueError("data.sets: two have the same boards, because split and seed are the same")
        if self.data.images > self.data.steps:
            raise ValueError("data.images: no step is left to predict")
        return self


class _Installed(Profile):
    """What `install` makes of a profile.

    Attributes:
        objects: where they lie.
    """

    objects: str


def run_of(words: list[str]) -> Path:
    """A run's folder, as the one word of a stage's command line.

    Raises:
        BusybotError: there is no such folder, or there are other words.
    """
    if len(words) != 1 or not Path(words[0]).is_dir():
        raise BusybotError(f"no folder of a run: {' '.join(words) or 'none is named'}", "name one, as runs/smoke")
    return Path(words[0])


def profile_of(run: Path, params: Path = FOLDER.parent / PARAMS) -> Profile:
    """What a run was asked for: the pipeline's values where they are its profile's, else the profile itself.

    What was asked for formerly stays in a run's folder: DVC leaves outputs of stages that are no more.

    Raises:
        BusybotError: there is no such profile, or a value is wrong; names the file and the value.
    """
    if params.is_file():
        installed = build(_Installed, params, [], {})
        if installed.profile == run.name:
            return installed
    return read_profile(run.name)


def read_profile(name: str, folder: Path = FOLDER) -> Profile:
    """A profile whose files are all sound.

    Raises:
        BusybotError: there is no such profile, or a value is wrong; names the file and the value.
    """
    known = sorted(path.parent.name for path in folder.glob(f"*/{PARAMS}"))
    if name not in known:
        raise BusybotError(f"there is no profile {name!r}", f"choose {' or '.join(known)}")
    place = folder / name
    profile = build(Profile, place / PARAMS, [], {})
    if profile.profile != name:
        raise BusybotError(f"{place / PARAMS}: parameter profile: it is not the folder's name, {name}")
    configs = {file: build(kind, place / file, [], {}) for file, kind in stage_configs(profile).items()}
    if profile.interact.model == "fast":
        _check_row(place / "interact.yaml", configs["interact.yaml"])
    _check_agents(place / PARAMS, profile.tasks)
    _check_encoder(place / PARAMS, profile.reason.encoder)
    return profile


def _check_row(file: Path, asked: BaseModel) -> None:
    """Refuse a training that is another row of Table 1: the pipeline judges it as ours of free mode, and says so."""
    ours, values = (flat(config.model_dump(mode="json")) for config in (type(asked)(), asked))
    for name in OTHER_ROWS:
        if values[name] != ours[name]:
            what = f"with {json.dumps(values[name])} it is another row of Table 1 than the one that the pipeline makes"
            hint = f"the default is {json.dumps(ours[name])}; python -m benchmarks.tables.table1 trains the other rows"
            raise BusybotError(f"{file}: parameter {name}: {what}", hint)


def _check_agents(file: Path, tasks: Tasks) -> None:
    from busybot.plan.agents.registry import kind_of

    for name in ("agents", "shown"):
        with naming(f"{file}: parameter tasks.{name}"):
            for agent in getattr(tasks, name).split(","):
                kind_of(agent)


def _check_encoder(file: Path, encoder: str) -> None:
    """Refuse what is no encoder; one with weights is not made here, for they may have to be downloaded."""
    from busybot.reason.encoders.registry import DEFAULT, ENCODERS, PIXELS, make_extractor

    base, dash, pixels = encoder.partition("-")
    named = base in (*ENCODERS, *plugins.names("encoders")) and (not dash or pixels in PIXELS)
    with naming(f"{file}: parameter reason.encoder"):
        if base == DEFAULT or not named:
            make_extractor(encoder)


def stage_configs(profile: Profile) -> dict[str, type[BaseModel]]:
    """What the other files of a profile are read as, by name; PyTorch is imported only here."""
    from busybot.interact.training.config import PaperConfig, TrainConfig
    from busybot.reason.train import CONFIGS

    interact = PaperConfig if profile.interact.model == "paper" else TrainConfig
    return {"interact.yaml": interact, "reason.yaml": CONFIGS[profile.reason.model]}


def install(name: str, params: Path, assets: str | None = None, folder: Path = FOLDER) -> None:
    """Make a profile's values the pipeline's; the file is left alone where it says the same.

    Args:
        assets: other objects.

    Raises:
        BusybotError: a value is wrong, or the objects are not there.
    """
    profile = read_profile(name, folder)
    options = {} if assets is None else {"assets": assets}
    chosen = build(Profile, folder / name / PARAMS, [], options).assets
    try:
        library = find(chosen)
    except BusybotError as error:
        raise BusybotError(error.what, "name the folder of annotated objects: make reproduce ASSETS=DIR") from None
    text = (folder / name / PARAMS).read_text(encoding="utf-8")
    if chosen != profile.assets:
        text = re.sub(r"(?m)^assets:.*$", lambda _: f"assets: {json.dumps(chosen, ensure_ascii=False)}", text)
    place = PROCEDURAL if chosen == "procedural" else library.folder.as_posix()
    text += OBJECTS.format(json.dumps(place, ensure_ascii=False))
    if not params.is_file() or params.read_text(encoding="utf-8") != text:
        write_atomically(params, text.encode())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("profile")
    parser.add_argument("--assets", help="objects: procedural, or a folder")
    arguments = parser.parse_args()
    try:
        install(arguments.profile, FOLDER.parent / PARAMS, arguments.assets)
    except BusybotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
