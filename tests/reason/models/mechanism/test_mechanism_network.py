"""Explanations of what responders show, what is counted of them, and the network that judges them."""

import math
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch

from benchmarks.studies.mechanisms import JUDGED_SEED, compare, draw
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.common.errors import BusybotError
from busybot.objects.resolve import find
from busybot.reason.models.mechanism.config import MechanismConfig, MechanismNetConfig
from busybot.reason.models.mechanism.contexts import (
    LUCK,
    MEMORIES,
    MISTAKE,
    STATES,
    SURE,
    UNRELIABLE,
    UNSURE,
    Explanations,
    Trace,
    explanations_of,
)
from busybot.reason.models.mechanism.evidence import EITHER, EVIDENCE, RECENT, SCALE, WITNESSES, evidence_of
from busybot.reason.models.mechanism.networks import (
    BoardFacts,
    MechanismNet,
    explanation_graph,
    families,
    parents_of,
)
from busybot.reason.models.mechanism.training import learner
from busybot.reason.models.mechanism.training.labelled import LabelledTrace, draw_boards
from busybot.reason.models.mechanism.training.learner import JUDGED_AFTER, MechanismLearner, Shelf, mask_links
from busybot.reason.pyg import Batch
from busybot.training.loop import fit

COLUMNS = {"new": 3, "never": 4, "sometimes": 5, "always": 6, "actions": 10}


def counted(trace: Trace, after: int) -> tuple[Explanations, np.ndarray]:
    found = explanations_of(trace)
    return found, np.expm1(evidence_of(trace, found, [after]).explanations[:, :, 0].numpy())


def explaining(found: Explanations, inputs: tuple[int, ...], memory: str) -> int:
    """The row of an explanation."""
    wanted = np.isin(np.arange(found.inputs.shape[1]), inputs)
    (row,) = np.flatnonzero((found.inputs == wanted).all(1) & (found.memory == MEMORIES.index(memory)))
    return int(row)


@pytest.fixture(scope="module")
def gates() -> list[LabelledTrace]:
    return [board for board, _ in draw("gates", 6, 0, find("procedural"))]


def walk(links: int, actions: int) -> np.ndarray:
    """States of two-state links of which one moves in every action."""
    rng = np.random.default_rng(0)
    states = np.zeros((actions + 1, links), int)
    for before, after, link in zip(states[:-1], states[1:], rng.integers(links, size=actions), strict=True):
        after[:] = before
        after[link] = 1 - before[link]
    return states


def test_what_is_right_is_never_contradicted_whatever_it_remembers() -> None:
    links = walk(3, 40)
    pressed = np.diff(links, axis=0, prepend=links[:1]) > 0
    late = np.maximum(np.arange(41) - 2, 0)
    latched = np.zeros(41, int)
    for action in range(1, 41):
        now = pressed[action]
        latched[action] = 1 if now[0] else 0 if now[2] else latched[action - 1]
    shown = [links[:, 0] ^ links[:, 1], links[late, 2], np.cumsum(pressed[:, 1]) % 2, latched]
    trace = Trace(links, np.stack(shown, axis=1), (2, 2, 2))
    found, told = counted(trace, 40)
    right = [((0, 1), "late 0"), ((2,), "late 2"), ((1,), "odd presses up"), ((0, 2), "last press up, up")]
    for responder, (inputs, memory) in enumerate(right):
        row = explaining(found, inputs, memory)
        assert told[responder, row, [COLUMNS["never"], COLUMNS["sometimes"]]].max() == 0, memory
        assert told[responder, row, COLUMNS["always"]] > 25
        likelier = evidence_of(trace, found, [40]).explanations[responder, :, 0, 0]
        simpler = found.inputs.sum(1) <= len(inputs)
        assert likelier[simpler].max() == likelier[row]


def log_share(states: np.ndarray, alike: np.ndarray, moment: int, few: float, ways: int | None = None) -> float:
    """Log probability of what shows at a moment, after these earlier ones."""
    same, total = int((states[:moment][alike] == states[moment]).sum()), int(alike.sum())
    return math.log((same + few) / (total + few * (ways or max(2, states[: moment + 1].max() + 1))))


