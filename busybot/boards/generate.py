"""Procedural boards (paper section 3 and appendix "Board Generation").

Boards come in appearance groups: one draw of objects, places, colours and trigger states, then a different set of
relations for each board. A group depends on (seed, split, group) alone, so any board can be made without the others.
"""

from collections import Counter
from collections.abc import Iterator
from math import perm
from shlex import quote

import numpy as np

from busybot.boards.config import SPLITS, BoardConfig
from busybot.boards.layout import place
from busybot.boards.real_board import real_board
from busybot.boards.relations import draw_relations
from busybot.boards.scenes import SCENES, scene_group
from busybot.boards.spec import PAPER, BoardSpec, PlacedObject, Relation
from busybot.boards.task import with_reachable_goal, with_task
from busybot.boards.textures import COLORS, TEXTURES
from busybot.boards.worlds import REAL_BOARD, links_of, with_world
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel

GENERATOR_VERSION = "1.0"
"""Changes when the same configuration gives other boards."""
APPEARANCE_TRIES = 2_000
WORLD_TRIES = 100
"""So many draws of objects in vain for a world beyond the paper's: each takes seconds, and such a configuration has few
boards, or none."""
RELATION_TRIES = 50


REASONS = ("too_many", "kinds", "overlap", "relations")
Redraws = Counter[str]
"""How often a draw was thrown away, by `REASONS`; a board's seed stays the same."""
Pools = dict[str, tuple[list[str], np.ndarray]]
"""What to draw from, per category: keys of objects and their probabilities."""


