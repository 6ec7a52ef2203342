"""One board as arrays for models of relations, and the states that an object showed on it, without labels.

Features, positions and actions come from `ObservedEpisode` and the features of its pictures, so they hold nothing that
a reasoner may not know. Triggers have no features, as in the paper.

Frames in which an object looks alike form a cluster, a state. Two looks are alike when they lie nearer than a
threshold, which is fixed once on training objects: between the distances of looks of one state (JPEG, a neighbour in
front) and those of different states.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from busybot.common import plugins
from busybot.common.errors import BusybotError

if TYPE_CHECKING:
    from busybot.reason.inputs.observation import ObservedEpisode
    from busybot.reason.inputs.trigger_links import LinkWatch, ObservedLinks

CHANNELS = 256
"""Numbers per object and frame (paper section 4.2)."""
Made = TypeVar("Made")


@dataclass(frozen=True)
class BoardSequence:
    """A board watched for T steps, N objects.

    Attributes:
        features: float32 (T + 1, N, 256), what each object looks like in each frame; zeros for triggers and for objects
            without a box in the first frame.
        positions: float32 (N, 3), visible centre in the first frame, board frame, board units; 0 where unknown.
        actions: float32 (T, 6), position (board frame, board units) and direction (unit vector).
        acted: int64 (T,), index of the trigger acted on as far as boxes tell (`acted_objects`), -1 for none.
        triggers: bool (N,).
        responders: bool (N,).
        world: as of `ObservedEpisode`.
        watch: tells what pictures show of the trigger links in the first so many actions (`LinkWatch.first`); None
            without pictures.
    """

    features: np.ndarray
    positions: np.ndarray
    actions: np.ndarray
    acted: np.ndarray
    triggers: np.ndarray
    responders: np.ndarray
    world: str = ""
    watch: "Callable[..., ObservedLinks] | None" = None
    _made: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def once(self, name: Any, make: Callable[[], Made]) -> Made:
        """What is made of this recording, made once: evaluators ask several models several things of the same one.

        Args:
            name: tells it from whatever else is made; what has another name is made anew.
        """
        if name not in self._made:
            self._made[name] = make()
        found: Made = self._made[name]
        return found

    @property
    def links(self) -> "ObservedLinks":
        """What pictures show of the trigger links.

        Raises:
            BusybotError: there are no pictures.
        """
        if self.watch is None:
            raise BusybotError("what was recorded without pictures tells nothing of links", "record it with pictures")
        return self.watch(self.steps)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """All but `world` and `watch`, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    @property
    def steps(self) -> int:
        """T, the number of actions."""
        return len(self.actions)

    @property
    def shown_triggers(self) -> np.ndarray:
        """Indices of the triggers that show in the first frame, int (O,)."""
        return np.flatnonzero(self.triggers & self.positions.any(axis=1))

    @property
    def candidates(self) -> np.ndarray:
        """bool (N, N), True where the row is a trigger and the column a responder."""
        return self.triggers[:, None] & self.responders[None]

    def first(self, images: int) -> "BoardSequence":
        """The same board watched for at most `images` frames (so many minus one actions)."""
        steps = min(max(0, images - 1), self.steps)

        def shortened() -> BoardSequence:
            return replace(
                self, features=self.features[: steps + 1], actions=self.actions[:steps], acted=self.acted[:steps]
            )

        return self.once(("first", steps), shortened)


def sequence_of(observed: "ObservedEpisode", features: np.ndarray, watch: "LinkWatch | None" = None) -> BoardSequence:
    """Put features beside what else a reasoner may read.

    Args:
        features: (T + 1, N, 256) of the frames of `observed`, any floating type; those of triggers and of objects
            without a box are replaced by zeros.
        watch: of the recording's links, for who has it already.

    Raises:
        BusybotError: the features are not those of so many frames and objects.
    """
    # they decode pictures; what trains does without
    from busybot.reason.inputs.observation import acted_objects, actions_of
    from busybot.reason.inputs.trigger_links import LinkWatch

    roles = np.array(observed.roles, str)
    expected = (len(observed.image_of), len(roles), CHANNELS)
    if features.shape != expected:
        raise BusybotError(f"features of shape {features.shape} where the episode has {expected}", "compute them again")
    left, top, right, bottom = np.asarray(observed.boxes).reshape(-1, 4).T
    seen = (left >= 0) & (top >= 0) & (right > left) & (bottom > top) & (roles == "responder")
    return BoardSequence(
        features=np.where(seen[None, :, None], features, 0).astype(np.float32),
        positions=np.nan_to_num(observed.positions, nan=0.0).astype(np.float32),
        actions=actions_of(observed),
        acted=acted_objects(observed).astype(np.int64),
        triggers=roles == "trigger",
        responders=roles == "responder",
        world=observed.world,
        watch=lru_cache(maxsize=None)((watch or LinkWatch(observed)).first),
    )


