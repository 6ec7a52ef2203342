"""Labels of a node's parts: beside it, over no name, with lines from them that do not cross."""

import numpy as np

from busybot.view.label_places import label_boxes, place_beside, place_labels

BOX = np.array([180.0, 180, 220, 220])
BOUNDS = np.array([0.0, 0, 400, 400])
TEXTS = ["a", "b", "c"]
NOTHING = np.zeros((0, 4))


def overlap(ones: np.ndarray, others: np.ndarray) -> bool:
    sides = np.minimum(ones[:, None, 2:], others[:, 2:]) - np.maximum(ones[:, None, :2], others[:, :2])
    return bool((sides > 0).all(-1).any())


def test_parts_stand_where_their_lines_do_not_cross() -> None:
    """Lines lead up, to the right part first: the row is in another order than the parts."""
    targets = [np.array([[300.0, 20.0]]), np.array([[200.0, 20.0]]), np.array([[100.0, 20.0]])]
    places = place_beside(BOX, TEXTS, targets, NOTHING, BOX[None], BOUNDS)
    assert len(set(places[:, 1])) == 1 and places[0, 1] < BOX[1]
    assert places[0, 0] > places[1, 0] > places[2, 0]
    sideways = [target[:, ::-1] for target in targets]
    turned = place_beside(BOX, TEXTS, sideways, NOTHING, BOX[None], BOUNDS)
    assert len(set(turned[:, 0])) == 1 and turned[0, 0] < BOX[0] and turned[0, 1] > turned[2, 1]


def test_parts_cover_no_name_and_stay_within_bounds() -> None:
    targets = [np.array([[200.0, 20.0]])] * 3
    names = label_boxes(np.array([[200.0, 160.0], [200.0, 130.0]]), ["a name"] * 2)  # above the box
    places = place_beside(BOX, TEXTS, targets, names, BOX[None], BOUNDS)
    boxes = label_boxes(places, TEXTS)
    assert not overlap(boxes, names) and not overlap(boxes, BOX[None])
    corner = place_beside(np.array([0.0, 0, 30, 30]), TEXTS, targets, NOTHING, NOTHING, BOUNDS)
    assert (label_boxes(corner, TEXTS)[:, :2] >= 0).all()


def test_a_label_leaves_the_arrow_head_free() -> None:
    """On an edge that is shorter than its label, which stands beside it then."""
    places = np.array([[0.0, 0.0], [70.0, 0.0]])
    (label,) = place_labels(places, ["a", "b"], [(0, 1)], ["one-to-one"])
    (box,) = label_boxes(label[None], ["one-to-one"])
    assert not ((box[:2] - 20 < places[1]) & (places[1] < box[2:] + 20)).all()


def test_many_parts_are_placed_too() -> None:
    texts = list("abcdefgh")
    places = place_beside(BOX, texts, [np.zeros((0, 2))] * 8, NOTHING, NOTHING, BOUNDS)
    boxes = label_boxes(places, texts)
    assert not any(overlap(boxes[[i]], np.delete(boxes, i, axis=0)) for i in range(8))
