"""The command line's frame: lazy subcommands, exit codes, one JSON object."""

import json
import os
import shlex
import subprocess
import sys
import types
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from busybot.cli import assets, main, train, view
from busybot.cli.common import episode_progress, print_json, say
from busybot.cli.dataset import printing
from busybot.cli.options import RENAMED, JsonOption
from busybot.common.errors import BusybotError, UsageError
from busybot.datasets.importing.sources import Imported
from tests.cli.commands import busybot

RUNNER = CliRunner()
HEAVY = ("sapien", "torch", "rerun", "numpy", "pandas", "pyarrow", "cv2", "rich")


def doctor(as_json: JsonOption = False, how: str = "well") -> None:
    """A stand-in subcommand."""
    if how == "badly":
        raise BusybotError("board 7: no lamp", "add a lamp")
    if how == "wrongly":
        raise UsageError("there is no such how", "say well")
    say("this goes on")
    with episode_progress("working") as progress:
        progress(1, 1)
    if how == "interrupted":
        raise KeyboardInterrupt
    if as_json:
        print_json({"how": how})


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("busybot.cli.doctor")
    module.doctor = doctor  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "busybot.cli.doctor", module)


def invoke(*args: str) -> Any:
    return RUNNER.invoke(main.app, list(args))


def test_done_is_0(stand_in: None) -> None:
    result = invoke("doctor", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {"how": "well"}


def test_fault_of_the_input_is_1_with_message_and_hint(stand_in: None) -> None:
    result = invoke("doctor", "--how", "badly")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr == "error: board 7: no lamp\n  hint: add a lamp\n"


def test_fault_with_json_is_one_object_too(stand_in: None) -> None:
    result = invoke("doctor", "--json", "--how", "badly")
    assert result.exit_code == 1
    assert json.loads(result.stdout) == {"error": "board 7: no lamp", "hint": "add a lamp"}


def test_what_can_never_be_right_is_2_and_leaves_no_json(stand_in: None) -> None:
    result = invoke("doctor", "--json", "--how", "wrongly")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == "error: there is no such how\n  hint: say well\n"


def test_quiet_leaves_answers_and_faults_alone(stand_in: None) -> None:
    assert "this goes on" in invoke("doctor").stderr and "working: 1 of 1" in invoke("doctor").stderr
    for words in (("--quiet", "--json"), ("--json", "-q")):
        quiet = invoke("doctor", *words)
        assert (quiet.stderr, json.loads(quiet.stdout)) == ("", {"how": "well"})
    assert "error: board 7: no lamp" in invoke("doctor", "--quiet", "--how", "badly").stderr
    assert "this goes on" in invoke("doctor").stderr, "it ends with the command"


def test_every_command_can_be_quiet() -> None:
    for name in main.COMMANDS:
        command = main.load_command(name)
        for one in getattr(command, "commands", {"": command}).values():
            assert [parameter.name for parameter in one.params].count("quiet") == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("report", "datasets/tiny", "--out", "o", "--reasoner", "lookup"), "--reasoner lookup is about an episode"),
        (("report", "datasets/tiny", "--out", "o", "--model", "procedural"), "--model procedural is about an episode"),
        (("view", "datasets/tiny", "--assets", "procedural"), "it needs --replay"),
        (("dataset", "export", "datasets/tiny", "--out", "o", "--to", "images", "--assets", "a"), "leave --assets out"),
    ],
)
def test_options_that_would_do_nothing_are_refused(words: tuple[str, ...], told: str) -> None:
    result = invoke(*words)
    assert result.exit_code == 2 and told in " ".join(result.stderr.split())


OLD_NAMES = [(words, old, new) for words, names in RENAMED.items() for old, new in names.items()]


@pytest.mark.parametrize(("words", "old", "new"), OLD_NAMES, ids=[f"{words} {old}" for words, old, _ in OLD_NAMES])
def test_an_old_name_works_for_a_version_and_says_so(words: str, old: str, new: str) -> None:
    name, *inner = words.split()
    command: Any = main.load_command(name)
    for one in inner:
        command = command.commands[one]
    options = {option: one for one in command.params for option in one.opts}
    assert new in options and old not in options
    value = "png" if old == "--images" else "paper"
    for typed in ([old, value], [f"{old}={value}"]):
        result = invoke(name, *inner, *typed, "--help")
        assert result.exit_code == 0 and f"{old} is called {new} now" in result.stderr
        assert f"{old} " not in result.stdout