def log_luck(states: np.ndarray, moments: list[int], goals: int) -> float:
    """Log probability of what shows at these moments, if one of so many goals is reached unless that fails."""
    told = []
    for goal in range(goals):
        shares = []
        for moment in moments:
            before, now = states[max(moment - 1, 0)], states[moment]
            if moment == 0 or before == goal:
                shares.append(1 - MISTAKE if now == goal else MISTAKE)
            else:
                shares.append(LUCK if now == goal else 1 - LUCK if now == before else MISTAKE)
        told.append(math.prod(shares))
    return math.log(sum(told) / goals)


def test_what_is_counted_is_what_brute_force_counts(gates: list[LabelledTrace]) -> None:
    trace = gates[0].trace.first(18)
    found, told = counted(trace, 18)
    counts = evidence_of(trace, found, [18])
    shape = (trace.responders.shape[1], len(found.own))
    for responder, row in np.random.default_rng(1).integers(shape, size=(40, 2)):
        states, logs, known = trace.responders[:, responder], np.zeros(5), {}
        before = np.concatenate([states[:1], states[:-1]])
        kinds = {"new": 0, "never": 0, "sometimes": 0, "always": 0}
        for moment in range(19):
            alike = found.contexts[:moment, row] == found.contexts[moment, row]
            if found.own[row]:
                alike &= before[:moment] == before[moment]
            same, total = int((states[:moment][alike] == states[moment]).sum()), int(alike.sum())
            sure, unsure = (log_share(states, alike, moment, few) for few in (SURE, UNSURE))
            context = (found.contexts[moment, row], before[moment] if found.own[row] else 0)
            one, other = known.get(context, (0.0, 0.0))
            known[context] = (one + sure, other + unsure)
            either = np.logaddexp(*known[context]) - np.logaddexp(one, other)
            if found.memory[row] == UNRELIABLE:
                equal = np.flatnonzero(found.contexts[:moment, row] == found.contexts[moment, row]).tolist()
                ways = max(2, states[: moment + 1].max() + 1)
                either = log_luck(states, [*equal, moment], ways) - log_luck(states, equal, ways)
            logs[:3] += [sure, unsure, either]
            if moment > 18 - RECENT:
                near = alike & (np.arange(moment) >= moment - RECENT)
                logs[3:] += [sure, log_share(states, near, moment, SURE, STATES)]
            kind = "new" if not total else "always" if same == total else "sometimes" if same else "never"
            kinds[kind] += 1
        columns = counts.explanations[responder, row, 0, [0, 1, 2, 11, 12]].numpy()
        np.testing.assert_allclose(columns, logs / 5, atol=1e-4)
        assert {name: round(float(told[responder, row, COLUMNS[name]])) for name in kinds} == kinds
        assert round(float(told[responder, row, COLUMNS["actions"]])) == 19


def test_what_fails_by_luck_is_told_from_what_moves_by_itself_and_from_what_moves_with_another_one() -> None:
    rng, links = np.random.default_rng(3), walk(3, 40)
    unreliable, strikes = np.zeros(41, int), np.cumsum(rng.random(41) < 0.2) % 2
    for action in range(1, 41):
        unreliable[action] = links[action, 1] if rng.random() < LUCK else unreliable[action - 1]
    strikes -= strikes[0]
    trace = Trace(links, np.stack([unreliable, abs(strikes), 1 - abs(strikes)], axis=1), (2, 2, 2))
    found = explanations_of(trace)
    told = evidence_of(trace, found, [40]).explanations[:, :, 0, [2, 14]]
    fails, alone = explaining(found, (1,), "own and now"), explaining(found, (), "own")
    others = np.setdiff1d(np.flatnonzero(found.inputs.sum(1) < 2), fails)
    assert told[0, fails, 0] > told[0, others, 0].max() + 1
    half = math.log(2) / 5  # of four functions of a link two depend on it
    assert float(told[0, fails, 1] - told[0, fails, 0]) == pytest.approx(half, abs=0.01)
    assert told[1:, alone, 1].min() > told[1:, alone, 0].max() + 1, "they strike together"
    assert told[0, alone, 1] < told[0, alone, 0] + 0.5


