"""Make the fixture of the present schema version, once, before a change of the schema is released.

    python -m tests.episodes.make_fixture

`tests/episodes/fixtures/VERSION` then holds a frozen dataset of a simulation with tasks (since 1.2 in a world whose
mechanisms remember), a recording without a simulator, and what must be read from both. It is committed and never made
again: `test_schema_versions.py` reads all that are there.
"""

from pathlib import Path

from busybot.boards.config import BoardConfig
from busybot.common.atomic_io import write_json
from busybot.datasets.create import create_dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.summary import summarise
from busybot.episodes.digests import episode_digests
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import SCHEMA_VERSION
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.scene.render import RenderConfig
from tests.episodes.synthetic import make_real_episode

FIXTURES = Path(__file__).with_name("fixtures")


def make(folder: Path) -> None:
    """Write the fixture into a new folder."""
    library = find("procedural")
    dataset = create_dataset(folder / "dataset", BoardConfig(world="mixed", tasks="reach", boards=2, seed=1), library)
    actions = CollectConfig(policy="scripted", steps=4, render=RenderConfig(width=128, height=96))
    collect(dataset, library, actions, workers=1)
    freeze(dataset.path, library, carry=False)
    write_episode(folder / "real.mcap", make_real_episode(steps=3))
    digests = episode_digests(read_episode(folder / "real.mcap"))
    write_json(folder / "expected.json", {"dataset": summarise(dataset.path), "real": vars(digests)})


if __name__ == "__main__":
    make(FIXTURES / SCHEMA_VERSION)
