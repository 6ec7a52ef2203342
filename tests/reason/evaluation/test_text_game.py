"""Boards as games of text: what a program is told, what it may do wrong, and how its claim is judged."""

import hashlib
import json
import shlex
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.cli.main import load_command
from busybot.common.errors import BusybotError, UsageError
from busybot.common.line_child import MOST_LINE, Child, NoAnswerError, command_words
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.reason.evaluation.play import AgentFiles, TextGames, make_work, play_boards, summarised, told_of
from busybot.reason.evaluation.text_game import (
    MOST_REFUSED,
    Act,
    Game,
    Know,
    PlayedBoard,
    RefusedError,
    play,
    understood,
)
from tests.cli.commands import busybot

AGENT = Path(__file__).resolve().parents[3] / "docs" / "extending" / "text_agent.py"
READ = "import json, sys, time; hear = lambda: json.loads(sys.stdin.readline()); first = hear()\n"
SAY = "def say(value): print(json.dumps(value), flush=True); return hear()\n"


@pytest.fixture(scope="module")
def boards(tiny: Path) -> Dataset:
    return Dataset.open(tiny)


@pytest.fixture(scope="module")
def library(boards: Dataset) -> Library:
    return library_of(boards)


@pytest.fixture
def game(boards: Dataset, library: Library) -> Game:
    return Game(boards.board(0), library, actions=6)


def python(code: str) -> tuple[str, ...]:
    return (sys.executable, "-ISc", READ + SAY + code)


def true_claim(game: Game) -> list[dict[str, Any]]:
    names = [(one.object, one.link) for one in game._inputs()]
    return [
        {"link": names.index((trigger.object, trigger.link)), "controls": relation.responder}
        for relation in game.board.relations
        for trigger in relation.triggers
    ]


def test_what_is_told_is_what_can_be_seen(game: Game) -> None:
    told = game.opening()
    assert told.keys() == {"event", "protocol", "objects", "touched", "actions_left"}
    for number, (one, placed) in enumerate(zip(told["objects"], game.board.objects, strict=True)):
        seen = {"look"} if placed.role == "responder" else {"links"}
        assert one.keys() == {"object", "name", "role"} | seen
        assert one["name"] == f"{placed.category} {number}" and one.get("look", 0) == 0
    assert [link for one in told["objects"] for link in one.get("links", [])] == list(range(len(game._links.sizes)))
    acted = game.act(Act(link=0))
    assert acted.keys() == {"event", "link", "direction", "moved", "changed", "touched", "actions_left"}
    assert acted["touched"] == [0] and acted["actions_left"] == 5
    text = json.dumps([told, acted])
    assert not any(relation.kind in text for relation in game.board.relations)
    assert not any(placed.instance in text for placed in game.board.objects)


@pytest.mark.parametrize("world", ["gates", "time", "chance", "chain", "lock", "rewired", "mixed"])
def test_looks_are_numbered_as_they_appear_in_every_world(world: str, few_objects: Any) -> None:
    objects = find(str(few_objects(0)))
    board = next(iter(generate_boards(BoardConfig(world=world, boards=1, seed=2), objects)))
    game = Game(board, objects, actions=40)
    last = {one["object"]: one["look"] for one in game.opening()["objects"] if "look" in one}
    newest = dict(last)
    for number in range(40):
        link = number % len(game._links.sizes)
        before = game.trace[-1]
        seen = game.act(Act(link=link, direction="forward" if before[0][link] == 0 else "back"))
        assert seen["moved"] == (game.trace[-1][0] != before[0])
        for one in seen["changed"]:
            assert one["look"] != last[one["object"]] and one["look"] <= newest[one["object"]] + 1
            last[one["object"]] = one["look"]
            newest[one["object"]] = max(newest[one["object"]], one["look"])
    assert max(newest.values()) >= 1
    judged = game.judged(game.claimed(Know(know=())), end="knows", note="", refused=0, early=False)
    assert judged.true and not judged.claimed and judged.bound is not None


