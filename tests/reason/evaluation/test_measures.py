"""What is measured in every world, against values computed by hand on boards of two switches and three responders."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from busybot.boards.mechanisms.base import Chance, Inputs, Memory
from busybot.boards.mechanisms.chance import Unreliable
from busybot.boards.spec import Relation, Rewiring
from busybot.episodes.episode import Episode
from busybot.evaluation.statistics import LEAST_PAIRS
from busybot.reason.evaluation import causes
from busybot.reason.evaluation.causes import (
    JudgedCauses,
    Watched,
    candidates_of,
    count_links,
    judge_causes,
    matched_links,
    parents_at,
)
from busybot.reason.evaluation.causes_summary import KEYS, hamming, summarise_causes
from busybot.reason.evaluation.ground_truth import states_of
from busybot.reason.evaluation.what_if import HORIZON, TOUR, Recalled, contacts_of
from busybot.reason.models.base import Imagining, InferredGraph, InferredLinks, Reasoner, imagine
from busybot.reason.models.lookup import Persistence
from tests.reason.worlds import LINKS, Knower, judge_of, play, relation, sequence_of

AND = relation("gate", (0, 3), 1, (0, 0, 0, 1), function="and")
OR = relation("gate", (0, 3), 1, (0, 1, 1, 1), function="or")
FOLLOWS = relation("one-to-one", (3,), 2, (0, 1))
LATE = relation("delay", (3,), 2, (0, 1), actions=2)
PRESSES = (0, 3, 0, 3, 3, 0, 0, 3) * 3
"""All combinations of two switches come up."""


def claims(*pairs: tuple[int, int], steps: int = len(PRESSES), p: float = 1.0) -> InferredGraph:
    probabilities = np.zeros((steps, 5, 5))
    for pair in pairs:
        probabilities[(slice(None), *pair)] = p
    return InferredGraph("claimed", probabilities)


def watched(episode: Episode, images: int = 17) -> Watched:
    sequence = sequence_of(episode)
    everyone = np.array([False, True, True, False, True])
    return Watched(episode, sequence.actions, sequence.acted, everyone, images, None, sequence, judge_of(sequence))


@pytest.fixture(autouse=True)
def _known_links(monkeypatch: pytest.MonkeyPatch) -> None:
    """The synthetic board's objects are in no library: its links have two states, its responders may have two."""
    monkeypatch.setattr(causes, "law_of", lambda episode, library: causes.Law(LINKS, ((True, False),) * 3))


# parents


def test_responders_are_candidates_where_one_may_follow_another() -> None:
    paper = {(0, 1), (0, 2), (0, 4), (3, 1), (3, 2), (3, 4)}
    among = {(1, 2), (2, 1), (1, 4), (4, 1), (2, 4), (4, 2)}
    for world, expected in (("gates", paper), ("chain", paper | among), ("mixed", paper | among)):
        board = play([AND], PRESSES, world).board
        assert {(int(i), int(j)) for i, j in np.argwhere(candidates_of(board))} == expected
    follows = play([AND, relation("one-to-one", (1,), 2, (0, 1))], PRESSES).board
    assert candidates_of(follows)[1, 2], "whatever its world is called"


def test_parents_change_with_a_rewiring() -> None:
    board = play(
        [AND, FOLLOWS], PRESSES, rewirings=(Rewiring(step=5, relation=relation("one-to-one", (0,), 2, (1, 0))),)
    ).board
    assert parents_at(board, 4)[3, 2] and not parents_at(board, 4)[0, 2]
    assert parents_at(board, 5)[0, 2] and not parents_at(board, 5)[3, 2]
    judged = judge_causes(watched(replace(play([AND, FOLLOWS], PRESSES), board=board)), claims((0, 2)))
    assert judged.true[5][3, 2] and judged.true[6][0, 2], "the sixth action shows it first"


def test_distance_counts_what_is_turned_round_once() -> None:
    true, claimed = np.zeros((2, 4, 4), bool)
    true[0, 1], true[1, 2], true[2, 3] = True, True, True
    claimed[0, 1], claimed[2, 1], claimed[0, 3] = True, True, True
    assert hamming(claimed, true) == 3, "one turned round, one missing, one too much"
    assert hamming(true, true) == 0


