"""Gates compute what their names say."""

from itertools import product

import numpy as np
import pytest

from busybot.boards.mechanisms.gate import FUNCTIONS, HELD_OUT, TRAINED, Gate, draw_function, in_words, truth_table

TABLES = {  # by the states of a and b: 00 01 10 11
    "and": (0, 0, 0, 1),
    "or": (0, 1, 1, 1),
    "nand": (1, 1, 1, 0),
    "nor": (1, 0, 0, 0),
    "xor": (0, 1, 1, 0),
    "xnor": (1, 0, 0, 1),
    "a-and-not-b": (0, 0, 1, 0),
    "not-a-and-b": (0, 1, 0, 0),
}
OF_THREE = {  # 000 001 010 011 100 101 110 111
    "and": (0, 0, 0, 0, 0, 0, 0, 1),
    "or": (0, 1, 1, 1, 1, 1, 1, 1),
    "nand": (1, 1, 1, 1, 1, 1, 1, 0),
    "nor": (1, 0, 0, 0, 0, 0, 0, 0),
    "majority": (0, 0, 0, 1, 0, 1, 1, 1),
    "xor": (0, 1, 1, 0, 1, 0, 0, 1),
}


@pytest.mark.parametrize(("function", "table"), [*TABLES.items(), *OF_THREE.items()])
def test_truth_tables(function: str, table: tuple[int, ...]) -> None:
    sizes = (2,) * {4: 2, 8: 3}[len(table)]
    gate = Gate(sizes=sizes, table=truth_table(function, sizes), function=function)
    assert gate.table == table and gate.lag == 0
    for inputs, shown in zip(product((0, 1), repeat=len(sizes)), table, strict=True):
        assert gate.start(inputs) == gate.step(inputs, (), None) == (shown, ())


@pytest.mark.parametrize("function", TABLES)
def test_a_link_with_three_states_is_on_at_its_upper_end(function: str) -> None:
    gate = Gate(sizes=(3, 2), table=truth_table(function, (3, 2)), function=function)
    for a, b in product(range(3), range(2)):
        assert gate.step((a, b), (), None)[0] == TABLES[function][2 * (a == 2) + b]


def test_every_input_matters_in_every_function() -> None:
    for count, names in ((2, (*TRAINED, *HELD_OUT[2])), (3, HELD_OUT[3])):
        for function in names:
            table = np.array(truth_table(function, (2,) * count)).reshape((2,) * count)
            assert all((np.take(table, 0, axis) != np.take(table, 1, axis)).any() for axis in range(count)), function


def test_what_is_held_out_is_drawn_there_only() -> None:
    rng = np.random.default_rng(0)
    drawn = {(n, novel): {draw_function(n, novel, rng) for _ in range(200)} for n in (1, 2, 3) for novel in (0, 1)}
    assert drawn[2, 0] == {"and", "or", "nand", "nor"} == set(TRAINED)
    assert drawn[2, 1] == {"xor", "xnor", "a-and-not-b", "not-a-and-b"}
    assert drawn[3, 1] == set(OF_THREE) and drawn[3, 0] == drawn[1, 0] == drawn[1, 1] == {None}
    assert all(Gate.draw((2, 2), 3, novel, rng) is None for novel in (False, True))


def test_an_unknown_function_is_refused() -> None:
    with pytest.raises(ValueError, match="no function 'nil', choose from and, or"):
        Gate(sizes=(2, 2), table=(0, 0, 0, 0), function="nil")
    assert set(FUNCTIONS) == {*TABLES, *OF_THREE}


def test_words() -> None:
    def said(function: str) -> str:
        return Gate(sizes=(2, 2), table=truth_table(function, (2, 2)), function=function).sentence(["a", "b"])

    assert said("a-and-not-b") == "shows a and not b" and said("not-a-and-b") == "shows b and not a"
    assert said("nand") == "shows NAND(a, b)"
    assert in_words((2, 2), (0, 0, 1, 1), ["a", "b"]) == "shows a function of a, b"
