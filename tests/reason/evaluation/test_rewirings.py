"""Changed mechanisms: when they show, who finds and places them, and who cries wolf, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import Rewiring
from busybot.episodes.episode import Episode
from busybot.reason.evaluation import causes
from busybot.reason.evaluation.causes import JudgedCauses, Watched, judge_causes
from busybot.reason.evaluation.causes_summary import summarise_causes
from busybot.reason.evaluation.ground_truth import trace_of
from busybot.reason.evaluation.rewirings import BESIDE, WITHIN, JudgedChanges, Rewired, shown_rewirings
from busybot.reason.models.base import InferredGraph
from tests.reason.worlds import LINKS, Knower, judge_of, play, relation, sequence_of

FOLLOWS, OTHER = relation("one-to-one", (3,), 2, (0, 1)), relation("one-to-one", (0,), 2, (0, 1))
AND, XOR = (
    relation("gate", (0, 3), 1, table, function=name) for name, table in (("and", (0, 0, 0, 1)), ("xor", (0, 1, 1, 0)))
)
HAPPENED, SHOWED, STEPS = 6, 8, 20
PRESSES = (3, 3, 0, 0, 3, 3, None, None, 3, 0, 0, 3) + (None,) * 8
"""Both switches rest in their first state when the door passes from switch 3 to switch 0: action 8 shows it."""


def board(*rewirings: Rewiring) -> Episode:
    return play([AND, FOLLOWS], PRESSES, "rewired", rewirings=rewirings)


def rewired() -> Episode:
    return board(Rewiring(step=HAPPENED, relation=OTHER))


def says(responder: int, since: int, at: int, steps: int = STEPS) -> InferredGraph:
    """Believed from the action `since` on that the mechanism is another one since the action `at`."""
    changed, changed_at = np.zeros((steps, 5)), np.full(5, -1)
    changed[since:, responder], changed_at[responder] = 0.9, at
    return InferredGraph("saying", np.zeros((steps, 5, 5)), changed=changed, changed_at=changed_at)


@pytest.fixture(autouse=True)
def _known_links(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(causes, "law_of", lambda episode, library: causes.Law(LINKS, ((True, False),) * 3))


def judge(episode: Episode, graph: InferredGraph) -> JudgedCauses:
    sequence, everyone = sequence_of(episode), np.array([False, True, True, False, True])
    return judge_causes(Watched(episode, sequence.actions, sequence.acted, everyone, 17), graph)


def summary(*told: tuple[Episode, InferredGraph]) -> dict:
    judged = [(episode.board, judge(episode, graph)) for episode, graph in told]
    return summarise_causes(judged, 17, None, 0)


def shown(episode: Episode) -> list[Rewired]:
    trace = trace_of(episode)
    assert trace is not None
    dynamics = Dynamics(episode.board, LINKS)
    return shown_rewirings(dynamics, trace[0], dynamics.run(trace[0].tolist()))


# when it shows


def test_a_rewiring_shows_when_the_old_mechanism_would_have_shown_another_state() -> None:
    assert shown(rewired()) == [Rewired(2, HAPPENED, SHOWED)]
    assert shown(board()) == []


def test_a_rewiring_may_show_at_once_or_never() -> None:
    turned = relation("one-to-one", (3,), 2, (1, 0))
    assert shown(board(Rewiring(step=HAPPENED, relation=turned))) == [Rewired(2, HAPPENED, HAPPENED)]
    assert shown(board(Rewiring(step=13, relation=OTHER))) == [], "no switch is pressed after it"


def test_the_old_mechanism_keeps_its_memory() -> None:
    """Switch 3 was pressed before the rewiring: two actions later the old one would have shown it."""
    late = relation("delay", (3,), 2, (0, 1), actions=2)
    episode = play([AND, late], (3, *(None,) * 8), "rewired", rewirings=(Rewiring(step=1, relation=OTHER),))
    assert shown(episode) == [Rewired(2, 1, 2)]


def test_what_follows_a_rewired_responder_is_not_rewired() -> None:
    chain = [FOLLOWS, relation("one-to-one", (2,), 1, (0, 1))]
    episode = play(chain, PRESSES, "chain", rewirings=(Rewiring(step=HAPPENED, relation=OTHER),))
    assert [one.responder for one in shown(episode)] == [2]


def test_two_rewirings_show_each_by_itself() -> None:
    episode = board(Rewiring(step=HAPPENED, relation=OTHER), Rewiring(step=4, relation=XOR))
    assert shown(episode) == [Rewired(1, 4, 4), Rewired(2, HAPPENED, SHOWED)]


# found and placed


@pytest.mark.parametrize(
    ("since", "at", "found", "placed"),
    [
        (SHOWED, HAPPENED, 1.0, 1.0),
        (SHOWED + WITHIN, SHOWED, 1.0, 1.0),  # the last action that counts
        (SHOWED + WITHIN + 1, HAPPENED, 0.0, 0.0),  # too late, wherever it is placed
        (SHOWED, HAPPENED - BESIDE, 1.0, 1.0),
        (SHOWED, HAPPENED - BESIDE - 1, 1.0, 0.0),
        (SHOWED, SHOWED + BESIDE, 1.0, 1.0),
        (SHOWED, SHOWED + BESIDE + 1, 1.0, 0.0),
        (SHOWED, -1, 1.0, 0.0),  # that, and not when
    ],
)
def test_found_in_time_and_placed_beside(since: int, at: int, found: float, placed: float) -> None:
    told = summary((rewired(), says(2, since, at)))
    assert (told["rewirings"], told["rewired_found"], told["rewired_placed"]) == (1, found, placed)
    assert told["rewired_false_alarms"] == 0.0 and told["rewired_false_alarms_calm"] is None


@pytest.mark.parametrize(
    ("since", "at", "right", "why"),
    [
        (SHOWED, HAPPENED, True, None),
        (SHOWED + WITHIN + 1, HAPPENED, True, "not found"),
        (SHOWED, HAPPENED - BESIDE - 1, True, "otherwise"),
        (SHOWED + WITHIN + 1, HAPPENED, False, "parents"),
        (SHOWED, HAPPENED, False, None),
    ],
)
def test_it_is_told_why_a_rewiring_is_not_placed(since: int, at: int, right: bool, why: str | None) -> None:
    graph = says(2, since, at)
    graph.probabilities[:, 0 if right else 3, 2] = 1.0
    reasons = dict.fromkeys(("not determined", "parents", "not found", "otherwise"), 0) | ({why: 1} if why else {})
    judged = judge(episode := rewired(), graph)
    assert judged.rewired is not None
    known = replace(judged, rewired=replace(judged.rewired, bound=JudgedChanges((True,), (True,), (0,), 0)))
    figures, unknown = (summarise_causes([(episode.board, one)], 17, None, 0) for one in (known, judged))
    assert figures["rewired_missed_because"] == reasons
    assert unknown["rewired_missed_because"] is None, "nobody knows what is determined: the observer did not follow"


def test_what_the_exact_observer_does_not_place_is_not_determined() -> None:
    episode, graph = rewired(), says(2, STEPS, -1)
    judged = judge(episode, graph)
    assert judged.rewired is not None and judged.rewired.told is not None
    blind = replace(judged, rewired=replace(judged.rewired, bound=judged.rewired.told))
    reasons = summarise_causes([(episode.board, blind)], 17, None, 0)["rewired_missed_because"]
    assert reasons == {"not determined": 1, "parents": 0, "not found": 0, "otherwise": 0}


def test_a_rewiring_excuses_questions_that_reach_it_alone() -> None:
    """Who knows what is true until then, and not that it changes, is wrong where a question goes on beyond it."""
    episode = play([AND, FOLLOWS], PRESSES, "rewired", rewirings=(Rewiring(step=HAPPENED, relation=OTHER),))
    sequence, everyone = sequence_of(episode), np.array([False, True, True, False, True])
    seen = Watched(episode, sequence.actions, sequence.acted, everyone, 17, None, sequence, judge_of(sequence))
    judged = judge_causes(seen, says(2, STEPS, -1), Knower(episode, [AND, FOLLOWS]))
    assert seen.pairs is not None and judged.told is not None and judged.exchanged is not None
    ends = seen.pairs.happened.steps + seen.pairs.happened.asked.sum(1)
    assert judged.exchanged[:, 2].tolist() == (ends > HAPPENED).tolist() and not judged.exchanged[:, [1, 4]].any()
    assert set(judged.exchanged[:, 2]) == {False, True} and judged.told[~judged.exchanged[:, 2]].all()
    missed = summarise_causes([(episode.board, judged)], 17, None, 0)["what_if_missed_because"]
    assert missed["rewired"] == sum(missed.values()) == (~judged.told[..., 2].all(1)).sum() > 0


def test_the_distance_is_counted_outside_of_the_time_in_which_nobody_can_tell() -> None:
    told = summary(*((rewired(), says(2, SHOWED, at)) for at in (HAPPENED - 4, HAPPENED, SHOWED, SHOWED + 2)))
    assert told["rewired_off"] == (4 + 0 + 0 + 2) / 4 and told["rewired_placed"] == 3 / 4


def test_another_responder_is_not_it() -> None:
    told = summary((rewired(), says(1, SHOWED, HAPPENED)))
    assert (told["rewired_found"], told["rewired_placed"], told["rewired_false_alarms"]) == (0.0, 0.0, 1.0)


def test_who_believes_it_before_it_happened_raises_a_false_alarm() -> None:
    early = summary((rewired(), says(2, HAPPENED - 1, HAPPENED)))
    assert (early["rewired_found"], early["rewired_false_alarms"]) == (1.0, 1.0)
    assert summary((rewired(), says(2, HAPPENED, HAPPENED)))["rewired_false_alarms"] == 0.0, "a guess, and right"


def test_boards_without_a_rewiring_have_false_alarms_of_their_own() -> None:
    told = summary((rewired(), says(2, SHOWED, HAPPENED)), (board(), says(2, 3, 3)), (board(), says(2, STEPS, -1)))
    assert told["rewirings"] == 1 and told["rewired_found"] == 1.0
    assert told["rewired_false_alarms"] == pytest.approx(1 / 3) and told["rewired_false_alarms_calm"] == 0.5


def test_what_showed_too_late_is_not_asked_about() -> None:
    """A recording that ends four actions after it showed: whoever found it, nobody is judged by it."""
    episode = rewired()
    short = replace(episode, steps=episode.steps[: SHOWED + WITHIN])
    told = summary((short, says(2, SHOWED, HAPPENED, len(short.steps))))
    assert told["rewirings"] == 0 and told["rewired_found"] is None
    longer = replace(episode, steps=episode.steps[: SHOWED + WITHIN + 1])
    assert summary((longer, says(2, SHOWED, HAPPENED, len(longer.steps))))["rewirings"] == 1


def test_who_says_nothing_is_not_judged_and_the_observer_is() -> None:
    told = summary((rewired(), InferredGraph("silent", np.zeros((STEPS, 5, 5)))))
    assert told["rewired_found"] is told["rewired_placed"] is told["rewired_false_alarms"] is None
    assert told["rewired_missed_because"] is None
    assert summary((board(), says(2, STEPS, -1)))["rewired_missed_because"] is None, "there was none"
    assert told["rewirings"] == 1 and told["rewired_found_bound"] is None, "the space has no rewirings so early"
    assert summary((board(), says(2, STEPS, -1)))["rewired_false_alarms_bound"] == 0.0


def test_the_observer_finds_what_showed() -> None:
    """In the world `rewired` it knows that something may change after actions 20 to 25."""
    presses = (0, 3, 0, 3, 3, 0, 0, 3) * 2 + (3, 0, 3, 0, 0, 0, 3, 0, 3, 3, 0, 3, 0, 0, 3, 0, 3, 0)
    episode = play(
        [relation("one-to-one", (0,), 1, (0, 1)), FOLLOWS], presses, "rewired",
        rewirings=(Rewiring(step=21, relation=OTHER),),
    )  # fmt: skip
    graph = InferredGraph("silent", np.zeros((len(presses), 5, 5)))
    judged = judge(episode, graph).rewired
    assert judged is not None and judged.bound is not None and [one.happened for one in judged.rewired] == [21]
    assert judged.bound.found == (True,) and judged.bound.placed == (True,) and judged.bound.alarms == 0