def test_what_was_not_seen_counts_as_if_it_had_not_been() -> None:
    """What remembers nothing has the evidence of the moments alone at which the responder was seen, whatever a hand
    left of the others; the second responder was seen throughout."""
    links, rng = walk(3, 40), np.random.default_rng(1)
    shown, kept = np.stack([links[:, 0] & links[:, 1], links[:, 2]], axis=1), rng.random(41) > 0.3
    kept[0] = True
    found, every = counted(Trace(links, shown, (2, 2, 2)), 40)
    _, parts = counted(Trace(links[kept], shown[kept], (2, 2, 2)), int(kept.sum()) - 1)
    of_links = ~found.inputs[:, 3:].any(1)
    rows = of_links & np.isin(found.memory, [MEMORIES.index(name) for name in ("none", "late 0")])
    columns = [0, 1, 2, *(COLUMNS[name] for name in ("new", "never", "sometimes", "always", "actions"))]
    seen = kept[:, None] | np.array([False, True])
    for stale in (0, 1):
        _, told = counted(Trace(links, np.where(seen, shown, stale), (2, 2, 2), ~seen), 40)
        np.testing.assert_allclose(told[0, rows][:, columns], parts[0, rows][:, columns], rtol=1e-4, atol=1e-5)
        last = told.shape[-1] - 1  # tells who changes together with the other one
        np.testing.assert_allclose(told[1, of_links, :last], every[1, of_links, :last], rtol=1e-5)


def test_what_lasts_is_weighed_by_how_long() -> None:
    links = walk(3, 12)
    pressed = np.diff(links[:, 0], prepend=0) > 0
    since = [next((k for k in range(m + 1) if pressed[m - k]), 99) for m in range(13)]
    trace = Trace(links, np.array([[int(k < 2)] for k in since]), (2, 2, 2))
    found = explanations_of(trace)
    told = 5 * evidence_of(trace, found, [12]).explanations[0, :, 0, [0, 14]]
    row = explaining(found, (0,), "since press up")
    assert found.contexts[:, row].tolist() == [min(k, 5) for k in since]
    shares = []
    for actions, first in product(range(1, 6), (0, 1)):
        right = sum(
            (first if min(k, 5) < actions else 1 - first) == state
            for k, state in zip(since, trace.responders[:, 0], strict=True)
        )
        shares.append((1 - MISTAKE) ** right * MISTAKE ** (13 - right))
    assert float(told[row, 1]) == pytest.approx(math.log(sum(shares) / 10), abs=1e-4)
    assert told[row, 1] > told[row, 0] and told[row, 1] > told[found.memory == MEMORIES.index("late 0")].max()


def test_functions_that_do_without_an_input_are_left_out() -> None:
    links = walk(3, 12)
    trace = Trace(links, links[:, :1] & links[:, 1:2], (2, 2, 2))
    found = explanations_of(trace)
    told = 5 * evidence_of(trace, found, [12]).explanations[0, :, 0, 14]
    for inputs in ((0,), (0, 1), (1, 2), (0, 1, 2)):
        read = {tuple(row[list(inputs)]): int(state) for row, state in zip(links, trace.responders[:, 0], strict=True)}
        situations = list(product((0, 1), repeat=len(inputs)))
        every = [dict(zip(situations, states, strict=True)) for states in product((0, 1), repeat=len(situations))]
        needed = [
            one for one in every
            if all(any(one[s] != one[(*s[:k], 1 - s[k], *s[k + 1 :])] for s in situations) for k in range(len(inputs)))
        ]  # fmt: skip
        agree = [one for one in needed if all(one[s] == state for s, state in read.items())]
        row, alone = explaining(found, inputs, "late 0"), {int(one) for one in inputs}
        if {0, 1} <= alone:
            assert float(told[row]) == pytest.approx(math.log(len(agree) / len(needed)), abs=0.5)
            assert math.log(len(agree) / len(needed)) != pytest.approx(math.log(len(agree) / len(every)), abs=0.1)
        else:
            assert not agree and told[row] < -4, "it is contradicted"


def test_an_input_matters_where_it_alone_changes_what_shows() -> None:
    links = walk(3, 40)
    trace = Trace(links, (links[:, :1] & links[:, 1:2]), (2, 2, 2))
    found = explanations_of(trace)
    told = torch.expm1(evidence_of(trace, found, [40]).inputs)[0, :, 0].numpy()

    def pairs(inputs: tuple[int, ...], one: int) -> list[int]:
        row = explaining(found, inputs, "late 0")
        (place,) = np.flatnonzero(((row, one) == found.reads.T).all(1))
        rest = [other for other in inputs if other != one]
        alone = [
            (a, b)
            for a, b in combinations(range(41), 2)
            if (links[a, rest] == links[b, rest]).all() and links[a, one] != links[b, one]
        ]
        differ = sum(bool(trace.responders[a, 0] != trace.responders[b, 0]) for a, b in alone)
        assert told[place].round().tolist() == [differ, len(alone) - differ]
        return told[place].round().tolist()

    assert pairs((0, 1), 0)[0] > 0 and pairs((0, 1), 1)[0] > 0
    assert pairs((0, 1, 2), 2)[0] == 0 and pairs((0, 1, 2), 2)[1] > 0
    assert pairs((0, 2), 2)[0] > 0, "what is not told of the second link looks like the third one's doing"


