"""`busybot train reason`: learn which trigger controls what, from recorded episodes alone (paper section 4.2).

A training is a folder:

train.json                  what was asked for; the same command continues, another one is refused
model/                      the trained model, with provenance and figures
metrics.csv, metrics.json   losses, and figures on boards of appearance groups that were held out
training.png                the same as a picture
checkpoints/, metrics/      to go on from where a killed training stopped

Relations, states and what the gripper truly held are never read (`inputs.observation`), but by the model `mechanism`:
unless it is trained from pictures alone, its labels are the true parents of the boards that it is trained on, and which
way round their links are.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from pydantic import ValidationError

from busybot.boards.spec import PAPER
from busybot.common.atomic_io import remove
from busybot.common.errors import BusybotError, UsageError
from busybot.common.frozen_model import first_fault
from busybot.common.process_pool import Progress
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import origin_of
from busybot.reason.inputs.board_dataset import RecordedBoards, held_apart
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.event.config import EventConfig
from busybot.reason.models.mechanism.config import MechanismConfig
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.registry import ReasonerInfo, make_network
from busybot.training.checkpoint import load_tensors, load_weights, save_model
from busybot.training.loop import Learner, fit
from busybot.training.model_cards import (
    INFO_FILE,
    WEIGHTS_FILE,
    check_weights,
    file_hashes,
    find_folder,
    read_info,
)
from busybot.training.run_folder import (
    TRAIN_FILE,
    Panel,
    begin_folder,
    draw,
    judgements,
    learner_versions,
    losses,
    read_metrics,
)

Config = EventConfig | PaperReasonConfig | MechanismConfig
CONFIGS: dict[str, type[EventConfig] | type[PaperReasonConfig] | type[MechanismConfig]] = {
    "event": EventConfig,
    "mechanism": MechanismConfig,
    "paper": PaperReasonConfig,
}
"""Parameters by model."""

SHOWN = {
    "loss": "held out",
    "loss_of_no_change": "held out, if nothing changed",
    "right": "all steps",
    "right_changes": "steps that changed something",
}
"""Names of figures on held-out boards in the picture."""
Told = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress display of this name."""


def train_reason(
    out: Path,
    config: Config,
    data: tuple[Path, ...],
    seed: int,
    told: Told,
    workers: int | None = None,
    start: str | None = None,
) -> ReasonerInfo:
    """Train, or continue a training that was interrupted; returns what the model's `model.json` says.

    Args:
        data: datasets with episodes.
        workers: processes that compute missing features.
        start: a shipped model's name or a model's folder, whose weights the training begins with; random ones without.

    Raises:
        BusybotError: the folder holds another training, or a dataset cannot be trained on.
    """
    datasets = [Dataset.open(path) for path in data]
    model = None if start is None else find_folder(start, "reason")
    config = suited(config if model is None else like(config, model), datasets)
    origin = [origin_of(dataset) for dataset in datasets]
    begun = {} if model is None else {"start": file_hashes(model)}
    if model is not None:
        refuse_other_sizes(config, model)  # before anything is written: the same command with others would be refused
    new = not (out / TRAIN_FILE).exists()
    begin_folder(out, config, seed, data=origin, **begun)
    if (out / "model" / INFO_FILE).exists():
        return read_info(out / "model", ReasonerInfo)
    features = []
    for dataset in datasets:
        with told(f"features of {dataset.path.name}") as progress:
            features.append(features_of(dataset, config.encoder, workers=workers, progress=progress))
    try:
        boards, held_out = held_apart(datasets, features, config.loop.held_out, seed, config.loop.boards)
        learner = make_learner(config, boards, held_out, seed, told)
    except BusybotError as error:
        if new:  # the folder would refuse the command with other datasets
            remove(out / TRAIN_FILE, out)
        raise type(error)(f"{', '.join(map(str, data))}: {error.what}", error.hint) from None
    if model is not None:
        begin_with(learner, model)
    figures = fit(learner, out, config.loop)
    plot(out, learner.name)
    info = ReasonerInfo(
        model=config.model,
        encoder=config.encoder,
        config=config.model_dump(mode="json"),
        training={
            "seed": seed,
            "data": origin,
            **begun,
            "features": features[0].key,
            "oracle": any(found.oracle for found in features),
            **({"labels": LABELS[config.labels]} if isinstance(config, MechanismConfig) else {}),
            "boards": len(boards),
            "boards_held_out": len(held_out),
            **figures,
            "versions": learner_versions(),
        },
    )
    save_model(out / "model", info, learner.network.state_dict())
    return info


LABELS = {"parents": "true parents, and which way round links are", "pictures": "none"}


