"""Reasoners that are given no boxes: objects are proposed from depth and from what the first actions changed.

A reasoner is given the proposed objects in place of the true ones (boxes, roles, positions), and is judged on the true
ones all the same. A proposed object stands for the true one of its role with whose first box its own shares most, if
that is at least `OVERLAP` of what both cover, one to one (Kuhn 1955). What is not proposed is missed: its relations are
not claimed and its states not foretold. What is proposed and stands for nothing is a *phantom*: whatever is claimed of
it is claimed wrongly.

Places: the N true objects, then the phantoms; M in all. What the reasoner says of its P objects is put there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from busybot.common.errors import UsageError
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.decoders import NearestState
from busybot.reason.evaluation.graph_files import OVERLAP, overlaps
from busybot.reason.evaluation.metrics import mean
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence, sequence_of
from busybot.reason.inputs.steady import steadied
from busybot.reason.models.base import InferredGraph, InferredLinks, Reasoner, believed, imagine

GIVEN, PROPOSED = "given", "proposed"
BOXES = (GIVEN, PROPOSED)
"""Where the objects come from that a reasoner is given."""
KEYS: dict[str, str] = {
    "boxes": "`given`, or `proposed` (`--boxes`)",
    "proposal_r, proposal_r_triggers, proposal_r_responders": "share of the objects that show in the first picture for "
    f"which one of their role is proposed whose box shares at least {OVERLAP:.0%} with theirs; null with given boxes",
    "proposal_p": "share of the proposed objects that stand for one",
    "proposal_r_boxes": "as `proposal_r`, whatever the role",
}
"""What the figures are called, and what they are."""


@dataclass(frozen=True)
class JudgedProposals:
    """Of one board.

    Attributes:
        roles: of the objects that show in the first picture.
        found, boxed: bool, one each: whether one is proposed of their role, and of whatever role.
        proposed: how many objects are.
    """

    roles: tuple[str, ...]
    found: tuple[bool, ...]
    boxed: tuple[bool, ...]
    proposed: int


@dataclass(frozen=True)
class Proposed:
    """The objects that a reasoner is given.

    Attributes:
        observed: the board with the P proposed objects.
        place: int (P,), what each of them stands for.
        objects: N.
        judged: how good they are.
    """

    observed: ObservedEpisode
    place: np.ndarray
    objects: int
    judged: JudgedProposals

    @property
    def places(self) -> int:
        """M."""
        return max(self.objects, int(self.place.max(initial=-1)) + 1)

    @cached_property
    def known(self) -> np.ndarray:
        """bool (N,), true objects that something stands for."""
        return np.isin(np.arange(self.objects), self.place)

    @property
    def acted(self) -> np.ndarray:
        """Place of the trigger that each action took hold of, as far as proposed boxes tell, int (T,), -1 for none."""
        return self.to_places(acted_objects(self.observed))

    def to_places(self, numbers: np.ndarray) -> np.ndarray:
        """Places of proposed objects; -1 stays."""
        return np.asarray(np.append(self.place, -1)[numbers])

    def from_places(self, places: np.ndarray) -> np.ndarray:
        """Proposed objects at these places; -1 where there is none."""
        back = np.full(self.places + 1, -1)
        back[self.place] = np.arange(len(self.place))
        return np.asarray(back[places])

    def spread(self, values: np.ndarray, axis: int, fill: float = 0.0) -> np.ndarray:
        """Values of P proposed objects along an axis at their M places."""
        shape = list(values.shape)
        shape[axis] = self.places
        found = np.full(shape, fill, values.dtype)
        np.moveaxis(found, axis, 0)[self.place] = np.moveaxis(values, axis, 0)
        return found

    def placed(self, graph: InferredGraph) -> InferredGraph:
        """A graph of the proposed objects at their places."""

        def pairs(values: np.ndarray) -> np.ndarray:
            return self.spread(self.spread(values, values.ndim - 2), values.ndim - 1)

        def words(told: tuple[str, ...] | None) -> tuple[str, ...] | None:
            return None if told is None else tuple(self.spread(np.array(told, object), 0, ""))  # type: ignore[arg-type]

        links = graph.links
        return replace(
            graph,
            probabilities=pairs(graph.probabilities),
            prior=None if graph.prior is None else pairs(graph.prior),
            links=None if links is None else InferredLinks(links.clusters, self.spread(links.probabilities, 2)),
            kinds=words(graph.kinds),
            words=None,  # they name objects by number, as sets of parents do
            parent_sets=None,
            lags=None if graph.lags is None else self.spread(graph.lags, 0, -1),
            changed=None if graph.changed is None else self.spread(graph.changed, 1),
            changed_at=None if graph.changed_at is None else self.spread(graph.changed_at, 0, -1),
        )

    def true_part(self, graph: InferredGraph) -> InferredGraph:
        """What a placed graph says of the true objects alone."""
        count, links = self.objects, graph.links
        return replace(
            graph,
            probabilities=graph.probabilities[:, :count, :count],
            prior=None if graph.prior is None else graph.prior[:count, :count],
            links=None if links is None else InferredLinks(links.clusters, links.probabilities[..., :count]),
            kinds=None if graph.kinds is None else graph.kinds[:count],
            lags=None if graph.lags is None else graph.lags[:count],
            changed=None if graph.changed is None else graph.changed[:, :count],
            changed_at=None if graph.changed_at is None else graph.changed_at[:count],
        )

    def spurious(self, graph: InferredGraph, steps: int) -> tuple[int, int]:
        """How much a placed graph claims of phantoms after so many steps: pairs of objects, and links with objects."""
        count, claimed, links = self.objects, graph.claimed(steps), graph.links
        of_links = 0 if links is None else int((links.after(steps)[:, count:] > graph.threshold).sum())
        return int(claimed.sum() - claimed[:count, :count].sum()), of_links


def propose_objects(observed: ObservedEpisode, images: int) -> Proposed:
    """The objects that the first pictures and actions of a board propose, beside those that are there.

    Args:
        observed: with the true boxes and roles.
        images: so many pictures are looked at.
    """
    from busybot.datasets.importing.proposals import propose
    from busybot.datasets.importing.recording import KnownObject, positions_of

    seen = steadied(observed.first(images))
    frames = (seen.frame(number) for number in range(len(seen.image_of)))
    pictures = ((frame.rgb, frame.depth) for frame in frames)
    pixels = [action.pixel if min(action.pixel) >= 0 else None for action in seen.actions]
    found = propose(pictures, pixels, seen.camera, still=True)
    roles, boxes = tuple(one.role for one in found), np.array([one.box for one in found], np.int16).reshape(-1, 4)
    known = [KnownObject("", one.role, one.box, None, "a proposed object") for one in found]
    given = replace(
        observed,
        roles=roles,
        boxes=boxes,
        positions=positions_of(known, observed.camera, observed.boxed.depth),
    )
    shared = overlaps(boxes, observed.boxes)
    alike = np.array(roles, str).reshape(-1, 1) == np.array(observed.roles, str)[None]
    place, boxed = matched(np.where(alike, shared, 0)), matched(shared)
    phantoms = place < 0
    place[phantoms] = len(observed.roles) + np.arange(phantoms.sum())
    visible = np.flatnonzero((observed.boxes[:, 2] > observed.boxes[:, 0]) & (observed.boxes[:, 0] >= 0))
    judged = JudgedProposals(
        tuple(observed.roles[index] for index in visible),
        tuple(bool(one) for one in np.isin(visible, place)),
        tuple(bool(one) for one in np.isin(visible, boxed)),
        len(found),
    )
    return Proposed(given, place, len(observed.roles), judged)


def matched(shared: np.ndarray) -> np.ndarray:
    """The column of each row, one to one, so that most is shared, int (P,); -1 for less than `OVERLAP`."""
    from scipy.optimize import linear_sum_assignment  # slow to load

    found = np.full(len(shared), -1)
    rows, columns = linear_sum_assignment(np.where(shared >= OVERLAP, shared, 0), maximize=True)
    kept = shared[rows, columns] >= OVERLAP
    found[rows[kept]] = columns[kept]
    return found


class PlacedReasoner:
    """A reasoner that is given proposed objects and asked about places.

    Attributes:
        sequence: what it is asked with, M objects.
    """

    def __init__(self, reasoner: Reasoner, proposed: Proposed):
        extractor = make_extractor(reasoner.encoder)
        if extractor.oracle:
            what = f"{reasoner.name} reads features of the encoder {reasoner.encoder}, which knows the true objects"
            raise UsageError(what, "give it the boxes: --boxes given")
        self.name, self.encoder = reasoner.name, reasoner.encoder
        self._reasoner, self._proposed = reasoner, proposed
        self._own = own = sequence_of(proposed.observed, extractor.of(proposed.observed))
        self.sequence = BoardSequence(
            proposed.spread(own.features, 1),
            proposed.spread(own.positions, 0),
            own.actions,
            proposed.to_places(own.acted),
            proposed.spread(own.triggers, 0),
            proposed.spread(own.responders, 0),
            own.world,
        )

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return self._proposed.placed(self._reasoner.graph(self._seen(seen)))

    def graph_at_the_end(self, seen: BoardSequence) -> InferredGraph:
        return self._proposed.placed(believed(self._reasoner, self._seen(seen)))

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        found = current.copy()
        of_own = current[:, self._proposed.place]
        acted = self._proposed.from_places(acted)
        found[:, self._proposed.place] = self._reasoner.predict(self._seen(seen), of_own, actions, acted)
        return found

    def what_if(self, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        acted = self._proposed.from_places(acted)
        return self._proposed.spread(imagine(self._reasoner, self._seen(seen), steps, actions, acted), 2)

    def _seen(self, seen: BoardSequence) -> BoardSequence:
        return self._own.first(seen.steps + 1)


class PlacedStates:
    """Reads the states of the N true objects from features at M places; what nothing stands for is never read rightly.

    Attributes:
        truth: int (T + 1, N).
    """

    def __init__(self, proposed: Proposed, features: np.ndarray, clusters: np.ndarray, states: np.ndarray):
        """Arguments as of `NearestState`, at M places; states of the N true objects."""
        self.truth, self._count = states, proposed.objects
        responders = np.array([index for index in np.flatnonzero(proposed.known) if states[:, index].min() >= 0], int)
        judged = np.isin(np.arange(self._count), responders)
        self._nearest = NearestState(features[:, : self._count], clusters[:, : self._count], states, judged)

    def read(self, features: np.ndarray) -> np.ndarray:
        """Features float (F, M, C) to states int (F, N)."""
        return self._nearest.read(features[:, : self._count].reshape(-1, self._count, CHANNELS))


def summarise_proposals(judged: Sequence[JudgedProposals | None]) -> dict[str, Any]:
    """All figures of `KEYS`; null where boxes were given."""
    told = [one for one in judged if one is not None]
    roles = [role for one in told for role in one.roles]
    found = np.array([hit for one in told for hit in one.found], bool)
    boxed = np.array([hit for one in told for hit in one.boxed], bool)
    triggers, proposed = np.array(roles, str) == "trigger", sum(one.proposed for one in told)
    return {
        "boxes": PROPOSED if told else GIVEN,
        "proposal_r": mean(found),
        "proposal_r_triggers": mean(found[triggers]),
        "proposal_r_responders": mean(found[~triggers]),
        "proposal_p": float(found.sum() / proposed) if proposed else None,
        "proposal_r_boxes": mean(boxed),
    }
