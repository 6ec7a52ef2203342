"""Parts of the time: each counts for itself, and together they are the whole."""

import time
from collections import Counter
from pathlib import Path

from benchmarks.speed.parts import BUILDING, TWICE, Clock, collect, table, watching
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.objects.resolve import find
from busybot.sim import interaction
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig


def busy(seconds: float) -> None:
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_a_part_is_told_without_those_that_it_called() -> None:
    clock = Clock()
    with clock.part("outer"):
        busy(0.02)
        for _ in range(2):
            with clock.part("inner"):
                busy(0.02)
                assert clock.within == ["outer", "inner"]
    assert 0.02 <= clock.seconds["outer"] < 0.035 and 0.04 <= clock.seconds["inner"] < 0.06 and not clock.within


def test_the_rest_is_other_and_parts_have_the_limits_that_there_are() -> None:
    rows = table({"little": 0.001, "much": 0.003}, 0.005, {"much": ("bare", 0.0015)})
    assert [(name, row["ms"]) for name, row in rows.items()] == [("much", 3), ("little", 1), ("other", 1), ("all", 5)]
    assert (rows["much"]["limit"], rows["much"]["ratio"], rows["much"]["share"]) == ("bare", 2, 0.6)
    assert "limit" not in rows["little"]


def test_collecting_consists_of_these_parts(tmp_path: Path) -> None:
    simulator = Simulator(find("procedural"), RenderConfig(width=160, height=120))
    board = next(generate_boards(BoardConfig(boards=1), simulator.library))
    clock, count = Clock(), Counter[str]()
    observe, execute = BoardScene.observe, interaction._execute
    began = time.process_time()
    with watching(clock, count):
        episode = collect(simulator, board, tmp_path / "e.mcap", clock)
    whole = time.process_time() - began
    assert set(BUILDING) | {TWICE, "render", "JPEG", "depth", "segmentation", "hashing"} < set(clock.seconds)
    assert 0.7 * whole < sum(clock.seconds.values()) <= whole
    assert count["physics"] >= len(episode.steps) and len(episode.images) == 1 + sum(s.success for s in episode.steps)
    assert BoardScene.observe is observe and interaction._execute is execute
