"""Two set-ups in one folder do not get into each other's way."""

import subprocess
import sys
from pathlib import Path

import pytest

from provision.steps import Log, SetupError, alone_in

ROOT = Path(__file__).resolve().parents[2]
OTHER = """
import sys
from pathlib import Path
from provision.steps import alone_in
with alone_in(Path(sys.argv[1])):
    print("working", flush=True)
    sys.stdin.read()
"""


def start(folder: Path) -> subprocess.Popen[str]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-c", OTHER, str(folder)], cwd=ROOT, text=True, **pipes)  # type: ignore[call-overload,no-any-return]


def test_the_second_says_that_it_waits_and_goes_on_when_the_first_ended(tmp_path: Path) -> None:
    with alone_in(tmp_path):
        subprocess.run(["true"], check=True)  # what is run does not keep the lock
        second = start(tmp_path)
        assert second.stderr is not None and f"another set-up works in {tmp_path}" in second.stderr.readline()
        assert second.poll() is None
    out, error = second.communicate(timeout=60)
    assert (second.returncode, out, error) == (0, "working\n", "")


def test_one_that_was_killed_holds_nobody_up(tmp_path: Path) -> None:
    first = start(tmp_path)
    assert first.stdout is not None and first.stdout.readline() == "working\n"
    first.kill()
    first.communicate()
    with alone_in(tmp_path):
        assert not list(tmp_path.iterdir()), "nothing is left in the folder"


def test_what_the_file_system_refuses_is_told(tmp_path: Path) -> None:
    (tmp_path / ".setup.log").mkdir()
    with pytest.raises(SetupError, match=r"\.setup\.log: Is a directory"), alone_in(tmp_path):
        Log(tmp_path / ".setup.log")
