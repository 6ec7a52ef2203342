"""Counting: responder j depends on trigger i when j changes in the steps that acted on i and not in the others.

The simplest reasoner, without training (protocol "Reasoning", row "counting"). For each responder the hypotheses are
"no trigger" and "trigger i" for every i, at most one trigger per responder as on the paper's boards. Under "trigger i"
the responder changes at one unknown rate in the steps that acted on i and at another, the noise rate, in all others;
under "no trigger" at the noise rate everywhere. Both rates have Beta priors, so the likelihood of what was seen is a
ratio of Beta functions, and Bayes' rule gives edge probabilities.

A step after which *nothing* looks different says only that its action failed; it is left out.
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.special import betaln, softmax

from busybot.common.frozen_model import FrozenModel
from busybot.reason.inputs.object_masks import ChangeConfig, changes
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects
from busybot.reason.models.base import InferredGraph

Positive = Annotated[float, Field(gt=0)]


class CountConfig(FrozenModel):
    """Priors of the counting inference.

    Attributes:
        controlled: probability that a responder has a trigger at all (about half of them have, on training boards).
        effect: Beta(a, b) of the rate of change in steps that acted on the trigger. Wide, because a trigger with
            several links changes the responder through one of them only.
        noise: Beta(a, b) of the rate of change in all other steps. Small: on training objects none of 14,000 unchanged
            appearances was taken for a change. Where many are, a larger rate keeps precision up at the cost of recall.
        change: when a responder counts as changed.
    """

    controlled: Annotated[float, Field(gt=0, lt=1)] = 0.5
    effect: tuple[Positive, Positive] = (1.5, 1.0)
    noise: tuple[Positive, Positive] = (1.0, 5000.0)
    change: ChangeConfig = ChangeConfig()


def count(observed: ObservedEpisode, config: CountConfig | None = None) -> InferredGraph:
    """Edge probabilities after each step.

    Without any step the graph has one entry: the prior.
    """
    config = config or CountConfig()
    changed = changes(observed, config.change)
    probabilities = count_changes(changed, acted_objects(observed), observed.triggers, observed.responders, config)
    prior = np.zeros(probabilities.shape[1:])
    if len(observed.triggers):
        prior[np.ix_(observed.triggers, observed.responders)] = config.controlled / len(observed.triggers)
    return InferredGraph("count", probabilities, prior=prior)


def count_changes(
    changed: np.ndarray, acted: np.ndarray, triggers: np.ndarray, responders: np.ndarray, config: CountConfig
) -> np.ndarray:
    """The inference itself, on discrete facts.

    Args:
        changed: bool (T, N), whether each object changed in each step.
        acted: int (T,), index of the trigger acted on, -1 for none.
        triggers, responders: indices of objects.

    Returns:
        float (max(T, 1), N, N): `[t, i, j]` is the probability that i controls j, from steps 0 to t.
    """
    if not len(changed):
        # a step that says nothing leaves the prior
        changed, acted = np.zeros((1, changed.shape[1]), bool), np.array([-1])
    steps, objects = changed.shape
    probabilities = np.zeros((steps, objects, objects))
    if not len(triggers) or not len(responders):
        return probabilities
    informative = np.asarray(changed.any(axis=1))
    # (T, I) and (T, J), then sums over the steps so far: actions per trigger, changes per responder, coincidences
    on: np.ndarray = np.equal.outer(acted, triggers)
    on &= informative[:, None]
    moved = changed[:, responders]
    total = np.cumsum(informative)[:, None, None]
    actions = np.cumsum(on, axis=0)[:, :, None]
    seen = np.cumsum(moved, axis=0)[:, None, :]
    together = np.cumsum(on[:, :, None] & moved[:, None, :], axis=0)
    caused = _log_evidence(together, actions - together, config.effect)
    by_chance = _log_evidence(seen - together, (total - actions) - (seen - together), config.noise)
    none = _log_evidence(seen, total - seen, config.noise) + np.log(1 - config.controlled)
    some = caused + by_chance + np.log(config.controlled / len(triggers))
    posterior = softmax(np.concatenate([none, some], axis=1), axis=1)[:, 1:]
    probabilities[:, triggers[:, None], responders[None]] = posterior
    return probabilities


def _log_evidence(successes: np.ndarray, failures: np.ndarray, prior: tuple[float, float]) -> np.ndarray:
    """Log probability of a sequence with so many successes and failures, its rate drawn from Beta(prior)."""
    a, b = prior
    return betaln(successes + a, failures + b) - betaln(a, b)