def test_probabilities_are_those_of_one_explanation_each_and_of_no_responder_by_itself(
    gates: list[LabelledTrace],
) -> None:
    net = MechanismNet(MechanismNetConfig())
    graph = Batch.from_data_list([explanation_graph(board.trace, [3, 20]) for board in gates[:2]])
    final, first, _ = net(graph)
    owner = graph["explanation", "explains", "responder"].edge_index[1]
    for shares in (final, first):
        sums = torch.zeros(graph["responder"].num_nodes, 2).index_add(0, owner, shares.exp())
        assert torch.allclose(sums, torch.ones_like(sums), atol=1e-5)
    assert final.exp()[~graph["explanation"].possible].max() < 1e-6
    assert graph["explanation"].evidence.shape[1:] == (2, EVIDENCE + 2)
    assert graph["explanation", "reads", "candidate"].witnesses.shape[1:] == (2, WITNESSES)
    alone = explanation_graph(gates[1].trace, [3, 20])
    told = parents_of(net(Batch.from_data_list([alone]))[0], alone)
    assert torch.allclose(told, parents_of(final, graph)[-len(told) :], atol=1e-5), "a batch changes nothing"


def test_what_a_world_makes_probable_is_so_where_it_is_told_alone(gates: list[LabelledTrace]) -> None:
    net = MechanismNet(MechanismNetConfig(worlds=("gates", "time")))
    of_pairs = MEMORIES.index("late 0") + 2 * len(MEMORIES)

    def share(world: int) -> float:
        graph = Batch.from_data_list([explanation_graph(gates[0].trace, [3], BoardFacts(world))])
        shares = net(graph)[0].exp()[graph["explanation"].kind == of_pairs]
        return float(shares.detach().sum())

    before = [share(world) for world in range(3)]
    with torch.no_grad():
        net.prior.weight[1, of_pairs] += 1
    after = [share(world) for world in range(3)]
    assert after[1] > before[1] + 0.1 and [after[0], after[2]] == [before[0], before[2]]


def test_what_is_learned_of_effects_that_come_late_holds_however_late_they_come(gates: list[LabelledTrace]) -> None:
    """Training boards have one delay alone."""
    net, trace = MechanismNet(MechanismNetConfig(families=True)), gates[0].trace
    late = [MEMORIES.index(f"late {actions}") + len(MEMORIES) for actions in range(4)]
    presses = [MEMORIES.index(f"odd presses {way}") + len(MEMORIES) for way in ("up", "down")]
    alike = families()
    assert alike[late[1]] == alike[late[2]] == alike[late[3]] != alike[late[0]]
    assert alike[presses[0]] == alike[presses[1]] != alike[presses[0] + len(MEMORIES)], (
        "of two links it is another kind"
    )
    assert alike[presses[0]] == alike[MEMORIES.index("since press up") + len(MEMORIES)], "a lasting effect of a press"
    assert len(set(alike)) == int(net.kind.weight.shape[1]) == max(alike) + 1

    def share(kind: int) -> float:
        graph = Batch.from_data_list([explanation_graph(trace, [3])])
        return float(net(graph)[0].exp()[graph["explanation"].kind == kind].detach().sum())

    before = [share(kind) for kind in late]
    with torch.no_grad():
        net.prior.weight[0, alike[late[1]]] += 1
    after = [share(kind) for kind in late]
    assert after[0] < before[0] and all(now > was for now, was in zip(after[1:], before[1:], strict=True))


