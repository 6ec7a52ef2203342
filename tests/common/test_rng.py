"""Generators depend on their key alone."""

from busybot.common.rng import generator


def test_same_key_same_draws_other_key_other_draws() -> None:
    first = generator(1, "train", 5, "board").integers(2**62, size=4).tolist()
    assert first == generator(1, "train", 5, "board").integers(2**62, size=4).tolist()
    others = [(2, "train", 5, "board"), (1, "novel", 5, "board"), (1, "train", 6, "board"), (1, "train", 5, "policy")]
    for key in others:
        assert generator(*key).integers(2**62, size=4).tolist() != first