def summary(*judged: tuple[Episode, JudgedCauses], pred_a: float | None = None, images: int = 17) -> dict:
    return summarise_causes([(episode.board, one) for episode, one in judged], images, pred_a, 0)


def test_parents_of_two_boards_are_pooled() -> None:
    """Three true parents on each: two claimed rightly and one wrongly on the first, none on the second."""
    first, second = play([AND, FOLLOWS], PRESSES), play([AND, FOLLOWS], PRESSES)
    told = summary(
        (first, judge_causes(watched(first), claims((0, 1), (3, 1), (0, 4)))),
        (second, judge_causes(watched(second), claims())),
    )
    assert (told["parent_p"], told["parent_r"]) == (pytest.approx(2 / 3), pytest.approx(2 / 6))
    assert told["parent_f1"] == pytest.approx(2 * 2 / (3 + 6)) and told["shd"] == (2 + 3) / 2
    assert [one["shd"] for one in told["cause_boards"]] == [2, 3]
    assert told["by_board"] == {"parent_f1": {"part": [4, 0], "whole": [6, 3]}}, "of what is told"
    assert told["parent_f1_bound"] == 1.0 and told["shd_bound"] == 0 and told["bound_boards"] == 2
    assert told["link_parent_f1"] is told["mechanism_accuracy"] is told["what_if"] is told["gap"] is None
    assert told["link_parent_f1_bound"] == told["mechanism_bound"] == 1.0
    assert told["cause_intervals"]["boards"]["parent_r"] == (0.0, pytest.approx(2 / 3))
    names = {name for line in KEYS for name in line.split(", ")}
    assert names == set(told), "every figure is explained"


def test_who_cannot_claim_that_responders_follow_misses_it() -> None:
    episode = play([relation("one-to-one", (0,), 1, (0, 1)), relation("one-to-one", (1,), 2, (0, 1))], PRESSES, "chain")
    blind, seeing = claims((0, 1)), claims((0, 1), (1, 2))
    assert summary((episode, judge_causes(watched(episode), blind)))["parent_r"] == 0.5
    assert summary((episode, judge_causes(watched(episode), seeing)))["parent_r"] == 1.0
    # an ancestor is no parent, and a pair turned round is one step away
    assert summary((episode, judge_causes(watched(episode), claims((0, 1), (0, 2)))))["shd"] == 2
    assert summary((episode, judge_causes(watched(episode), claims((0, 1), (2, 1)))))["shd"] == 1


def test_discovery_is_followed_action_by_action() -> None:
    episode = play([AND, FOLLOWS], PRESSES)
    probabilities = np.zeros((len(PRESSES), 5, 5))
    probabilities[9:, 0, 1] = probabilities[9:, 3, 1] = probabilities[14:, 3, 2] = 1
    told = summary((episode, judge_causes(watched(episode), InferredGraph("slow", probabilities))))
    curve = told["discovery"]
    assert [point["actions"] for point in curve] == list(range(1, len(PRESSES) + 1))
    assert curve[8]["parent_f1"] == 0.0 and curve[9]["parent_f1"] == pytest.approx(4 / 5)
    assert told["actions_until_found"] == 15 and told["actions_until_found_bound"] < 15
    assert curve[-1]["parent_f1_bound"] == 1.0 and curve[0]["parent_f1_bound"] < 1


# links


def test_clusters_are_matched_one_to_one() -> None:
    """Cluster 0 has two actions on link 1 and one on link 0, cluster 1 three on link 1; cluster 2 touched nothing."""
    clusters, held = np.array([0, 0, 0, 1, 1, 1, 2, -1]), np.array([1, 1, 0, 1, 1, 1, -1, 0])
    assert matched_links(clusters, held, 3) == {0: 0, 1: 1}
    assert matched_links(np.full(4, -1), np.zeros(4, int), 2) == {}


