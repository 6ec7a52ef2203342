"""The paper's candidate positions (section 3.2 "Data collection"): the best pixel of each K-means cluster."""

import numpy as np
from scipy.cluster.vq import kmeans2

from busybot.rng import generator

MOST_POINTS = 4000
"""K-means looks at no more pixels than these, evenly chosen."""


def cluster_tops(affordance: np.ndarray, likely: np.ndarray, clusters: int) -> np.ndarray:
    """Group the likely pixels by K-means and take the best of each cluster.

    Args:
        affordance: float (H, W).
        likely: bool (H, W).
        clusters: k; fewer pixels make fewer clusters.

    Returns:
        int (K, 2), u and v. Equal input gives equal output: the clusters' seeds come from a generator of their own.
    """
    rows, columns = np.nonzero(likely)
    if not len(rows):
        return np.zeros((0, 2), int)
    points = np.stack([columns, rows], axis=1).astype(float)
    every = -(-len(points) // MOST_POINTS)
    centres, _ = kmeans2(
        points[::every], min(clusters, len(points[::every])), minit="++", rng=generator(0, "", 0, "interact/kmeans")
    )
    owner = np.argmin(((points[:, None] - centres[None]) ** 2).sum(-1), axis=1)
    values = affordance[rows, columns]
    best = [np.flatnonzero(owner == k)[values[owner == k].argmax()] for k in np.unique(owner)]
    return np.stack([columns[best], rows[best]], axis=1)
