"""What a model thought before every action follows from the recording."""

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.interact.trace import retrace
from busybot.objects.library import find
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policies import BuiltIn
from busybot.sim.recorder import record_episode
from busybot.sim.render import RenderConfig
from busybot.sim.scene import Simulator
from tests.interact.scenes import ButtonModel


def test_links_are_known_once_they_moved() -> None:
    library = find("procedural")
    (board,) = generate_boards(BoardConfig(boards=1, seed=2), library)
    episode = record_episode(Simulator(library, RenderConfig()), board, BuiltIn("scripted"), 6, InteractionConfig(), 0)
    thoughts = list(retrace(episode, ButtonModel()))
    assert [thought.step for thought in thoughts] == list(range(6))
    assert not thoughts[0].links.any() and not thoughts[0].known
    moved = {(step.acted_object, step.acted_link) for step in episode.steps[:5] if step.reward}
    assert thoughts[5].links.max() == len(moved)
    for thought in thoughts:
        assert thought.affordance.shape == (480, 640) and 0 <= thought.affordance.min() <= thought.affordance.max() <= 1
