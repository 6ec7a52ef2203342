"""Boards written by hand: two-state switches with one link each, one with three states, and responders."""

from typing import Any

from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.spec import BODY, BoardSpec, LinkRef, Lock, PlacedObject, Relation, Rewiring


def board(
    relations: list[Relation],
    sizes: tuple[int, ...] = (2, 2),
    responders: int = 4,
    states: tuple[int, ...] | None = None,
    **more: Any,
) -> BoardSpec:
    """A board with a switch for each of `sizes`, then so many responders; link k is `link(k)`."""
    there = states or (0,) * len(sizes)
    switches = [
        PlacedObject(key=f"Switch/s{k}", role="trigger", position=(k, 0, 0), yaw=0, scale=1, states=(state,))
        for k, state in enumerate(there)
    ]
    lamps = [
        PlacedObject(key=f"Lamp/l{k}", role="responder", position=(k, 2, 0), yaw=0, scale=1) for k in range(responders)
    ]
    values = {"index": 0, "seed": 3, "split": "train", "appearance_group": 0, "texture": "wood", "color": (1, 1, 1)}
    values |= {"objects": (*switches, *lamps), "relations": tuple(relations), "world": "by-hand", **more}
    return BoardSpec.model_validate(values)


def links(sizes: tuple[int, ...] = (2, 2)) -> Links:
    return Links(tuple((number, "handle") for number in range(len(sizes))), sizes)


def dynamics(relations: list[Relation], sizes: tuple[int, ...] = (2, 2), lucky: bool = True, **more: Any) -> Dynamics:
    return Dynamics(board(relations, sizes, **more), links(sizes), lucky)


def link(number: int) -> LinkRef:
    return LinkRef(object=number, link="handle")


def body(responder: int) -> LinkRef:
    return LinkRef(object=responder, link=BODY)


def relation(kind: str, responder: int, inputs: list[LinkRef], states: tuple[int, ...], **parameters: Any) -> Relation:
    stage = "multi" if max(states) == 2 else "single"
    return Relation(
        kind=kind, triggers=tuple(inputs), responder=responder, stage=stage, states=states, parameters=parameters
    )


def lock(number: int, responder: int, *states: int) -> Lock:
    return Lock(link=link(number), responder=responder, states=states)


def rewiring(step: int, new: Relation) -> Rewiring:
    return Rewiring(step=step, relation=new)
