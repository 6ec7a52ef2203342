"""Questions "what if" as a file: answers are what the board's law says, and given ones are judged pair by pair."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.boards.dynamics import Dynamics
from busybot.boards.true_causes import VariableNames
from busybot.boards.worlds import links_of
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import read_result
from busybot.reason.evaluation import questions
from tests.cli.commands import busybot
from tests.episodes.folders import make_dataset
from tests.episodes.symbolic import library_at, make_world_dataset

Objects = Callable[[int], Path]


@pytest.fixture
def asked(tmp_path: Path, few_objects: Objects) -> tuple[Path, Path, list[dict[str, Any]]]:
    """A dataset of `gates`, the folder of its objects, and the questions about it."""
    folder = few_objects(0)
    make_world_dataset(tmp_path / "data", folder, "gates")
    done = busybot("eval", "what-if", tmp_path / "data", "--questions", tmp_path / "q.jsonl", "--assets", folder)
    assert done.returncode == 0, done.stderr
    return tmp_path / "data", folder, [json.loads(line) for line in (tmp_path / "q.jsonl").read_text().splitlines()]


def judged(data: Path, folder: Path, answers: list[dict[str, Any]], *more: object) -> Any:
    file = data.parent / "given.jsonl"
    file.write_text("".join(json.dumps(one) + "\n" for one in answers))
    return busybot("eval", "what-if", data, "--answers", file, "--assets", folder, *more)


def test_answers_are_what_the_law_makes_of_the_recorded_actions(asked: tuple[Path, Path, list[dict[str, Any]]]) -> None:
    data, folder, pairs = asked
    library, dataset = library_at(folder), Dataset.open(data)
    assert {one["board"] for one in pairs} == {0, 1, 2}
    for one in pairs:
        board = dataset.board(one["board"])
        episode, names = read_episode(dataset.episode_path(one["board"]), "lazy"), VariableNames(board)
        links = links_of([library.get(placed.key) for placed in board.objects])
        link = [names.link(*name) for name in links.names].index(one["link"])
        until = one["step"] + one["actions"]
        moves = np.array(
            [episode.steps[0].trigger_states_before, *(step.trigger_states_after for step in episode.steps)]
        )
        without = moves[: until + 1].copy()
        assert moves[one["step"], link] != moves[one["step"] + 1, link], "that action moved that link"
        without[one["step"] + 1 :, link] = moves[one["step"], link]
        assert (moves[one["step"] + 1 : until + 1, link] == moves[one["step"] + 1, link]).all(), "nothing else moved it"
        for way, path in (("happened", moves[: until + 1]), ("otherwise", without)):
            shown = [state.shown for state in Dynamics(board, links).run(path.tolist())][one["step"] + 1 :]
            for index in range(len(board.objects)):
                if told := one["answers"].get(names.body(index)):
                    assert told[way] == [states[index] for states in shown]
        both = [[told[way] for told in one["answers"].values()] for way in ("happened", "otherwise")]
        assert both[0] != both[1], "what makes no difference is not asked"


def test_a_pair_is_right_if_all_of_it_is(asked: tuple[Path, Path, list[dict[str, Any]]], tmp_path: Path) -> None:
    data, folder, pairs = asked
    done = judged(data, folder, pairs, "--out", tmp_path / "r.json", "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["what_if"] == 1.0
    told = read_result(tmp_path / "r.json", "what-if")
    assert told["right"] == told["pairs"] == len(pairs) and told["boards"] == 3 and told["logged"] is None
    assert told["seed"] == 0
    assert 0 < told["intervals"]["what_if"][0] < told["intervals"]["what_if"][1] == 1.0
    name = next(iter(pairs[1]["answers"]))
    pairs[1]["answers"][name]["otherwise"][-1] ^= 1
    done = judged(data, folder, pairs, "--json")
    assert json.loads(done.stdout)["right"] == len(pairs) - 1
    told = f"{len(pairs) - 1} of {len(pairs)} pairs answered rightly"
    assert told in judged(data, folder, pairs, "--workers", "2").stdout


def test_what_is_no_answer_is_named(asked: tuple[Path, Path, list[dict[str, Any]]], tmp_path: Path) -> None:
    data, folder, pairs = asked
    last, name = pairs[-1], next(iter(pairs[-1]["answers"]))
    place = f"given.jsonl: board {last['board']}, question {last['question']}"

    def refused(answers: list[dict[str, Any]]) -> str:
        done = judged(data, folder, answers)
        assert done.returncode == 1 and done.stdout == ""
        return done.stderr

    assert f"{place}: there is no answer" in refused(pairs[:-1])
    others = {key: one for key, one in last["answers"].items() if key != name}
    assert f"{place}: there is no answer for {name}" in refused([*pairs[:-1], {**last, "answers": others}])
    short = {**last["answers"], name: {"happened": [], "otherwise": last["answers"][name]["otherwise"]}}
    told = refused([*pairs[:-1], {**last, "answers": short}])
    assert f"{name}: happened has 0 states for {last['actions']} action" in told
    assert "line 2: a second answer to question 0 of board 0" in refused([pairs[0], pairs[0]])
    assert "line 1: board: Input should be" in refused([{**last, "board": "x"}])
    told = refused([*pairs[:-1], {**last, "step": last["step"] + 1}])
    assert f"{place}: it is about {last['link']} after step {last['step'] + 1}" in told
    told = refused([*pairs[:-1], {**last, "link": "switch\nerror: nothing"}])
    assert f"{place}: it is about switch\\nerror: nothing after step" in told, "no line of ours"
    assert "board 9, question 0: nobody asked that" in refused([*pairs, {**last, "board": 9, "question": 0}])
    for line in ("{nope", '{"board": NaN}', "[" * 100_000, f'{{"board": {"9" * 5000}}}'):
        (tmp_path / "bad.jsonl").write_text(line)
        done = busybot("eval", "what-if", data, "--answers", tmp_path / "bad.jsonl", "--assets", folder)
        assert done.returncode == 1 and "bad.jsonl: line 1: not valid JSON" in done.stderr
    more = last["answers"] | {"nobody_9": last["answers"][name]}
    assert judged(data, folder, [*pairs[:-1], {**last, "answers": more}]).returncode == 0, "nobody asked, nobody minds"
    done = busybot("eval", "what-if", data, "--assets", folder)
    assert done.returncode == 2 and "give --questions FILE or --answers FILE" in done.stderr
    done = busybot("eval", "what-if", data, "--questions", tmp_path / "q.jsonl", "--out", tmp_path / "r.json")
    assert done.returncode == 2 and "--out is about answers" in done.stderr and not (tmp_path / "r.json").exists()


def test_a_dataset_that_nothing_can_be_asked_about_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_dataset(tmp_path / "data", boards=1, finished=[0])
    monkeypatch.setattr(questions, "questions_of", lambda *_: [])
    done = busybot("eval", "what-if", tmp_path / "data", "--questions", tmp_path / "q.jsonl")
    assert done.returncode == 1 and "nothing to ask" in done.stderr and not (tmp_path / "q.jsonl").exists()
