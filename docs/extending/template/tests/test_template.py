"""What the package brings, by itself: no simulator, no recordings."""

import numpy as np
from busybot_template.encoder import MeanColour
from busybot_template.mechanism import Majority
from busybot_template.objects import folder

from busybot.objects.library import Library
from busybot.reason.inputs.appearances import Appearance


def test_most_of_three() -> None:
    mechanism = Majority.draw((2, 2, 2), 2, False, np.random.default_rng(0))
    assert mechanism is not None
    shown = [mechanism.step(inputs, (), None)[0] for inputs in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1), (1, 1, 1))]
    assert shown == [0, 0, 1, 1, 1]


def test_colours_tell_looks_apart() -> None:
    red, blue = (np.full((8, 8, 3), colour, np.uint8) for colour in ((200, 0, 0), (0, 0, 200)))
    own = np.ones((8, 8), bool)
    rows = MeanColour().encode([Appearance(red, own), Appearance(blue, own)])
    assert rows.shape == (2, 256) and np.linalg.norm(rows[0] - rows[1]) > MeanColour.threshold


def test_its_objects_are_a_library() -> None:
    assert list(Library.load(folder()).objects) == ["Switch/plank"]
