"""`busybot train bc` and `busybot train ppo`: the paper's learned agents for reaching goals."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from busybot.cli.common import JsonOption, SeedOption, WorkersOption, episode_progress, kept_in, print_json, say

OutOption = Annotated[Path, typer.Option(help="Folder of the training; the same command continues in it.")]
DataOption = Annotated[
    list[Path], typer.Option(help="Dataset of the training split with tasks and recorded histories; repeatable.")
]
PolicyModelOption = Annotated[
    str | None,
    typer.Option(
        help="Interaction model that proposes candidates: a shipped one (`procedural` by default) or a folder."
    ),
]
ExploredOption = Annotated[
    Path | None, typer.Option(help="Folder of explored boards, which trainings may share; by default OUT/boards.")
]
AssetsOption = Annotated[str | None, typer.Option(help="Objects, if they are not found by their hashes.")]
ConfigOption = Annotated[Path | None, typer.Option(help="YAML file with parameters (BcConfig, PpoConfig).")]
SetOption = Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as minutes=10.")]


def command(agent: str, about: str) -> Callable[..., None]:
    """The command that trains an agent; both take the same options."""

    def train(
        out: OutOption,
        data: DataOption,
        policy_model: PolicyModelOption = None,
        explored: ExploredOption = None,
        assets: AssetsOption = None,
        seed: SeedOption = 0,
        workers: WorkersOption = None,
        config: ConfigOption = None,
        set_: SetOption = None,
        json: JsonOption = False,
    ) -> None:
        from busybot.common.config import build
        from busybot.common.process_pool import default_workers
        from busybot.interact.policy.policy_factory import DEFAULT_MODEL
        from busybot.plan.learning.train import CONFIGS, PracticeSource, train_policy

        built: Any = build(CONFIGS[agent], config, set_ or [], {})
        source = PracticeSource(tuple(data), policy_model or DEFAULT_MODEL, assets, explored)
        with kept_in(out):
            info, budget = train_policy(out, built, source, seed, workers or default_workers(), episode_progress)
        if json:
            print_json({"out": out, "model": out / "model", "training": info.training, "budget": budget})
            return
        say(f"{budget['iterations']} iterations in {budget['minutes']} of at most {budget['minutes_allowed']} minutes")
        say(f"the policy is in {out / 'model'}")
        say(f"next: busybot eval plan DATASET --agents {agent}={out}")

    train.__doc__ = about
    return train


bc = command("bc", "Learn to reach goals by imitating an oracle, on training boards.")
ppo = command("ppo", "Learn to reach goals by trial and error, on training boards; needs the extra `baselines`.")
