"""Boards follow the rules of the protocol, and the same seed gives the same boards."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.generate import Redraws, generate_boards
from busybot.boards.layout import BOARD_HALF, EDGE, footprint
from busybot.boards.relations import STEP_OF_STATE
from busybot.boards.spec import BoardSpec, LinkRef, Relation
from busybot.boards.worlds import BUILT
from busybot.common.errors import BusybotError
from busybot.objects.library import Library
from busybot.objects.resolve import find


@pytest.fixture(scope="module", params=["procedural", "real"])
def library(request: pytest.FixtureRequest) -> Library:
    if request.param == "procedural":
        return find("procedural")
    return Library.load(request.getfixturevalue("partnet"))


def boards(library: Library, **options: object) -> list[BoardSpec]:
    return list(generate_boards(BoardConfig(**options), library))


def test_where_fewer_responders_are_drawn_than_lamps_all_are_lamps() -> None:
    counts = [
        Counter(placed.category for placed in board.objects)
        for board in boards(find("procedural"), boards=20, group_size=1, switches=(1, 2), responders=(2, 6))
    ]
    assert any(count["Lamp"] < 3 for count in counts) and any(count["Lamp"] > 3 for count in counts)
    assert all(count["Lamp"] >= 3 or not count["Door"] for count in counts)


@pytest.mark.parametrize("split", ["train", "novel-config", "novel-object"])
def test_counts_are_those_of_the_protocol(library: Library, split: str) -> None:
    for board in boards(library, split=split, boards=200):
        count = Counter(placed.category for placed in board.objects)
        assert 2 <= count["Switch"] <= 3
        assert 3 <= count["Lamp"] <= 5
        assert 5 <= count["Lamp"] + count["Door"] <= 6
        assert count["Toy"] == 1
        assert len(board.objects) <= 10


def test_every_trigger_link_controls_one_responder_of_its_own(library: Library) -> None:
    for board in boards(library, boards=200):
        links = [
            (index, link.name)
            for index, placed in enumerate(board.objects)
            for link in library.get(placed.key).trigger_links
        ]
        controlled = [relation.responder for relation in board.relations]
        assert sorted((r.triggers[0].object, r.triggers[0].link) for r in board.relations) == sorted(links)
        assert len(set(controlled)) == len(controlled)
        for relation in board.relations:
            trigger = library.get(board.objects[relation.triggers[0].object].key)
            link = next(link for link in trigger.trigger_links if link.name == relation.triggers[0].link)
            effect = library.get(board.objects[relation.responder].key).effect
            assert effect is not None
            if link.kind == "multi-direction":
                assert (relation.kind, relation.stage, relation.states) == (
                    "one-to-many-effects",
                    "multi",
                    STEP_OF_STATE,
                )
                assert effect.multi is not None
            else:
                siblings = len(trigger.trigger_links)
                assert relation.kind == ("one-to-many-objects" if siblings > 1 else "one-to-one")
                assert relation.stage == "single" and effect.single is not None


def test_groups_share_their_appearance_and_differ_in_relations(library: Library) -> None:
    made = boards(library, boards=60)
    for start in (0, 20, 40):
        group = made[start : start + 20]
        assert {board.appearance_group for board in group} == {start // 20}
        assert len({(board.objects, board.texture, board.color) for board in group}) == 1
        assert len({tuple(relation.responder for relation in board.relations) for board in group}) == 20
    assert len({(board.objects, board.texture, board.color) for board in made}) == 3


def test_objects_stay_on_the_board_and_do_not_overlap(library: Library) -> None:
    config = BoardConfig(boards=100, group_size=1)
    for board in generate_boards(config, library):
        boxes = []
        for placed in board.objects:
            low, high = footprint(library.get(placed.key), placed.yaw, config.margin)
            x, y, _ = placed.position
            boxes.append((low[0] + x, low[1] + y, high[0] + x, high[1] + y))
        slack = 1e-4
        assert all(min(box[:2]) >= -(BOARD_HALF - EDGE) - slack for box in boxes)
        assert all(max(box[2:]) <= BOARD_HALF - EDGE + slack for box in boxes)
        for first in range(len(boxes)):
            for second in range(first):
                a, b = boxes[first], boxes[second]
                apart = a[2] <= b[0] + slack or b[2] <= a[0] + slack or a[3] <= b[1] + slack or b[3] <= a[1] + slack
                assert apart, (board.index, board.objects[first].key, board.objects[second].key)


def test_only_lamps_and_doors_are_turned(library: Library) -> None:
    turned = Counter(p.category for board in boards(library, boards=100, group_size=1) for p in board.objects if p.yaw)
    assert set(turned) == {"Lamp", "Door"}


def test_splits_use_their_own_objects(library: Library) -> None:
    keys = {
        split: {p.key for board in boards(library, split=split, boards=300, group_size=1) for p in board.objects}
        for split in ("train", "novel-config", "novel-object")
    }
    train = {key for category in ("Switch", "Lamp", "Door", "Toy") for key, _ in library.weights("train", category)}
    assert keys["train"] <= train and keys["novel-config"] <= train
    assert not keys["novel-object"] & train


def test_same_seed_same_boards_and_a_longer_dataset_starts_with_a_shorter_one(library: Library) -> None:
    long, short = boards(library, boards=50, seed=7), boards(library, boards=33, seed=7)
    assert long[:33] == short
    assert boards(library, boards=33, seed=8)[0] != short[0]
    assert boards(library, boards=33, seed=7, split="novel-config")[0].objects != short[0].objects


def test_relation_options_restrict_the_triggers(library: Library) -> None:
    for board in boards(library, boards=40, relations="one-to-one"):
        assert {relation.kind for relation in board.relations} == {"one-to-one"}
    for board in boards(library, boards=40, relations="one-to-many"):
        assert {"one-to-many-effects", "one-to-many-objects"} <= {relation.kind for relation in board.relations}


def test_json_round_trip_and_digest(library: Library) -> None:
    board = boards(library, boards=1)[0]
    again = BoardSpec.model_validate_json(board.model_dump_json(indent=3))
    assert again == board and again.digest() == board.digest()
    other = board.model_copy(update={"relations": board.relations[1:]})
    assert other.digest() != board.digest()


def test_relation_matrix_collapses_links(library: Library) -> None:
    board = boards(library, boards=1, relations="one-to-many")[0]
    matrix = board.relation_matrix()
    assert sum(map(sum, matrix)) == len(board.relations)
    assert all(matrix[relation.triggers[0].object][relation.responder] for relation in board.relations)


@pytest.mark.long
def test_weights_are_honoured_unless_uniform(partnet: Path) -> None:
    library = Library.load(partnet)

    def share(uniform: bool) -> float:
        made = boards(library, boards=1500, group_size=1, uniform=uniform)
        switches = Counter(p.instance for board in made for p in board.objects if p.category == "Switch")
        return switches["100965"] / switches.total()

    # 4 of 48 draws by the authors' weights, 1 of 32 instances without them
    assert share(False) == pytest.approx(4 / 48, abs=0.02)
    assert share(True) == pytest.approx(1 / 32, abs=0.012)


def test_what_cannot_be_met_is_refused_with_the_numbers(library: Library) -> None:
    with pytest.raises(BusybotError, match=r"no board of group 0 fits.*more\s+than 10 objects.*found no free place"):
        boards(library, boards=1, margin=2.0)
    with pytest.raises(BusybotError, match="more trigger links than compatible responders"):
        boards(library, boards=1, switches=(5, 5), lamps=(1, 1), responders=(1, 1), toys=(0, 0))


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({"relations": "one-to-one", "switches": (2, 2), "responders": (4, 4), "lamps": (3, 4)}, 12),
        ({"switches": (1, 1), "links": (1, 1), "responders": (3, 3), "lamps": (2, 3)}, 4),
    ],
)
def test_a_group_larger_than_there_are_wirings_is_refused_at_once(options: dict[str, object], most: int) -> None:
    with pytest.raises(
        BusybotError, match=f"a board with 20 different sets .* more than {most}\n.* a smaller --group-size"
    ):
        boards(find("procedural"), **options)
    assert len(boards(find("procedural"), boards=most, group_size=most, **options)) == most


def test_what_no_world_has_is_given_up_early() -> None:
    one = {"world": "gates", "boards": 1, "responders": (1, 1), "lamps": (0, 1)}
    with pytest.raises(BusybotError, match=r"no board of group 0 fits .* after \d\d\d draws: .*\n.*fewer locks"):
        boards(find("procedural"), **one)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"world": "lock", "depth": (0, 0)}, "depth: .*'lock' has at least one lock, 0 allowed"),
        ({"world": "real-board", "split": "novel-object"}, "'real-board' has objects of its own"),
        ({"switches": (3, 2)}, "switches: the range 3..2 is empty"),
        ({"switches": (0, 2)}, "at least one"),
        ({"lamps": (7, 8)}, "at least 7 do not fit"),
        ({"toys": (6, 6)}, "ask for at least 13 objects"),
        ({"links": (20, 8)}, "links: the range 20..8 is empty"),
    ],
)
def test_contradictory_counts_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        BoardConfig(**options)


@pytest.mark.parametrize("options", [{"world": ["gates"]}, {"world": {}}, {"links": ["a", 8]}, {"links": [None, 8]}])
def test_values_of_another_type_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match=next(iter(options))):
        BoardConfig.model_validate(options)


def test_redraws_are_counted(partnet: Path) -> None:
    redraws = Redraws()
    list(generate_boards(BoardConfig(boards=200, relations="one-to-many"), Library.load(partnet), redraws))
    assert redraws["kinds"] > 0 and redraws["too_many"] == 0


def test_relations_must_name_objects_that_exist(library: Library) -> None:
    board = boards(library, boards=1)[0]
    trigger = board.relations[0].triggers[0].object
    for responder in (len(board.objects), trigger):
        wrong = Relation(
            kind="one-to-one",
            triggers=(LinkRef(object=trigger, link="link_0"),),
            responder=responder,
            stage="single",
            states=(0, 1),
        )
        with pytest.raises(ValueError, match="names object|is a trigger"):
            BoardSpec.model_validate(board.model_dump() | {"relations": [wrong.model_dump()]})
    with pytest.raises(ValueError, match="an idle link is of object"):
        BoardSpec.model_validate(board.model_dump() | {"idle": [{"object": len(board.objects), "link": "link_0"}]})


def test_unknown_relation_kinds_survive_the_schema(library: Library) -> None:
    board = boards(library, boards=1)[0]
    gate = board.relations[0].model_copy(update={"kind": "and-gate", "parameters": {"delay": 2}})
    gate = gate.model_copy(update={"triggers": gate.triggers * 2})
    again = BoardSpec.model_validate_json(board.model_copy(update={"relations": (gate,)}).model_dump_json())
    assert again.relations[0].kind == "and-gate" and again.relations[0].parameters == {"delay": 2}


def without(library: Library, category: str) -> Library:
    """The library of somebody who has no such objects."""
    kept = {key: model for key, model in library.objects.items() if model.category != category}
    splits = {split: {key: weights[key] for key in weights if key in kept} for split, weights in library.splits.items()}
    return replace(library, objects=kept, splits=splits)


def test_a_library_without_doors_has_boards_of_lamps(library: Library) -> None:
    lamps = boards(library, boards=2, group_size=1, lamps=(6, 6))
    assert boards(without(library, "Door"), boards=2, group_size=1, lamps=(6, 6)) == lamps
    with pytest.raises(BusybotError, match=r"no Door .* may need up to 3") as error:
        boards(without(library, "Door"), boards=1)
    hint = error.value.hint or ""
    assert f"busybot assets merge procedural {library.folder} --out NEW" in hint and "--set lamps=[6,6]" in hint


def key_of(library: Library, category: str, split: str = "train") -> str:
    return library.weights(split, category)[-1][0]


def test_objects_that_are_asked_for_stand_on_every_board(library: Library) -> None:
    wanted = [key_of(library, category) for category in ("Switch", "Lamp", "Toy")]
    for board in boards(library, boards=40, include=wanted, group_size=1):
        count = Counter(placed.category for placed in board.objects)
        assert set(wanted) <= {placed.key for placed in board.objects}
        assert 2 <= count["Switch"] <= 3 and count["Toy"] == 1 and 5 <= count["Lamp"] + count["Door"] <= 6
    for board in boards(library, boards=20, include=[key_of(library, "Door")], group_size=1):
        assert key_of(library, "Door") in {placed.key for placed in board.objects}


def test_no_other_object_of_its_category_is_drawn(library: Library) -> None:
    lamps = [key for key, _ in library.weights("train", "Lamp")][:2]
    for board in boards(library, boards=40, only=lamps):
        assert {placed.key for placed in board.objects if placed.category == "Lamp"} <= set(lamps)
    usual = {placed.key for board in boards(library, boards=40) for placed in board.objects}
    assert len({key for key in usual if key.startswith("Lamp/")} - set(lamps)) >= 1


def test_objects_that_there_are_not_or_not_in_the_split_are_refused(library: Library) -> None:
    for option in ("include", "only"):
        with pytest.raises(BusybotError, match="has no object 'Lamp/none'"):
            boards(library, **{option: ["Lamp/none"]})
        novel = key_of(library, "Lamp", "novel")
        with pytest.raises(BusybotError, match=f"{novel} is none of the objects for the split 'train'"):
            boards(library, **{option: [novel]})


def test_what_is_not_asked_for_leaves_the_configuration_as_it_was() -> None:
    assert not {"include", "only"} & set(BoardConfig().model_dump(mode="json"))
    assert BoardConfig(only=["Lamp/a"]).model_dump(mode="json")["only"] == ["Lamp/a"]
    assert BoardConfig.model_validate(BoardConfig(only=["Lamp/a"]).model_dump(mode="json")).only == ("Lamp/a",)


@pytest.mark.parametrize("links", [{}, {"links": None}, {"links": (3, 5)}, {"links": (8, 10)}])
@pytest.mark.parametrize("world", ["paper", "gates", "kitchen", "real-board"])
def test_what_is_recorded_of_a_configuration_draws_the_same_boards(world: str, links: dict[str, object]) -> None:
    if world in BUILT and links.get("links"):
        return
    config = BoardConfig(world=world, **links)
    assert BoardConfig.model_validate(config.model_dump(mode="json")) == config
    assert ("links" in config.model_dump(mode="json")) == (world == "gates" or config.links is not None)


def test_where_no_board_has_as_many_links_the_hint_names_links() -> None:
    with pytest.raises(BusybotError, match="no board of group 0 fits") as error:
        list(generate_boards(BoardConfig(boards=1, group_size=1, links=(1, 1)), find("procedural")))
    assert "for other links" in str(error.value.hint) and "depth" not in str(error.value.hint)
