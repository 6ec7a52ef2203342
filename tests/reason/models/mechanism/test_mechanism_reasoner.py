"""The `mechanism` model as a reasoner: traces as pictures show them, labels, prediction and what might have been."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch

from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import Rewiring
from busybot.boards.worlds import links_of
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.objects.resolve import find
from busybot.reason.inputs.board_dataset import RecordedBoards
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.inputs.trigger_links import ObservedLinks, numbered
from busybot.reason.models.base import Imagining, believed
from busybot.reason.models.mechanism import contexts
from busybot.reason.models.mechanism.config import Blur, MechanismConfig, MechanismNetConfig
from busybot.reason.models.mechanism.contexts import (
    LUCK,
    MEMORIES,
    MISTAKE,
    NOW,
    STATES,
    UNRELIABLE,
    Trace,
    contexts_of,
    explanations_of,
    goals,
)
from busybot.reason.models.mechanism.laws import Moment
from busybot.reason.models.mechanism.networks import MechanismNet
from busybot.reason.models.mechanism.perception import BACK, perceive
from busybot.reason.models.mechanism.reasoner import AT_ONCE, NOWHERE, MechanismReasoner, _together, _Understood
from busybot.reason.models.mechanism.training.labelled import draw_boards, labelled
from busybot.reason.models.mechanism.training.learner import _looked_at
from busybot.reason.models.mechanism.unseen import Touched
from busybot.reason.models.registry import reasoner_of
from tests.reason.worlds import SWITCHES, looks_of, play, relation
from tests.reason.worlds import sequence_of as symbolic_sequence

XOR = relation("gate", SWITCHES, 1, (0, 1, 1, 0), function="xor")
FOLLOWS = relation("one-to-one", (3,), 2, (1, 0))
PRESSES = [0, 3, 0, 3, 3, 0, 0, 3, 0, 3, 3, 0, 3, 0, 0, 3, 0, 3]


@pytest.fixture(scope="module")
def watched() -> BoardSequence:
    """A board of two switches: their exclusive or decides the lamp 1, the second the door 2, nothing the toy 4."""
    episode = play([XOR, FOLLOWS], PRESSES)
    seen = symbolic_sequence(episode)
    clusters = np.array([SWITCHES.index(pressed) for pressed in PRESSES])
    states = np.array([episode.steps[0].trigger_states_before, *(one.trigger_states_after for one in episode.steps)])
    directions = np.zeros((STATES, STATES, 3))
    directions[0, 1], directions[1, 0] = seen.actions[0, 3:], -seen.actions[0, 3:]
    places = np.array([seen.actions[clusters == link, :2].mean(0) for link in range(2)])

    def watch(steps: int) -> ObservedLinks:
        return ObservedLinks(clusters[:steps], states[: steps + 1], np.array(SWITCHES), places, (directions,) * 2)

    values = seen.arrays | {"watch": watch}
    return BoardSequence(**values)


class Right(MechanismNet):
    """Knows the explanations that are right."""

    wanted: Sequence[tuple[list[int], str]] = (([0, 1], "late 0"), ([1], "late 0"), ([], "none"))
    """Inputs and memory, for each responder."""

    def __init__(self, unseen: bool = False) -> None:
        super().__init__(MechanismNetConfig(unseen=unseen))

    def forward(self, graph):  # type: ignore[no-untyped-def]
        count, moments = graph["explanation"].num_nodes // 3, graph["explanation"].evidence.shape[1]
        found = graph["explanation", "reads", "candidate"].edge_index
        inputs = torch.zeros(3 * count, 5, dtype=torch.bool)
        inputs[found[0], found[1] % 5] = True
        shares = torch.full((3 * count, moments), math.log(1e-9))
        kinds = graph["explanation"].kind % len(MEMORIES)
        for responder, (read, memory) in enumerate(self.wanted):
            right = torch.zeros(5, dtype=torch.bool)
            right[read] = True
            rows = torch.arange(3 * count) // count == responder
            [row] = torch.nonzero(rows & (inputs == right).all(1) & (kinds == MEMORIES.index(memory))).tolist()
            shares[row] = 0.0
        return shares, shares, None


def test_what_it_understands_is_told_as_a_graph(watched: BoardSequence) -> None:
    graph = MechanismReasoner(Right(), "embedded").graph(watched)
    claimed = graph.claimed(len(PRESSES))
    assert {(int(i), int(j)) for i, j in zip(*np.nonzero(claimed), strict=True)} == {(0, 1), (3, 1), (3, 2)}
    assert graph.links is not None and graph.kinds is not None and graph.lags is not None
    assert (graph.links.after(len(PRESSES)) > 0.5).tolist() == [
        [False, True, False, False, False],
        [False, True, True, False, False],
    ]
    assert (
        graph.kinds[1:3] == ("gate", "one-to-one") and graph.kinds[4] == "rest" and graph.lags[1:3].tolist() == [0, 0]
    )
    assert len(graph.probabilities) == len(PRESSES)


def test_links_that_nobody_saw_moving_count_for_pairs_of_triggers_and_responders_alone(watched: BoardSequence) -> None:
    """Both switches are sure to decide the lamp 1, the second one the door 2; what the other pairs gain is what the
    network makes of them."""
    watched = replace(watched, positions=np.ones_like(watched.positions))  # all of them show
    net = Right(unseen=True)
    assert net.unseen is not None
    with torch.no_grad():
        net.unseen.weight += torch.randn(net.unseen.weight.shape, generator=torch.Generator().manual_seed(1))
    reasoner, without = MechanismReasoner(net, "embedded"), MechanismReasoner(Right(), "embedded").graph(watched)
    graph = reasoner.graph(watched)
    differs = (abs(graph.probabilities - without.probabilities) > 1e-4).any(0)
    assert {(int(i), int(j)) for i, j in zip(*np.nonzero(differs), strict=True)} == {(0, 2), (0, 4), (3, 4)}
    perceived = perceive(watched, "embedded")
    found, shares, _ = reasoner.explain(perceived.trace, range(len(PRESSES) + 1))
    with torch.no_grad():
        told = net.unseen(Touched.of(watched, perceived).pairs(range(len(PRESSES) + 1), shares, found.inputs), 0)
    np.testing.assert_allclose(graph.probabilities[:, [0, 3]][:, :, [1, 2, 4]], told[1:], atol=1e-6)
    assert graph.links is not None and without.links is not None
    np.testing.assert_array_equal(graph.links.after(9), without.links.after(9))


class Boards:
    """A recorded board, one of whose mechanisms changed after nine actions: then the first switch moves the door."""

    def __init__(self, sequence: BoardSequence):
        episode = play([XOR, FOLLOWS], PRESSES)
        changed = (Rewiring(step=9, relation=relation("one-to-one", (0,), 2, (1, 0))),)
        self._sequence = sequence
        self._episode = replace(episode, board=episode.board.model_copy(update={"rewirings": changed}))

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: int) -> BoardSequence:
        return replace(self._sequence, positions=np.ones_like(self._sequence.positions))

    def episode(self, index: int) -> Episode:
        return self._episode

    def file(self, index: int) -> Path:
        return Path("episodes/000007.mcap")


def test_what_links_decide_that_nobody_saw_moving_is_learned_from_parts_of_recordings(watched: BoardSequence) -> None:
    """Each shows what it shows by itself; the mechanism that decides at its end is the true one."""
    told: list[int] = []
    [board] = _looked_at(cast(RecordedBoards, Boards(watched)), MechanismConfig(), True, told.append)
    assert told == [1] and board.actions == len(PRESSES)
    ended = [len(part.touched.acted) for part in board.triggers]
    assert ended == [0, 3, 6, 10, 16] and [len(part.touched.trace.links) - 1 for part in board.triggers] == ended
    assert [part.touched.triggers.tolist() for part in board.triggers] == [[0, 3]] * 5
    before, after = [[1, 0, 0], [1, 1, 0]], [[1, 1, 0], [1, 0, 0]]
    assert [part.deciding.tolist() for part in board.triggers] == [before, before, before, after, after]
    [whole] = _looked_at(cast(RecordedBoards, Boards(watched)), MechanismConfig(), False, told.append)
    assert not whole.triggers


def test_a_board_on_which_nobody_acted_or_nothing_responds_teaches_nothing(watched: BoardSequence) -> None:
    told: list[int] = []
    for sequence in (watched.first(1), replace(watched, responders=np.zeros_like(watched.responders))):
        boards = cast(RecordedBoards, Boards(sequence))
        assert not list(_looked_at(boards, MechanismConfig(), True, told.append))
    assert told == [1, 1]


def test_labels_that_nobody_has_are_not_learned_from(watched: BoardSequence) -> None:
    boards = Boards(watched)
    boards._episode = replace(
        boards._episode, board=boards._episode.board.model_copy(update={"relations_known": False})
    )
    unknown = cast(RecordedBoards, boards)
    with pytest.raises(BusybotError, match="000007.mcap: nobody knows") as told:
        list(_looked_at(unknown, MechanismConfig(), False, lambda done: None))
    assert "labels=pictures" in str(told.value.hint)
    [board] = _looked_at(unknown, MechanismConfig(labels="pictures"), False, lambda done: None)
    assert board.parents is None


def test_what_is_believed_at_the_end_is_told_without_the_rest(watched: BoardSequence) -> None:
    watched = replace(watched, positions=np.ones_like(watched.positions))
    for steps in (0, 5, len(PRESSES)):
        reasoner = MechanismReasoner(Right(unseen=True), "embedded")
        told, whole = believed(reasoner, watched.first(steps + 1)), reasoner.graph(watched.first(steps + 1))
        assert len(told.probabilities) == 1 and told.kinds == whole.kinds and told.words is None
        np.testing.assert_allclose(told.after(steps), whole.after(steps), atol=1e-6)
        assert told.links is not None and whole.links is not None
        np.testing.assert_allclose(told.links.after(steps), whole.links.after(steps), atol=1e-6)


def test_before_anything_was_done_there_is_the_prior_alone(watched: BoardSequence) -> None:
    seen = watched.first(1)
    for unseen in (False, True):
        graph = MechanismReasoner(Right(unseen), "embedded").graph(seen)
        assert len(graph.probabilities) == 1


def test_many_moments_are_weighed_as_each_by_itself(watched: BoardSequence) -> None:
    torch.manual_seed(0)
    reasoner, trace = (
        MechanismReasoner(MechanismNet(MechanismNetConfig()), "embedded"),
        perceive(watched, "embedded").trace,
    )
    after = range(len(PRESSES) + 1)
    assert len(after) > AT_ONCE
    _, shares, changed = reasoner.explain(trace, after)
    singly = [reasoner.explain(trace, [one])[1:] for one in after]
    np.testing.assert_allclose(shares, np.concatenate([one for one, _ in singly], 2), atol=1e-5)
    assert changed is not None
    np.testing.assert_allclose(changed, np.concatenate([one for _, one in singly if one is not None], 1), atol=1e-5)


def test_it_says_what_follows_and_what_would_have_followed(watched: BoardSequence) -> None:
    reasoner = MechanismReasoner(Right(), "embedded")
    assert isinstance(reasoner, Imagining)
    for known in (12, 15):
        told = reasoner.predict(
            watched.first(known + 1),
            watched.features[known][None],
            watched.actions[known][None],
            watched.acted[known][None],
        )
        np.testing.assert_allclose(told[0], watched.features[known + 1], atol=1e-5)
    after = 10
    asked = slice(after, after + 5)
    told = reasoner.what_if(watched, np.array([after]), watched.actions[None, asked], watched.acted[None, asked])
    np.testing.assert_allclose(told[0], watched.features[after + 1 : after + 6], atol=1e-5)


def test_what_might_have_been_has_the_luck_of_what_was(watched: BoardSequence) -> None:
    """The toy, which nothing decides, showed another look for two frames. Had the first switch not been moved it would
    have, too; after the recording that is not expected again."""
    features = watched.features.copy()
    features[8:10, 4], features[:8, 4] = features[0, 1] + 1, features[0, 1]
    features[10:, 4] = features[0, 1]
    reasoner, seen = MechanismReasoner(Right(), "embedded"), replace(watched, features=features)
    actions, acted = seen.actions[None, 6:10].copy(), seen.acted[None, 6:10].copy()
    for moved in (True, False):
        actions[0, 0], acted[0, 0] = (seen.actions[6], seen.acted[6]) if moved else (np.zeros(6), -1)
        told = reasoner.what_if(seen, np.array([6]), actions, acted)[0]
        np.testing.assert_allclose(told[:, 4], features[7:11, 4], atol=1e-5)
        assert np.allclose(told[0, 1], features[7, 1], atol=1e-5) == moved, "the lamp follows the switches"
    after = reasoner.what_if(seen, np.array([seen.steps]), actions, acted)[0]
    np.testing.assert_allclose(after[:, 4], features[[0] * 4, 4], atol=1e-5)


def test_what_happened_while_something_hid_a_responder_is_not_taken_for_what_was_seen(watched: BoardSequence) -> None:
    """The lamp is the exclusive or of two switches; while it was hidden it seems to stay as it was."""
    reasoner = MechanismReasoner(Right(), "embedded")
    known = reasoner._understand(watched)
    at = 1 + int(np.flatnonzero(known.trace.responders[1:, 0] != known.trace.responders[:-1, 0])[-1])
    hidden = np.zeros(known.trace.responders.shape, bool)
    hidden[at, 0] = True
    stale = known.trace.responders.copy()
    stale[at, 0] = stale[at - 1, 0]
    behind = replace(
        known, perceived=replace(known.perceived, trace=replace(known.trace, responders=stale, hidden=hidden))
    )
    contexts, before = known.found.contexts[at], known.trace.responders[at - 1]
    assert behind.following(contexts, before, at)[0] == known.trace.responders[at, 0] != stale[at, 0]


def test_before_anything_was_done_all_pairs_are_alike(watched: BoardSequence) -> None:
    torch.manual_seed(0)
    reasoner = MechanismReasoner(MechanismNet(MechanismNetConfig()), "embedded")
    graph = reasoner.graph(watched.first(1))
    assert graph.probabilities.shape == (1, 5, 5)
    of_triggers = np.outer(watched.triggers, watched.responders)
    of_responders = np.outer(watched.responders, watched.responders) & ~np.eye(5, dtype=bool)
    for pairs in (of_triggers, of_responders):
        assert 0 < graph.probabilities[0, pairs].min() < 1 and np.ptp(graph.probabilities[0, pairs]) < 1e-6
    assert not graph.probabilities[0, ~of_triggers & ~of_responders].any()
    with pytest.raises(BusybotError, match="without pictures"):
        reasoner.graph(BoardSequence(**watched.arrays))


def test_labels_are_the_true_parents_of_links_that_were_seen(watched: BoardSequence) -> None:
    episode = play([XOR, FOLLOWS], PRESSES)
    seen = labelled(episode, perceive(watched, "embedded"))
    assert seen.parents.shape == (len(PRESSES), 5, 3)
    np.testing.assert_array_equal(seen.parents[-1].T, [[1, 1, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 0, 0, 0]])


def test_drawn_boards_follow_their_law_as_pictures_would_show_them() -> None:
    library, clear = find("procedural"), Blur(**dict.fromkeys(Blur.model_fields, 0.0))
    for board, seen in draw_boards("gates", 3, 5, library, 25, clear):
        links = links_of([library.get(placed.key) for placed in board.objects])
        assert seen.trace.links.shape == (26, len(links.sizes)) and seen.trace.links[0].max() <= 1
        first = [placed.states for placed in board.objects if placed.states]
        true = np.array([state for states in first for state in states])
        top = np.array(links.sizes) - 1
        turned = np.where(true > top / 2, top - seen.trace.links, seen.trace.links)  # as the board has them
        law = Dynamics(board, links)
        states = law.run(turned.tolist())
        shown = np.array([[one for one in state.shown if one >= 0] for state in states])
        for told, column in zip(seen.trace.responders.T, shown.T, strict=True):
            assert len({*zip(told.tolist(), column.tolist(), strict=True)}) == len(set(told.tolist())), (
                "names of states"
            )


def test_what_is_rewired_is_another_mechanism_from_then_on() -> None:
    for board, seen in draw_boards("rewired", 3, 5, find("procedural"), 30):
        responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
        changed = {one.relation.responder: one.step for one in board.rewirings}
        assert changed and seen.world == "rewired"
        for index, column in zip(responders, seen.changed.T, strict=True):
            assert column.tolist() == [action >= changed.get(index, 30) for action in range(30)]


def test_a_world_is_heard_where_it_was_learned_and_forgotten_where_it_was_not(watched: BoardSequence) -> None:
    torch.manual_seed(0)
    reasoner = MechanismReasoner(MechanismNet(MechanismNetConfig(worlds=("gates", "time"))), "embedded")
    told = {name: reasoner.graph(replace(watched, world=name)) for name in ("", "gates", "time", "chance")}
    assert np.array_equal(told[""].probabilities, told["chance"].probabilities)
    assert len({one.probabilities.tobytes() for one in told.values()}) == 3
    assert told["time"].changed is not None and 0 < told["time"].changed[:, [1, 2, 4]].min() < 1


def test_a_link_that_is_not_seen_to_move_is_felt(watched: BoardSequence) -> None:
    whole = perceive(watched, "embedded")
    links = whole.links

    def watch(steps: int) -> ObservedLinks:
        clusters = np.where(links.clusters == 1, -1, links.clusters)
        return ObservedLinks(
            clusters[:steps], links.states[: steps + 1, :1], links.owners[:1], links.places[:1], links.directions[:1]
        )

    felt = perceive(replace(watched, watch=watch), "embedded")
    np.testing.assert_array_equal(felt.trace.links, whole.trace.links)
    np.testing.assert_array_equal(felt.links.clusters, links.clusters)
    assert felt.links.owners.tolist() == links.owners.tolist() and felt.trace.sizes == whole.trace.sizes
    np.testing.assert_allclose(felt.links.directions[1], links.directions[1], atol=1e-6)
    still = replace(watched, watch=watch, features=np.repeat(watched.features[:1], len(watched.features), 0))
    assert len(perceive(still, "embedded").links.owners) == 1, "what has no effects is held"


def test_another_recording_is_not_answered_from_memory(watched: BoardSequence) -> None:
    reasoner = MechanismReasoner(Right(), "embedded")
    asked = (watched.features[-1][None], watched.actions[-1][None], watched.acted[-1][None])
    before = reasoner.predict(watched, *asked)
    replaced = replace(watched, features=watched.features[:, ::-1].copy())
    assert not np.array_equal(reasoner.predict(replaced, *asked), before)
    np.testing.assert_array_equal(
        reasoner.predict(replaced, *asked), MechanismReasoner(Right(), "embedded").predict(replaced, *asked)
    )


def test_models_that_share_a_recording_tell_what_each_tells_alone(watched: BoardSequence) -> None:
    def told(reasoner: MechanismReasoner, seen: BoardSequence) -> list[np.ndarray]:
        graphs = [reasoner.graph(seen.first(images)).probabilities for images in (len(PRESSES) + 1, 6)]
        asked = (watched.features[-2:], watched.actions[-2:], watched.acted[-2:])
        return [*graphs, *(reasoner.predict(seen.first(images), *asked) for images in (6, len(PRESSES) + 1))]

    torch.manual_seed(0)
    models = [MechanismReasoner(MechanismNet(MechanismNetConfig()), "embedded") for _ in range(2)]
    for model in models:
        for together, alone in zip(told(model, watched), told(model, replace(watched)), strict=True):
            np.testing.assert_array_equal(together, alone)


def test_mechanisms_are_told_in_words(watched: BoardSequence) -> None:
    graph = MechanismReasoner(Right(), "embedded").graph(watched)
    assert graph.words == (
        "",
        "changes whenever object 0 or object 3 is moved",
        "follows object 3",
        "",
        "nothing moves it",
    )


def test_parents_are_told_together(watched: BoardSequence) -> None:
    graph = MechanismReasoner(Right(), "embedded").graph(watched)
    assert graph.parent_sets is not None and graph.links is not None
    assert [len(sets) > 0 for sets in graph.parent_sets] == [False, True, True, False, True]
    for responder in (1, 2, 4):
        sets, single = graph.parent_sets[responder], graph.links.after(watched.steps)[:, responder]
        told = np.array([one.probability for one in sets])
        assert (np.diff(told) <= 0).all() and told.min() >= 0.01 and told.sum() == pytest.approx(1, abs=0.05)
        for link, sure in enumerate(single):
            named = sum(one.probability for one in sets if link in one.links)
            assert named == pytest.approx(sure, abs=0.05)
    both, alone, none = (graph.parent_sets[responder][0] for responder in (1, 2, 4))
    assert len(both.links) == 2 and len(alone.links) == 1 and none.links == none.objects == ()
    assert MechanismReasoner(Right(), "embedded").graph_at_the_end(replace(watched)).parent_sets is None


def test_where_nothing_was_seen_moving_nothing_is_foretold(watched: BoardSequence) -> None:
    def watch(steps: int) -> ObservedLinks:
        return ObservedLinks(
            np.full(steps, -1), np.zeros((steps + 1, 0), int), np.zeros(0, int), np.zeros((0, 2)), directions=()
        )

    still = replace(watched, watch=watch, features=np.repeat(watched.features[:1], len(watched.features), 0))
    reasoner = reasoner_of("mechanism")
    told = reasoner.predict(still, still.features[-1][None], still.actions[-1][None], still.acted[-1][None])
    np.testing.assert_array_equal(told[0], still.features[-1])
    graph = reasoner.graph(still)
    assert graph.words is not None and set(graph.words) == {"", "nothing moves it"}
    assert not graph.claimed(still.steps).any() and graph.links is not None and not len(graph.links.after(1))


@pytest.mark.parametrize("there", [("trigger",), ("responder",), ()])
@pytest.mark.parametrize("actions", [0, len(PRESSES)])
@pytest.mark.parametrize("steadied", [False, True])
def test_boards_that_lack_triggers_or_responders_are_answered(
    watched: BoardSequence, there: tuple[str, ...], actions: int, steadied: bool
) -> None:
    kept = np.zeros(len(watched.triggers), bool)
    for role, own in (("trigger", watched.triggers), ("responder", watched.responders)):
        kept |= own & (role in there)

    def watch(steps: int, effects: tuple[bool, ...] | None = None) -> ObservedLinks:
        links = ObservedLinks(
            np.full(steps, -1), np.zeros((steps + 1, 0), int), np.zeros(0, int), np.zeros((0, 2)), directions=()
        )
        if "trigger" in there:
            links = replace(watched.watch(steps), owners=np.arange(2))
        return replace(links, steadied=steadied)

    acted = np.where(watched.acted == SWITCHES[1], 1, watched.acted) if "trigger" in there else watched.acted * 0 - 1
    seen = BoardSequence(
        watched.features[:, kept], watched.positions[kept], watched.actions, acted, watched.triggers[kept],
        watched.responders[kept], watch=watch,
    ).first(actions + 1)  # fmt: skip
    reasoner = MechanismReasoner(MechanismNet(MechanismNetConfig(unseen=True, rising=True, unsteady=True)), "embedded")
    graph, current = reasoner.graph(seen), seen.features[-1]
    assert np.isfinite(graph.probabilities).all() and graph.probabilities.shape[1:] == (kept.sum(),) * 2
    told = reasoner.predict(seen, current[None], watched.actions[:1], acted[:1])
    assert told.shape == (1, *current.shape) and np.isfinite(told).all()
    assert np.isfinite(reasoner.expected_information(seen, watched.actions[:3], acted[:3])).all()
    tries = [[0]] if actions else []
    now = reasoner.released(seen, tries)
    then = reasoner.released(seen, tries, watched.actions[:3], acted[:3])
    assert now.shape == (len(tries),) and then.shape == (3, len(tries))
    assert ((now >= 0) & (now <= 1)).all() and ((then >= 0) & (then <= 1)).all()
    assert 0 <= reasoner.certainty(seen) <= 1


def test_what_a_hand_hides_before_a_real_camera_tells_nothing(watched: BoardSequence) -> None:
    """The lamp behind it keeps its look to the last bit; before a still camera equal looks are what nothing changed."""
    hidden, noise = slice(7, 9), np.random.default_rng(0).normal(0, 1e-3, watched.features.shape).astype(np.float32)
    features = np.where(watched.responders[:, None], watched.features + noise, 0)
    features[hidden, 1] = features[hidden.start - 1, 1]
    looks = {"features": features, "watch": lambda steps, effects=None: replace(watched.watch(steps), steadied=True)}
    seen = BoardSequence(**watched.arrays | looks)
    trace = perceive(seen, "embedded").trace
    assert trace.hidden is not None and np.argwhere(trace.hidden).tolist() == [[7, 0], [8, 0]]
    reasoner = MechanismReasoner(Right(), "embedded")
    assert (reasoner._understand(seen).at()[0] == trace.seen.T).all(), "no mechanism is told by it"
    before = perceive(seen.first(9), "embedded").trace
    assert before.hidden is not None and before.hidden.tolist() == trace.hidden[:9].tolist()
    still = BoardSequence(**watched.arrays | {"features": features, "watch": watched.watch})
    assert perceive(still, "embedded").trace.hidden is None


def test_a_link_may_go_on_to_where_it_was_never_seen_as_long_as_that_was_not_tried(watched: BoardSequence) -> None:
    """Each switch was seen in two states: what is on beyond tells more than the way back, less with each vain try."""
    reasoner = MechanismReasoner(Right(), "embedded")
    trace, last = perceive(watched, "embedded").trace, PRESSES.index(0)
    up = trace.links[-1, 0] == 1
    on = watched.actions[last] * (1 if up else BACK)
    actions, acted = np.stack([on, on * BACK]), np.zeros(2, int)
    beyond, back = reasoner.expected_information(watched, actions, acted)
    assert beyond > 0.1 > back >= 0
    before = [int(np.flatnonzero((trace.responders[:-1] != trace.responders[-1]).any(1))[0])]
    [may], then = reasoner.released(watched, [before]), reasoner.released(watched, [before], actions, acted)
    often = [
        press == 0 and state == trace.links[-1, 0] for press, state in zip(PRESSES, trace.links[:, 0], strict=False)
    ]
    tried = watched.actions.copy()
    tried[np.flatnonzero(often)[:2], 3:] = on[3:]  # which then went back, as recordings tell of what was done
    again = replace(watched, actions=tried)
    assert reasoner.expected_information(again, actions, acted) == pytest.approx([beyond * NOWHERE**2, back])
    vain = reasoner.released(again, [before], actions, acted)
    assert vain[0] == pytest.approx(may + NOWHERE**2 * (then[0] - may)) and vain[1] == then[1]


@pytest.mark.parametrize("seed", range(20))
def test_plans_and_predictions_foretell_the_same(seed: int) -> None:
    """Of a function of two links, three states at most, some of whose combinations were never met."""
    rng = np.random.default_rng(seed)
    links = np.cumsum(np.eye(2, dtype=int)[rng.integers(2, size=rng.integers(4, 12))], 0) % 2
    shown = numbered(rng.integers(3, size=4)[links @ [1, 2]])[:, None]
    trace = Trace(links, shown, (2, 2))
    found = explanations_of(trace)
    [row] = np.flatnonzero((found.inputs == [True, True, False]).all(1) & (found.memory == NOW))
    sure = np.eye(len(found.own))[[row]]
    known = _Understood(SimpleNamespace(trace=trace), found, sure, np.zeros(1, int), sure, np.zeros(2))  # type: ignore[arg-type]
    laws, start = known.laws(), Moment.new(links[-1], shown[-1])
    for states in product((0, 1), repeat=2):
        [contexts] = contexts_of(trace.longer(states, shown[-1]), 1)
        assert known.following(contexts, shown[-1]).tolist() == [*laws.expected(start, [states])[-1].shown]


def test_what_may_fail_goes_where_it_was_seen_going_or_staying() -> None:
    """One link, one responder that stayed twice and followed once: where luck is given it follows."""
    trace = Trace(np.array([[0], [1], [0], [1], [0], [1]]), np.array([[0], [0], [0], [0], [0], [1]]), (2,))
    found = explanations_of(trace)
    of_luck = found.memory == UNRELIABLE
    place = int(np.flatnonzero((found.inputs[of_luck].sum(1) == 1) & found.inputs[of_luck, 0])[0])
    told, met = goals(trace, found, found.contexts[-1])
    failed = (1 - LUCK) ** 2
    once = np.array([(1 - MISTAKE) ** 2 * MISTAKE, failed * LUCK])  # it was there all the time, or went there
    np.testing.assert_allclose(told[0, place], [*once / once.sum(), 0], atol=1e-9)
    resting, _ = goals(trace, found, found.contexts[0])
    always = np.array([(1 - MISTAKE) ** 3, MISTAKE * failed])
    np.testing.assert_allclose(resting[0, place], [*always / always.sum(), 0], atol=1e-9)
    late = goals(trace, found, found.contexts[-1], np.arange(6)[None] >= 5)[0][0, place]
    np.testing.assert_allclose(late, [MISTAKE / (MISTAKE + LUCK), LUCK / (MISTAKE + LUCK), 0])
    assert met[0, place] and not goals(trace, found, found.contexts[-1] + 100)[1].any()


def exchanged(first: np.ndarray, then: np.ndarray, links: np.ndarray, since: int, memory: str) -> _Understood:
    """One responder, which two links decide; another function of them from a moment on."""
    shown = np.where(np.arange(len(links)) < since, first, then)[:, None]
    trace = Trace(links, shown, (2, 2))
    found = explanations_of(trace)
    [row] = np.flatnonzero((found.inputs == [True, True, False]).all(1) & (found.memory == MEMORIES.index(memory)))
    shares = np.eye(len(found.own))[[row]]
    seen = SimpleNamespace(trace=trace)
    return _Understood(seen, found, shares, np.array([since]), shares * 0.9, np.zeros(2))  # type: ignore[arg-type]


def test_each_mechanism_of_a_responder_is_told_by_its_own_time() -> None:
    """An AND that was never seen to burn becomes an OR that was never seen dark."""
    links = np.array([[0, 0], [0, 1], [0, 0], [1, 0], *[[1, 1], [0, 1], [1, 1], [1, 0]] * 2])
    known = exchanged(links.min(1), links.max(1), links, 4, "late 0")
    short = exchanged(links[:11].min(1), links[:11].max(1), links[:11], 4, "late 0")
    assert short.at()[0].all() and not short.at(0)[0][:, 4:].any(), "few actions since tell too little alone"
    for moment, right in ((2, [0, 0, 0, 1]), (-1, [0, 1, 1, 1])):
        of, shares = known.at(moment)
        assert of.tolist() == [[(step >= 4) == (moment == -1) for step in range(12)]]
        assert shares.max() == (1 if moment == -1 else 0.9)
        laws = known.laws(moment)
        for way, state in zip(product((0, 1), repeat=2), right, strict=True):
            [contexts] = contexts_of(known.trace.longer(way, known.trace.responders[-1]), 1)
            told = known.following(contexts, np.array([1 - state]), None if moment < 0 else moment)
            if moment < 0 or tuple(links[moment]) != way:
                assert told.tolist() == [state], (moment, way)
            assert laws.expected(Moment.new((0, 0), (1 - state,)), [way])[-1].shown == (state,)


def test_what_failed_would_have_failed() -> None:
    """It went up at the second try; asked about the first one with the other link moved too, it stays."""
    links = np.array([[0, 0], [1, 0], [1, 1], [1, 1], [1, 1], [0, 1]])
    known = exchanged(np.array([0, 0, 0, 1, 1, 1]), np.zeros(6, int), links, 6, "own and now")
    [both] = contexts_of(known.trace.first(1).longer([1, 1], np.array([0])), 1)
    assert known.following(both, np.array([0])).tolist() == [1], "where luck is given"
    assert known.following(both, np.array([0]), 2).tolist() == [0], "it failed then"
    assert known.following(both, np.array([0]), 3).tolist() == [1]


def test_what_no_link_moves_and_always_changes_together_has_a_clock() -> None:
    changed = np.array([[0, 0, 0], [0, 0, 0], [0, 1, 0], [1, 0, 1], [1, 0, 1], [1, 0, 1]], bool)
    alone = np.array([True, True, True, True, True, False])
    assert np.argwhere(_together(changed, alone)).tolist() == [[3, 4], [4, 3]], "not what rests or follows a link"
    assert not _together(np.zeros((2, 0), bool), np.ones(2, bool)).any(), "before the first action"


class ByThemselves(Right):
    """Believes that no link moves anything."""

    wanted = (([], "own"), ([], "own"), ([], "none"))


def test_what_would_not_fit_into_the_memory_is_refused_before_it_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def board(actions: int) -> Trace:
        return Trace(np.zeros((actions + 1, 6), int), np.zeros((actions + 1, 5), int), (2,) * 6)

    monkeypatch.setattr(contexts, "memory_limit", lambda: 2**30)
    assert explanations_of(board(60)).contexts.shape == (61, 301)
    with pytest.raises(
        BusybotError, match=r"200 actions on a board of 6 links that moved and 5 responders: .* 0.5, half"
    ):
        explanations_of(board(200))


def test_clocks_are_found_and_said(watched: BoardSequence) -> None:
    """The lamp 1 and the door 2 change at the same three moments; then the door once more, and has none."""
    shown = np.zeros((len(PRESSES) + 1, 5), int)
    for moment in (4, 9, 11):
        shown[moment:, 1:3] ^= 1
    kinds, words = [], []
    for _ in range(2):
        seen = replace(watched, features=looks_of(shown) * watched.responders[None, :, None])
        graph = MechanismReasoner(ByThemselves(), "embedded").graph(seen)
        kinds.append([graph.kinds[index] for index in (1, 2, 4)] if graph.kinds else [])
        words.append([graph.words[index] for index in (1, 2, 4)] if graph.words else [])
        shown[15:, 2] ^= 1
    assert kinds == [["clock", "clock", "rest"], ["flicker", "flicker", "rest"]]
    alone = "changes by itself"
    assert words[0] == [f"{alone}, together with object 2", f"{alone}, together with object 1", "nothing moves it"]
    assert words[1] == [alone, alone, "nothing moves it"]
