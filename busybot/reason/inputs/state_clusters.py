"""Clusters an object's features on a board into the states that it showed, without labels.

Frames in which an object looks alike form a cluster. Two looks are alike when they lie nearer than a threshold, which
is fixed once on training objects: between the distances of looks of one state (JPEG, a neighbour in front) and those of
different states.
"""

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from busybot.common.errors import BusybotError

THRESHOLDS = {"embedded": 0.5, "embedded-box": 0.5, "embedded-mask": 0.5}
"""Distance by encoder: what `benchmarks/studies/features.py` fits on training boards (0.44 to 0.48), rounded."""

UNSEEN = -1
"""Cluster of triggers and of objects that no box shows."""


def threshold_of(encoder: str) -> float:
    """The threshold of an encoder's features.

    Raises:
        BusybotError: none was fixed for it.
    """
    if encoder not in THRESHOLDS:
        what = f"no threshold is known for the features of encoder {encoder!r}"
        raise BusybotError(what, "fit one on training boards (`busybot.reason.inputs.state_clusters.fit_threshold`)")
    return THRESHOLDS[encoder]


def clusters_of(features: np.ndarray, threshold: float) -> np.ndarray:
    """Clusters of each object's looks, numbered from 0 in the order in which they appear.

    Args:
        features: (T + 1, N, C); zeros for objects without features.
        threshold: greatest mean distance of two clusters that are one.

    Returns:
        int (T + 1, N), `UNSEEN` for objects without features.
    """
    labels = np.full(features.shape[:2], UNSEEN)
    for index in np.flatnonzero(np.any(features, axis=(0, 2))):
        labels[:, index] = _cluster(features[:, index].astype(np.float32), threshold)
    return labels


def _cluster(looks: np.ndarray, threshold: float) -> np.ndarray:
    """Clusters of one object's looks (T + 1, C): average linkage of those that differ."""
    distinct, frame = np.unique(looks, axis=0, return_inverse=True)
    frame = frame.reshape(-1)
    if len(distinct) == 1:
        return np.zeros(len(looks), int)
    found = fcluster(linkage(distinct, "average"), threshold, "distance")[frame]
    order = {number: place for place, number in enumerate(dict.fromkeys(found.tolist()))}
    return np.array([order[number] for number in found.tolist()])


def fit_threshold(alike: np.ndarray, different: np.ndarray) -> float:
    """A third of the way from the distances of looks of one state to those of different states.

    Nearer to the former: on boards as they are rendered these are almost 0, and other objects may change less.

    Args:
        alike: distances between looks of one state.
        different: distances between looks of different states.
    """
    low, high = float(np.quantile(alike, 0.999)), float(np.quantile(different, 0.001))
    return low + (high - low) / 3
