"""What pictures tell of mechanisms, from recordings alone: the graph, words, causes; nothing that a file can misuse."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from busybot.boards.spec import BODY, LinkRef, Relation, Rewiring
from busybot.boards.true_causes import Change
from busybot.boards.worlds import WORLDS, links_of
from busybot.episodes.episode import Episode
from busybot.view.annotations import truth_matrix
from busybot.view.mechanisms import Factor, MechanismView, harmless, mechanism_view
from tests.episodes.symbolic import library_at, make_world_episode, world_boards
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.view.world_episodes import contradicted, large_episodes

Objects = Callable[[int], Path]


def episodes(folder: Path, world: str, count: int = 3) -> list[Episode]:
    return [make_world_episode(board, library_at(folder)) for board in world_boards(folder, world, count)]


@pytest.mark.parametrize("world", WORLDS)
def test_the_law_of_a_board_is_known_from_its_recording(world: str, few_objects: Objects) -> None:
    folder = few_objects(0)
    for episode in episodes(folder, world):
        view, board = MechanismView(episode), episode.board
        known = links_of([library_at(folder).get(placed.key) for placed in board.objects])
        assert view.dynamics is not None and view.dynamics.links.names == known.names
        shown = [step.responder_states_after for step in episode.steps]
        changed = sum(
            a != b for now, then in zip(shown[1:], shown, strict=False) for a, b in zip(now, then, strict=True)
        )
        first = zip(shown[0], episode.steps[0].responder_states_before, strict=True)
        assert len(view.changes) == changed + sum(a != b for a, b in first), "each change is explained once"
        assert len(view.sentences) == len(board.relations) + len(board.rewirings) + len(board.locks) + len(board.idle)
        for who, words in view.sentences:
            assert who.split()[0] in ("lamp", "door", "toy", "switch") and words


@pytest.mark.parametrize("world", ["mixed", "time", "chance"])
def test_the_law_of_a_board_of_many_links_is_known_too(world: str, few_objects: Objects) -> None:
    for episode in large_episodes(few_objects(0), world, 2):
        view = MechanismView(episode)
        assert len(view.links) > 10 and view.dynamics is not None and not view.unexplained
        states = [step.responder_states_after for step in episode.steps]
        before = [episode.steps[0].responder_states_before, *states]
        changed = {
            (responder, step)
            for step, (was, now) in enumerate(zip(before, states, strict=False), start=1)
            for responder in range(len(now))
            if was[responder] != now[responder]
        }
        assert changed and {(one.responder, one.step) for one in view.changes} == changed
        kinds = {factor.effects: factor.kind for factor in view.factors(0) if factor.kind != "clock"}
        for relation in view.board.relations:
            if relation.kind in ("unreliable", "flicker"):
                assert kinds[view.node(LinkRef(object=relation.responder, link=BODY)),] == "chance"


def test_links_that_decide_nothing_together_are_tried_apart(
    few_objects: Objects, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Timers and latches do not tell how many states a link has: of seven such links together there are 128 ways."""
    (episode,) = large_episodes(few_objects(0), "time", 1)
    law = MechanismView(episode).dynamics
    monkeypatch.setattr("busybot.view.mechanisms.MOST_WAYS", 40)
    assert law is not None and MechanismView(episode).dynamics is not None
    monkeypatch.setattr("busybot.view.mechanisms.MOST_WAYS", 1)
    view = MechanismView(episode)
    assert view.dynamics is None and view.changes == []
    assert view.unexplained == "what changes go back to is not known here"


def factors_of(folder: Path, world: str, kind: str) -> list[tuple[MechanismView, Factor]]:
    found = []
    for episode in episodes(folder, world, 4):
        view = MechanismView(episode)
        found += [(view, factor) for factor in view.factors(0) if factor.kind == kind]
    return found


def test_every_input_is_an_edge_of_the_graph(few_objects: Objects) -> None:
    for view, factor in factors_of(few_objects(0), "gates", "mechanism"):
        (effect,) = factor.effects
        relation = next(one for one in view.board.relations if one.responder == view.nodes[effect].object)
        assert [(view.nodes[n].object) for n in factor.causes] == [ref.object for ref in relation.triggers]
        assert (
            factor.label == str(relation.parameters.get("function", relation.kind)).upper() or not relation.parameters
        )
        assert "lag" not in factor.label


def test_lags_clocks_and_locks_are_told(few_objects: Objects) -> None:
    folder = few_objects(0)
    late = [factor.label for _, factor in factors_of(folder, "time", "mechanism") if "delay" in factor.label]
    assert late and all(label == "delay 1, lag 1" for label in late)
    assert all(factor.label.endswith("lag 0+") for _, factor in factors_of(folder, "chance", "chance") if factor.causes)
    clocks = factors_of(folder, "chance", "clock")
    assert clocks and all(not clock.causes and len(clock.effects) in (2, 3) for _, clock in clocks)
    read = [factor for _, factor in factors_of(folder, "chain", "mechanism") if "lag" in factor.label]
    assert read and all("lag 1" in factor.label or "lag 0 and 1" in factor.label for factor in read)
    for view, lock in factors_of(folder, "lock", "lock"):
        roles = [view.board.objects[view.nodes[n].object].role for n in (*lock.causes, *lock.effects)]
        assert roles == ["responder", "trigger"], "what it opens is a link"


