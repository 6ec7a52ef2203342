"""Draws which trigger controls which responder (paper section 3 "Relations").

Every trigger link controls exactly one responder and no responder has two triggers. Multi-direction links drive
multi-stage responders, two-state links single-stage ones.
"""

import numpy as np

from busybot.boards.spec import LinkRef, Relation
from busybot.objects.model import ObjectModel, TriggerLink

STEP_OF_STATE = (1, 0, 2)
"""Multi-stage responder step while a multi-direction link rests low, in the middle, high."""


def responder_state(relation: Relation, trigger_state: int) -> int:
    """State that the relation's responder takes while its trigger rests in `trigger_state`."""
    return relation.states[trigger_state]


def draw_relations(models: list[ObjectModel], rng: np.random.Generator) -> tuple[Relation, ...] | None:
    """A random assignment of a responder to every trigger link; None if the compatible responders do not suffice.

    Multi-direction links choose first because fewer responders suit them.
    """
    links = [
        (index, link, len(model.trigger_links)) for index, model in enumerate(models) for link in model.trigger_links
    ]
    links.sort(key=lambda entry: entry[1].kind != "multi-direction")
    free = [index for index, model in enumerate(models) if model.effect is not None]
    relations = []
    for index, link, siblings in links:
        suitable = [responder for responder in free if suits(link, models[responder])]
        if not suitable:
            return None
        responder = int(rng.choice(suitable))
        free.remove(responder)
        relations.append(direct_relation(index, link, siblings, responder))
    return tuple(sorted(relations, key=lambda r: (r.triggers[0].object, r.triggers[0].link)))


def suits(link: TriggerLink, responder: ObjectModel) -> bool:
    """Whether the responder has as many stages as the link has states."""
    effect = responder.effect
    if effect is None:
        return False
    return (effect.multi if link.kind == "multi-direction" else effect.single) is not None


def direct_relation(index: int, link: TriggerLink, siblings: int, responder: int) -> Relation:
    """A responder that follows a link of object `index`, which has so many links."""
    multi = link.kind == "multi-direction"
    kind = "one-to-many-effects" if multi else "one-to-many-objects" if siblings > 1 else "one-to-one"
    return Relation(
        kind=kind,
        triggers=(LinkRef(object=index, link=link.name),),
        responder=responder,
        stage="multi" if multi else "single",
        states=STEP_OF_STATE if multi else (0, 1),
    )