def generate_boards(config: BoardConfig, library: Library, redraws: Redraws | None = None) -> Iterator[BoardSpec]:
    """All boards of the configuration in order; `redraws` counts the draws thrown away.

    Raises:
        BusybotError: a category is empty, or no board fits the configuration (with the numbers).
    """
    if config.world == REAL_BOARD:
        yield from (real_board(config, library, index) for index in range(config.boards))
        return
    groups = range((config.boards + config.group_size - 1) // config.group_size)
    if config.world in SCENES:
        for group in groups:
            yield from _scene(config, library, group)
        return
    pools = _pools(config, library)
    if config.world == PAPER:
        _refuse_few_wirings(config, library, pools)
    for group in groups:
        yield from _group(config, library, pools, group, Redraws() if redraws is None else redraws)


def _pools(config: BoardConfig, library: Library) -> Pools:
    """The split's instances; an empty category that the configuration needs is refused."""
    lamps = min(config.lamps[1], config.responders[1])
    doors = config.responders[1] - config.lamps[0]  # a responder that is no lamp is a door
    needed = {"Switch": config.switches[1], "Lamp": lamps, "Door": doors, "Toy": config.toys[1]}
    pools: Pools = {}
    for category, most in needed.items():
        entries = library.weights(SPLITS[config.split], category)
        if config.relations == "one-to-one" and category == "Switch":
            entries = [(key, weight) for key, weight in entries if _is_plain(library.get(key))]
        _refuse_strangers(config, library, category, [key for key, _ in entries])
        entries = [entry for entry in entries if entry[0] in config.only] or entries
        if not entries and most > 0:
            most_lamps = config.responders[1]
            without = "set its count to 0"
            if category == "Door":
                without = f"let all responders be lamps: --set lamps=[{most_lamps},{most_lamps}]"
            more = f"busybot assets merge procedural {quote(str(library.folder))} --out NEW"
            raise BusybotError(
                f"{library.name}: no {category} for the split {config.split!r} (relations {config.relations!r}), "
                f"but a board may need up to {most}",
                f"add objects of this category, as `{more}` does, or {without}",
            )
        weights = np.array([1.0 if config.uniform else weight for _, weight in entries])
        pools[category] = [key for key, _ in entries], weights / weights.sum() if len(weights) else weights
    return pools


def _refuse_strangers(config: BoardConfig, library: Library, category: str, keys: list[str]) -> None:
    """Refuse objects that are asked for by name, but that boards of this kind cannot have."""
    for key in (*config.include, *config.only):
        library.get(key)
        if key.startswith(f"{category}/") and key not in keys:
            what = f"{key} is none of the objects for the split {config.split!r} (relations {config.relations!r})"
            raise BusybotError(f"{library.name}: {what}", "`busybot assets list` shows the splits and kinds of links")


def _refuse_few_wirings(config: BoardConfig, library: Library, pools: Pools) -> None:
    """Refuse groups that no board has enough wirings for: they would be drawn in vain for minutes."""
    most = _most_wirings(config, library, pools)
    if 0 < most < config.group_size:  # with none at all, the draws tell why
        what = f"a group needs a board with {config.group_size} different sets of relations; none has more than {most}"
        raise BusybotError(what, "ask for a smaller --group-size, or for more responders")


def _most_wirings(config: BoardConfig, library: Library, pools: Pools) -> int:
    """No board has more sets of relations than this: links of each kind take different responders that fit them."""
    models = [library.get(key) for keys, _ in pools.values() for key in keys]
    models += [library.get(key) for key in config.include]
    kinds = [[link.kind for link in model.trigger_links] for model in models if model.category == "Switch"]
    links = {(of.count("two-state"), of.count("multi-direction")) for of in kinds}
    effects = [(model.category, model.effect) for model in models if model.effect is not None]
    single = _most_of({category for category, effect in effects if effect.single is not None}, config)
    multi = _most_of({category for category, effect in effects if effect.multi is not None}, config)
    most, reached = 0, {(0, 0)}
    for switches in range(1, config.switches[1] + 1):
        room = min(config.responders[1] + config.toys[1], config.max_objects - switches)
        reached = {(a + c, b + d) for a, b in reached for c, d in links if a + b + c + d <= room}
        if switches < config.switches[0]:
            continue
        for two, several in reached:
            if config.links is None or config.least_links <= two + several <= config.links[1]:
                apart = perm(min(room, single), two) * perm(min(room, multi), several)
                most = max(most, min(perm(room, two + several), apart))
    return most


def _most_of(categories: set[str], config: BoardConfig) -> int:
    """At most so many responders of these categories stand on a board."""
    lamps = config.lamps[1] if "Lamp" in categories else 0
    doors = config.responders[1] - config.lamps[0] if "Door" in categories else 0
    return min(lamps + doors, config.responders[1]) + (config.toys[1] if "Toy" in categories else 0)


def _group(config: BoardConfig, library: Library, pools: Pools, group: int, redraws: Redraws) -> Iterator[BoardSpec]:
    rng = generator(config.seed, config.split, group, "board")
    counted = Redraws()
    for _ in range(APPEARANCE_TRIES):
        models = _draw_models(config, library, pools, rng, counted)
        placements = place(models, rng, config.margin) if models else None
        if models is None or placements is None:
            counted["overlap"] += models is not None
            continue
        # the whole group is drawn, however many boards are asked for: a longer dataset starts with a shorter one
        relations = (
            _distinct_relations(models, config.group_size, rng) if config.world == PAPER else [()] * config.group_size
        )
        if relations is None:
            counted["relations"] += 1
            continue
        objects = tuple(
            PlacedObject(
                key=model.key,
                role=model.role,
                position=position,
                yaw=yaw,
                scale=model.scale,
                states=tuple(int(rng.integers(link.states)) for link in model.trigger_links),
            )
            for model, (position, yaw) in zip(models, placements, strict=True)
        )
        texture, color = str(rng.choice(TEXTURES)), COLORS[int(rng.integers(len(COLORS)))]
        first = group * config.group_size
        boards = []
        for index in range(first, first + config.group_size):
            board = BoardSpec(
                index=index,
                seed=config.seed,
                split=config.split,
                appearance_group=group,
                texture=texture,
                color=color,
                objects=objects,
                relations=relations[index - first],
            )
            made = _in_world(config, board, models)
            if made is None:
                break
            boards.append(made)
        if len(boards) < config.group_size:
            counted["relations"] += 1
            if config.world != PAPER and counted["relations"] == WORLD_TRIES:
                break
            continue
        redraws.update(counted)
        yield from boards[: config.boards - first]
        return
    raise _none_fits(config, group, counted)


def _none_fits(config: BoardConfig, group: int, counted: Redraws) -> BusybotError:
    draws = sum(counted[reason] for reason in REASONS)
    return BusybotError(
        f"no board of group {group} fits the configuration after {draws} draws: "
        f"{counted['too_many']} had more than {config.max_objects} objects, "
        f"{counted['kinds']} lacked the asked kinds or numbers of triggers, {counted['overlap']} found no free place, "
        f"{counted['relations']} had more trigger links than compatible responders "
        f"(or fewer than {config.group_size} different sets of relations)",
        "ask for fewer objects, more responders, a smaller margin or a smaller group_size"
        + ("; or for other links" if config.links or config.world != PAPER else "")
        + (", or fewer locks (depth)" if config.world != PAPER else ""),
    )


def _scene(config: BoardConfig, library: Library, group: int) -> Iterator[BoardSpec]:
    """A scene and its wirings, with tasks if they are asked for."""
    first, blank = group * config.group_size, {"texture": "wood", "color": (1, 1, 1), "objects": (), "relations": ()}
    told = {"index": first, "seed": config.seed, "split": config.split, "appearance_group": group}
    empty = BoardSpec.model_validate({**blank, **told, "world": config.world})
    for board in scene_group(empty, config.group_size, library, SPLITS[config.split]):
        if board.index >= config.boards:
            return
        links = links_of([library.get(placed.key) for placed in board.objects])
        found = with_reachable_goal(board, links, config.plan) if config.tasks else board
        if found is None:
            raise BusybotError(f"board {board.index}: no goal within {config.plan} actions", "--set plan=12")
        yield found


def _in_world(config: BoardConfig, board: BoardSpec, models: list[ObjectModel]) -> BoardSpec | None:
    """The board with relations of its world and a task, as asked for; None if its objects do not suffice."""
    if config.world == PAPER:
        assert config.tasks != "reach"
        return with_task(board, models, config.tasks) if config.tasks else board
    found = with_world(board, models, config.world, config.depth)
    if found is None or config.tasks is None:
        return found
    return with_reachable_goal(found, links_of(models), config.plan)


def _draw_models(
    config: BoardConfig, library: Library, pools: Pools, rng: np.random.Generator, redraws: Redraws
) -> list[ObjectModel] | None:
    switches = int(rng.integers(*config.switches, endpoint=True))
    responders = int(rng.integers(*config.responders, endpoint=True))
    fewest, most = (min(count, responders) for count in config.lamps)
    lamps = int(rng.integers(fewest, most, endpoint=True)) if responders else 0
    toys = int(rng.integers(*config.toys, endpoint=True))
    if switches + responders + toys > config.max_objects:
        redraws["too_many"] += 1
        return None
    wanted = ["Switch"] * switches + ["Lamp"] * lamps + ["Door"] * (responders - lamps) + ["Toy"] * toys
    models: list[ObjectModel] = []
    for category in rng.permutation(wanted):
        keys, probabilities = pools[str(category)]
        models.append(library.get(keys[rng.choice(len(keys), p=probabilities)]))
    if not _put_in(models, [library.get(key) for key in config.include]):
        redraws["kinds"] += 1
        return None
    links = sum(len(model.trigger_links) for model in models)
    if config.links and not config.least_links <= links <= config.links[1]:
        redraws["kinds"] += 1
        return None
    if config.relations == "one-to-many" and not _has_both_kinds(models):
        redraws["kinds"] += 1
        return None
    return models


def _put_in(models: list[ObjectModel], wanted: list[ObjectModel]) -> bool:
    """Let objects take the places of others of their categories; False if there are too few of these."""
    for model in wanted:
        places = [place for place, other in enumerate(models) if other.category == model.category]
        free = [place for place in places if models[place] not in wanted]
        if model not in models and not free:
            return False
        if model not in models:
            models[free[0]] = model
    return True


def _is_plain(model: ObjectModel) -> bool:
    """One link with two states: the trigger of a one-to-one relation."""
    return len(model.trigger_links) == 1 and model.trigger_links[0].kind == "two-state"


def _has_both_kinds(models: list[ObjectModel]) -> bool:
    multi_direction = any(link.kind == "multi-direction" for model in models for link in model.trigger_links)
    return multi_direction and any(len(model.trigger_links) > 1 for model in models)


def _distinct_relations(
    models: list[ObjectModel], count: int, rng: np.random.Generator
) -> list[tuple[Relation, ...]] | None:
    """`count` different sets of relations, or None if they are too many to find."""
    found: dict[tuple[int, ...], tuple[Relation, ...]] = {}
    for attempt in range(count * RELATION_TRIES):
        relations = draw_relations(models, rng)
        if relations is not None:
            found.setdefault(tuple(relation.responder for relation in relations), relations)
        elif not found and attempt >= RELATION_TRIES:
            return None
        if len(found) == count:
            return list(found.values())
    return None
