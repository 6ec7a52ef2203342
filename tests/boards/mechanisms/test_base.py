"""What all mechanisms have in common, the kinds that there are, and those that strangers bring."""

import warnings
from importlib.metadata import EntryPoint
from itertools import product

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.mechanisms import Mechanism, available, kind_named, mechanism_of
from busybot.boards.spec import LinkRef, Relation
from busybot.boards.worlds import world_named
from busybot.common.errors import BusybotError
from tests.boards.worlds_by_hand import dynamics, link, relation

OWN = {
    "rest",
    *("one-to-one", "one-to-many-effects", "one-to-many-objects", "gate", "delay", "timer", "toggle", "latch"),
    *("unreliable", "flicker", "clock"),
}
DRAWS = 60


def drawn(kind: str, novel: bool) -> list[Mechanism]:
    """Mechanisms of a kind for all numbers of inputs, sizes and stages that it has."""
    rng = np.random.default_rng(0)
    cases = [(sizes, stages) for count in range(4) for sizes in product((2, 3), repeat=count) for stages in (2, 3)]
    found = [available()[kind].draw(sizes, stages, novel, rng) for sizes, stages in cases for _ in range(DRAWS)]
    return [one for one in found if one is not None]


def test_these_kinds_are_there_under_their_names() -> None:
    assert set(available()) == OWN
    assert all(kind.kind == name for name, kind in available().items())


@pytest.mark.parametrize("kind", sorted(OWN))
@pytest.mark.parametrize("novel", [False, True])
def test_what_is_drawn_fits_its_inputs_and_is_written_and_read_again(kind: str, novel: bool) -> None:
    for one in drawn(kind, novel):
        least, most = one.arity
        assert least <= len(one.sizes) <= most and len(one.table) == one.rows(one.sizes)
        inputs = tuple(LinkRef(object=0, link=f"link_{number}") for number in range(len(one.sizes)))
        stage = "multi" if max(one.table) == 2 else "single"
        written = Relation(
            kind=kind, triggers=inputs, responder=1, stage=stage, states=one.table, parameters=one.parameters()
        )
        assert mechanism_of(Relation.model_validate_json(written.model_dump_json()), one.sizes) == one
        assert one.sentence([ref.link for ref in inputs])


@pytest.mark.parametrize("kind", sorted(OWN))
def test_a_step_is_pure_and_rest_stays_rest(kind: str) -> None:
    """Equal inputs, memory and luck give equal answers; without luck and without motion nothing changes."""
    for one in drawn(kind, False) + drawn(kind, True):
        for inputs in product(*(range(size) for size in one.sizes)):
            shown, memory = one.start(inputs)
            assert one.step(inputs, memory, None) == (shown, memory)
            answers = {one.step(inputs, memory, np.random.default_rng(7)) for _ in range(3)}
            assert len(answers) == 1 and one.draws == (one.kind in ("unreliable", "flicker", "clock"))
            assert all(isinstance(number, int) for number in (shown, *memory))


def test_training_and_the_split_of_new_mechanisms_have_no_mechanism_of_links_in_common() -> None:
    for kind in OWN - {"flicker", "clock", "rest"}:
        functions = [{(one.table, one.sizes, *one.parameters().items()) for one in drawn(kind, n)} for n in (0, 1)]
        if kind == "unreliable":  # whose probabilities are drawn from a range
            functions = [{(table, sizes) for table, sizes, _ in one} for one in functions]
        assert not functions[0] & functions[1], kind
        assert functions[0] or functions[1]
    assert drawn("flicker", False) == drawn("flicker", True) != []


@pytest.mark.parametrize(
    ("kind", "states", "parameters", "message"),
    [
        ("sorcery", (0, 1), {}, "unknown kind 'sorcery'"),
        ("one-to-one", (0, 1, 0), {}, "3 states are listed, its inputs have 2"),
        ("gate", (0, 1), {"function": "and"}, "2 to 3 inputs, not 1"),
        ("delay", (0, 1), {"actions": 9}, "actions"),
        ("delay", (0, 1), {}, "actions"),
        ("delay", (0, 1), {"actions": 1, "colour": "red"}, "colour"),
        ("delay", (0, 1), {"actions": 1, "sizes": [2]}, "sizes"),
        ("unreliable", (0, 1), {"probability": float("nan")}, "probability"),
    ],
)
def test_a_relation_that_is_no_mechanism_is_refused_by_name(
    kind: str, states: tuple[int, ...], parameters: dict[str, object], message: str
) -> None:
    ref = LinkRef(object=0, link="a")
    relation = Relation(kind=kind, triggers=(ref,), responder=1, stage="single", states=states, parameters=parameters)
    with pytest.raises(BusybotError, match=message) as error:
        mechanism_of(relation, (2,))
    assert kind in error.value.what and error.value.hint


