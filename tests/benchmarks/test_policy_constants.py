"""What the study of the policy's constants fits."""

from benchmarks.studies.policy_constants import _line
from busybot.common.rng import generator
from busybot.interact.policy.direction_pairs import sigmoid


def test_the_line_by_which_links_were_drawn_is_found() -> None:
    rng = generator(0, "", 0, "line")
    logits = rng.normal(-2, 2, 4000)
    found = _line(logits, rng.random(4000) < sigmoid(1.8 * (logits + 2)))
    assert abs(found["steeper"] - 1.8) < 0.2 and abs(found["even"] + 2) < 0.1