def suited(config: Config, datasets: list[Dataset]) -> Config:
    """The same with what the `mechanism` network hears and says where nobody chose it: worlds of the datasets, families
    of explanations; with labels all that these teach.

    Raises:
        UsageError: it is to hear or say what only labels teach, and there are to be none.
    """
    if not isinstance(config, MechanismConfig):
        return config
    generators = [dataset.info.generator for dataset in datasets if not dataset.info.generator.imported]
    told = {str(one.config.get("world", PAPER)) for one in generators}
    labels = config.labels == "parents"
    given = config.net.model_fields_set
    heard: dict[str, object] = {"worlds": config.net.worlds or tuple(sorted(told))}
    heard["families"] = config.net.families or "families" not in given
    for name in ("changes", "unseen", "apart", "rising", "unsteady"):
        heard[name] = getattr(config.net, name) if name in given else labels
        if heard[name] and not labels:
            raise UsageError(f"net.{name}=true: only labels teach that", "leave it out, or train with labels=parents")
    return config.model_copy(update={"net": config.net.model_copy(update=heard)})


def like(config: Config, model: Path) -> Config:
    """The same with the sizes of a model's networks, where nobody chose others; what is learned beside may differ.

    Raises:
        BusybotError: its card is damaged.
        UsageError: it is another kind of model, or reads other features.
    """
    card = read_info(model, ReasonerInfo)
    if (card.model, card.encoder) != (config.model, config.encoder):
        what = f"{model}: a model `{card.model}` that reads `{card.encoder}`, and `{config.model}` is trained"
        raise UsageError(f"{what} that reads `{config.encoder}`", "begin with one of the same kind")
    taught = card.training.get("labels", LABELS["parents"])
    if isinstance(config, MechanismConfig) and config.labels == "pictures" and taught != LABELS["pictures"]:
        what = f"{model}: it was taught by {taught}, and this training is to have no labels"
        raise UsageError(what, "begin with a model that was trained with labels=pictures, or train with labels=parents")
    part = "network" if isinstance(config, PaperReasonConfig) else "net"
    try:
        theirs = getattr(type(config).model_validate(card.config), part)
    except ValidationError as error:
        raise BusybotError(f"{model / INFO_FILE}: config.{first_fault(error)}", "copy the model again") from None
    kept = {name: getattr(theirs, name) for name in type(theirs).model_fields if name not in LEARNED_BESIDE}
    own = getattr(config, part)
    chosen = {name: getattr(own, name) for name in own.model_fields_set}
    return config.model_copy(update={part: type(own)(**{**kept, **chosen})})


LEARNED_BESIDE = ("unseen", "apart")
"""Sizes of what is learned anew, see `Learner.learned_beside`."""


def refuse_other_sizes(config: Config, model: Path) -> None:
    """Refuse a model with whose weights no training with these parameters can begin.

    Raises:
        BusybotError: the model is damaged.
        UsageError: its network has other sizes.
    """
    import torch

    with torch.device("meta"):  # sizes alone
        own = make_network(config).state_dict()
    file, beside = model / WEIGHTS_FILE, _learned_beside(config)
    found = load_tensors(file).tensors
    check_weights(file, read_info(model, ReasonerInfo))
    for name in sorted({*own, *found}):
        theirs, wanted = (tuple(each[name].shape) if name in each else "absent" for each in (found, own))
        if not name.startswith(beside) and theirs != wanted:
            what = f"{file}: {name} is {theirs}, and in this training {wanted}"
            raise UsageError(what, "leave its sizes as they are, or begin with another model")


def _learned_beside(config: Config) -> tuple[str, ...]:
    """See `Learner.learned_beside`."""
    if not isinstance(config, MechanismConfig):
        return Learner.learned_beside
    from busybot.reason.models.mechanism.training.learner import MechanismLearner

    return MechanismLearner.learned_beside


def begin_with(learner: Learner, model: Path) -> None:
    """Give a learner's network the weights of a model, all but those that are learned beside it."""
    file, own, beside = model / WEIGHTS_FILE, learner.network.state_dict(), learner.learned_beside
    found = load_tensors(file).tensors
    load_weights(learner.network, {name: own[name] if name.startswith(beside) else found[name] for name in own}, file)


def make_learner(config: Config, boards: RecordedBoards, held_out: RecordedBoards, seed: int, told: Told) -> Learner:
    """The learner of the model whose parameters these are, told how far it is with boards that it looks at first."""
    if isinstance(config, PaperReasonConfig):
        from busybot.reason.models.paper.learner import PaperLearner

        return PaperLearner(config, boards, held_out, seed)
    if isinstance(config, MechanismConfig):
        from busybot.reason.models.mechanism.training.learner import learner_of

        with told("boards looked at") as progress:
            return learner_of(config, boards, held_out, seed, progress)
    from busybot.reason.models.event.learner import EventLearner

    return EventLearner(config, boards, held_out, seed)


def plot(out: Path, name: str) -> None:
    """Draw `training.png`: losses, and shares on held-out boards if known."""
    lines = read_metrics(out / "metrics" / f"{name}.jsonl")
    known = {figure for line in lines for figure in line.get("validation", {})}
    of_loss = {figure: label for figure, label in SHOWN.items() if figure in known and figure.startswith("loss")}
    shares = {figure: label for figure, label in SHOWN.items() if figure in known and figure not in of_loss}
    curves = {"trained on": losses(lines), **judgements(lines, of_loss)}
    panels = [Panel(f"loss of the {name} model", curves, logarithmic=True)]
    if shares:
        panels.append(Panel("held-out steps predicted rightly", judgements(lines, shares), shares=True))
    draw(out / "training.png", [panels])