def test_parents_at_the_level_of_links() -> None:
    """A cluster that is no link is a parent that is not there; a link without a cluster is missed."""
    episode = play([AND, FOLLOWS], (0, 3, 0, 3))
    clusters = np.array([1, -1, 1, 0])  # switch 3 is cluster 0, switch 0 is cluster 1, cluster 2 is nothing
    probabilities = np.zeros((4, 3, 5))
    probabilities[1:, 1, 1], probabilities[3:, 0, 2], probabilities[3:, 2, 4] = 1, 1, 1
    claimed = np.zeros((5, 5, 5), bool)
    candidates = watched(episode).candidates
    counts = count_links(episode, InferredLinks(clusters, probabilities), 0.5, claimed, candidates)
    assert counts[0].sum(0).tolist() == [0, 0, 3] and counts[2].sum(0).tolist() == [1, 1, 3]
    assert counts[4].tolist() == [[0, 0, 0], [1, 1, 2], [1, 1, 1], [0, 0, 0], [0, 1, 0]]
    own = probabilities.copy()
    own[:, 1, 0] = own[:, 0, 3] = 1  # links of triggers that are said to control these: nobody asks that
    again = count_links(episode, InferredLinks(clusters, own), 0.5, claimed, candidates)
    np.testing.assert_array_equal(again, counts)
    graph = replace(claims(steps=4), links=InferredLinks(clusters, probabilities))
    told = summary((episode, judge_causes(watched(episode, images=5), graph)), images=5)
    assert (told["link_parent_p"], told["link_parent_r"]) == (pytest.approx(2 / 3), pytest.approx(2 / 3))


def test_a_step_is_of_all_kinds_that_read_its_link_then() -> None:
    truth = states_of(play([AND, FOLLOWS], (0, 3, 0, 3)))
    assert truth is not None and truth.kinds == (("gate",), ("gate", "one-to-one")) * 2


def test_what_was_believed_without_later_pictures_counts_where_it_is_known() -> None:
    """After two actions: it takes two contacts for one link, which it says controls the lamp and the toy."""
    episode, clusters = play([AND, FOLLOWS], (0, 3, 0, 3)), np.array([0, 1, 0, 1])
    links = InferredLinks(clusters, np.zeros((4, 2, 5)))
    graph, early = replace(claims((3, 2), steps=4), links=links), np.zeros((2, 1, 5))
    early[:, 0, [1, 4]] = 1
    other = replace(claims((0, 1), (0, 4), steps=2, p=0.8), links=InferredLinks(np.zeros(2, int), early))
    told = judge_causes(watched(episode, images=5), graph, early={2: other, 9: other})
    assert [(one > 0).sum() for one in told.probabilities] == [0, 1, 2, 1, 1] and told.probabilities[2].max() == 0.8
    assert told.claimed[2, 0, 1] and not told.claimed[2, 3, 2] and told.claimed[3, 3, 2]
    assert told.links is not None and told.links[2].tolist() == [[0, 0, 0], [1, 1, 2], [0, 0, 1], [0, 0, 0], [0, 1, 0]]
    assert told.links[[1, 3, 4], :, 1].sum() == 0


def test_on_which_boards_it_is_judged_is_not_a_models_choice() -> None:
    """It tells of links, kinds, lags and changes on the first board alone: on the second it knows none of them."""
    rewired = Rewiring(step=5, relation=relation("one-to-one", (0,), 2, (1, 0)))
    episode = play([AND, FOLLOWS], PRESSES, "rewired", rewirings=(rewired,))
    clusters, single = np.array([PRESSES]).ravel() // 3, np.zeros((1, 2, 5))
    single[0, [0, 1], 1] = single[0, 0, 2] = 1
    changed = np.zeros((len(PRESSES), 5))
    changed[6:, 2] = 1
    outspoken = replace(
        claims((0, 1), (3, 1), (0, 2)),
        links=InferredLinks(clusters, single),
        kinds=("", "gate", "one-to-one", "", ""),
        lags=np.array([-1, 0, 0, -1, -1]),
        changed=changed,
        changed_at=np.array([-1, -1, 5, -1, -1]),
    )
    silent = claims((0, 1), (3, 1), (0, 2))
    names = ("link_parent_r", "kind_accuracy", "lag_accuracy", "rewired_placed")
    judged = [(episode, judge_causes(watched(episode), one)) for one in (outspoken, silent)]
    alone, both, none = (summary(*each) for each in (judged[:1], judged, judged[1:]))
    assert [both[name] for name in names] == [pytest.approx(alone[name] / 2) for name in names]
    assert alone["link_parent_r"] == alone["rewired_placed"] == 1.0
    assert [none[name] for name in names] == [None] * 4, "who tells of them nowhere is not asked"