MODELS = {
    "--model": {"collect", "eval interact", "view", "report", "demo"},
    "--reasoner": {"collect", "eval reason", "eval plan", "view", "report"},
    "--variant": {"train interact", "train reason"},
    "--images": {"eval reason", "eval what-if"},
    "--image-format": {"collect"},
}


def test_an_option_has_one_meaning_in_all_commands() -> None:
    found: dict[str, set[str]] = {option: set() for option in MODELS}
    for name in main.COMMANDS:
        command = main.load_command(name)
        for inner, one in getattr(command, "commands", {"": command}).items():
            for option in (option for parameter in one.params for option in parameter.opts if option in found):
                found[option].add(f"{name} {inner}".strip())
    assert found == MODELS


@pytest.mark.parametrize(
    ("typed", "offered", "not_offered"),
    [
        ("generate --split nov", ["novel-config", "novel-object", "novel-mechanism"], "train"),
        ("generate --relations one", ["one-to-one", "one-to-many"], "any"),
        ("generate --world ", ["paper", "gates", "toggle"], "clock"),
        ("collect --policy ", ["random", "learned", "curious", "scripted"], ""),
        ("collect --model pro", ["procedural"], ""),
        ("eval reason --reasoner ", ["event", "lookup", "persistence", "count", "pc"], "procedural"),
        ("train interact --variant ", ["fast", "paper"], ""),
        ("collect --device c", ["cpu"], "auto"),
        ("models info ", ["procedural", "event"], "lookup"),
        ("gene", ["generate"], "collect"),
    ],
)
def test_shells_complete_choices(typed: str, offered: list[str], not_offered: str) -> None:
    words = {"COMP_WORDS": f"busybot {typed}", "COMP_CWORD": str(len(typed.split(" ")))}
    asked = {**os.environ, **words, "_BUSYBOT_COMPLETE": "complete_bash"}
    done = subprocess.run([sys.executable, "-m", "busybot"], capture_output=True, text=True, env=asked)
    answers = done.stdout.split()
    assert set(offered) <= set(answers) and not_offered not in answers and done.stderr == ""


def test_ctrl_c_is_130(stand_in: None) -> None:
    assert invoke("doctor", "--how", "interrupted").exit_code == 130


@pytest.mark.parametrize("args", [("doctor", "--nonsense"), ("no-such-command",), ("doctor", "surplus")])
def test_wrong_usage_is_2(stand_in: None, args: tuple[str, ...]) -> None:
    result = invoke(*args)
    assert result.exit_code == 2
    assert result.stdout == ""


def test_one_subcommand_is_still_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """`eval reason` stays `eval reason` while `reason` is the only thing that `eval` has."""
    module = types.ModuleType("busybot.cli.eval")
    module.app = typer.Typer()  # type: ignore[attr-defined]
    module.app.command("reason")(doctor)
    monkeypatch.setitem(sys.modules, "busybot.cli.eval", module)
    assert invoke("eval", "reason", "--json").exit_code == 0
    assert invoke("eval", "--json").exit_code == 2


def test_a_module_that_is_absent_is_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(main, "COMMANDS", ("doctor", "unwritten"))
    assert invoke("--help").exit_code == 0
    assert invoke("unwritten").exit_code == 2


def test_a_command_whose_own_import_fails_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "busybot.sim.vulkan_check", None)
    monkeypatch.setattr(main.importlib, "import_module", lambda name: __import__("surely_absent"))
    with pytest.raises(ModuleNotFoundError, match="surely_absent"):
        main.load_command("doctor")


