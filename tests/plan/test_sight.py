"""Features of pictures one by one are those of the recorded episode."""

from pathlib import Path

import numpy as np
import pytest

from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.plan.agent_policy import OnlineFeatures
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import observe_episode


@pytest.mark.parametrize("encoder", ["embedded", "random-centre"])
def test_pictures_one_by_one_give_the_features_of_the_episode(encoder: str, tiny: Path) -> None:
    dataset, chosen = Dataset.open(tiny), make_extractor(encoder)
    for index in (0, 5):
        observed = observe_episode(read_episode(dataset.episode_path(index)))
        together = chosen.of(observed)
        sight = OnlineFeatures(observed, chosen)
        frames = [sight.see(observed.frame(number)) for number in range(len(observed.image_of))]
        np.testing.assert_allclose(np.stack(frames), together.astype(np.float32), rtol=2e-3 * (encoder != "embedded"))
        assert np.ptp(together.astype(float), axis=0).max() > 0.5  # something changed