THRESHOLDS = {"embedded": 0.5, "embedded-box": 0.5, "embedded-mask": 0.5, "resnet50keras": 0.35}
"""Distance by encoder: what `benchmarks/studies/features.py` fits on training boards, rounded."""
SMALLEST = 0.01
"""Of the median change on a board, the threshold of encoders for which none was fitted. Less than the smallest change,
which is 0.03 with drawn weights (docs/results/reason.md): where a state has several clusters, each still stands for it.
"""

UNSEEN = -1
"""Cluster of triggers and of objects that no box shows."""


def threshold_of(encoder: str, features: np.ndarray | None = None) -> float:
    """The threshold of an encoder's features.

    Args:
        features: (T + 1, N, C) of a board, to which it is fitted where no threshold is known of the encoder.

    Raises:
        BusybotError: none is known, and there are no features.
    """
    base = encoder.partition("-")[0]
    if encoder in THRESHOLDS:
        return THRESHOLDS[encoder]
    if base in plugins.names("encoders"):
        brought = getattr(plugins.load("encoders", base), "threshold", None)
        if isinstance(brought, int | float) and brought > 0:
            return float(brought)
    if features is None:
        what = f"no threshold is known for the features of encoder {encoder!r}"
        raise BusybotError(what, "fit one on training boards (`busybot.reason.inputs.sequence.fit_threshold`)")
    apart = np.linalg.norm(np.diff(features.astype(np.float32), axis=0), axis=-1)
    return SMALLEST * float(np.median(apart[apart > 0])) if apart.any() else 1.0


def clusters_of(features: np.ndarray, threshold: float, share: float = 0.0) -> np.ndarray:
    """Clusters of each object's looks, numbered from 0 in the order in which they appear.

    Args:
        features: (T + 1, N, C); zeros for objects without features.
        threshold: greatest mean distance of two clusters that are one.
        share: two are one, too, if they differ by less than this share of an object's most different clusters.

    Returns:
        int (T + 1, N), `UNSEEN` for objects without features.
    """
    labels = np.full(features.shape[:2], UNSEEN)
    for index in np.flatnonzero(np.any(features, axis=(0, 2))):
        labels[:, index] = _cluster(features[:, index].astype(np.float32), threshold, share)
    return labels


def _cluster(looks: np.ndarray, threshold: float, share: float) -> np.ndarray:
    """Clusters of one object's looks (T + 1, C): average linkage of those that differ."""
    from scipy.cluster.hierarchy import fcluster, linkage  # what trains on sequences does without

    looks = looks + 0.0  # there is but one zero
    each = [one.tobytes() for one in looks]
    distinct = dict.fromkeys(each)
    if len(distinct) == 1:
        return np.zeros(len(looks), int)
    # sorted, so that clusters do not depend on the order in which looks appear
    ordered = sorted(distinct, key=lambda one: np.frombuffer(one, np.float32).tolist())
    place = {one: number for number, one in enumerate(ordered)}
    tree = linkage(np.array([np.frombuffer(one, np.float32) for one in ordered]), "average")
    threshold = max(threshold, share * float(tree[:, 2].max()))
    found = fcluster(tree, threshold, "distance")[[place[one] for one in each]]
    order = {number: place for place, number in enumerate(dict.fromkeys(found.tolist()))}
    return np.array([order[number] for number in found.tolist()])


FEW, MOST_HIDDEN = 12, 0.2
"""In fewer steps looks need not stay or return; a hand hides no larger share of them."""


def hidden_looks(looks: np.ndarray, few: int = FEW) -> np.ndarray:
    """In which frames an object was not seen, bool (T + 1, N), by its looks, float (T + 1, N, C).

    What something hides keeps its look to the last bit (`appearances`), and what happened behind shows later. Where
    hardly any picture is like another one, a look that was there before tells so. That the camera is such a one, the
    looks of the whole recording tell: to a still one most of them stay or return. What has no box, and looks like
    nothing in all frames, tells neither.

    Args:
        few: with fewer steps than these nothing tells what the camera is, and nothing is hidden; 0 if that is known.
    """
    hidden, boxed = np.zeros(looks.shape[:2], bool), looks.any((0, 2))
    for index in np.flatnonzero(boxed):
        each = [one.tobytes() for one in looks[:, index] + 0.0]  # there is but one zero
        met = set()
        for number, one in enumerate(each):
            hidden[number, index] = one in met
            met.add(one)
    if len(looks) <= few or not boxed.any() or hidden[:, boxed].mean() > MOST_HIDDEN:
        return np.zeros_like(hidden)
    return hidden


def fit_threshold(alike: np.ndarray, different: np.ndarray) -> float:
    """A third of the way from the distances of looks of one state to those of different states.

    Nearer to the former: on boards as they are rendered these are almost 0, and other objects may change less.

    Args:
        alike: distances between looks of one state.
        different: distances between looks of different states.
    """
    low, high = float(np.quantile(alike, 0.999)), float(np.quantile(different, 0.001))
    return low + (high - low) / 3
