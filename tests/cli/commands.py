"""Commands as a user types them, run in the test's own process: no second Python has to start and import everything."""

from dataclasses import dataclass

from typer.testing import CliRunner

from busybot.cli.main import app


@dataclass(frozen=True)
class Done:
    """What a finished process leaves."""

    returncode: int
    stdout: str
    stderr: str


def busybot(*arguments: object) -> Done:
    """Run `busybot ARGUMENTS`; what a user would see as a traceback is raised."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Done(result.exit_code, result.stdout, result.stderr)