@pytest.mark.parametrize(
    ("code", "end", "note"),
    [
        ("time.sleep(60)", "timeout", ""),
        ("sys.exit('\\x1b[2J no more')", "died", r"\x1b[2J no more"),
        ("import os; os.close(1); time.sleep(60)", "died", ""),
        ("sys.stdout.write('x' * 200_000); sys.stdout.flush(); time.sleep(60)", "line too long", ""),
        ("print(' ' * 70_000 + '{}', flush=True); time.sleep(60)", "line too long", ""),
        ("while True: print('what?', flush=True)", "too many refused", "no line of JSON"),
        ("while True: print('[' * 50_000, flush=True)", "too many refused", "no line of JSON"),
        ("while True: sys.stdout.buffer.write(b'\\xff\\x00\\n')", "too many refused", "no line of JSON"),
        ("while True: say({'link': 99})", "too many refused", "no such link"),
        ("while True: say({'link': 0, 'direction': '\\x1b[31mup'})", "too many refused", "direction"),
        ("while True: say({'link': True})", "too many refused", "link"),
        ("while True: say({'know': [{'link': 0, 'controls': 0}]})", "too many refused", "name responders"),
        ("while True: say({'link': 0})", "too many refused", "no action is left"),
        ("while True: print('x' * 60_000, file=sys.stderr)", "timeout", "xxx"),
    ],
)
def test_what_goes_wrong_ends_the_board_and_claims_nothing(game: Game, code: str, end: str, note: str) -> None:
    began = time.monotonic()
    played = play(game, python(code), 1.2 if end == "timeout" else 20)
    assert played.end == end and note in played.note and "\x1b" not in played.note
    assert not played.claimed and not played.early and played.true
    assert (played.refused == MOST_REFUSED) == (end == "too many refused")
    assert time.monotonic() - began < 15


def test_who_was_refused_may_go_on(game: Game) -> None:
    code = "no = say({'link': -1}); assert no['event'] == 'refused' and no['actions_left'] == 6\n"
    code += (
        "say({'link': 0, 'why': 'unknown keys are left alone'}); say({'link': None})\nprint('{\"know\": []}', end='')"
    )
    played = play(game, python(code), 20)
    assert (played.end, played.actions, played.refused, played.early) == ("knows", 2, 1, True)


def test_answers_may_come_before_they_are_asked_for(game: Game) -> None:
    """Also from a program that never reads: neither side waits for the other."""
    answers = "\n".join([*[json.dumps({"link": 0})] * 3, json.dumps({"know": []})])
    played = play(game, (sys.executable, "-ISc", f"print('''{answers}''')"), 20)
    assert (played.end, played.actions) == ("knows", 3)


def test_an_early_claim_is_judged(game: Game, boards: Dataset, library: Library) -> None:
    right = play(game, python(f"print(json.dumps({{'know': {true_claim(game)}}}))"), 20)
    wrong = play(Game(boards.board(1), library, 6), python("print('{\"know\": []}')"), 20)
    assert right.early and right.true == right.claimed and wrong.early and wrong.true != wrong.claimed
    figures = summarised([boards.board(0), boards.board(1)], [right, wrong], seed=0)
    assert (figures["wrong_early_stops"], figures["early_stops"], figures["actions_used"]) == (0.5, 2, 0.0)
    assert figures["parent_p"] == figures["link_parent_p"] == 1.0
    assert figures["parent_r"] == len(right.true) / len(right.true + wrong.true)
    assert figures["shd"] == len(wrong.true) / 2 and figures["ends"] == {"knows": 2}
    assert PlayedBoard.model_validate_json(right.model_dump_json()) == right


def test_links_are_judged_apart_from_their_objects(game: Game) -> None:
    owners = [owner for owner, _ in game._links.names]
    true = {(one["link"], one["controls"]) for one in true_claim(game)}
    several = [number for number, owner in enumerate(owners) if owners.count(owner) > 1]
    if several:
        other = next((k, r) for k in several for r in game._responders if (k, r) not in true)
        judged = game.judged(
            game.claimed(Know.model_validate({"know": [{"link": other[0], "controls": other[1]}]})),
            end="knows", note="", refused=0, early=True,
        )  # fmt: skip
        assert len(judged.claimed) == 1 and sum(right for right, _, _ in judged.links) == 0
    # in the paper's world nothing but links controls: the claim is left aside
    claim = {"know": [{"object": game._responders[0], "controls": game._responders[1]}]}
    judged = game.judged(game.claimed(Know.model_validate(claim)), end="knows", note="", refused=0, early=True)
    assert not judged.claimed and sum(claimed for _, claimed, _ in judged.links) == 0


