"""The study of which action next: what it counts, and that a small one works."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies import curiosity
from benchmarks.studies.bounds import Drawn
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.common.errors import UsageError
from busybot.evaluation.results import read_result, stamp, write_result
from busybot.objects.resolve import find
from busybot.plan.curious import REASONER


def test_when_relations_are_known_is_the_first_action_after_which_f1_is_high_enough() -> None:
    """Two boards, three actions: F1 of both together is .5, then .95, then 1."""
    counts = np.array([[[5, 10, 10], [9, 10, 10], [10, 10, 10]], [[5, 10, 10], [10, 10, 10], [10, 10, 10]]])
    told = curiosity.figures(counts, "gates")
    assert told["f1"] == pytest.approx([0.5, 0.95, 1.0]) and told["until"] == 2
    never = curiosity.figures(counts[:, :1], "gates")
    assert never["until"] == 2, "one more than there were"


def test_trainings_of_one_name_are_refused_and_rows_of_other_weights_kept(tmp_path: Path) -> None:
    words = ["--parts", "stopping", "--only", "gates", "--boards", "1", "--out", str(tmp_path / "c.json")]
    for seeds in (["a/model", "b/model"], [REASONER]):
        with pytest.raises(UsageError, match="two trainings have one name"):
            curiosity.main([*words, "--seeds", *seeds])
    before = {"models": {REASONER: {"weights.safetensors": "0" * 64}}}
    write_result(tmp_path / "c.json", stamp("curiosity", hashes=before) | {"rows": {"gates": {"stopping": {}}}})
    with pytest.raises(UsageError, match=f"c.json: it has rows about another {REASONER}"):
        curiosity.main(words)


@pytest.mark.long
def test_a_small_study(tmp_path: Path) -> None:
    library, other = find("procedural"), "benchmarks/models/mechanism-1"
    every = curiosity.drawn("gates", 1, (*curiosity.CHOICES, "greedy"), library, 3, (REASONER, other))
    found = every[REASONER]
    for told in every.values():
        assert {len(one["f1"]) for one in told.values()} == {curiosity.ACTIONS}
        assert told["greedy"]["regret"] == 0 and told["curious"]["f1"][-1] > 0.8
    again = curiosity.drawn("gates", 1, ("curious", "greedy"), library, 3, (other,))[other]
    for choice in ("curious", "greedy"):  # what the observer chose for the other one it would have chosen for this one
        assert again[choice]["f1"] == every[other][choice]["f1"]
    curiosity.curves(tmp_path / "curves.png", {"rows": {"gates": {"drawn": found}}})
    assert (tmp_path / "curves.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.long
def test_other_seeds_stand_beside_what_is_there(tmp_path: Path) -> None:
    """What was played is kept; a training that was not asked yet is asked alone."""
    out = tmp_path / "curiosity.json"
    words = ["--parts", "stopping", "--only", "gates", "--boards", "1", "--out", str(out)]
    curiosity.main(words)
    first = read_result(out, "curiosity")["rows"]
    curiosity.main([*words, "--seeds", "benchmarks/models/mechanism-1"])
    told = read_result(out, "curiosity")["rows"]["gates"]
    assert told["stopping"] == first["gates"]["stopping"] and list(told["seeds"]) == ["mechanism-1"]
    assert told["seeds"]["mechanism-1"]["stopping"]["curious"]["boards"] == 1
    with pytest.raises(UsageError, match="a model event"):
        curiosity.main([*words, "--seeds", "event"])


def test_on_a_drawn_board_what_is_held_is_known_and_worth_little_until_it_is_let_go() -> None:
    library = find("procedural")
    [spec] = generate_boards(BoardConfig(world="lock", boards=1, seed=5, group_size=1, depth=(3, 4)), library)
    board = Drawn(spec, library)
    player = curiosity.Player(board, curiosity._reasoner(REASONER), "curious", np.random.default_rng(0))
    for _ in board.triggers:
        player.act()
    moved = {link for link, tries in enumerate(player._tries) if any(success for _, success, _ in tries)}
    still = {one.trigger for one in player._held.places if not one.moved}
    assert still == set(range(len(board.triggers))) - moved and still
    for place in player._held.places:
        assert set(place.actions) <= {step for step, success, _ in player._tries[place.trigger] if not success}
    closed, known = sorted(still)[0], sorted(moved)[0]
    moves = [board.moves(closed)[0], board.moves(known)[0], board.triggers]
    told = player._worth([closed, known, None], moves)
    assert told.shape == (3,) and (told >= 0).all()
    place = player._place(closed)
    assert place is not None and player._place(known) is None
    place.waited, place.empty = 1.0, 1e-9
    surely = player._worth([closed], moves[:1])
    place.waited, place.empty = 1e-9, 1.0
    assert surely[0] < player._worth([closed], moves[:1])[0], "who thinks that nothing holds it tries it"
