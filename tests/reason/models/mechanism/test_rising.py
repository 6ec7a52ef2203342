"""Which way round links are: what looks tell of it, and what that tells of explanations."""

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
import pytest
import torch

from busybot.reason.inputs.trigger_links import ObservedLinks
from busybot.reason.models.mechanism.config import MechanismNetConfig
from busybot.reason.models.mechanism.contexts import MEMORIES, Trace, explanations_of
from busybot.reason.models.mechanism.networks import BoardFacts, MechanismNet, explanation_graph
from busybot.reason.models.mechanism.rising import (
    FORM,
    SUREST,
    Rising,
    alike_of,
    explained,
    forms_of,
    lawful,
    odds_of,
    ways_of,
)
from busybot.reason.models.mechanism.training.known_links import KnownLinks
from busybot.reason.models.mechanism.training.labelled import (
    LabelledLinks,
    LabelledTrace,
    LabelledTriggers,
    true_rises,
)
from busybot.reason.models.mechanism.unseen import Touched
from busybot.reason.pyg import Batch
from tests.reason.worlds import play, relation

UP, RIGHT = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
MOST = float(np.log(SUREST / (1 - SUREST)))


def form(way: Sequence[float] = UP, width: float = 0.1) -> np.ndarray:
    return np.array([*way, np.log(width), np.log(0.2), 0.02, 0.03, 0.0, 0.01, 2], np.float32)


def trace(function: Sequence[int], moves: int = 40) -> Trace:
    """A responder that shows a function of two links, all four combinations of which come often."""
    rng = np.random.default_rng(0)
    links = np.cumsum(np.eye(2, dtype=int)[rng.integers(2, size=moves)], axis=0) % 2
    links = np.vstack([np.zeros((1, 2), int), links])
    return Trace(links, np.array(function)[links @ [1, 2]][:, None], (2, 2))


BOTH, ONE_ALONE, NEITHER, EXACTLY_ONE = (0, 0, 0, 1), (0, 1, 0, 0), (1, 0, 0, 0), (0, 1, 1, 0)


def row_of(found: object, memory: str, inputs: Sequence[bool]) -> int:
    [row] = np.flatnonzero(
        (found.inputs == list(inputs)).all(1) & (found.memory == MEMORIES.index(memory))  # type: ignore[attr-defined]
    )
    return int(row)


def test_a_link_is_as_others_of_its_form_were() -> None:
    known, rises = torch.from_numpy(np.stack([form()] * 5)), torch.tensor([1.0, 1, 1, 1, 0])
    asked = torch.from_numpy(np.stack([form(), form(tuple(-np.array(UP))), form(RIGHT), form(width=0.3)]))
    same, back, other, larger = odds_of(asked, known, rises).tolist()
    assert 1 < same <= MOST + 1e-6 and back == pytest.approx(-same)
    assert abs(other) < 0.1 and abs(larger) < 0.1
    many = odds_of(asked[:1], known.repeat(100, 1), rises.repeat(100))
    assert float(many) == pytest.approx(MOST), "no more than so sure"
    unseen = asked.clone()
    unseen[:, 5] = torch.nan
    assert odds_of(unseen, known, rises).tolist() == [0] * 4


def test_links_are_remembered_with_the_weights() -> None:
    rising, again = Rising(), Rising()
    assert rising(torch.from_numpy(form()[None])).tolist() == [0], "nothing is known yet"
    rising.learn(np.stack([form(), form(RIGHT)]), np.array([1, -1]))
    again.load_state_dict(rising.state_dict())
    told = again(torch.from_numpy(np.stack([form(), form(RIGHT)])))
    assert told[0] > 0.5 > -0.5 > told[1]


@pytest.mark.parametrize(("function", "alike"), [(BOTH, 1), (NEITHER, 1), (ONE_ALONE, -1), (EXACTLY_ONE, 0)])
@pytest.mark.parametrize("memory", ["late 0", "own and now"])
def test_the_combination_that_differs_tells_how_a_gate_reads_its_links(
    function: Sequence[int], alike: int, memory: str
) -> None:
    seen = trace(function)
    found = explanations_of(seen)
    odds = alike_of(seen, found, [0, 40])[0]
    row = row_of(found, memory, (True, True, False))
    assert odds[row, 0] == pytest.approx(0, abs=1e-5), "a new board tells nothing"
    if alike:
        assert float(odds[row, 1]) * alike > 5
    else:
        assert abs(float(odds[row, 1])) < 1e-3
    alone = [row_of(found, "late 0", one) for one in ((True, False, False), (False, True, False))]
    assert odds[alone].abs().max() == 0 and odds[row_of(found, "odd presses up", (True, False, False))].abs().max() == 0


