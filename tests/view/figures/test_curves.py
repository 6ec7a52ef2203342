"""The curves of an evaluation."""

from pathlib import Path

import cv2
import numpy as np

from busybot.view.figures.curves import images_figure
from busybot.view.palette import ACTION, CORRECT


def result(pred_a: float | None) -> dict:
    empty = {"edge_r": 0.5, "edge_r_bound": 0.6, "pred_a_bound": None}
    points = [{"images": number, "edge_p": 1.0, "pred_a": pred_a, **empty} for number in (2, 3, 4)]
    return {"model": "m", "boards": 3, "dataset": {"name": "d", "split": "train"}, "by_images": points}


def drawn(path: Path, color: tuple[int, int, int]) -> bool:
    picture = cv2.imread(str(path))
    assert picture is not None
    return bool((np.abs(picture[..., ::-1].astype(int) - color).max(-1) < 8).any())


def test_what_is_undefined_has_no_curve(tmp_path: Path) -> None:
    with_it, without = (images_figure(tmp_path / f"{share}.png", result(share)) for share in (0.9, None))
    assert drawn(with_it, CORRECT) and drawn(with_it, ACTION)
    assert drawn(without, CORRECT) and not drawn(without, ACTION)
