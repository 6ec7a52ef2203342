"""What a reasoner expected, in the recording for Rerun."""

from pathlib import Path

import numpy as np

from busybot.reason.evaluation.prediction import Explanation, explain
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.lookup import Lookup
from busybot.view.annotations import board_bounds
from busybot.view.palette import CORRECT, WRONG
from busybot.view.rerun.camera import VIEW_MARGIN
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.rerun.skills import LETTER, LINE, eventful, label_places, words
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.view.rerun.test_recording import entities, rows

EPISODE = make_episode(steps=2)
JUDGED = np.array([False, True, True, False, True])


def foreseen() -> Explanation:
    """Lamp 1 changes in step 0 as expected; in step 1 door 2 is expected to and lamp 1 does instead."""
    states = np.array([[-1, 0, 0, -1, 0], [-1, 1, 0, -1, 0], [-1, 0, 0, -1, 0]])
    expected = np.array([[-1, 1, 0, -1, 0], [-1, 1, 1, -1, 0]])
    return Explanation(InferredGraph("hand", np.zeros((2, 5, 5))), states, expected, JUDGED, True)


def test_expectations_in_words() -> None:
    assert words(EPISODE, foreseen(), 0) == "expected lamp 1 to become 1: right"
    assert words(EPISODE, foreseen(), 1) == "expected door 2 to become 1: but lamp 1 is 0 and door 2 is 0"
    nothing = Explanation(foreseen().graph, foreseen().states, foreseen().states[:2], JUDGED, True)
    assert words(EPISODE, nothing, 0) == "expected no change: but lamp 1 is 1"


def test_hits_are_green_and_errors_red_on_the_picture_and_in_the_lanes(tmp_path: Path) -> None:
    path = tmp_path / "e.rrd"
    save_rrd(path, EPISODE, [foreseen().graph], layers=RecordingLayers(foreseen=foreseen()))
    lanes = {name for name in entities(path) if name.startswith("/expectations/")}
    assert lanes == {f"/expectations/{name}_{what}" for name in ("lamp_1", "door_2") for what in ("is", "expected")}
    texts = {row["step"]: row["Points2D:labels"] for row in rows(path, "/expected/words")}
    assert texts[1] == ["lamp 1: 0 to 1, as expected"]
    assert texts[2] == ["lamp 1: 1 to 0, expected 1", "door 2: still 0, expected 1"]
    colors = {row["step"]: row["Boxes2D:colors"] for row in rows(path, "/expected/objects")}
    green, red = (
        sum(value << shift for value, shift in zip((*c, 255), (24, 16, 8, 0), strict=True)) for c in (CORRECT, WRONG)
    )
    assert colors[1][0] == green and colors[2][:2] == [red, red] and green not in colors[2]
    expected = {
        row["step"]: row["StateChange:state"] for row in rows(path, "/expectations/door_2_expected") if row.get("step")
    }
    assert expected == {1: ["0"], 2: ["not 1"]}


def test_what_never_happened_nor_was_expected_has_no_lane() -> None:
    assert eventful(foreseen()).tolist() == [1, 2]


def test_a_board_without_boxes_can_be_looked_at(tmp_path: Path) -> None:
    episode = make_real_episode()
    expected = explain(episode, Lookup())
    save_rrd(tmp_path / "e.rrd", episode, [expected.graph], layers=RecordingLayers(foreseen=expected))
    assert "/expected/picture" in entities(tmp_path / "e.rrd")


def test_words_stay_within_the_view() -> None:
    """Rerun centres them on their place; the board's ends are those of the view."""
    wide = make_episode(steps=1, width=640, height=480)
    low, high = board_bounds(wide, VIEW_MARGIN)
    boxes = np.array([[0, 100, 40, 140], [300, 440, 340, 480], [600, 100, 640, 140]], float)
    labels = ["switch 3: 0 to 1, as expected", "lamp 1", "toy 4: still 0, expected 1"]
    places = label_places(wide, boxes, labels)
    half = np.array([len(label) for label in labels]) * LETTER / 2
    assert (places[:, 0] - half >= low[0] - 1e-9).all() and (places[:, 0] + half <= high[0] + 1e-9).all()
    assert places[1, 0] == 320 and places[0, 1] == 140 and places[1, 1] + LINE <= high[1]
