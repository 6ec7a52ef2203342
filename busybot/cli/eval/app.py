"""`busybot eval`: measure a skill on a dataset."""

import typer

from busybot.cli.common import CONTEXT
from busybot.cli.eval import interact as eval_interact
from busybot.cli.eval import plan as eval_plan
from busybot.cli.eval import reason as eval_reason

app = typer.Typer(
    add_completion=False, no_args_is_help=True, context_settings=CONTEXT, help="Measure a skill on a dataset."
)
reason = app.command()(eval_reason.reason)
interact = app.command()(eval_interact.interact)
plan = app.command()(eval_plan.plan)