def test_a_model_is_followed_as_far_as_it_has_seen() -> None:
    """It claims the truth after 46 actions, of which discovery is followed for 40."""
    presses = PRESSES * 3
    episode, probabilities = play([AND, FOLLOWS], presses), np.zeros((len(presses), 5, 5))
    probabilities[45:, 0, 1] = probabilities[45:, 3, 1] = probabilities[45:, 3, 2] = 1
    judged = judge_causes(watched(episode, images=61), InferredGraph("late", probabilities))
    told = summary((episode, judged), images=61)
    assert told["parent_f1"] == 1.0 and told["shd"] == 0
    assert len(told["discovery"]) == 40 and told["discovery"][-1]["parent_f1"] == 0


# mechanisms and what if


def asked(episode: Episode, reasoner: Reasoner, **more: int) -> JudgedCauses:
    return judge_causes(watched(episode, **more), claims(steps=len(episode.steps)), reasoner)


def test_who_is_asked_about_states_that_were_never_seen_is_told_apart() -> None:
    """Switch 3 moved before the observed actions end, or after: one of its states was never shown to anybody."""
    for presses, met in (((0, 3, 0, 3), 1.0), ((0, 0, 0, 3), 0.5)):
        episode = play([AND, relation("one-to-one", (0,), 4, (0, 1))], presses)
        told = summary((episode, judge_causes(watched(episode, images=4), claims(steps=4), Knower(episode))), images=4)
        assert told["mechanisms_met"] == met
        assert told["mechanism_bound_met"] == told["mechanism_bound"] or met < 1
        assert told["mechanism_accuracy_met"] == 1.0


@pytest.mark.parametrize("second", [FOLLOWS, LATE, relation("toggle", (3,), 2, (0, 1))], ids=lambda one: one.kind)
def test_who_knows_the_law_answers_everything(second: Relation) -> None:
    episode = play([AND, second], PRESSES, "mixed")
    assert isinstance(Knower(episode), Imagining)
    told = summary((episode, asked(episode, Knower(episode))), pred_a=0.75)
    assert told["mechanism_accuracy"] == 1.0 and told["gap"] == -0.25
    assert told["what_if"] == told["what_if_factual"] == told["what_if_left_out"] == 1.0 and told["what_if_pairs"] > 0
    assert told["mechanism_by_kind"]["rest"] == {"accuracy": 1.0, "bound": 1.0, "responders": 1}


def test_a_mechanism_is_known_by_what_it_does() -> None:
    """Who takes AND for OR is wrong about the lamp and right about the door."""
    episode = play([AND, FOLLOWS], PRESSES)
    judged = asked(episode, Knower(episode, [OR, FOLLOWS]))
    assert [(one.responder, one.kind, one.right) for one in judged.mechanisms] == [
        (1, "gate", False), (2, "one-to-one", True), (4, "rest", True),
    ]  # fmt: skip
    # a table by another name is the same mechanism
    named = [relation("gate", (3, 0), 1, (0, 0, 0, 1), function="and"), FOLLOWS]
    assert all(one.right for one in asked(episode, Knower(episode, named)).mechanisms)


