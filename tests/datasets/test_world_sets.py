"""The committed sets of boards: they are drawn again, and a board that is another one is named."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from busybot.boards.spec import PAPER
from busybot.boards.worlds import WORLDS
from busybot.datasets.create import create_dataset
from busybot.objects.resolve import find
from datasets import worlds
from tests.episodes.symbolic import library_at


@pytest.mark.parametrize("world", [PAPER, *WORLDS])
def test_every_world_has_its_sets(world: str) -> None:
    objects = json.loads((worlds.FILES / f"{world}.json").read_text())["objects"]
    assert objects.keys() == {"procedural", "partnet-mobility", *(["drawn-2026"] if world == PAPER else [])}
    for cards in objects.values():
        assert set(cards) == set(worlds.sets_of(world))
        assert len({card["board_hash"] for card in cards.values()}) == len(cards)
        assert all(len(card["board_digests"].split()) == card["boards"] == 200 for card in cards.values())


@pytest.mark.long
def test_the_first_boards_of_a_set_are_drawn_again(tmp_path: Path) -> None:
    card = json.loads((worlds.FILES / "lock.json").read_text())["objects"]["procedural"]["validation"]
    drawn = create_dataset(tmp_path / "d", worlds.config_of("lock", "validation", 5), find("procedural"))
    assert worlds.unlike(card, drawn) == []


def test_a_board_that_is_another_one_is_named(
    few_objects: Callable[[int], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = library_at(few_objects(0))
    (tmp_path / "files").mkdir()
    monkeypatch.setattr(worlds, "FILES", tmp_path / "files")
    monkeypatch.setattr(worlds, "SETS", {"validation": "train"})
    monkeypatch.setattr(worlds, "config_of", lambda world, name, of=worlds.config_of: of(world, name, 3))
    worlds.write("gates", library, tmp_path / "written")
    assert worlds.check("gates", library, tmp_path / "again") == []
    file = tmp_path / "files" / "gates.json"
    told = json.loads(file.read_text())
    card = told["objects"][library.name]["validation"]
    first, *rest = card["board_digests"].split()
    card |= {"board_hash": "0" * 64, "board_digests": " ".join(["0" * 16, *rest])}
    file.write_text(json.dumps(told))
    assert worlds.check("gates", library, tmp_path / "again") == ["gates/validation: boards [0] are others"]
