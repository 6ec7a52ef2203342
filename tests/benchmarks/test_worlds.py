"""The table of worlds and its shortcuts: what rows see, what they claim, and that a whole run of a small one works."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.speed import world_row
from benchmarks.studies import mechanism_ablations, perception_costs, shortcuts
from benchmarks.studies.bounds import Symbolic, play
from benchmarks.studies.shortcuts import compared
from benchmarks.tables import worlds
from benchmarks.tables.world_rows import ACTIONS, DiscoveryConfig, Samples, detected, granger, pc
from benchmarks.tables.worlds import LEARNED, Recorded, _is_there
from busybot.boards.dynamics import Triggers
from busybot.common.errors import UsageError
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.evaluation.results import read_result
from busybot.reason.evaluation.ground_truth import trace_of
from busybot.training.model_cards import file_hashes, find_folder

ABSENT = "causal-learn is not installed: `make extras`"


def samples(follows: bool = False) -> Samples:
    """Two links that move by chance, a responder that follows the first, and one that follows the second one action
    late; or, where responders may be causes, the first responder."""
    links = generator(0, "test", 1, "links").integers(0, 2, (201, 2))
    late = links[:, 0 if follows else 1]
    return Samples(links, np.stack([links[:, 0], np.concatenate([[0], late[:-1]])], axis=1), follows)


def test_causes_come_before_their_effects() -> None:
    one = samples(follows=True)
    causes = one.causes(lags=1)
    assert causes.shape == (200, 2 * 2 + 2)
    assert np.array_equal(causes[:, :2], one.links[1:]) and np.array_equal(causes[:, 2:4], one.links[:-1])
    assert np.array_equal(causes[:, 4:], one.shown[:-1])
    assert samples().causes(lags=0).shape == (200, 2)


@pytest.mark.long
@pytest.mark.parametrize("name", ["pc", "granger"])
def test_discovery_finds_what_follows(name: str) -> None:
    pytest.importorskip("causallearn", reason=ABSENT, exc_type=ImportError)
    config = DiscoveryConfig(states=True, lags=1, level=0.01, condition=0)
    found = pc(samples(), config) if name == "pc" else granger(samples(), config) > 0.3
    assert found.tolist() == [[True, False], [False, True], [False, False], [False, False]]
    now = config.model_copy(update={"lags": 0})
    late = pc(samples(follows=True), now) if name == "pc" else granger(samples(follows=True), now) > 0.3
    assert late[2, 1] and not late[3, 0], "a responder may be a cause where the world says so"


def test_all_links_come_in_turn() -> None:
    board, moved = Symbolic.draw(4, generator(0, "test", 0, "draw")), []
    act = board.act

    def watched(triggers: Triggers) -> None:
        moved.extend(np.flatnonzero(np.array(triggers) != np.array(board.triggers)).tolist())
        act(triggers)

    board.act = watched  # type: ignore[method-assign]
    play(board, "coverage", (8,), np.random.default_rng(1))
    assert moved[:4] == moved[4:] and sorted(moved[:4]) == [0, 1, 2, 3]


def test_a_state_that_is_seen_as_another_one_is_wrong_in_the_frames_of_the_fewer() -> None:
    seen, true = np.array([0, 0, 0, 1, 1, 2]), np.array([5, 5, 7, 7, 7, 5])
    assert perception_costs.wrong(seen, true) == 1 and perception_costs.wrong(true, true) == 0
    assert perception_costs.wrong(np.zeros(4, int), np.array([0, 1, 1, 1])) == 1, "one that never seems to change"


def test_pairs_are_compared_within_their_group() -> None:
    score, true = np.array([0.9, 0.1, 0.5, 0.5, 0.2, 0.8]), np.array([1, 0, 1, 0, 1, 0], bool)
    assert compared(score, true, np.array([0, 0, 1, 1, 2, 2])) == (1.5, 3)
    assert compared(score, true, np.zeros(6, int)) == (5.5, 9)


def test_rows_are_compared_with_the_network_on_the_boards_that_both_have() -> None:
    def row(right: int, boards: int) -> dict[str, Any]:
        return {"boards": boards, "by_board": {"object": {"part": [right] * boards, "whole": [8] * boards}}}

    told = {"rows": {"tuned": {}, "count": row(4, 10)}, LEARNED: {"mechanism": row(8, 6)}}
    found = worlds.compared(told, "gates", 0)
    assert found.keys() == {"count"} and found["count"]["object"]["boards"] == 6
    assert found["count"]["object"]["difference"] == -0.5 and found["count"]["object"]["p"] == 2 / 2**6
    del told[LEARNED]
    assert worlds.compared(told, "gates", 0) == {}


@pytest.mark.long
def test_a_small_table(tmp_path: Path) -> None:
    """Two boards of one world: recorded, judged and examined for shortcuts."""
    data, out = tmp_path / "data", tmp_path / "worlds.json"
    worlds.record(["--data", str(data), "--only", "gates", "--most", "2"])
    words = ["--data", str(data), "--only", "gates", "--parts", "rows,exploring", "--greedy", "1", "--out", str(out)]
    worlds.main([*words, "--assets", "procedural"])
    told = read_result(out, "worlds")["rows"]["gates"]
    rows = told["rows"]
    assert list(rows["observer"]["object"]) == [str(number) for number in ACTIONS]
    assert rows["observer"]["object"]["30"]["f1"] > rows["persistence"]["object"]["30"]["f1"] == 0
    assert rows["persistence"]["mechanism_accuracy"] == 0 and rows["observer"]["link"]["30"]["p"] > 0.5
    assert rows["observer-detected"]["detected"]["responders"] > 0.95
    assert rows["observer"]["lag_accuracy"] == 1 and rows["count"]["lag_accuracy"] is None
    parents = rows["observer"]["by_board"]["object"]
    assert sum(parents["part"]) / sum(parents["whole"]) == pytest.approx(rows["observer"]["object"]["22"]["f1"])
    assert {name: one["boards"] for name, one in told["exploring"].items()} == {"random": 2, "coverage": 2, "greedy": 1}
    recorded = Recorded.at(data / "gates" / "validation", "procedural")
    for seen in recorded.boards():
        trace = trace_of(seen.episode)
        assert trace is not None
        links, _ = detected(seen, seen.clusters)
        assert np.equal(links, trace[0]).mean() > 0.7, "but for what no pixel shows"
    told = shortcuts.actions(seen.sequence)
    assert told[..., 0].max() <= 30 and not told[~seen.sequence.triggers].any()
    out, place = tmp_path / "costs.json", data / "gates" / "validation"
    perception_costs.main(["--data", f"clean={place}", "--assets", "procedural", "--out", str(out)])
    cost = read_result(out, "perception-costs")["rows"]["clean"]
    assert cost["boards"] == 2 and list(cost["ways"]) == ["seen", "links", "responders", "both"]
    assert cost["mistakes"]["responder states wrong"] == 0 < cost["mistakes"]["links moved"]
    assert cost["ways"]["responders"] == cost["ways"]["seen"], "what is seen rightly costs nothing"
    assert cost["ways"]["links"]["30"]["share"] >= cost["ways"]["seen"]["30"]["share"] > 0.5
    out = tmp_path / "ablations.json"
    words = ["--data", str(data), "--worlds", "gates", "--work", str(tmp_path / "work"), "--iterations", "4"]
    rows = ["labels", "labels no past", "pictures nothing hidden", "labels links not seen"]
    mechanism_ablations.main([*words, "--only", ",".join(rows[1:]), "--out", str(out)])
    made = read_result(out, "mechanism-ablations")
    assert made["judged"] == {"gates": 2} and {row["boards"] for row in made["rows"].values()} == {4}
    assert list(made["rows"]) == rows, "that which they are compared with is among them"
    assert made["hashes"]["data"]["gates/validation"] == recorded.dataset.hashes().content
    models = [row["model"] for row in made["rows"].values()]
    assert len(models[0]) == 64 and len(set(models[:3])) == 3, "what is trained on other things has other weights"
    assert models[3] == models[0], "on these boards every action that moves a link flips it: nothing is lost unseen"
    told = [row["worlds"]["all"]["30"] for row in made["rows"].values()]
    assert told[0]["ahead"] == 0 and all(0 <= one["share"] <= 1 for one in told)
    assert all(one["ahead"] == pytest.approx(one["share"] - told[0]["share"]) for one in told)


@pytest.mark.parametrize(
    ("name", "there", "missing"),
    [("explored", [], "policy"), ("chosen", [], "policy"), ("chosen", ["--policy", "some"], "reasoner")],
)
def test_who_asks_for_boards_that_a_training_acted_on_says_which(
    tmp_path: Path, name: str, there: list[str], missing: str
) -> None:
    with pytest.raises(SystemExit, match=f"{name}: nobody is there to act.*--{missing}"):
        worlds.record(["--data", str(tmp_path), "--sets", f"training,{name}", *there])
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_what_a_model_chose_is_recorded(tmp_path: Path) -> None:
    """By its training and that of the policy, and told in the recording."""
    words = ["--data", str(tmp_path), "--only", "gates", "--sets", "chosen", "--most", "1"]
    worlds.record([*words, "--policy", "benchmarks/models/lean-free-0", "--reasoner", "benchmarks/models/mechanism-1"])
    collect = Dataset.open(tmp_path / "gates" / "chosen").info.collect
    assert collect is not None and collect.policy == "curious" and collect.seed == worlds.RECORDED["chosen"][1]


def test_a_model_of_other_weights_is_judged_beside_one_that_was() -> None:
    shipped = Path("mechanism")
    told: dict[str, Any] = {"rows": {}, LEARNED: {"mechanism": {"model": {"weights.safetensors": "0"}}}}
    assert _is_there("rows", told, None) and not _is_there("discovery", told, None)
    assert not _is_there(LEARNED, told, shipped)
    told[LEARNED]["mechanism"] = {"model": file_hashes(find_folder(shipped, "reason"))}
    assert _is_there(LEARNED, told, shipped)


def test_what_is_learned_is_about_a_model(tmp_path: Path) -> None:
    words = ["--data", str(tmp_path), "--out", str(tmp_path / "worlds.json"), "--parts", LEARNED]
    with pytest.raises(UsageError, match="the part learned is about a trained model(.|\n)*--model"):
        worlds.main(words)


@pytest.mark.long
def test_what_a_row_costs(tmp_path: Path) -> None:
    """From nothing to a row, once: what is done is not run again, and keeps what it cost."""
    out, work = tmp_path / "row.json", tmp_path / "work"
    words = ["--assets", "procedural", "--work", str(work), "--only", "gates", "--boards", "2", "--out", str(out)]
    words += ["--iterations", "2", "--drawn", "1", "--policy", "procedural"]
    words += ["--reasoner", "benchmarks/models/mechanism-first"]
    world_row.main(words)
    made = read_result(out, "world-row")
    assert list(made["rows"]) == ["record", "train", "judge"]
    assert all(0 < told["cpu_minutes"] < 5 and told["megabytes"] > 50 for told in made["rows"].values())
    assert read_result(work / "row.json", "worlds")["rows"]["gates"]["learned"]["mechanism"]["boards"] == 2
    world_row.main(words)
    assert read_result(out, "world-row")["rows"] == made["rows"]