def test_importing_the_command_line_imports_nothing_heavy() -> None:
    code = f"import sys, busybot.cli.main; print([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_help_of_every_command_imports_nothing_heavy() -> None:
    """Subcommands import what is heavy inside their functions."""
    code = (
        "import sys, busybot.cli.main as m\n"
        "for name in m.COMMANDS: m.load_command(name)\n"
        f"print([name for name in {HEAVY[:-1]!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_ctrl_c_during_the_first_imports_is_quiet() -> None:
    code = (
        "import sys\n"
        "class Interrupted:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'typer': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupted())\n"
        "from busybot.__main__ import main; main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "")


def test_python_m_busybot() -> None:
    done = subprocess.run([sys.executable, "-m", "busybot", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "0.1.0\n")


def test_native_libraries_cannot_spoil_the_json() -> None:
    """What C++ or a child process writes to file descriptor 1 ends on standard error."""
    code = (
        "import os\n"
        "from busybot.cli.common import native_output_on_stderr, print_json\n"
        "with native_output_on_stderr(True):\n"
        "    os.write(1, b'[warning] from C++\\n')\n"
        "    os.system('echo from a child')\n"
        "    print_json({'a': 1})\n"
        "print('after')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == '{"a": 1}\nafter\n'
    assert done.stderr == "[warning] from C++\nfrom a child\n"


def test_json_knows_our_types(capsys: pytest.CaptureFixture[str]) -> None:
    import numpy as np

    from busybot.cli.doctor import Check

    print_json({"path": Path("a/b"), "check": Check("x", True, "y"), "n": np.int64(3), "v": np.zeros(2), "s": {2, 1}})
    assert json.loads(capsys.readouterr().out) == {
        "path": "a/b",
        "check": {"name": "x", "ok": True, "value": "y", "hint": None},
        "n": 3,
        "v": [0.0, 0.0],
        "s": [1, 2],
    }


def test_what_is_no_number_is_null_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"x": float("nan"), "y": [float("-inf"), 0.5]})
    assert json.loads(capsys.readouterr().out) == {"x": None, "y": [None, 0.5]}


def told_by(what: str, place: Path) -> object:
    """Let a command tell what to do next with a place."""
    if what == "training":
        return train._tell(False, place, "reason", {})
    if what == "recording":
        return view._tell(SimpleNamespace(save=place, screenshot=None, figure=None, url=None))
    if what == "dataset":
        dataset: Any = SimpleNamespace(path=place, info=SimpleNamespace(boards=1))
        row: dict[str, object] = dict.fromkeys(("frames", "width", "height", "actions", "triggers", "responders"), 0)
        return printing.imported(Imported("images", [row | {"place": "x", "relations": None}], dataset))
    return say(assets._next("check", place))


@pytest.mark.parametrize("what", ["library", "training", "recording", "dataset"])
def test_commands_that_are_proposed_can_be_pasted(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    told_by(what, Path("my data/it's new"))
    words = shlex.split(capsys.readouterr().err.strip().splitlines()[-1])
    assert "my data/it's new" in words


def test_a_report_has_no_use_for_a_model_without_an_episode(tmp_path: Path) -> None:
    done = invoke("report", str(tmp_path), "--out", str(tmp_path / "report"), "--model", "procedural")
    assert done.exit_code == 2 and "--episode" in done.stderr and not (tmp_path / "report").exists()


def test_a_misspelt_command_is_told_the_near_one() -> None:
    result = invoke("colect")
    assert result.exit_code == 2
    assert "Did you mean 'collect'?" in result.output


DRAWS_OR_COMPUTES = {
    *("collect", "features", "replay", "view", "report", "demo", "assets sheet", "dataset regenerate"),
    *(f"train {skill}" for skill in ("interact", "reason", "bc", "ppo")),
    *(f"eval {skill}" for skill in ("interact", "reason", "plan")),
}


def test_commands_that_draw_or_compute_take_a_device() -> None:
    found = set()
    for name in main.COMMANDS:
        command = main.load_command(name)
        for inner, one in getattr(command, "commands", {"": command}).items():
            if any(parameter.name == "device" for parameter in one.params):
                found.add(f"{name} {inner}".strip())
    assert found == DRAWS_OR_COMPUTES


def test_a_device_of_no_kind_is_wrong_usage() -> None:
    done = RUNNER.invoke(main.app, ["collect", "no-such-dataset", "--device", "abacus", "--json"])
    assert (done.exit_code, done.stdout) == (2, "") and "there is no device 'abacus'" in done.stderr


@pytest.mark.parametrize("order", [("--device", "cuda:99", "--json"), ("--json", "--device", "cuda:99")])
def test_a_device_that_is_not_there_is_refused_before_anything_else(order: tuple[str, ...]) -> None:
    done = RUNNER.invoke(main.app, ["collect", "no-such-dataset", *order])
    assert done.exit_code == 1 and "there is no device cuda:99" in json.loads(done.stdout)["error"]
    assert "no-such-dataset" not in done.stdout


def test_the_environment_says_how_many_workers_there_are(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[int] = []

    def told(wanted: int | None) -> int:
        asked.append(wanted or 0)
        raise BusybotError("enough")

    monkeypatch.setattr(import_module("busybot.cli.dataset.app"), "processes", told)
    tiny = Path(__file__).parents[2] / "datasets" / "tiny"
    monkeypatch.setenv("BUSYBOT_WORKERS", "3")
    busybot("dataset", "verify", tiny)
    busybot("dataset", "verify", tiny, "--workers", "2")
    assert asked == [3, 2]
    monkeypatch.setenv("BUSYBOT_WORKERS", "none")
    done = busybot("dataset", "verify", tiny)
    assert done.returncode == 2 and "BUSYBOT_WORKERS" in done.stderr and asked == [3, 2]
