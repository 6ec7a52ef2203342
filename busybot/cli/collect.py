"""`busybot collect DATASET`: an episode for every board that has none."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from busybot.cli.common import answer, episode_progress, own_name, processes, say
from busybot.cli.options import (
    AssetsOption,
    DeviceOption,
    JsonOption,
    StrictOption,
    WorkersOption,
    interaction_models,
    offering,
    reasoners,
)
from busybot.common.errors import UsageError

if TYPE_CHECKING:
    from busybot.common.process_pool import Engine
    from busybot.sim.policy import AnyPolicyFactory


def collect(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder made by `busybot generate`.")],
    steps: Annotated[int | None, typer.Option(min=0, help="Actions on each board; 30 by default.")] = None,
    policy: Annotated[
        Literal["random", "learned", "curious", "scripted"] | None,
        typer.Option(
            help="random (the default; learned with tasks), learned, curious (does what tells most about causes), or "
            "scripted (an oracle that knows the joints)."
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="With --policy learned or curious: a shipped model's name or a folder.",
            autocompletion=offering(interaction_models),
        ),
    ] = None,
    reasoner: Annotated[
        str | None,
        typer.Option(
            help="With --policy curious: a shipped model's name (mechanism by default) or a folder.",
            autocompletion=offering(reasoners),
        ),
    ] = None,
    until_known: Annotated[
        bool, typer.Option("--until-known", help="With --policy curious: stop when all relations are known for sure.")
    ] = False,
    strict: StrictOption = False,
    camera: Annotated[
        Literal["clean", "real"] | None,
        typer.Option(help="clean (the default), or real: noise, blur, drift, shake, shadows, hands, lossy depth."),
    ] = None,
    image_format: Annotated[
        Literal["jpeg", "png"] | None, typer.Option(help="Store pictures as jpeg (the default) or png.")
    ] = None,
    assets: AssetsOption = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the policy; the dataset's by default.")] = None,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    engine: Annotated[
        Literal["local", "ray"], typer.Option(help="local, or ray for the machines of a cluster.")
    ] = "local",
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters (CollectConfig).")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as interaction.delta=1000.")] = None,
    json: JsonOption = False,
) -> None:
    """Act on every board and record what happens. Ctrl-C loses nothing: the same command continues."""
    from busybot.common.config import build
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.sim.collect import CollectConfig
    from busybot.sim.collect import collect as run

    options: dict[str, Any] = {
        "steps": steps,
        "policy": policy,
        "images": image_format,
        "seed": seed,
        "interaction.strict": strict or None,
    }
    target = Dataset.open(dataset)
    usual = ({"policy": "learned"} if target.info.tasks else {}) | _camera_terms(camera)
    options["render.camera"] = {} if camera == "clean" else None
    if camera == "clean" and (named := [one for one in set_ or () if one.startswith("render.camera")]):
        raise UsageError(f"--camera clean: --set {named[0]} is no clean camera", "leave one of the two out")
    parameters = build(CollectConfig, config, set_ or [], options, usual)
    library = library_of(target, assets)
    factory, provenance = _policy_factory(parameters.policy, model, parameters.learned, reasoner, until_known)
    try:
        with episode_progress("collecting") as progress:
            count, runner = processes(workers), _engine(engine)
            result = run(target, library, parameters, count, progress, factory, provenance, runner)
    except KeyboardInterrupt:
        say(f"{len(target.finished())} of {target.info.boards} episodes are there; the same command continues")
        raise
    answer(
        json,
        {"dataset": dataset, "boards": result.boards, "episodes": result.done, "new": result.new},
        f"{result.done} of {result.boards} episodes in {dataset}, {result.new} of them new",
        f"next: {own_name()} dataset info {quote(str(dataset))}; {own_name()} view {quote(str(dataset))}",
    )


def _camera_terms(camera: str | None) -> dict[str, Any]:
    """Strengths that the terms of a camera have unless others are named, by dotted names."""
    from busybot.sim.scene.real_camera import REAL

    return {f"render.camera.{term}": value for term, value in REAL.items()} if camera == "real" else {}


def _engine(name: str) -> "Engine":
    """Who runs the workers."""
    from busybot.common.process_pool import run_on_ray, run_tasks

    return run_on_ray if name == "ray" else run_tasks


def _policy_factory(
    policy: str, model: str | None, learned: dict[str, Any], reasoner: str | None, until_known: bool
) -> "tuple[AnyPolicyFactory | None, dict[str, Any] | None]":
    """What makes the policies, and what it is made of; None for the built-in ones."""
    trained, curious = ("learned", "curious"), ("curious",)
    given = [
        (f"--model {model}", model is not None, trained),
        (f"--set learned.{next(iter(learned), '')}", bool(learned), trained),
        (f"--reasoner {reasoner}", reasoner is not None, curious),
        ("--until-known", until_known, curious),
    ]
    for name, told, fitting in given:
        if told and policy not in fitting:
            what = f"{name} goes with --policy {fitting[0]}, not with {policy}"
            raise UsageError(what, f"leave it out, or say --policy {fitting[0]}")
    if policy not in trained:
        return None, None
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory

    factory = LearnedPolicyFactory(model or DEFAULT_MODEL, "collect", learned)
    if policy == "learned":
        return factory, factory.provenance()
    from busybot.plan.curious import REASONER, CuriousFactory, curious_reasoner

    curious_reasoner(reasoner or REASONER)  # refuses another before anything is written
    asking = CuriousFactory(factory, reasoner or REASONER, until_known)
    return asking, asking.provenance()