def test_what_no_training_has_is_rarer_than_the_rest_of_its_family(gates: list[LabelledTrace]) -> None:
    """As gates of three inputs."""
    of_pairs, of_three = (MEMORIES.index("late 0") + inputs * len(MEMORIES) for inputs in (2, 3))
    net = MechanismNet(MechanismNetConfig(families=True))
    assert net.family[of_pairs] == net.family[of_three]
    one, late, odd, three = (
        net.rarer[inputs * len(MEMORIES) + MEMORIES.index(name)].item()
        for inputs, name in ((1, "late 1"), (2, "late 2"), (1, "odd presses up"), (3, "late 0"))
    )
    assert one == 0 and late == odd == -1 and three == -3, "nor memories that only new kinds have"

    def share() -> float:
        graph = Batch.from_data_list([explanation_graph(gates[0].trace, [3])])
        return float(net(graph)[0].exp()[graph["explanation"].kind == of_three].detach().sum())

    rare = share()
    net.rarer.zero_()
    assert 0 < rare < share() / 2
    assert not MechanismNet(MechanismNetConfig()).rarer.any(), "models of before know nothing of it"


def test_what_is_all_but_certain_stays_a_number(gates: list[LabelledTrace]) -> None:
    """Hundreds of actions make log odds of changes whose exponentials are none."""
    trace = gates[0].trace
    graph = explanation_graph(trace, [30])
    graph["responder"].odds = torch.full((trace.responders.shape[1], 1, 3), 300.0)
    change = MechanismNet(MechanismNetConfig())(Batch.from_data_list([graph]))[2]
    assert change is not None and bool(change.isfinite().all())


def test_what_is_counted_of_hundreds_of_actions_stays_a_number() -> None:
    """What shows by chance alone is explained far better without any of the inputs than with them."""
    links = walk(2, 250)
    trace = Trace(links, np.random.default_rng(0).integers(2, size=(251, 1)), (2, 2))
    told = evidence_of(trace, explanations_of(trace), [50, 250])
    assert bool(told.explanations.isfinite().all())


@pytest.mark.parametrize("labels", ["parents", "pictures"])
def test_held_out_boards_may_be_shorter_than_others(
    gates: list[LabelledTrace], labels: Literal["parents", "pictures"]
) -> None:
    def of(board: LabelledTrace, actions: int) -> LabelledTrace:
        assert board.parents is not None and board.changed is not None
        true = (board.parents[:actions], board.changed[:actions]) if labels == "parents" else ()
        return LabelledTrace(board.trace.first(actions), board.world, *true)

    config = MechanismConfig(labels=labels, net=MechanismNetConfig(changes=labels == "parents"))
    held_out = [of(board, actions) for board, actions in zip(gates, (12, 30), strict=False)]
    assert math.isfinite(MechanismLearner(config, held_out, held_out, 0).judge()["loss"])


def test_boards_whose_true_parents_no_explanation_reads_teach_nothing_wrong(gates: list[LabelledTrace]) -> None:
    board = replace(gates[0], parents=np.ones_like(gates[0].parents))  # more inputs than explanations have
    learner = MechanismLearner(MechanismConfig(iterations=1), [board], [board], 0)
    assert math.isfinite(learner.judge()["loss"])
    assert math.isfinite(learner.iterate(0)[0])


def test_changes_need_not_be_learned(gates: list[LabelledTrace]) -> None:
    learner = MechanismLearner(MechanismConfig(net=MechanismNetConfig(changes=False)), gates[:2], gates[2:4], 0)
    assert math.isfinite(learner.iterate(0)[0]) and math.isfinite(learner.judge()["loss"])


def test_log_odds_are_made_as_sure_as_they_are_right() -> None:
    rng = torch.Generator().manual_seed(0)
    right = 2 * torch.randn(20_000, generator=rng)
    true = (torch.rand(20_000, generator=rng) < right.sigmoid()).float()
    scale, shift = learner.logistic(2 * right - 3, true)
    assert (scale, shift) == pytest.approx((0.5, 1.5), abs=0.1)
    assert learner.logistic(right, torch.zeros(20_000))[1] < -3, "what never happens is said never to happen"


