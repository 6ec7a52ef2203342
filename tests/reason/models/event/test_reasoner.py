"""The trained event model: what it finds, what it copies, and what must not matter to it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch_geometric.data import Batch

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.event import networks
from busybot.reason.models.event.config import EventConfig, EventNetConfig
from busybot.reason.models.event.data import board_graph, context_of, padded
from busybot.reason.models.event.learner import EventLearner
from busybot.reason.models.event.networks import EventNet, EventReasoner
from busybot.reason.models.lookup import Lookup
from tests.reason.boards import make_boards
from tests.reason.judging import score

FRESH = 500


@pytest.fixture(scope="module")
def trained() -> Iterator[EventReasoner]:
    threads = torch.get_num_threads()
    config = EventConfig(iterations=160, batch=24, learning_rate=6e-3, net=EventNetConfig(width=16, heads=2))
    learner = EventLearner(config, [board.seen for board in make_boards(200)], [], 0)
    for iteration in range(config.iterations):
        learner.iterate(iteration)
    yield EventReasoner(learner.network, "embedded")
    torch.set_num_threads(threads)


def predicted(reasoner: EventReasoner, sequence: BoardSequence, images: int = 23) -> np.ndarray:
    seen = sequence.first(images)
    later = slice(seen.steps, None)
    return reasoner.predict(seen, sequence.features[seen.steps : -1], sequence.actions[later], sequence.acted[later])


@pytest.mark.long
def test_it_finds_edges_and_predicts_steps_on_boards_that_it_never_saw(trained: EventReasoner) -> None:
    boards = make_boards(80, FRESH)
    found, looked_up = score(trained, boards), score(Lookup(), boards)
    assert found.precision > 0.98 and found.recall > 0.97
    assert found.right > looked_up.right + 0.05, "it learns which actions fail"
    assert found.right_changes > 0.9


def test_more_objects_than_in_training_are_no_matter(trained: EventReasoner) -> None:
    found = score(trained, make_boards(15, FRESH, triggers=6, responders=14, steps=60), images=50)
    assert found.precision > 0.97 and found.recall > 0.9 and found.right > 0.8


def test_every_predicted_look_is_a_copy(trained: EventReasoner) -> None:
    copied = 0
    for board in make_boards(10, FRESH):
        seen, current, acted = board.seen.first(23), board.seen.features[22:-1], board.seen.acted[22:]
        after = predicted(trained, board.seen)
        believed = trained.graph(seen).after(seen.steps)[acted]
        for step, index in np.argwhere((after != current).any(axis=-1)):
            assert believed[step, index] > 0.4, "only what the trigger controls changes"
            assert (after[step, index] == seen.features[:, index]).all(axis=1).any()
            copied += 1
    assert copied > 20


def test_probabilities_of_one_responder_leave_room_for_no_trigger(trained: EventReasoner) -> None:
    for board in make_boards(5, FRESH):
        graph = trained.graph(board.seen)
        assert graph.probabilities.shape == (30, *board.edges.shape) and graph.prior is not None
        assert graph.probabilities.min() >= 0 and graph.probabilities.sum(axis=1).max() <= 1 + 1e-6
        assert not graph.probabilities[:, ~board.seen.candidates].any()
        assert 0 < graph.prior[board.seen.candidates].max() < 0.9


def test_the_graph_after_some_steps_does_not_know_the_later_ones(trained: EventReasoner) -> None:
    board = make_boards(1, FRESH)[0]
    whole, part = trained.graph(board.seen), trained.graph(board.seen.first(11))
    np.testing.assert_allclose(whole.probabilities[:10], part.probabilities, atol=1e-5)


def test_graphs_of_all_steps_at_once_are_those_of_each(trained: EventReasoner, monkeypatch: pytest.MonkeyPatch) -> None:
    for board in make_boards(4, FRESH):
        known = context_of(Batch.from_data_list([board_graph(board.seen)]), trained.network.scale)
        alone = [trained.network.log_edges(known.first(steps))[0].exp().detach() for steps in range(1, 23)]
        graph = trained.graph(board.seen.first(23))
        told = graph.probabilities[:, board.seen.candidates]
        np.testing.assert_allclose(told, torch.stack(alone), rtol=1e-4, atol=1e-6)
        prior = trained.network.log_edges(known.first(0))[0].exp().detach()
        np.testing.assert_allclose(graph.after(0)[board.seen.candidates], prior, rtol=1e-4, atol=1e-6)
        with monkeypatch.context() as patch:
            patch.setattr(networks, "AT_ONCE", 1)
            one_by_one = trained.graph(board.seen.first(23)).probabilities[:, board.seen.candidates]
        np.testing.assert_allclose(told, one_by_one, rtol=1e-4, atol=1e-6)


def test_what_if_is_prediction_after_prediction(trained: EventReasoner) -> None:
    moved = 0
    for board in make_boards(6, FRESH):
        seen, steps = board.seen.first(23), np.array([0, 5, 22])
        chosen = np.array([[3, 7, 1, 7], [2, 2, 9, 4], [0, 6, 11, 12]])
        acted = np.where(chosen == 9, -1, seen.acted[chosen])
        told = trained.what_if(seen, steps, seen.actions[chosen], acted)
        current = seen.features[steps]
        for number in range(chosen.shape[1]):
            current = trained.predict(seen, current, seen.actions[chosen[:, number]], acted[:, number])
            np.testing.assert_array_equal(told[:, number], current)
        moved += int((told[:, 1:] != told[:, :-1]).any(-1).sum())
    assert moved > 10


def test_axes_of_the_features_do_not_matter(trained: EventReasoner) -> None:
    """Another order and other signs of the 256 numbers: the same graph, the same predictions."""
    rng = np.random.default_rng(0)
    order, signs = rng.permutation(256), rng.choice([-1, 1], 256).astype(np.float32)
    for board in make_boards(4, FRESH):
        turned = replace(board.seen, features=board.seen.features[..., order] * signs)
        graphs = [trained.graph(seen).probabilities for seen in (board.seen, turned)]
        np.testing.assert_allclose(graphs[0], graphs[1], atol=1e-4)
        np.testing.assert_array_equal(predicted(trained, board.seen)[..., order] * signs, predicted(trained, turned))


def test_the_order_of_objects_does_not_matter(trained: EventReasoner) -> None:
    for board in make_boards(4, FRESH):
        seen, count = board.seen, len(board.seen.triggers)
        order = np.random.default_rng(1).permutation(count)
        place = np.argsort(order)
        shuffled = BoardSequence(
            seen.features[:, order],
            seen.positions[order],
            seen.actions,
            place[seen.acted],
            seen.triggers[order],
            seen.responders[order],
        )
        graph, other = trained.graph(seen).probabilities, trained.graph(shuffled).probabilities
        np.testing.assert_allclose(graph[:, order][:, :, order], other, atol=1e-5)
        np.testing.assert_array_equal(predicted(trained, seen)[:, order], predicted(trained, shuffled))


def test_a_quarter_turn_of_the_board_does_not_matter(trained: EventReasoner) -> None:
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    for board in make_boards(4, FRESH):
        actions = np.concatenate([board.seen.actions[:, :3] @ turn, board.seen.actions[:, 3:] @ turn], axis=1)
        turned = replace(board.seen, positions=board.seen.positions @ turn, actions=actions)
        np.testing.assert_array_equal(predicted(trained, board.seen), predicted(trained, turned))


def test_a_miss_changes_nothing(trained: EventReasoner) -> None:
    board = make_boards(1, FRESH)[0]
    missed = replace(board.seen, acted=np.full(30, -1))
    np.testing.assert_array_equal(predicted(trained, missed), board.seen.features[22:-1])


@pytest.mark.parametrize("images", [1, 2])
def test_one_image_or_one_step_is_enough_to_answer(trained: EventReasoner, images: int) -> None:
    board = make_boards(1, FRESH)[0]
    graph = trained.graph(board.seen.first(images))
    assert graph.probabilities.shape[0] == 1 and np.isfinite(graph.probabilities).all()
    assert predicted(trained, board.seen, images).shape == (31 - images, len(board.edges), 256)
    seen, nothing = board.seen.first(images), np.zeros((2, 3), int)
    told = trained.what_if(seen, np.zeros(2, int), board.seen.actions[nothing], board.seen.acted[nothing])
    assert told.shape == (2, 3, len(board.edges), 256)
    nobody = np.zeros(0, int), board.seen.actions[nothing[:0]], board.seen.acted[nothing[:0]]
    assert trained.what_if(seen, *nobody).shape[:2] == (0, 3)


@pytest.mark.parametrize("without", ["triggers", "responders"])
def test_boards_without_triggers_or_responders_are_no_error(trained: EventReasoner, without: str) -> None:
    seen = make_boards(1, FRESH)[0].seen
    nobody = np.zeros(len(seen.triggers), bool)
    if without == "triggers":
        bare = replace(seen, triggers=nobody, acted=np.full(30, -1))
    else:
        bare = replace(seen, responders=nobody)
    assert not trained.graph(bare).probabilities.any()
    np.testing.assert_array_equal(predicted(trained, bare), bare.features[22:-1])
    steps, chosen = np.array([4]), np.array([[6, 7]])
    told = trained.what_if(bare, steps, bare.actions[chosen], bare.acted[chosen])
    np.testing.assert_array_equal(told, np.repeat(bare.features[steps, None], 2, 1))


def test_boards_of_different_sizes_and_lengths_share_a_batch() -> None:
    boards = [*make_boards(2, 1), *make_boards(1, 2, triggers=4, responders=9, steps=12)]
    network = EventNet(EventNetConfig(), 2.0).eval()
    torch.nn.init.normal_(network.edges.pair[-1].weight)
    alone = [network.log_edges(context_of(Batch.from_data_list([board_graph(b.seen)]), 2.0))[0] for b in boards]
    together = network.log_edges(context_of(Batch.from_data_list(padded(board_graph(b.seen) for b in boards)), 2.0))[0]
    assert [len(one) for one in alone][2] == 36
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-4, rtol=1e-4)