def test_links_of_one_object_are_nodes_that_do_not_lie_on_each_other(few_objects: Objects) -> None:
    for episode in episodes(few_objects(0), "gates"):
        view = MechanismView(episode)
        names = [node.name for node in view.nodes]
        assert len(set(names)) == len(names) == len({tuple(place) for place in view.places})
        assert set(view.link_names) <= set(names)


def test_a_rewired_board_has_another_graph_from_then_on(few_objects: Objects) -> None:
    for episode in episodes(few_objects(0), "rewired"):
        view = MechanismView(episode)
        begin, since = view.moments
        assert (begin, since) == (0, episode.board.rewirings[0].step + 1)
        assert view.factors(since - 1) == view.factors(0) != view.factors(since)
        responder = episode.board.rewirings[0].relation.responder
        new = {ref.object for ref in episode.board.rewirings[0].relation.triggers}
        assert set(truth_matrix(episode.board, since)[:, responder].nonzero()[0]) == new
        told = [words for _, words in view.sentences if f"from step {since} on" in words]
        assert len(told) == 1


def test_what_a_change_goes_back_to_is_what_held_then(few_objects: Objects) -> None:
    """A clock whose place a mechanism with luck of its own takes."""
    for episode in episodes(few_objects(0), "chance", 12):
        for clock in (one for one in episode.board.relations if "stream" in one.parameters):
            own = {name: value for name, value in clock.parameters.items() if name != "stream"}
            later = Rewiring(step=3, relation=clock.model_copy(update={"parameters": own}))
            view = MechanismView(replace(episode, board=episode.board.model_copy(update={"rewirings": (later,)})))
            told = [view.because(Change(clock.responder, step)) for step in (3, 5)]
            assert told == ["a hidden clock", "by itself"]
            return
    raise AssertionError("no board has a clock")


def test_attempts_on_a_held_link_are_marked(few_objects: Objects) -> None:
    marked = 0
    for episode in episodes(few_objects(0), "lock"):
        for step, link in MechanismView(episode).held:
            done = episode.steps[step - 1]
            assert done.trigger_states_before[link] == done.trigger_states_after[link] and done.acted_link
            marked += 1
    assert marked > 3


def test_the_papers_world_has_no_such_view() -> None:
    assert mechanism_view(make_episode()) is None


def test_recordings_that_know_little_and_strange_kinds_are_told_all_the_same(few_objects: Objects) -> None:
    (episode,) = episodes(few_objects(0), "gates", 1)
    blind = replace(make_real_episode(), board=make_real_episode().board.model_copy(update={"world": "gates"}))
    assert MechanismView(blind).changes == [] and MechanismView(blind).held == []
    odd = Relation.model_validate(
        {**dict(episode.board.relations[0]), "kind": "from-elsewhere", "parameters": {"x": 7}}
    )
    board = episode.board.model_copy(update={"relations": (odd, *episode.board.relations[1:])})
    view = MechanismView(replace(episode, board=board))
    assert view.dynamics is None and view.changes == []
    assert view.factors(0)[0].label == "from-elsewhere 7"
    assert view.sentences[0][1].startswith("from-elsewhere of switch") and view.unexplained


def test_kinds_keep_their_type_where_the_law_is_not_known(few_objects: Objects) -> None:
    for episode in episodes(few_objects(0), "chance"):
        known, blind = MechanismView(episode), MechanismView(contradicted(episode))
        assert blind.dynamics is None and blind.changes == [] and known.dynamics is not None
        told, true = ([(one.key, one.kind) for one in view.factors(0)] for view in (blind, known))
        assert told == true and "chance" in dict(told).values()
        assert blind.unexplained == "what changes go back to is not known here" and not known.unexplained


def test_two_links_of_one_name_have_no_law(few_objects: Objects) -> None:
    (episode,) = episodes(few_objects(0), "gates", 1)
    again = next(link for link in episode.links if link.trigger)
    steps = [
        replace(
            step,
            trigger_states_before=(*step.trigger_states_before, 0),
            trigger_states_after=(*step.trigger_states_after, 0),
        )
        for step in episode.steps
    ]
    assert MechanismView(replace(episode, links=(*episode.links, again), steps=steps)).dynamics is None


def test_text_of_a_file_stays_one_short_line() -> None:
    assert harmless("a\nb\t\x1b[31m\u202ec") == "a b [31m c"
    assert len(harmless("x" * 999)) == 28
