"""Judges of predicted features: the nearest of the states that the object showed, and decoders."""

import numpy as np

from busybot.objects.resolve import find
from busybot.reason.evaluation.decoders import (
    DecodedState,
    Examples,
    Linear,
    NearestState,
    appearances,
    examples,
    fit_decoders,
)
from tests.episodes.synthetic import make_board

JUDGED = np.array([False, True, True])


def looks(*values: tuple[float, float]) -> np.ndarray:
    """Features (F, 3, 2) of a trigger and two responders, each with one number that tells."""
    features = np.zeros((len(values), 3, 2), np.float32)
    features[:, 1, 0], features[:, 2, 0] = np.array(values).T
    return features


def nearest() -> NearestState:
    """Responder 1 shows 0 and 10 (states 0, 1), responder 2 shows 5 (state 2) throughout."""
    true = looks((0, 5), (0.2, 5), (10, 5))
    clusters = np.array([[-1, 0, 0], [-1, 0, 0], [-1, 1, 0]])
    states = np.array([[-1, 0, 2], [-1, 0, 2], [-1, 1, 2]])
    return NearestState(true, clusters, states, JUDGED)


def test_the_nearest_shown_state_counts() -> None:
    read = nearest().read(looks((4.9, 100), (5.2, -100)))
    assert read.tolist() == [[-1, 0, 2], [-1, 1, 2]]


def test_true_features_are_read_as_they_are() -> None:
    judge = nearest()
    assert (judge.read(looks((0, 5), (0.2, 5), (10, 5))) == judge.truth)[:, JUDGED].all()


def test_a_cluster_of_two_states_is_read_as_the_commoner_one() -> None:
    """The judge's own mistakes are seen: one of three frames is read wrongly."""
    states = np.array([[-1, 1, 2], [-1, 0, 2], [-1, 0, 2]])
    judge = NearestState(looks((0, 5), (0, 5), (0, 5)), np.zeros((3, 3), int), states, JUDGED)
    assert judge.read(looks((7, 7)))[0, 1] == 0
    assert (judge.read(looks((0, 5), (0, 5), (0, 5))) == judge.truth)[:, 1].tolist() == [False, True, True]


def test_lamps_are_named_by_colour_and_doors_by_state() -> None:
    library = find("procedural")
    lamp, door = (next(k for k in library.objects if k.startswith(category)) for category in ("Lamp/", "Door/"))
    board = make_board()
    objects = list(board.objects)
    objects[0] = objects[0].model_copy(update={"key": next(k for k in library.objects if k.startswith("Switch/"))})
    objects[1] = objects[1].model_copy(update={"key": lamp})
    objects[2] = objects[2].model_copy(update={"key": door})
    board = board.model_copy(update={"objects": tuple(objects[:3]), "relations": board.relations[:1]})
    shown = appearances(board, library, np.array([[-1, 0, 0], [-1, 1, 1]]))
    effect = library.get(lamp).effect
    assert effect is not None and effect.single is not None
    color = "#" + "".join(f"{round(255 * channel):02x}" for channel in effect.single[1])
    assert shown.tolist() == [["", "off", "0"], ["", color, "1"]]


def test_a_decoder_reads_what_it_was_shown() -> None:
    rng = np.random.Generator(np.random.PCG64(0))
    shown = np.array(["off", "#ff0000", "#00ff00"])[rng.integers(3, size=90)]
    features = rng.normal(size=(90, 8))
    features[:, 0] += 9.0 * (shown == "#ff0000")
    features[:, 1] += 9.0 * (shown == "#00ff00")
    decoder = Linear(features, shown)
    assert (decoder.read(features) == shown).mean() > 0.95
    assert decoder.read(np.array([[9.0] + [0.0] * 7])).tolist() == ["#ff0000"]


def test_each_thing_that_an_object_shows_is_one_example() -> None:
    shown = np.array([["", "off", "0"], ["", "off", "0"], ["", "#ff0000", "0"]])
    parts = examples(make_board(), looks((0, 5), (2, 5), (10, 5)), shown, JUDGED)
    assert parts.categories.tolist() == ["Lamp", "Lamp", "Door"]
    assert dict(zip(parts.shown.tolist(), parts.features[:, 0].tolist(), strict=True)) == {
        "off": 1.0,
        "#ff0000": 10.0,
        "0": 5.0,
    }


def test_a_category_without_decoder_is_read_as_nothing() -> None:
    lamps = Examples(np.array([[0.0, 1.0], [1.0, 0.0]]), np.array(["Lamp"] * 2), np.array(["off", "#ff0000"]))
    truth = np.array([["", "off", "0"]])
    judge = DecodedState(fit_decoders([lamps]), make_board(), truth, JUDGED)
    read = judge.read(looks((1, 5)))
    assert read.tolist() == [["", "#ff0000", ""]]
    assert not (read == judge.truth)[0, JUDGED].any()