def test_the_same_seed_gives_the_same_board(boards: Dataset, library: Library) -> None:
    words = (sys.executable, str(AGENT))
    once, again = (play(Game(boards.board(3), library, 12, seed=5), words, 20) for _ in range(2))
    assert once == again and once.end == "knows"

    def moved(seed: int) -> list[bool]:
        game = Game(boards.board(3), library, 200, seed)
        return [game.act(Act(link=0, direction=("forward", "back")[number % 2]))["moved"] for number in range(200)]

    assert moved(1) == moved(1) != moved(2)


def test_the_child_ends_with_its_group(game: Game, tmp_path: Path) -> None:
    told = tmp_path / "pids"
    code = "import subprocess, os; one = subprocess.Popen(['sleep', '600'])\n"
    code += f"open({str(told)!r}, 'w').write(f'{{os.getpid()}} {{one.pid}}'); print('{{\"know\": []}}', flush=True)\n"
    code += "time.sleep(600)"
    assert play(game, python(code), 20).end == "knows"
    for pid in map(int, told.read_text().split()):
        status = Path(f"/proc/{pid}/status")
        until = time.monotonic() + 5
        while status.exists() and "State:\tZ" not in status.read_text() and time.monotonic() < until:
            time.sleep(0.01)
        assert not status.exists() or "State:\tZ" in status.read_text()


def test_a_line_may_be_as_long_as_is_said() -> None:
    child = Child((sys.executable, "-ISc", f"print('x' * {MOST_LINE}); print('y')"), 20)
    assert len(child.ask({})) == MOST_LINE and child.ask({}) == b"y"
    with pytest.raises(NoAnswerError):
        child.ask({})
    assert child.close() == ""


@pytest.mark.parametrize(
    "line", [b"", b"[]", b"null", b"\xff", b"1" * 10_000, b'{"link": 1.0}', b'{"know": [[]]}', b"{}"]
)
def test_what_means_nothing_is_refused(line: bytes) -> None:
    with pytest.raises(RefusedError):
        understood(line)
    assert understood(b'{"link": null}') == Act(link=None)


def test_commands_are_given_to_no_shell(tmp_path: Path) -> None:
    assert command_words(f"{shlex.quote(sys.executable)} 'a b' '$HOME' ';'")[1:] == ("a b", "$HOME", ";")
    with pytest.raises(BusybotError, match="there is no program"):
        command_words("no-such-program-here --fast")
    for wrong in ("", "python '"):
        with pytest.raises(UsageError):
            command_words(wrong)
    broken = tmp_path / "broken"
    broken.write_text("no program")
    broken.chmod(0o755)
    with pytest.raises(OSError):
        Child([str(broken)], 1)


def test_relations_that_nobody_knows_are_refused(boards: Dataset, library: Library, monkeypatch: Any) -> None:
    unknown = [boards.board(0).model_copy(update={"relations_known": False})]
    monkeypatch.setattr(Dataset, "boards", lambda self: unknown)
    with pytest.raises(BusybotError, match="nobody knows the relations of board 0"):
        play_boards(TextGames(boards, library, ("true",)))


def test_the_example_needs_nothing_of_ours(boards: Dataset, library: Library) -> None:
    text = AGENT.read_text()
    assert len(text.splitlines()) <= 40 and "busybot" not in text
    work = make_work(TextGames(boards, library, (sys.executable, "-IS", str(AGENT)), timeout_s=20))
    played = work(4)
    assert played.end == "knows" and played.actions == 22 and played.claimed == played.true


