"""Counting: which trigger explains a responder's changes, and how sure one may be."""

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.counting import CountConfig, count, count_changes
from busybot.reason.models.registry import infer
from tests.episodes.synthetic import make_episode, make_real_episode

TRIGGERS, RESPONDERS = np.array([0, 1]), np.array([2, 3])


def beliefs(steps: list[tuple[int, set[int]]], config: CountConfig | None = None) -> np.ndarray:
    """Probabilities after each of some steps (trigger acted on, objects that changed); objects 0, 1 are triggers."""
    changed = np.zeros((len(steps), 4), bool)
    for number, (_, objects) in enumerate(steps):
        changed[number, list(objects)] = True
    acted = np.array([trigger for trigger, _ in steps], int)
    return count_changes(changed, acted, TRIGGERS, RESPONDERS, config or CountConfig())


def edges(probabilities: np.ndarray) -> set[tuple[int, int]]:
    rows, columns = np.nonzero(probabilities[-1] >= 0.5)
    return {(int(i), int(j)) for i, j in zip(rows, columns, strict=True)}


def test_the_probability_after_one_change_follows_from_bayes_rule() -> None:
    """One step on trigger 0, after which 2 looks different and 3 does not. Rates: mean 1/2 and 1/101."""
    after = beliefs([(0, {2})], CountConfig(controlled=0.5, effect=(1, 1), noise=(1, 100)))[0]
    some, noise = 1 / 2, 1 / 101
    assert after[0, 2] == pytest.approx(0.25 * some / (0.25 * some + 0.75 * noise))
    assert after[1, 2] == pytest.approx(0.25 * noise / (0.25 * some + 0.75 * noise))
    assert after[0, 3] == pytest.approx(0.25 * (1 - some) / (0.25 * (1 - some) + 0.75 * (1 - noise)))


def test_two_steps_share_an_unknown_rate() -> None:
    """Changes in both steps on trigger 0: Beta(1, 1) gives 1/2 * 2/3, Beta(1, 9) gives 1/10 * 2/11."""
    after = beliefs([(0, {2}), (0, {2})], CountConfig(controlled=0.5, effect=(1, 1), noise=(1, 9)))[1]
    some, noise = 1 / 3, 2 / 110
    assert after[0, 2] == pytest.approx(0.25 * some / (0.25 * some + 0.75 * noise))


def test_each_responder_follows_its_trigger() -> None:
    assert edges(beliefs([(0, {2}), (1, {3}), (0, {2}), (1, {3})])) == {(0, 2), (1, 3)}


def test_one_trigger_may_control_several_responders_by_its_links() -> None:
    assert edges(beliefs([(0, {2}), (0, {3}), (1, {1}), (0, {2}), (0, {0})])) == {(0, 2), (0, 3)}


def test_what_changes_whatever_one_does_depends_on_nothing() -> None:
    config = CountConfig(noise=(1, 10))
    assert edges(beliefs([(0, {2, 3}), (1, {2}), (0, {2, 3}), (1, {2})] * 4, config)) == {(0, 3)}


def test_a_responder_has_at_most_one_trigger() -> None:
    after = beliefs([(0, {2}), (1, {2}), (0, {2}), (0, {2})])
    assert (after.sum(1) <= 1 + 1e-9).all()
    assert edges(after) == {(0, 2)}


def test_a_step_without_any_change_says_nothing() -> None:
    np.testing.assert_allclose(beliefs([(0, set()), (1, set())])[-1], beliefs([])[-1])


def test_a_trigger_that_moves_without_effect_speaks_against_its_edges() -> None:
    prior, after = beliefs([])[-1], beliefs([(0, {0})] * 5)[-1]
    assert after[0, 2] < prior[0, 2] / 4 and after[1, 2] > prior[1, 2]


def test_a_change_without_an_action_on_a_trigger_is_no_edge() -> None:
    assert edges(beliefs([(-1, {2}), (-1, {2})])) == set()


def test_without_steps_there_is_the_prior() -> None:
    prior = beliefs([], CountConfig(controlled=0.4))
    assert prior.shape == (1, 4, 4)
    np.testing.assert_allclose(prior[0][TRIGGERS[:, None], RESPONDERS], 0.2)
    assert prior.sum() == pytest.approx(0.8)


def test_what_is_believed_after_a_step_does_not_depend_on_later_ones() -> None:
    steps: list[tuple[int, set[int]]] = [(0, {2}), (1, {3}), (1, {1}), (0, {2, 3}), (-1, set())]
    np.testing.assert_allclose(beliefs(steps)[:3], beliefs(steps[:3]))


def test_no_triggers_or_no_responders_no_edges() -> None:
    changed, acted, nobody = np.ones((2, 4), bool), np.array([-1, -1]), np.array([], int)
    assert not count_changes(changed, acted, nobody, np.arange(4), CountConfig()).any()
    assert not count_changes(changed, acted, np.arange(4), nobody, CountConfig()).any()


def test_an_episode_gives_one_graph_per_step() -> None:
    episode = make_episode(steps=12)
    graph = infer(episode)
    assert (graph.name, graph.probabilities.shape) == ("count", (12, 5, 5))
    assert edges(graph.probabilities) == {(0, 1), (3, 2)}
    assert not graph.probabilities[:, ~observe_episode(episode).candidates].any()


def test_nothing_is_claimed_where_nothing_can_be_seen() -> None:
    assert not edges(count(observe_episode(make_real_episode())).probabilities)


def test_an_unknown_model_is_refused_by_name() -> None:
    with pytest.raises(BusybotError, match="no model 'oracle'.*\n.*count"):
        infer(make_episode(), model="oracle")


@pytest.mark.parametrize("triggers", [1, 2, 3])
def test_nothing_is_claimed_without_evidence(triggers: int) -> None:
    """Steps in which nothing changed say nothing, however few triggers there are to choose from."""
    changed, acted = np.zeros((3, triggers + 2), bool), np.zeros(3, int)
    chances = count_changes(changed, acted, np.arange(triggers), np.arange(triggers, triggers + 2), CountConfig())
    graph = InferredGraph("count", chances)
    assert not graph.claimed(3).any()
    assert chances.max() == pytest.approx(0.5 / triggers)


def test_before_the_first_step_the_prior_is_believed() -> None:
    observed = observe_episode(make_episode(0))
    prior = infer(observed).after(0)
    pairs = np.ix_(observed.triggers, observed.responders)
    assert prior[pairs] == pytest.approx(0.5 / len(observed.triggers))
    assert prior.sum() == pytest.approx(prior[pairs].sum())
