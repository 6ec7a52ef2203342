"""`busybot train`: learn a skill from recorded files."""

from collections.abc import Callable
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from busybot.cli.common import CONTEXT, answer, episode_progress, kept_in, processes, say
from busybot.cli.options import (
    AssetsOption,
    DeviceOption,
    JsonOption,
    SeedOption,
    StrictOption,
    WorkersOption,
    encoders,
    interaction_models,
    offering,
    trained_reasoners,
)
from busybot.common.errors import BusybotError, UsageError

if TYPE_CHECKING:
    from busybot.interact.training.fast import Training
    from busybot.interact.training.paper import PaperTraining

app = typer.Typer(add_completion=False, no_args_is_help=True, context_settings=CONTEXT, help="Learn a skill.")

OutOption = Annotated[Path, typer.Option(help="Folder of the training; the same command continues in it.")]


@app.command()
def interact(
    out: OutOption,
    variant: Annotated[
        Literal["fast", "paper"] | None, typer.Option(help="Networks and schedule: fast (default) or paper.")
    ] = None,
    assets: Annotated[str | None, typer.Option(help="Objects to act on: procedural, or a folder.")] = None,
    data: Annotated[
        list[Path] | None, typer.Option(help="Recorded rounds to train on instead of collecting; repeatable.")
    ] = None,
    offline: Annotated[bool, typer.Option("--offline", help="Collect nothing: train on OUT/rounds.")] = False,
    strict: StrictOption = False,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters (TrainConfig, PaperConfig).")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as interaction.delta=1000.")] = None,
    json: JsonOption = False,
) -> None:
    """Learn where and how to act, in rounds: collect with what is known, then train on all that is recorded."""
    if offline and not data and not (out / "rounds").is_dir():
        raise BusybotError(f"{out}: it has no folder `rounds` to train on", "collect first: leave --offline out")
    if assets and (offline or data):
        raise UsageError(f"--assets {assets}: nothing is collected", "leave it out, or --offline and --data")
    options = {"variant": variant, "interaction.strict": strict or None}
    objects = None if offline or data else assets or "procedural"
    training = _interaction(out, (config, set_ or [], options), objects, tuple(data or ()), seed, processes(workers))
    with kept_in(out):
        trained = training.run()
    _tell(json, out, "interact", trained.info.training)


def _interaction(
    out: Path,
    parameters: tuple[Path | None, list[str], dict[str, Any]],
    assets: str | None,
    data: tuple[Path, ...],
    seed: int,
    workers: int,
) -> "Training | PaperTraining":
    """The training of the variant that is asked for; without assets nothing is collected."""
    from busybot.common.config import asked, build
    from busybot.interact.training.config import STRICT, PaperConfig, RecordConfig, TrainConfig
    from busybot.interact.training.fast import Training
    from busybot.interact.training.paper import PaperTraining
    from busybot.interact.training.round_recorder import Recorder, RoundProgress
    from busybot.objects.resolve import find

    variant = asked("variant", *parameters)  # whether the option says so, a setting or the file
    told = RoundProgress(say, episode_progress)

    def recorder(config: RecordConfig) -> Recorder:
        return Recorder(find(assets) if assets else None, config, seed, workers, told)

    if variant == "paper":
        paper = build(PaperConfig, *parameters)
        return PaperTraining(out, paper, recorder(paper), data)
    fast = build(TrainConfig, *parameters)
    if fast.interaction.strict:  # whether the option said so, a setting or the file
        fast = build(TrainConfig, *parameters, STRICT)
    return Training(out, fast, recorder(fast), data)