def test_the_command(tiny: Path, tmp_path: Path, in_process: None) -> None:
    words = ("play", tiny, "--agent", shlex.join([sys.executable, str(AGENT)]), "--workers", 1, "--boards", 2)
    done = busybot(*words, "--json", "--out", tmp_path / "out")
    result = json.loads(done.stdout)
    assert done.returncode == 0 and result == json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["kind"] == "play" and result["boards"] == 2 and result["parent_f1"] == 1.0
    # all boards are judged there already: the table comes at once
    again = busybot(*words, "--out", tmp_path / "out")
    assert "exact observer" in again.stdout and "boards ended: knows 2" in again.stdout
    other = busybot(*words, "--out", tmp_path / "out", "--seed", 1)
    assert other.returncode == 1 and "other settings" in other.stderr
    name, *rest = shlex.split(result["command"])[1:]
    assert load_command(name).make_context(name, rest).params["boards"] == 2


def test_another_program_does_not_go_on_where_one_stopped(tiny: Path, tmp_path: Path, in_process: None) -> None:
    agent = tmp_path / "agent.py"
    agent.write_text(AGENT.read_text())
    words = ("play", tiny, "--agent", shlex.join([sys.executable, str(agent)]), "--workers", 1, "--boards", 1)
    assert busybot(*words, "--out", tmp_path / "out").returncode == 0
    agent.write_text("print('{\"know\": []}')")
    other = busybot(*words, "--out", tmp_path / "out")
    assert other.returncode == 1 and f"agent_files differ: {agent}\n" in other.stderr
    agent.unlink()
    gone = busybot(*words, "--out", tmp_path / "out")
    assert gone.returncode == 1 and f"agent_files differ: {agent}\n" in gone.stderr


LOGS = "for name in sys.argv[1:3]: open(name, 'a').write(f'{time.time()}\\n')\nprint('{\"know\": []}')\n"


@pytest.fixture
def logging_agent(tmp_path: Path) -> list[str]:
    """Writes into two files, one of which is there before; weights and a prompt it leaves alone."""
    for name, text in {"agent.py": READ + LOGS, "cache.sqlite": "old", "weights": "ab", "prompt.txt": "think"}.items():
        (tmp_path / name).write_text(text)
    return [str(tmp_path / name) for name in ("agent.py", "run.log", "cache.sqlite", "weights", "prompt.txt")]


