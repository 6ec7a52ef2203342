"""The `mechanism` model as a reasoner: parents of every responder, and what it shows next.

What a responder shows after an action is what it showed in equal contexts, over all explanations, each with its
probability, as long as the same mechanism decided it. In a context that was never seen it shows what it must if each
input is to matter (`completion`); where that is open, nothing changes.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph, InferredLinks, ParentSet
from busybot.reason.models.mechanism.changes import EARLIEST
from busybot.reason.models.mechanism.completion import completed, lasting
from busybot.reason.models.mechanism.contexts import (
    LONGEST,
    REMEMBERED,
    SINCE,
    STATES,
    UNRELIABLE,
    Explanations,
    Trace,
    attempts,
    contexts_of,
    explanations_of,
    followed,
    goals,
    memories,
)
from busybot.reason.models.mechanism.curiosity import Expected, certainty, expected, released, yields
from busybot.reason.models.mechanism.laws import Laws
from busybot.reason.models.mechanism.networks import (
    BoardFacts,
    MechanismNet,
    explanation_graph,
    moments_of,
    world_number,
)
from busybot.reason.models.mechanism.perception import Perceived
from busybot.reason.models.mechanism.present import RARE, REST, Past
from busybot.reason.models.mechanism.rising import forms_of
from busybot.reason.models.mechanism.study import study_of
from busybot.reason.models.mechanism.unseen import Touched
from busybot.reason.pyg import HeteroData

NOWHERE = 0.1
"""How far to believe that a link can be pushed on to where it was never seen: so much as before it was tried."""
KINDS = {
    "own and now": "unreliable",
    "odd": "toggle",
    "since": "timer",
    "last": "latch",
}
"""Kinds of mechanisms (`boards.mechanisms`) by what is remembered; what remembers nothing is named by its inputs, and
what has no inputs by when it changes."""

CHANGED = 0.5
"""A mechanism that is more probably another one than at first is taken for another one."""
AT_ONCE = 16
"""Moments that the network weighs at once: with more what it computes does not stay near the processor."""
LIKELY = 0.02
"""Less probable explanations are not asked about what they never met."""
_COMPLETED = memories("states", "since")


@dataclass(frozen=True)
class _Understood:
    """A recording of T actions and what explains it; R responders, H explanations.

    Attributes:
        shares: float (R, H), probability of each explanation at the end.
        since: int (R,), the moment from which on the mechanism that a responder has at the end decides it; 0 is the
            new board.
        early: float (R, H), probability of each explanation before that; the same where there is no such time.
        rising: float (L,), log odds that the links' states are numbered as they rise.
    """

    perceived: Perceived
    found: Explanations
    shares: np.ndarray
    since: np.ndarray
    early: np.ndarray
    rising: np.ndarray
    _unmet: dict[tuple[int, int, bytes], dict[int, np.ndarray]] = field(default_factory=dict)

    @property
    def trace(self) -> Trace:
        return self.perceived.trace

    @cached_property
    def likeliest(self) -> np.ndarray:
        """int (R,), the explanations that are most probable at the end."""
        return self.shares.argmax(axis=1)

    @cached_property
    def inputs(self) -> np.ndarray:
        """bool (R, L + R), what these read."""
        return self.found.inputs[self.likeliest]

    @property
    def changed(self) -> np.ndarray:
        """bool (R, T), which responders changed after each action."""
        return (self.trace.responders[1:] != self.trace.responders[:-1]).T

    @cached_property
    def together(self) -> np.ndarray:
        """bool (R, R), see `_together`."""
        return _together(self.changed, np.logical_not(self.inputs.any(axis=1)))

    def at(self, moment: int = -1) -> tuple[np.ndarray, np.ndarray]:
        """What is known of the mechanisms that decided responders at a moment, the end by default: bool (R, T + 1), the
        moments that tell of them, at which these did and it was seen, or all of these as long as few are since a
        change; float (R, H), the probability of each explanation then."""
        late = np.arange(len(self.trace.links)) >= self.since[:, None]
        then = late[:, moment, None]
        few = then & (late.sum(1, keepdims=True) < EARLIEST)
        return ((late == then) | few) & self.trace.seen.T, np.where(then, self.shares, self.early)

    def laws(self, moment: int = -1) -> Laws:
        """What the board did at a moment, the end by default."""
        found, trace, (of, shares) = self.found, self.trace, self.at(moment)
        return Laws(trace.sizes, found.inputs, found.memory, shares, trace.links, trace.responders, of, self.rising)

    def following(self, contexts: np.ndarray, before: np.ndarray, at: int | None = None) -> np.ndarray:
        """The likeliest states after an action, int (R,).

        Args:
            contexts: int (H,) or (R, H), after the action; what `own` adds is left out.
            before: int (R,), states before it.
            at: in place of which action of the recording this one is taken, from 1: what luck did then it does now, so
                an explanation to which nothing is different foretells what was seen.
        """
        shown, (of, shares) = self.trace.responders, self.at(-1 if at is None else at)
        counts = followed(self.trace, self.found, contexts, before, of)
        total, stays = counts.sum(2, keepdims=True), np.eye(STATES)[before][:, None]
        likely, met = np.where(total > 0, (counts + RARE) / (total + STATES * RARE), stays), total[..., 0] > 0
        going, known = goals(self.trace, self.found, contexts, of)
        likely[:, self._lucky], met[:, self._lucky] = np.where(known[..., None], going, stays), known
        for responder, row in zip(*np.nonzero(~met & (shares > LIKELY) & self._completing), strict=True):
            context = int(np.broadcast_to(contexts, met.shape)[responder, row])
            told = self._completed(responder, row, of[responder]).get(context)
            if told is not None and told.max() > 0.5:
                likely[responder, row] = told
        if at is not None:
            same = (contexts == self.found.contexts[at]) & (~self.found.own | (before == shown[at - 1])[:, None])
            same &= self.trace.seen[at][:, None]  # what happened behind a hand, nobody knows
            likely = np.where(same[..., None], np.eye(STATES)[shown[at]][:, None], likely)
            likely = np.where(self._failed(at, of)[..., None], stays, likely)
        there = np.arange(STATES) <= shown.max(0)[:, None]
        return np.asarray((np.einsum("rh,rhs->rs", shares, likely) * there).argmax(1))

    @cached_property
    def _completing(self) -> np.ndarray:
        """bool (H,), which explanations say something of what they never met."""
        return np.isin(self.found.memory, _COMPLETED)

    @cached_property
    def _lucky(self) -> np.ndarray:
        """int (U,), the explanations of what may fail."""
        return np.flatnonzero(self.found.memory == UNRELIABLE)

    def _failed(self, action: int, of: np.ndarray) -> np.ndarray:
        """bool (R, H), by which explanations an action failed to move a responder, from 1."""
        before, after = self.trace.responders[action - 1 : action + 1]
        going, _ = goals(self.trace, self.found, self.found.contexts[action], of)
        told = np.zeros(self.shares.shape, bool)
        seen = self.trace.seen[action - 1] & self.trace.seen[action]
        told[:, self._lucky] = (going.argmax(-1) != after[:, None]) & (seen & (after == before))[:, None]
        return told

    def _completed(self, responder: int, row: int, of: np.ndarray) -> dict[int, np.ndarray]:
        """What an explanation must say of contexts that were never met at these moments, float (STATES,) by context."""
        if (key := (responder, row, of.tobytes())) not in self._unmet:
            trace, inputs = self.trace, np.flatnonzero(self.found.inputs[row])
            sizes = np.array([*trace.sizes, *np.maximum(trace.responders.max(0) + 1, 2)])[inputs]
            contexts, shown = self.found.contexts[of, row], trace.responders[:, responder]
            tells = (attempts(shown) if row in self._lucky else np.eye(STATES)[shown])[of]
            lasts = self.found.memory[row] in SINCE
            each = LONGEST + 1 if lasts else STATES
            places = each ** np.arange(len(inputs))
            states = STATES if shown.max() > 1 else 2
            known = {
                tuple((context // places % each).tolist()): int(tells[contexts == context].sum(0).argmax())
                for context in set(contexts.tolist())
            }
            rising = np.append(self.rising, np.zeros(trace.responders.shape[1]))[inputs].tolist()
            told = lasting(known, states) if lasts else completed(known, sizes.tolist(), states, rising)
            self._unmet[key] = {
                int(np.array(one) @ places): np.pad(shares, (0, STATES - len(shares))) for one, shares in told.items()
            }
        return self._unmet[key]


class MechanismReasoner:
    """See `Reasoner`.

    Args:
        encoder: of the features that it was trained with.
    """

    name = "mechanism"

    def __init__(self, net: MechanismNet, encoder: str):
        self._net, self.encoder = net.eval(), encoder

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each step, at the level of objects and of links, with kinds and lags. Those of
        objects count links that nobody saw moving, if the network knows of such.

        What counts as one link, and as one look, and how many states a link has, is found in all pictures of `seen`;
        all other evidence of earlier rows is from the actions until then. Kinds and lags are those of the end.
        """
        return self._graph(seen, range(seen.steps + 1), *self._after_each(seen))

    def graph_at_the_end(self, seen: BoardSequence) -> InferredGraph:
        """See `Brief`; without words, which cost more than all else."""
        return self._graph(seen, [seen.steps], *self._at_the_end(seen), worded=False)

    def _graph(
        self,
        seen: BoardSequence,
        after: Sequence[int],
        shares: np.ndarray,
        believed: np.ndarray | None,
        worded: bool = True,
    ) -> InferredGraph:
        """Of what is believed after so many actions each, as of `_weighed`; the first may be a new board."""
        known = self._understand(seen)
        links, objects = known.perceived.links, len(seen.triggers)
        owners = np.concatenate([links.owners, known.perceived.responders]).astype(int)
        of_objects = np.zeros((len(known.found.inputs), objects), bool)
        for row, inputs in zip(of_objects, known.found.inputs, strict=True):
            row[owners[inputs]] = True
        pairs = np.zeros((len(after), objects, objects))
        pairs[:, :, known.perceived.responders] = np.einsum("rhk,hi->kir", shares, of_objects)
        self._with_unseen_links(seen, known, after, shares, pairs)
        single = np.zeros((len(after), len(links.owners), objects))
        own = known.found.inputs[:, : len(links.owners)]
        single[:, :, known.perceived.responders] = np.einsum("rhk,hi->kir", shares, own)
        kinds, lags = self._named(known, objects)
        changed = changed_at = None
        if believed is not None:
            changed, changed_at = np.zeros((len(after), objects)), np.full(objects, -1)
            changed[:, known.perceived.responders] = believed.T
            changed_at[known.perceived.responders] = np.where(known.since, known.since - 1, -1)
        steps = slice(1 if after[0] == 0 else 0, None)  # a new board is not after a step
        return InferredGraph(
            self.name,
            pairs[steps] if len(pairs[steps]) else pairs,
            prior=pairs[0] if after[0] == 0 else None,
            links=InferredLinks(links.clusters, single[steps]),
            kinds=kinds,
            lags=lags,
            words=self._in_words(known, objects) if worded else None,
            parent_sets=_parent_sets(known, shares[..., -1], objects) if worded else None,
            changed=None if changed is None else changed[steps],
            changed_at=changed_at,
        )

    def _with_unseen_links(
        self, seen: BoardSequence, known: _Understood, after: Sequence[int], shares: np.ndarray, pairs: np.ndarray
    ) -> None:
        """Put into the probabilities of pairs (K, N, N) that links decide a responder that nobody saw moving."""
        if self._net.unseen is not None:
            touched = Touched.of(seen, known.perceived)
            told = touched.pairs(after, shares, known.found.inputs)
            with torch.no_grad():
                sure = self._net.unseen(told, world_number(self._net.config, seen.world))
            pairs[np.ix_(np.arange(len(pairs)), touched.triggers, known.perceived.responders)] = sure.numpy()

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """What follows each action by itself; how links stand then is told by `present`."""
        known, told = self._understand(seen), []
        past = Past(known.perceived, known.found, *known.at())
        for looks, action, owner in zip(current, actions, acted, strict=True):
            before = known.perceived.states_of(looks)
            links = past.standing(before, action, int(owner))
            rested = known.trace.longer(links, before, REST)
            moved = rested.longer(known.perceived.moved(links, action, int(owner), before), before)
            earlier, later = contexts_of(moved, 2)
            after = known.following(past.remembered(earlier, later, before), before)
            changed = np.isin(np.arange(len(looks)), known.perceived.responders[after != before])
            told.append(np.where(changed[:, None], known.perceived.shown(after, looks), looks))
        return np.array(told, np.float32).reshape(current.shape)

    def what_if(self, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """See `Imagining`: what links did before is remembered, by the explanations that need it.

        Of actions that were recorded it is known what followed; that tells of the luck that they would have had
        otherwise (abduction, action, prediction: Pearl, Causality, 2009).
        """
        known = self._understand(seen)
        told = np.zeros((*actions.shape[:2], *seen.features.shape[1:]), np.float32)
        for question, start in enumerate(steps.tolist()):
            trace, states = known.trace.first(start), known.trace.links[start]
            for number, (action, owner) in enumerate(zip(actions[question], acted[question].tolist(), strict=True)):
                before = trace.responders[-1]
                states = known.perceived.moved(states, action, owner, before, beyond=True)
                links = states.clip(0, np.array(trace.sizes) - 1)
                [contexts] = contexts_of(trace.longer(links, before), 1)
                after = known.following(contexts, before, start + number + 1 if start + number < seen.steps else None)
                trace = trace.longer(links, after)
                told[question, number] = known.perceived.shown(after, seen.features[0])
        return told

    def expected_information(self, seen: BoardSequence, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """See `Curious`: an action moves a link as the seen ones did, on to where it was never seen, or nothing."""
        told, vain = self._expected(seen, actions, acted)
        return told.information * NOWHERE**vain

    def released(
        self,
        seen: BoardSequence,
        tries: Sequence[Sequence[int]],
        actions: np.ndarray | None = None,
        acted: np.ndarray | None = None,
    ) -> np.ndarray:
        """See `Curious`."""
        responders = study_of(seen, self.encoder).perceived.trace.responders
        if actions is None or acted is None:
            return released(responders, tries)
        told, vain = self._expected(seen, actions, acted)
        goes = (NOWHERE**vain)[:, None]
        return goes * released(responders, tries, told.shown) + (1 - goes) * released(responders, tries)

    def _expected(self, seen: BoardSequence, actions: np.ndarray, acted: np.ndarray) -> tuple[Expected, np.ndarray]:
        """Of S actions, and how often what each pushes on was tried in vain, int (S,)."""
        known = self._understand(seen)
        leads = [_led(known.perceived, seen.actions, *one) for one in zip(actions, acted.tolist(), strict=True)]
        distinct = tuple(dict.fromkeys(move for move, _ in leads))
        of, shares = known.at()
        told = seen.once((self, "expected", distinct), lambda: expected(known.trace, known.found, shares, distinct, of))
        return told.take([distinct.index(move) for move, _ in leads]), np.array([vain for _, vain in leads], int)

    def yields(self, seen: BoardSequence, tries: Sequence[Sequence[tuple[int, bool, bool]]]) -> np.ndarray:
        """See `Curious`."""
        shown = study_of(seen, self.encoder).perceived.trace.responders
        return np.array([yields(shown, own) for own in tries])

    def certainty(self, seen: BoardSequence) -> float:
        """See `Curious`; none as long as a trigger that shows was never seen moving, which may control anything."""
        known = self._understand(seen)
        there = seen.shown_triggers
        if not len(there) or not np.isin(there, known.perceived.links.owners).all():
            return 0.0
        return certainty(known.found, known.shares)

    def laws(self, seen: BoardSequence) -> tuple[Perceived, Laws]:
        """What pictures show of a board, and what it does, to plan with: as it did at first, for a task begins on a new
        board, on which nothing was exchanged yet."""
        known = self._understand(seen)
        return known.perceived, known.laws(0)

    def _after_each(self, seen: BoardSequence) -> tuple[np.ndarray, np.ndarray | None]:
        """As `_weighed`, on the new board and after each action."""
        return seen.once((self, "after each"), lambda: self._studied(seen, study_of(seen, self.encoder).after_each))

    def _at_the_end(self, seen: BoardSequence) -> tuple[np.ndarray, np.ndarray | None]:
        """As `_weighed`, after the last action."""
        return seen.once((self, "at the end"), lambda: self._studied(seen, study_of(seen, self.encoder).at_the_end))

    def _studied(self, seen: BoardSequence, graph: HeteroData) -> tuple[np.ndarray, np.ndarray | None]:
        return self._weighed(graph, self.facts_of(seen), len(study_of(seen, self.encoder).found.inputs))

    def _understand(self, seen: BoardSequence) -> _Understood:
        """What was understood is remembered: evaluators ask several things of one recording."""

        def understood() -> _Understood:
            study = study_of(seen, self.encoder)
            shares, changed = self._at_the_end(seen)
            shares, since = shares[..., 0], np.zeros(len(shares), int)
            if changed is not None:
                since = np.where(changed[:, 0] > CHANGED, study.places, 0)
            early = shares
            if since.any():
                each, _ = self._after_each(seen)
                early = np.where(since[:, None] > 0, each[np.arange(len(since)), :, since - 1], shares)
            rising = self.facts_of(seen).rising
            assert rising is not None
            return _Understood(study.perceived, study.found, shares, since, early, rising)

        return seen.once((self, "understood"), understood)

    def facts_of(self, seen: BoardSequence) -> BoardFacts:
        """What a recording tells beside its trace, looked up once."""

        def facts() -> BoardFacts:
            links, known = study_of(seen, self.encoder).perceived.links, self._net.rising
            forms = forms_of(links)
            rising = np.zeros(len(forms)) if known is None else known(torch.from_numpy(forms)).double().numpy()
            return BoardFacts(world_number(self._net.config, seen.world), rising, links.steadied)

        return seen.once((self, "facts"), facts)

    def explain(
        self,
        trace: Trace,
        after: Sequence[int],
        world: str = "",
        rising: np.ndarray | None = None,
        unsteady: bool = False,
    ) -> tuple[Explanations, np.ndarray, np.ndarray | None]:
        """What explains a trace after so many actions each.

        Args:
            world: that is told.
            rising: float (L,), log odds that the links' states are numbered as they rise; None if nobody knows.
            unsteady: whether the camera was not still.

        Returns:
            The explanations; how probable each is, float (R, H, K); and how probable it is that another mechanism than
            at first decides each responder, float (R, K), None if the network does not say so.
        """
        told = BoardFacts(world_number(self._net.config, world), rising, unsteady)
        found = explanations_of(trace)
        return found, *self._weighed(explanation_graph(trace, after), told, len(found.inputs))

    @torch.no_grad()
    def _weighed(self, graph: HeteroData, what: BoardFacts, explanations: int) -> tuple[np.ndarray, np.ndarray | None]:
        """See `explain`.

        Args:
            explanations: H.
        """
        told = copy(graph)
        what.to(told)
        moments = torch.arange(graph["explanation"].evidence.shape[1]).split(AT_ONCE)
        parts = [self._net(moments_of(told, few)) for few in moments]  # one board is a batch as it is
        logs, _, odds = zip(*parts, strict=True)
        final, change = torch.cat(logs, 1), None if odds[0] is None else torch.cat(odds, 1)
        shares = final.exp().view(graph["responder"].num_nodes, explanations, final.shape[1]).double().numpy()
        return shares, None if change is None else change.sigmoid().double().numpy()

    def _in_words(self, known: _Understood, objects: int) -> tuple[str, ...]:
        """What decides each object; links of a trigger that has several are counted."""
        owners, laws = known.perceived.links.owners.tolist(), known.laws()
        names = [
            f"object {owner}" + (f" (link {owners[:k].count(owner) + 1})" if owners.count(owner) > 1 else "")
            for k, owner in enumerate(owners)
        ]
        names += [f"object {responder}" for responder in known.perceived.responders]
        told = [""] * objects
        for number, responder in enumerate(known.perceived.responders):
            others = " and ".join(names[len(owners) + other] for other in np.flatnonzero(known.together[number]))
            told[responder] = laws.words(number, names) + (f", together with {others}" if others else "")
        return tuple(told)

    def _named(self, known: _Understood, objects: int) -> tuple[tuple[str, ...], np.ndarray]:
        kinds, lags = [""] * objects, np.full(objects, -1)
        count, memories_of = len(known.perceived.links.owners), known.found.memory[known.likeliest]
        changed, timed = known.changed.sum(axis=1), known.together.sum(axis=1)
        for number, index in enumerate(known.perceived.responders):
            inputs, memory = known.inputs[number], REMEMBERED[memories_of[number]]
            if inputs.any():
                by_inputs = "delay" if memory.delay else "one-to-one" if inputs.sum() == 1 else "gate"
                kinds[index] = KINDS.get(memory.name, KINDS.get(memory.what, by_inputs))
                lags[index] = memory.delay + int(inputs[count:].any())
            else:
                kinds[index] = "clock" if timed[number] else "flicker" if changed[number] else "rest"
        return tuple(kinds), lags


LEAST_SET = 0.01
"""Less probable sets of inputs are not told."""


def _parent_sets(known: _Understood, shares: np.ndarray, objects: int) -> tuple[tuple[ParentSet, ...], ...]:
    """Of each object the sets of inputs that explanations have, with the sum of their shares (R, H)."""
    found: list[tuple[ParentSet, ...]] = [()] * objects
    count = len(known.perceived.links.owners)
    sets, of = np.unique(known.found.inputs, axis=0, return_inverse=True)
    for responder, own in zip(known.perceived.responders.tolist(), shares, strict=True):
        sums = np.bincount(of.reshape(-1), own, len(sets))
        likeliest = [number for number in np.argsort(-sums, kind="stable") if sums[number] >= LEAST_SET]
        found[responder] = tuple(
            ParentSet(
                tuple(np.flatnonzero(sets[number, :count]).tolist()),
                tuple(known.perceived.responders[sets[number, count:]].tolist()),
                float(sums[number]),
            )
            for number in likeliest
        )
    return tuple(found)


def _led(perceived: Perceived, proposed: np.ndarray, action: np.ndarray, acted: int) -> tuple[tuple[int, ...], int]:
    """In which states an action that works leaves the links; and if it pushes one on to where it was never seen, which
    is the last of `STATES`, whichever way that lies, how often that was tried in vain.

    Args:
        proposed: all actions so far, as of `BoardSequence`.
    """
    now, link = perceived.trace.links[-1], perceived.pushed_on(action, acted)
    if link is None:
        return tuple(perceived.moved(now, action, acted).tolist()), 0
    own = (perceived.links.clusters == link) & (perceived.trace.links[:-1, link] == now[link])
    vain = int((own & (proposed[:, 3:] @ action[3:] > 0)).sum())  # or it had been seen there
    return (*now[:link].tolist(), STATES - 1, *now[link + 1 :].tolist()), vain


def _together(changed: np.ndarray, alone: np.ndarray) -> np.ndarray:
    """Which responders that no input moves always change together, as a clock makes them that nobody sees, bool (R, R).

    Args:
        changed: bool (R, T), which responders changed after each action.
        alone: bool (R,), which have no inputs.
    """
    same = (changed[:, None] == changed).all(axis=2) & changed.any(axis=1)
    return np.asarray(same & alone & alone[:, None] & ~np.eye(len(changed), dtype=bool))