def test_it_is_told_why_mechanisms_are_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the AND something is told wrongly: whether its parents are claimed, and were met, says why."""
    episode = play([AND, FOLLOWS], PRESSES)
    right = ((0, 1), (3, 1), (0, 2))
    for pairs, images, why in ((right, 17, "otherwise"), (right[1:], 17, "parents"), (right, 2, "never met")):
        judged = judge_causes(watched(episode, images), claims(*pairs), Knower(episode, [OR, FOLLOWS]))
        assert summary((episode, judged), images=images)["mechanism_missed_because"][why] == 1
    known = judge_causes(watched(episode), claims(*right), Knower(episode))
    assert not any(summary((episode, known))["mechanism_missed_because"].values())
    assert summary((episode, judge_causes(watched(episode), claims(*right))))["mechanism_missed_because"] is None
    monkeypatch.setattr(causes, "_varied", lambda *_: False)
    untouched = judge_causes(watched(episode), claims(), Knower(episode))
    told = summary((episode, untouched))
    assert told["mechanism_missed_because"] == {"not asked": 2, "parents": 0, "never met": 0, "otherwise": 0}
    assert told["mechanism_bound"] == 0.0  # who knows the mechanism is not asked, either


def test_a_delay_is_no_mechanism_without_a_memory() -> None:
    episode = play([AND, LATE], PRESSES, "time")
    judged = asked(episode, Knower(episode, [AND, FOLLOWS]))
    assert {one.responder: one.right for one in judged.mechanisms} == {1: True, 2: False, 4: True}


def test_who_expects_no_change_knows_what_nothing_moves() -> None:
    """Its own predictions stand for answers; what had happened without an action it tells, what did happen not."""
    episode = play([AND, FOLLOWS], PRESSES)
    judged = asked(episode, Persistence())
    assert {one.responder: one.right for one in judged.mechanisms} == {1: False, 2: False, 4: True}
    assert judged.told is not None and not judged.told[:, 0].all(-1).any()
    assert summary((episode, judged))["what_if"] == 0.0


def test_who_knows_the_law_and_what_luck_did_guesses_the_rest() -> None:
    """A lamp burns, with luck, where one of two switches is on: had the first press been left out, the second one would
    have needed luck, which it did not need as it was."""
    lucky = relation("unreliable", (0, 3), 1, (0, 1, 1, 1), probability=0.7)
    episodes = [play([lucky, FOLLOWS], (0, 3, None, None), "chance", index=index) for index in range(20)]
    told = [(episode, asked(episode, Knower(episode), images=5)) for episode in episodes]
    figures = summary(*told, images=5)
    assert figures["what_if"] == 1.0 > figures["what_if_bound"] > 0.5, "no model knows luck as this one does"
    unlucky = np.concatenate([judged.unlucky for _, judged in told if judged.unlucky is not None])
    assert unlucky[:, 1].any() and not unlucky[:, [0, 2, 3, 4]].any()
    # without the second press there is no other luck than that which showed
    for index in range(12):
        judged = asked(
            episode := play([lucky], (0, None, None, None), "chance", index=index), Knower(episode), images=5
        )
        assert judged.unlucky is not None and not judged.unlucky.any()


def test_luck_may_be_asked_for_several_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lamp that two throws have to allow, of which the second is made where the first one did."""

    def step(self: Unreliable, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        fires = chance is None or (chance.random() < self.probability and chance.random() < self.probability)
        now = self.shown(inputs) if fires else memory[0]
        return now, (now,)

    monkeypatch.setattr(Unreliable, "step", step)
    lucky = relation("unreliable", (0, 3), 1, (0, 1, 1, 1), probability=0.6)
    episodes = [play([lucky, FOLLOWS], (0, 3, 0, 3, 0, 3), "chance", index=index) for index in range(12)]
    told = [(episode, asked(episode, Knower(episode), images=7)) for episode in episodes]
    figures = summary(*told, images=7)
    # whoever takes it for one throw names the likelier state of 41 pairs
    assert figures["what_if_pairs"] == 53 and figures["what_if_bound"] == 42 / 53


def test_luck_that_nobody_can_list_is_taken_as_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lamp calculates with what it draws: nobody guesses it, and nobody falls over it."""

    def step(self: Unreliable, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        now = self.shown(inputs) if chance is None or int(chance.random() * 3) else memory[0]
        return now, (now,)

    monkeypatch.setattr(Unreliable, "step", step)
    monkeypatch.setattr(causes, "_observed", lambda *_: None)
    lucky = relation("unreliable", (0, 3), 1, (0, 1, 1, 1), probability=0.6)
    episodes = [play([lucky, FOLLOWS], (0, 3, 0, 3, 0, 3), "chance", index=index) for index in range(12)]
    told = [(episode, asked(episode, Knower(episode), images=7)) for episode in episodes]
    assert summary(*told, images=7)["what_if_bound"] == 1.0


@pytest.mark.parametrize("name", ["scaled", "counting"])
def test_what_nobody_can_list_has_no_bound_and_is_judged_all_the_same(name: str, registered: list[EntryPoint]) -> None:
    """Mechanisms of a package: one calculates with its luck, the other one counts without end."""
    registered.append(EntryPoint(name, f"tests.boards.mechanisms.strange:{name.title()}", "busybot.mechanisms"))
    episode = play([relation(name, (3,), 2, (0, 1))], PRESSES, name)
    judged = judge_causes(watched(episode), claims((3, 2)), Knower(episode))
    assert judged.bound is None and judged.links_bound is None and judged.claimed[-1][3, 2]
    assert [(one.kind, one.right, one.bound) for one in judged.mechanisms if one.driven] == [(name, True, None)]


def test_luck_is_remembered_as_far_as_it_goes() -> None:
    recalled = Recalled((1, 0))
    assert not recalled.random() < 0.9, "as it was"
    assert not recalled.random() < 0.0, "it cannot be as it was"
    assert recalled.random() < 0.6 and not recalled.random() < 0.4, "then what is likelier"
    assert recalled.taken == [1, 1, 0, 1]


def test_it_is_told_why_questions_are_missed() -> None:
    """Of the AND something is told wrongly: its parents are wrong, or they are right and the tour is wrong, too."""
    episode, right = play([AND, FOLLOWS], PRESSES), ((0, 1), (3, 1), (0, 2))
    whole = None
    for pairs, why in ((right, "mechanism"), (right[1:], "parents")):
        judged = judge_causes(watched(episode), claims(*pairs), Knower(episode, [OR, FOLLOWS]))
        figures = summary((episode, judged))
        missed = round((1 - figures["what_if"]) * figures["what_if_pairs"])
        assert missed and figures["what_if_missed_because"] == {
            "luck": 0, "rewired": 0, "parents": 0, "mechanism": 0, "otherwise": 0, why: missed,
        }  # fmt: skip
        whole = judged
    assert whole is not None and whole.told is not None and whole.unlucky is not None
    happened, otherwise = whole.told[:, 0], whole.told[:, 1]
    lucky = summary((episode, replace(whole, unlucky=np.ones_like(whole.unlucky))))["what_if_missed_because"]["luck"]
    assert lucky == (happened & ~otherwise).any(1).sum() < missed, "who is wrong about what happened has no excuse"
    known = judge_causes(watched(episode), claims(*right), Knower(episode))
    assert not any(summary((episode, known))["what_if_missed_because"].values())
    assert summary((episode, judge_causes(watched(episode), claims(*right))))["what_if_missed_because"] is None


def test_what_was_never_moved_cannot_be_known() -> None:
    """The switch 3 was never pressed: nobody asks what the lamp does then, and nobody counts as knowing."""
    episode = play([AND, FOLLOWS], (0,) * 20)
    judged = asked(episode, Knower(episode))
    assert {one.responder: one.right for one in judged.mechanisms} == {1: False, 2: False, 4: True}
    assert {one.responder: one.bound for one in judged.mechanisms}[2] is False


def test_the_observer_is_asked_with_all_that_was_observed_and_no_more() -> None:
    episode = play([AND, FOLLOWS], PRESSES)
    known = [asked(episode, Knower(episode), images=images).mechanisms for images in (2, 17)]
    assert {one.responder: one.bound for one in known[0]}[2] is False and all(one.bound for one in known[1])


def test_kinds_and_lags_are_compared_by_name() -> None:
    episode = play([AND, LATE], PRESSES, "time")
    graph = replace(claims(), kinds=("", "gate", "one-to-one", "", ""), lags=np.array([-1, 0, 2, -1, -1]))
    told = summary((episode, judge_causes(watched(episode), graph)))
    assert told["kind_accuracy"] == pytest.approx(2 / 3) and told["lag_accuracy"] == 1.0
    silent = summary((episode, judge_causes(watched(episode), claims())))
    assert silent["kind_accuracy"] is silent["lag_accuracy"] is None


def test_a_pair_asks_what_one_action_did() -> None:
    """The door follows switch 3 two actions later: left out, the next but one state is another one."""
    episode = play([LATE], (0, 3, 0, 0, 0, 0, 0), "time")
    right = asked(episode, Knower(episode), images=8).told
    assert right is not None and right.all(-1).tolist() == [[True, True]], "switch 0 does nothing"
    hasty = asked(episode, Knower(episode, [FOLLOWS]), images=8).told
    assert hasty is not None and np.argwhere(~hasty).tolist() == [[0, 0, 2]]


def test_where_nobody_wrote_down_what_was_tried_the_chosen_direction_counts() -> None:
    episode = play([AND, FOLLOWS], PRESSES)
    known = sequence_of(episode), [replace(step, direction=step.executed[-1], executed=()) for step in episode.steps]
    told = [contacts_of(one, known[0].actions, known[0].acted, LINKS.sizes) for one in
            (episode, replace(episode, steps=known[1]))]  # fmt: skip
    for move, action in told[0].actions.items():
        np.testing.assert_array_equal(told[1].actions[move], action)


def test_answers_chain_predictions_where_nothing_else_is_there() -> None:
    episode = play([AND, FOLLOWS], PRESSES)
    sequence = sequence_of(episode)

    class Counter(Persistence):
        def predict(self, seen: object, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
            return current + 1

    told = imagine(Counter(), sequence, np.array([0, 4]), np.zeros((2, 3, 6), np.float32), np.full((2, 3), -1))
    assert told.shape == (2, 3, 5, 256)
    np.testing.assert_allclose(told[1, 2], sequence.features[4] + 3)


# calibration


def test_calibration_needs_enough_uncertain_pairs() -> None:
    """Six pairs a board, of which three are parents, all believed with 0.7: they are off by 0.2."""
    episode = play([AND, FOLLOWS], PRESSES)
    pairs: Sequence[tuple[int, int]] = [(i, j) for i in (0, 3) for j in (1, 2, 4)]
    judged = judge_causes(watched(episode), claims(*pairs, p=0.7))
    few, many = summary((episode, judged)), summary(*[(episode, judged)] * (LEAST_PAIRS // 6 + 1))
    assert (few["ece_uncertain"], few["uncertain_pairs"]) == (None, 6)
    assert many["ece_uncertain"] == pytest.approx(0.2) and many["uncertain_pairs"] == 504
    assert few["ece_by_chance"] is None and 0.01 < many["ece_by_chance"] < 0.03, "0.016 of 504 independent ones"
    told = {point["images"]: point["uncertain_pairs"] for point in many["uncertain_by_images"]}
    assert told == {4: 504, 8: 504, 12: 504, 16: 504, 22: 504, 30: 0}, "no board has 29 actions"


def test_beliefs_are_compared_with_the_observers() -> None:
    """Who says what he says is off by nothing; one who is surer of every pair by .2 is, by that, and the other way."""
    episode = play([AND, FOLLOWS], PRESSES)
    judged = judge_causes(watched(episode), claims((0, 1), p=0.7))
    assert judged.observed is not None and judged.bound is not None
    assert np.array_equal(judged.bound, (judged.observed > 0.5) & judged.candidates)
    doubted = replace(judged, observed=np.full(judged.observed.shape, 0.3))
    for said, bias in ((0.3, 0.0), (0.5, 0.2), (0.1, -0.2)):
        told = summary((episode, replace(doubted, probabilities=np.full(judged.probabilities.shape, said))))
        assert told["belief_bias"] == pytest.approx(bias)
        apart = 0.3 * np.log(0.3 / said) + 0.7 * np.log(0.7 / (1 - said))
        assert told["belief_divergence"] == pytest.approx(apart, abs=1e-6)
    sure = summary((episode, replace(judged, probabilities=judged.observed)))
    assert sure["belief_divergence"] == pytest.approx(0, abs=1e-6)
    wrong = replace(judged, observed=np.ones(judged.observed.shape), probabilities=np.zeros(judged.observed.shape))
    told = summary((episode, wrong))
    assert told["belief_bias"] is None and told["belief_divergence"] == pytest.approx(np.log(999), rel=0.01)
    blind = summary((episode, replace(judged, observed=None)))
    assert blind["belief_bias"] is blind["belief_divergence"] is None


def test_nothing_judged_is_null_and_no_crash() -> None:
    told = summary()
    assert told["parent_f1"] is told["shd"] is told["mechanism_bound"] is told["what_if"] is None
    assert told["discovery"] == [] and told["bound_boards"] == 0
    assert told["cause_intervals"]["objects"]["parent_f1"] is None


def test_a_recording_that_breaks_the_law_has_parents_and_no_bound() -> None:
    episode = play([AND, FOLLOWS], PRESSES)
    broken = replace(episode, steps=[replace(step, responder_states_after=(-1, 1, 1, -1, 1)) for step in episode.steps])
    judged = judge_causes(watched(broken), claims((0, 1)))
    assert judged.bound is None and judged.mechanisms == () and judged.true[3][0, 1]


def test_a_tour_is_longer_than_what_it_has_to_find_out() -> None:
    assert TOUR >= 4 * 9 and HORIZON >= 4, "nine combinations of two levers; a delay of three actions"