def test_explanations_are_as_probable_as_the_way_round_that_they_need() -> None:
    seen = trace(BOTH)
    found = explanations_of(seen)
    ways = ways_of(2, 1)
    assert ways.shape == found.reads[0].shape
    of_last = row_of(found, "last press up, down", (True, True, False))
    assert ways[found.reads[0] == of_last].tolist() == [1, -1]
    source, read = (torch.from_numpy(one) for one in found.reads)
    alike = alike_of(seen, found, [40])[0]

    def told(*odds: float) -> torch.Tensor:
        rising = torch.tensor([*odds, 0.0])
        return explained(rising, read, source, torch.from_numpy(ways), alike)[:, 0]

    assert told(0, 0).abs().max() < 1e-5, "who knows nothing is told nothing"
    gate, pressed, late = (
        row_of(found, memory, inputs)
        for memory, inputs in (
            ("late 0", (True, True, False)), ("since press up", (True, False, False)), ("late 1", (True, False, False)),
        )
    )  # fmt: skip
    same, opposite = told(2, 2), told(2, -2)
    assert same[gate] > 0.3 and opposite[gate] < -0.5 and same[late] == 0
    assert float(same[pressed]) == pytest.approx(np.log(2 / (1 + np.exp(-2)))) and told(-2, 0)[pressed] < -1
    expected = 2 * np.log(2) - np.log1p(np.exp(-2)) - np.log1p(np.exp(-2))
    assert float(opposite[of_last]) == pytest.approx(expected)


def test_a_board_is_heard_as_far_as_its_other_responders_follow_the_law() -> None:
    """Two boards, of three responders and of one; two explanations each, between which what was counted decides."""
    owner, of = torch.arange(8) // 2, torch.tensor([0, 0, 0, 1])
    ratio = torch.tensor([1.8, 0.2] * 4).log()[:, None]

    def heard(*sure: float) -> torch.Tensor:
        shares = torch.tensor([one for first in sure for one in (first, 1 - first)])[:, None]
        return lawful(ratio, shares, owner, of, 2).exp()[:, 0]

    half = 0.5 * ratio.exp()[:2, 0] + 0.5
    assert torch.allclose(heard(0.5, 1, 0, 0)[6:], half), "alone, nobody knows whether it does"
    follow, against = heard(0.5, 1, 1, 1)[:2], heard(0.5, 0, 0, 1)[:2]
    assert follow[0] > half[0] > against[0] > 1 and follow[1] < half[1] < against[1] < 1
    odds = 1.8 * 0.2
    assert float(heard(0.5, 1, 0, 1)[0]) == pytest.approx((1.8 * odds + 1) / (odds + 1))


def test_a_network_hears_which_way_round_links_are_if_it_is_to() -> None:
    def shares(rising: bool, odds: Sequence[float]) -> torch.Tensor:
        torch.manual_seed(0)
        net = MechanismNet(MechanismNetConfig(rising=rising))
        graph = explanation_graph(trace(BOTH), [5, 20], BoardFacts(rising=np.array(odds)))
        return net(Batch.from_data_list([graph, graph]))[0].detach()

    assert torch.equal(shares(False, (2, 2)), shares(False, (2, -2)))
    assert not torch.allclose(shares(True, (2, 2)), shares(True, (2, -2)))