def test_what_is_said_of_changes_is_corrected_at_the_end() -> None:
    boards = [board for _, board in draw_boards("rewired", 12, 3, find("procedural"), 30)]
    one = MechanismLearner(MechanismConfig(iterations=0, untold=0.0), boards, [], 0)
    graph = Batch.from_data_list([boards[0].graph([10, 30])])
    with torch.no_grad():
        before = one.network(graph)[2]
        one.network.correct_changes(2.0, 0.5)
        assert torch.allclose(one.network(graph)[2], 2 * before + 0.5, atol=1e-5)
        one.network.correct_changes(0.5, -0.25)
    one.conclude()
    said, true = [], []
    for number in range(len(boards)):
        known = Batch.from_data_list([one._half_told(number)])
        with torch.no_grad():
            said.append(one.network(known)[2].flatten())
        true.append(known["responder"].changed.float().flatten())
    assert float(torch.cat(said).sigmoid().mean()) == pytest.approx(float(torch.cat(true).mean()), abs=0.02)
    gates = [board for _, board in draw_boards("gates", 3, 3, find("procedural"), 30)]
    never = MechanismLearner(MechanismConfig(iterations=0), gates, [], 0)
    kept = never.network.change[-1].weight.detach().clone()
    never.conclude()
    assert torch.equal(never.network.change[-1].weight, kept), "nothing to learn from"


def test_later_actions_do_not_change_what_was_believed(gates: list[LabelledTrace]) -> None:
    trace = gates[0].trace
    net = MechanismNet(MechanismNetConfig())
    early, late = explanation_graph(trace.first(10), [10]), explanation_graph(trace, [10, 30])
    one, two = (parents_of(net(Batch.from_data_list([each]))[0], each) for each in (early, late))
    assert torch.allclose(one[:, 0], two[:, 0], atol=1e-5) and not torch.allclose(two[:, 0], two[:, 1], atol=1e-2)


@pytest.mark.long
def test_it_learns_from_what_is_seen_later_alone(gates: list[LabelledTrace]) -> None:
    boards = [LabelledTrace(board.trace, board.world) for board in gates]
    graph = boards[0].graph([5, 30])
    assert "right" not in graph["explanation"] and "changed" not in graph["responder"], "nothing true is there"
    found = evidence_of(boards[0].trace, explanations_of(boards[0].trace), [5, 30]).explanations[..., EITHER]
    later = graph["explanation"].later.view(*found.shape)
    assert torch.allclose(later[..., 0], SCALE * (found[..., 1] - found[..., 0]), atol=1e-4) and not later[..., 1].any()
    config = MechanismConfig(iterations=60, batch=4, labels="pictures", net=MechanismNetConfig(changes=False))
    learner = MechanismLearner(config, boards[:5], boards[5:], 0)
    before = learner.judge()["loss"]
    for iteration in range(60):
        learner.iterate(iteration)
    assert learner.judge()["loss"] < before - 0.1


def test_masked_links_explain_nothing(gates: list[LabelledTrace]) -> None:
    """Of two boards in a batch each masks its own; what reads no hidden link stays as probable as others leave it."""
    graph = Batch.from_data_list([LabelledTrace(one.trace, one.world).graph([5, 30]) for one in gates[:2]])
    node, links = graph["explanation"], graph["input"].link.clone()
    source, target = graph["explanation", "reads", "candidate"].edge_index
    read = graph["candidate", "is", "input"].edge_index[1][target]
    possible = node.possible.clone()
    mask_links(graph, 0.0, np.random.default_rng(0))
    assert torch.equal(node.possible, possible)
    mask_links(graph, 0.5, np.random.default_rng(0))
    kept = torch.unique(read[node.possible[source].any(1)])  # the inputs that anything still reads
    hidden = links.index_fill(0, kept, False)
    assert 0 < int(hidden.sum()) < int(links.sum()) and (~hidden | links).all()
    reads_hidden = torch.zeros_like(possible).index_fill(0, source[hidden[read]], True)
    assert torch.equal(node.possible, possible & ~reads_hidden)
    with torch.no_grad():
        said = MechanismNet(MechanismNetConfig(changes=False))(graph)[0]
    assert float(said[reads_hidden].max()) < -1e3


@pytest.mark.parametrize(("labels", "masks"), [("parents", False), ("pictures", True)])
def test_links_are_masked_where_pictures_alone_teach(
    gates: list[LabelledTrace], monkeypatch: pytest.MonkeyPatch, labels: Literal["parents", "pictures"], masks: bool
) -> None:
    asked: list[float] = []
    monkeypatch.setattr(learner, "mask_links", lambda graph, share, rng: asked.append(share))
    boards = gates[:2] if labels == "parents" else [LabelledTrace(one.trace, one.world) for one in gates[:2]]
    config = MechanismConfig(labels=labels, masked=0.3, net=MechanismNetConfig(changes=False))
    MechanismLearner(config, boards, [], 0).iterate(0)
    assert asked == [0.3] * masks