def test_what_the_run_itself_writes_does_not_stop_it(
    tiny: Path, tmp_path: Path, logging_agent: list[str], in_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, log, cache, weights, prompt = logging_agent
    words = ("play", tiny, "--agent", shlex.join([sys.executable, *logging_agent]), "--workers", 1, "--boards", 3)

    def stopping(game: Game, *how: Any) -> PlayedBoard:
        if game.board.index == 2:
            raise BusybotError("stopped")
        return play(game, *how)

    monkeypatch.setattr("busybot.reason.evaluation.play.play", stopping)
    assert "stopped" in busybot(*words, "--out", tmp_path / "out").stderr
    monkeypatch.undo()
    assert len(Path(log).read_text().splitlines()) == 2
    once = json.loads(busybot(*words, "--out", tmp_path / "out", "--json").stdout)
    assert len(Path(log).read_text().splitlines()) == 3, "two boards were kept"
    assert once["agent_changed"] == [cache, log] and once["agent_data"].keys() == {cache, weights, prompt}
    again = json.loads(busybot(*words, "--json").stdout)
    [told] = again["hashes"]["models"].values()
    assert once["hashes"] == again["hashes"] and told.keys() == {sys.executable, logging_agent[0], weights, prompt}
    Path(prompt).write_text("think again")
    shown = busybot(*words, "--out", tmp_path / "out")
    assert f"not counted as the agent: {cache}, {prompt}, {log}" in shown.stdout.replace("\n", " ")


def test_programs_are_told_from_what_they_read_and_write(tmp_path: Path) -> None:
    for name in ("run", "agent.PY", "tool.mjs", "run.log", "weights"):
        (tmp_path / name).write_text("")
    (tmp_path / "run").chmod(0o755)
    words = [str(tmp_path / name) for name in ("run", "agent.PY", "tool.mjs", "run.log", "weights", "absent.py")]
    files = AgentFiles.of(["sh", *words, "--log", "-"])
    assert files.programs.keys() == {"sh", *words[:3]} and files.data.keys() == {*words[3:5]}
    assert AgentFiles.of([words[3], "-x"]).programs.keys() == {words[3]}, "it is what is started"


def test_a_file_that_may_not_be_read_is_told_by_its_size_and_date(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(place: Path) -> str:
        raise BusybotError(f"{place}: cannot be read: Permission denied")

    (tmp_path / "run.log").write_text("of somebody else")
    monkeypatch.setattr("busybot.reason.evaluation.play.sha256_of", refuse)
    assert str(told_of(tmp_path / "run.log")).startswith("16 bytes, changed at ")


def test_last_words_of_a_program_are_no_lines_of_ours(tiny: Path, in_process: None) -> None:
    forged = "boom\nboards ended: knows 24\nerror: all is fine\n"
    agent = shlex.join([sys.executable, "-ISc", f"import sys; sys.stderr.write({forged!r}); sys.exit(3)"])
    done = busybot("play", tiny, "--agent", agent, "--workers", 1, "--boards", 1)
    assert "board 0: died: boom\\nboards ended: knows 24\\nerror: all is fine\n" in done.stdout
    assert [line for line in done.stdout.splitlines() if line.startswith(("boards", "error"))] == [
        "boards ended: died 1"
    ]


@pytest.mark.long
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_command_leaves_no_program(tiny: Path, tmp_path: Path, how: signal.Signals) -> None:
    pids, wrapper = tmp_path / "pids", tmp_path / "wrap.sh"
    thinks = f"import os, time; open({str(pids)!r}, 'a').write(f'{{os.getpid()}}\\n'); time.sleep(600)"
    wrapper.write_text(f"#!/bin/sh\n{shlex.join([sys.executable, '-ISc', thinks])}\nexit 0\n")
    wrapper.chmod(0o755)
    words = [sys.executable, "-m", "busybot", "play", str(tiny), "--agent", str(wrapper), "--workers", "2"]
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # ignored where tests run in a script's background
    null, pipe = subprocess.DEVNULL, subprocess.PIPE
    command = subprocess.Popen(words, stdout=null, stderr=pipe, text=True, preexec_fn=heard)
    until = time.monotonic() + 100
    while time.monotonic() < until and not (pids.exists() and len(pids.read_text().split()) == 2):
        time.sleep(0.01)
    programs = [psutil.Process(int(pid)) for pid in pids.read_text().split()]
    command.send_signal(how)
    _, said = command.communicate(timeout=30)
    assert how is signal.SIGKILL or (command.returncode == 130 and "interrupted" in said)
    _, left = psutil.wait_procs(programs, timeout=10)
    for one in left:
        one.kill()
    assert len(programs) == 2 and not left


def test_a_program_that_says_nothing_at_all_is_an_error(tiny: Path) -> None:
    dies = shlex.join([sys.executable, "-c", "raise SystemExit(3)"])
    done = busybot("play", tiny, "--agent", dies, "--workers", 1, "--boards", 2)
    assert done.returncode == 1 and "exact observer" in done.stdout
    assert "error: the program gave no answer on any board" in done.stderr and "hint: " in done.stderr
    told = busybot("play", tiny, "--agent", dies, "--workers", 1, "--boards", 2, "--json")
    assert told.returncode == 1 and json.loads(told.stdout)["actions_used"] == 0
    refused = shlex.join([sys.executable, "-c", "while True: input(); print('?', flush=True)"])
    assert busybot("play", tiny, "--agent", refused, "--workers", 1, "--boards", 1).returncode == 0


def test_words_of_a_command_that_name_no_file_or_a_huge_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "weights").write_bytes(b"ab")
    assert told_of(Path("x = 1;" * 100)) is None and told_of(tmp_path) is None
    assert told_of(tmp_path / "weights") == hashlib.sha256(b"ab").hexdigest()
    monkeypatch.setattr("busybot.reason.evaluation.play.MAX_HASHED_BYTES", 1)
    assert str(told_of(tmp_path / "weights")).startswith("2 bytes, changed at ")


def test_programs_that_are_not_there_are_named(tiny: Path) -> None:
    done = busybot("play", tiny, "--agent", "no-such-program-here")
    assert done.returncode == 1 and "no-such-program-here" in done.stderr
    assert busybot("play", tiny, "--agent", "'").returncode == 2
