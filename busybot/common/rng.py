"""Every random draw of the project comes from a generator made here.

A generator depends on (seed, split, index, purpose) alone, so an episode comes out the same whatever the number of
workers, the order of work or what was drawn for other purposes before.
"""

import hashlib

import numpy as np


def generator(seed: int, split: str, index: int, purpose: str) -> np.random.Generator:
    """A PCG64 generator of its own for one purpose of one episode (or board, or group)."""
    key = f"{seed}/{split}/{index}/{purpose}".encode()
    entropy = int.from_bytes(hashlib.sha256(key).digest()[:16], "little")
    return np.random.Generator(np.random.PCG64(entropy))
