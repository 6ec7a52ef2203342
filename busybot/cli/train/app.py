"""`busybot train`: learn a skill from recorded files."""

import typer

from busybot.cli.common import CONTEXT
from busybot.cli.train import interact as train_interact
from busybot.cli.train import plan as train_plan
from busybot.cli.train import reason as train_reason

app = typer.Typer(add_completion=False, no_args_is_help=True, context_settings=CONTEXT, help="Learn a skill.")
interact = app.command()(train_interact.interact)
reason = app.command()(train_reason.reason)
bc = app.command("bc")(train_plan.bc)
ppo = app.command("ppo")(train_plan.ppo)