@app.command()
def reason(
    out: OutOption,
    data: Annotated[list[Path], typer.Option(help="Dataset with episodes to train on; repeatable.")],
    variant: Annotated[
        Literal["event", "mechanism", "paper"], typer.Option(help="Networks: event, mechanism or paper.")
    ] = "event",
    encoder: Annotated[
        str | None,
        typer.Option(
            help="Features to read: embedded (default, but for paper), resnet50 (paper's), resnet50keras or random.",
            autocompletion=offering(encoders),
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="Model to begin with instead of random weights: a shipped one, or a folder.",
            autocompletion=offering(trained_reasoners),
        ),
    ] = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    config: Annotated[
        Path | None, typer.Option(help="YAML file with parameters (EventConfig, MechanismConfig, PaperReasonConfig).")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as net.width=64.")] = None,
    json: JsonOption = False,
) -> None:
    """Learn relations and effects from recorded episodes; `event` and `paper` are told neither.

    The model `mechanism` is told: its labels are the true parents of the boards that it is trained on, and
    which way round their links are.
    """
    from busybot.common.config import build
    from busybot.datasets.dataset import Dataset
    from busybot.datasets.summary import kept_to_judge
    from busybot.reason.train import CONFIGS, train_reason

    parameters = build(CONFIGS[variant], config, set_ or [], {"encoder": encoder})
    for path in data:
        if lost := kept_to_judge(Dataset.open(path)):
            say(lost)
    with kept_in(out):
        trained = train_reason(out, parameters, tuple(data), seed, episode_progress, workers, start)
    _tell_held_out(trained.training, parameters.loop.held_out)
    _tell(json, out, "reason", trained.training)


def _tell(json: bool, out: Path, skill: str, training: Any) -> None:
    facts = {"out": out, "model": out / "model", "training": training}
    hint = f"next: busybot eval {skill} DATASET --{'reasoner' if skill == 'reason' else 'model'} {quote(str(out))}"
    answer(json, facts, f"the model is in {out / 'model'}", hint)


def _tell_held_out(training: dict[str, Any], share: float) -> None:
    """Say so where boards were to be held out and none were."""
    if share and training.get("boards_held_out") == 0:
        say(
            "nothing was held out to judge the training by: all boards look alike, they are one appearance group; "
            "for more of these, busybot generate with more --boards than --group-size"
        )


def _planner(agent: str, about: str) -> Callable[..., None]:
    """The command that trains one of the paper's learned agents for reaching goals; both take the same options."""

    def train(
        out: OutOption,
        data: Annotated[
            list[Path],
            typer.Option(help="Dataset of the training split with tasks and recorded histories; repeatable."),
        ],
        policy_model: Annotated[
            str | None,
            typer.Option(
                help="Interaction model that proposes candidates: a shipped one (`procedural` by default) or a folder.",
                autocompletion=offering(interaction_models),
            ),
        ] = None,
        explored: Annotated[
            Path | None,
            typer.Option(help="Folder of explored boards, which trainings may share; by default OUT/boards."),
        ] = None,
        assets: AssetsOption = None,
        seed: SeedOption = 0,
        workers: WorkersOption = None,
        device: DeviceOption = "auto",
        config: Annotated[Path | None, typer.Option(help="YAML file with parameters (BcConfig, PpoConfig).")] = None,
        set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as minutes=10.")] = None,
        json: JsonOption = False,
    ) -> None:
        from busybot.common.config import build
        from busybot.interact.policy.policy_factory import DEFAULT_MODEL
        from busybot.plan.learning.train import CONFIGS, PracticeSource, train_policy

        built: Any = build(CONFIGS[agent], config, set_ or [], {})
        source = PracticeSource(tuple(data), policy_model or DEFAULT_MODEL, assets, explored)
        with kept_in(out):
            info, budget = train_policy(out, built, source, seed, processes(workers), episode_progress)
        _tell_held_out(info.training, built.loop.held_out)
        among = f" --policy-model {quote(policy_model)}" if policy_model else ""
        minutes = f"{budget['minutes']} of at most {budget['minutes_allowed']} minutes"
        answer(
            json,
            {"out": out, "model": out / "model", "training": info.training, "budget": budget},
            f"{budget['iterations']} iterations in {minutes}",
            f"the policy is in {out / 'model'}",
            f"next: busybot eval plan DATASET --agents {quote(f'{agent}={out}')}{among}",
        )

    train.__doc__ = about
    return train


bc = app.command("bc")(_planner("bc", "Learn to reach goals by imitating an oracle, on training boards."))
ppo = app.command("ppo")(
    _planner("ppo", "Learn to reach goals by trial and error, on training boards; needs the extra `baselines`.")
)