def test_packages_bring_kinds_of_their_own(registered: list[EntryPoint]) -> None:
    registered.append(EntryPoint("echo", "tests.boards.mechanisms.strange:Echo", "busybot.mechanisms"))
    assert set(available()) == OWN | {"echo"}
    one = available()["echo"].draw((2,), 2, False, np.random.default_rng(0))
    assert one is not None and one.step((1,), (0,), None) == (0, (1,))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("tests.boards.mechanisms.strange:NOTHING", "is no Mechanism"),
        ("tests.boards.mechanisms.strange:Taken", "'toggle', which is there already"),
        ("tests.boards.mechanisms.strange:Absent", "cannot be loaded"),
        ("tests.boards.mechanisms.no_such_module:Echo", "cannot be loaded"),
        ("tests.boards.mechanisms.strange:Misnamed", "names its kind 'in_order'"),
        ("tests.boards.mechanisms.strange:Odd", "has the arity 2"),
    ],
)
def test_packages_that_bring_something_else_are_named(registered: list[EntryPoint], value: str, message: str) -> None:
    registered.append(EntryPoint("strange", value, "busybot.mechanisms"))
    with pytest.raises(BusybotError, match=message) as error:
        kind_named("strange")
    assert value in error.value.what and error.value.hint
    with pytest.warns(UserWarning, match=f"{value}.*{message}.*left out"):
        assert set(available()) == OWN


def test_a_kind_that_shows_what_no_responder_has_is_named(registered: list[EntryPoint]) -> None:
    """When it shows it: a recording would take -1 for a trigger."""
    registered.append(EntryPoint("beyond", "tests.boards.mechanisms.strange:Beyond", "busybot.mechanisms"))
    law = dynamics([relation("beyond", 2, [link(0)], (0, 1))])
    state = law.step((0, 0), law.start((0, 0)))
    with pytest.raises(BusybotError, match=r"responder 2: its mechanism, of the kind 'beyond', shows state -1 of 2"):
        law.step((1, 0), state)


def test_a_kind_may_begin_with_nothing_to_remember(registered: list[EntryPoint]) -> None:
    registered.append(EntryPoint("late", "tests.boards.mechanisms.strange:Late", "busybot.mechanisms"))
    law = dynamics([relation("late", 2, [link(0)], (0, 1))])
    assert law.remembers and law.start((0, 0)).flat == ()
    assert [one.shown[2] for one in law.run([(0, 0), (0, 0), (1, 0), (1, 0)])] == [0, 0, 0, 1]
    assert not dynamics([relation("gate", 2, [link(0), link(1)], (0, 0, 0, 1), function="and")]).remembers


@pytest.mark.parametrize(
    ("name", "message"),
    [("many", "'many' has at least 4 inputs, and of drawn ones none has more than 3"), ("never", "draws none")],
)
def test_a_kind_of_which_no_board_is_drawn_is_told_why(registered: list[EntryPoint], name: str, message: str) -> None:
    registered.append(EntryPoint(name, f"tests.boards.mechanisms.strange:{name.title()}", "busybot.mechanisms"))
    for novel in (False, True):
        with pytest.raises(BusybotError, match=message):
            world_named(name, novel)


def test_what_ails_a_package_concerns_no_other_name(registered: list[EntryPoint]) -> None:
    """Neither a world of ours, nor a relation, nor another package; a warning would be an error here."""
    registered.append(EntryPoint("strange", "tests.boards.mechanisms.no_such_module:Echo", "busybot.mechanisms"))
    registered.append(EntryPoint("echo", "tests.boards.mechanisms.strange:Echo", "busybot.mechanisms"))
    relation = Relation(
        kind="echo", triggers=(LinkRef(object=0, link="a"),), responder=1, stage="single", states=(0, 1)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert BoardConfig(world="gates").world == "gates" and mechanism_of(relation, (2,)).kind == "echo"
        assert world_named("echo").kinds == {"echo": 1.0}
    with pytest.raises(BusybotError, match="no_such_module:Echo' of the group busybot.mechanisms cannot be loaded"):
        world_named("strange")
    with pytest.warns(UserWarning, match="left out"), pytest.raises(BusybotError, match="no world 'ekho'") as error:
        world_named("ekho")
    assert str(error.value.hint).startswith("did you mean echo? ")