@pytest.mark.long
def test_what_is_kept_on_the_shelf_is_what_was_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learner, "SHELF", 20)
    shelf, given = Shelf(), [torch.randn(*shape) for shape in ((2, 3), (4,), (0, 5), (7, 3), (1, 1))]
    kept = [shelf.kept(values) for values in given]
    assert all(torch.equal(one, values.half()) for one, values in zip(kept, given, strict=True))


def test_drawn_boards_are_none_that_anybody_generates_with_the_same_seed() -> None:
    library = find("procedural")
    drawn = {board.digest() for board, _ in draw_boards("gates", 8, 3, library, 1)}
    generated = generate_boards(BoardConfig(world="gates", boards=8, seed=3, group_size=1), library)
    assert len(drawn) == 8 and drawn.isdisjoint(board.digest() for board in generated)


def test_it_learns_and_goes_on_where_it_was_stopped(gates: list[LabelledTrace], tmp_path: Path) -> None:
    def trained(folder: str, iterations: int) -> MechanismLearner:
        config = MechanismConfig(iterations=30, batch=4)
        config = config.model_copy(update={"loop": config.loop.model_copy(update={"judge": 10})})
        learner = MechanismLearner(config, gates[:5], gates[5:], 0)
        learner.iterations = iterations
        fit(learner, tmp_path / folder, config.loop)
        return learner

    whole = trained("whole", 30)
    trained("parts", 10)
    parts = trained("parts", 30)
    for one, two in zip(whole.network.parameters(), parts.network.parameters(), strict=True):
        assert torch.equal(one, two)
    judged = list(draw("gates", 2, JUDGED_SEED, find("procedural")))
    rows = compare(whole.network.eval(), judged, 0)
    assert set(rows) == {str(after) for after in JUDGED_AFTER}
    assert rows["30"]["bound"]["share"] > 0.8 and rows["30"]["network"]["share"] > rows["4"]["network"]["share"]


def test_without_a_board_on_which_anything_was_done_there_is_nothing_to_train_on() -> None:
    with pytest.raises(BusybotError, match="no board is left to train on"):
        MechanismLearner(MechanismConfig(labels="pictures"), [], [], 0).iterate(0)


def test_early_moments_are_learned_from_as_if_recordings_ended_there(gates: list[LabelledTrace]) -> None:
    """Links that move later only explain nothing yet, and are none of the parents; one that ended is alike."""
    board = gates[0]
    assert board.parents is not None and board.changed is not None
    after, links = (0, 2, 30), board.trace.links
    graph = board.graph(after)
    node = graph["explanation"]
    source, target = graph["explanation", "reads", "candidate"].edge_index
    read = graph["candidate", "is", "input"].edge_index[1][target]
    for moment, actions in enumerate(after):
        moved = (links[: actions + 1] != links[0]).any(0)
        unknown = torch.from_numpy(~np.pad(moved, (0, board.trace.responders.shape[1]), constant_values=True))
        assert not node.possible[source[unknown[read]], moment].any()
        told = torch.zeros(graph["responder"].num_nodes, dtype=torch.bool)
        told[graph["explanation", "explains", "responder"].edge_index[1][node.right[:, moment]]] = True
        assert told.all(), "something is right of each responder"
        assert not (node.right[:, moment] & ~node.possible[:, moment]).any()
    first = links.shape[1] - int((links[:3] != links[0]).any(0).sum())
    assert first > 0 and node.possible[:, 2].sum() > node.possible[:, 1].sum() > node.possible[:, 0].sum()
    seen = links[:3] != links[0]
    known = replace(
        board,
        trace=replace(
            board.trace.first(2),
            links=board.trace.links[:3, seen.any(0)],
            sizes=tuple(np.array(board.trace.sizes)[seen.any(0)].tolist()),
        ),
        parents=board.parents[:2, np.pad(seen.any(0), (0, board.trace.responders.shape[1]), constant_values=True)],
        changed=board.changed[:2],
    )
    net = MechanismNet(MechanismNetConfig())
    ended, early = Batch.from_data_list([known.graph([2])]), Batch.from_data_list([board.graph([2])])
    loss = [float(learner.loss_of(net, each, 0.3, 1.0).detach()) for each in (ended, early)]
    assert loss[0] == pytest.approx(loss[1], rel=1e-3), "the links of which nobody knows are as good as not there"