def test_forms_are_told_of_links_that_were_seen() -> None:
    ways = np.zeros((3, 3, 3))
    ways[0, 1], ways[1, 0] = RIGHT, -np.array(RIGHT)
    outlines = np.array([[0.1, 0.2, 0.02, 0.03, 0.0, 0.01]])
    states = np.array([[0], [1], [0]])
    links = ObservedLinks(np.zeros(2, int), states, np.zeros(1, int), np.zeros((1, 2)), (ways,), outlines=outlines)
    np.testing.assert_allclose(forms_of(links), form(RIGHT)[None], rtol=1e-6)
    unknown = ObservedLinks(np.zeros(2, int), states, np.zeros(1, int), np.zeros((1, 2)), (np.zeros((3, 3, 3)),))
    assert forms_of(unknown).shape == (1, FORM) and np.isnan(forms_of(unknown)[0, :-1]).all()


def board(rises: Sequence[int], forms: Sequence[np.ndarray] = (), objects: Sequence[str] = ()) -> LabelledTrace:
    told = LabelledLinks(np.array(rises), np.array(forms, np.float32).reshape(-1, FORM), tuple(objects))
    return LabelledTrace(trace(BOTH), "gates", links=told)


def test_a_board_is_told_by_others_and_as_a_new_one_by_other_objects() -> None:
    boards = [board([1, -1], [form(), form(RIGHT)], ["a", "b"]), board([1, -1], [form(), form(RIGHT)], ["a", "c"])]
    known = KnownLinks.of(boards, np.random.default_rng(0))
    heard = [known.heard(boards[0], np.random.default_rng(seed)).rising for seed in range(20)]
    as_known, as_new = max(heard, key=itemgetter(0)), min(heard, key=itemgetter(0))
    assert as_known[0] > 0.5 and as_known[1] < -0.5
    assert abs(as_new[0]) < 0.1 and as_new[1] < -0.5, "nobody else has an object a; b looks like c"
    assert {tuple(one) for one in heard} == {tuple(one) for one in (as_known, as_new)}


def test_parts_of_a_recording_are_told_by_others_too() -> None:
    """Who learns from a part of what pictures show of a board may not be told by the whole of it."""
    one = board([1], [form()], ["a"])
    forms = np.stack([form()])
    touched = Touched(one.trace, np.zeros(1, int), np.zeros(40, int), np.zeros(1, int), forms)
    one = replace(one, triggers=(LabelledTriggers(touched, np.ones((1, 1), bool)),))
    alone = KnownLinks.of([one], np.random.default_rng(0)).heard(one, np.random.default_rng(0))
    assert alone.triggers[0].rising.tolist() == [0] == alone.rising.tolist()
    boards = [one, board([1], [form()], ["b"])]
    told = KnownLinks.of(boards, np.random.default_rng(0)).heard(one, np.random.default_rng(0))
    assert told.triggers[0].rising[0] == told.rising[0] > 0.5


def test_what_is_only_drawn_hears_what_recorded_links_are_told() -> None:
    boards = [board([1, -1], [form(), form(RIGHT)], ["a", "b"]) for _ in range(3)]
    known = KnownLinks.of(boards, np.random.default_rng(0))
    odds = np.array([known.heard(board([1, -1, 0]), np.random.default_rng(seed)).rising for seed in range(50)])
    assert odds[:, 0].mean() > 0.3 and odds[:, 1].mean() < -0.3
    assert odds[:, 2].max() > 0.5 and odds[:, 2].min() < -0.5, "what is no link sounds like one, either way round"
    nothing = KnownLinks.of([board([1])], np.random.default_rng(0))
    assert nothing.heard(board([1, 1]), np.random.default_rng(0)).rising.tolist() == [0, 0] and nothing.forms.shape == (
        0,
        FORM,
    )
    untold = LabelledTrace(trace(BOTH), "gates")
    assert known.heard(untold, np.random.default_rng(0)) is untold


def test_labels_say_which_way_round_states_are_numbered() -> None:
    presses = [0, 0, 3, 0, 3, 3, 0]
    episode = play([relation("gate", (0, 3), 1, [0, 1, 1, 0], function="xor")], presses)
    held = [(0, "link_0"), (3, "link_0"), (1, "link_0")]
    true = np.array([(0, 0), *(step.trigger_states_after for step in episode.steps)])
    said = Trace(np.column_stack([true[:, 0], 1 - true[:, 1], true[:, 0]]), np.zeros((8, 1), int), (2, 2, 2))
    assert true_rises(episode, said, held).tolist() == [1, -1, 0], "the third was never moved"
