"""The mechanisms that are there: those of this folder, and those of packages that register a class in the entry-point
group `busybot.mechanisms` (docs/extending/mechanism.md).
"""

import re
import warnings
from collections.abc import Mapping, Sequence
from functools import cache

from pydantic import ValidationError

from busybot.boards.mechanisms.base import Mechanism
from busybot.boards.mechanisms.chance import Clock, Flicker, Unreliable
from busybot.boards.mechanisms.delay import Delay
from busybot.boards.mechanisms.direct import ManyEffects, ManyObjects, OneToOne
from busybot.boards.mechanisms.gate import Gate
from busybot.boards.mechanisms.latch import Latch
from busybot.boards.mechanisms.rest import Rest
from busybot.boards.mechanisms.timer import Timer
from busybot.boards.mechanisms.toggle import Toggle
from busybot.boards.spec import KIND_PATTERN, Relation
from busybot.common import plugins
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault

RESERVED = ("stream",)
"""Parameters of any relation: `stream` names the luck of responders that have it in common."""


OWN: dict[str, type[Mechanism]] = {
    one.kind: one
    for one in (OneToOne, ManyEffects, ManyObjects, Gate, Delay, Timer, Toggle, Latch, Unreliable, Flicker, Clock, Rest)
}
"""The kinds of this folder by name."""


@cache
def available() -> dict[str, type[Mechanism]]:
    """All kinds by name: those of this folder, then those of installed packages; a warning says which are left out."""
    kinds = dict(OWN)
    for name in plugins.names("mechanisms"):
        try:
            found = _brought(name, kinds)
        except BusybotError as error:
            warnings.warn(f"{error.what}; it is left out: {error.hint}", stacklevel=2)
        else:
            kinds[found.kind] = found
    return kinds


def kind_named(name: str) -> type[Mechanism] | None:
    """The kind of that name, None if there is none. No package is loaded for one of this folder's, and of the others
    first the one that has the same name: what ails one concerns nobody else.

    Raises:
        BusybotError: a package of that name cannot be loaded, or brings something else, or a name that is taken.
    """
    if name in OWN:
        return OWN[name]
    if name in plugins.names("mechanisms") and (found := _brought(name, OWN)).kind == name:
        return found
    return available().get(name)


def known_kind(name: str) -> type[Mechanism]:
    """The kind of that name.

    Raises:
        BusybotError: as `kind_named`, and if there is none.
    """
    if (kind := kind_named(name)) is None:
        known = ", ".join(sorted(available()))
        hint = f"here are {known}; install the package that brings it"
        raise BusybotError(f"a relation of the unknown kind {name!r}", hint)
    return kind


def _brought(name: str, known: Mapping[str, type[Mechanism]]) -> type[Mechanism]:
    """What a package brings under a name, if it is a kind and none of the known ones."""
    found, where = plugins.load("mechanisms", name), plugins.where("mechanisms", name)
    if not (isinstance(found, type) and issubclass(found, Mechanism)):
        raise BusybotError(f"{where} is no Mechanism", "derive its class from busybot.boards.mechanisms.base")
    kind, arity = getattr(found, "kind", None), found.arity
    if not (isinstance(kind, str) and re.fullmatch(KIND_PATTERN, kind)):
        raise BusybotError(f"{where} names its kind {kind!r}", "name it by lower-case letters, digits and hyphens")
    if not (isinstance(arity, tuple | list) and len(arity) == 2 and all(isinstance(count, int) for count in arity)):
        raise BusybotError(f"{where} has the arity {arity!r}", "give two numbers of inputs: the least, then the most")
    if not 0 <= arity[0] <= arity[1]:
        raise BusybotError(f"{where} has from {arity[0]} to {arity[1]} inputs", "give the least number, then the most")
    if known.get(found.kind, found) is not found:
        raise BusybotError(f"{where} brings a kind {found.kind!r}, which is there already", "rename it")
    return found


def mechanism_of(relation: Relation, sizes: Sequence[int]) -> Mechanism:
    """The mechanism that a relation describes.

    Args:
        sizes: number of states of each of the relation's inputs.

    Raises:
        BusybotError: nobody here knows its kind, or it does not fit its inputs.
    """
    kind = known_kind(relation.kind)
    own = {name: value for name, value in relation.parameters.items() if name not in RESERVED}
    try:
        return kind(sizes=tuple(sizes), table=relation.states, **own)
    except (ValidationError, TypeError) as error:
        fault = first_fault(error) if isinstance(error, ValidationError) else str(error)
        raise BusybotError(
            f"a relation of kind {relation.kind!r}: {fault}", "correct its states or parameters"
        ) from None
