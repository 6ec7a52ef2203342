"""A whole training of the paper variant on a tiny schedule, from rounds that were recorded before."""

import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.episodes.camera import Rays
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import PaperPositionNet
from busybot.interact.affordance.paper import PaperModel
from busybot.interact.policy.config import AffordanceInfo, PolicyConfig
from busybot.interact.policy.direction_pairs import NOT_ELEVATED, sigmoid
from busybot.interact.policy.learned import LearnedPolicy, mode_named, policy_name
from busybot.interact.policy.paper import PaperPolicy
from busybot.interact.policy.policy_factory import LearnedPolicyFactory, usual_mode
from busybot.interact.training import paper
from busybot.interact.training.config import PaperConfig
from busybot.interact.training.paper import PaperAffordanceLearner, PaperTraining
from busybot.interact.training.round_recorder import Recorder, RoundProgress
from busybot.interact.training.sample_cache import Samples
from busybot.training.checkpoint import save_tensors
from busybot.training.model_cards import read_info, write_info
from busybot.training.run_folder import read_metrics
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.interact.trainings import weights

CONFIG = PaperConfig.model_validate(
    {
        "epochs": 4,
        "random_epochs": 1,
        "all_directions_epochs": 2,
        "joint_epochs": 3,
        "buffer": 20,
        "threads": 1,
        "interaction": {"delta": 20},
        "position": {"batch": 2, "iterations": 2},
        "direction": {"batch": 2, "iterations": 3},
    }
)
"""Epoch 0 trains nothing, 1 the position network, 2 nothing, 3 both; the buffer holds the last one and a bit."""
BOARDS = (2, 3, 4, 3)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four epochs; boards have six steps. The second and the fourth are equal: they share a cache."""
    folder = tmp_path_factory.mktemp("recorded")
    for epoch, boards in enumerate(BOARDS):
        make_dataset(folder / f"{epoch:03d}", boards=boards, finished=range(boards))
    return folder


def training(out: Path, rounds: Path | None = None, config: PaperConfig = CONFIG) -> PaperTraining:
    told = RoundProgress(lambda text: None, lambda label: nullcontext(lambda done, total: None))
    datasets = tuple(sorted(rounds.iterdir())) if rounds else ()
    return PaperTraining(out, config, Recorder(None, config, 0, 1, told), datasets)


@pytest.fixture(scope="module")
def trained(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained") / "run"
    training(out, recorded).run()
    return out


@pytest.mark.long
def test_each_phase_trains_its_networks(trained: Path) -> None:
    iterations = {kind: len(read_metrics(trained / "metrics" / f"{kind}.jsonl")) for kind in ("position", "direction")}
    assert iterations == {"position": 4, "direction": 3}
    epochs = read_metrics(trained / "metrics" / "epochs.jsonl")
    assert [line["epoch"] for line in epochs] == [0, 1, 2, 3]
    assert [line["epsilon_direction"] for line in epochs] == [1, 1, 1, 1]
    assert [line["steps"] for line in epochs] == [6 * boards for boards in BOARDS]
    assert all(0 < line["rewarded"] < line["steps"] for line in epochs)
    assert (trained / "training.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_only_what_is_in_the_buffer_stays_cached(trained: Path, recorded: Path) -> None:
    assert len(list((trained / "cache").iterdir())) == 2
    run = training(trained, recorded)
    run.run()  # nothing is left to do
    samples = run.buffer(3)
    assert len(samples) == 20 and samples.first == 22
    assert list(np.bincount(samples.dataset)) == [2, 18]


@pytest.mark.long
def test_going_on_tells_of_no_epoch_again_that_was_told(
    trained: Path, recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of hundreds of epochs that takes minutes, and until it is done fewer of them are told."""
    told: list[int] = []
    monkeypatch.setattr(paper, "PLOT_EVERY", 1)
    monkeypatch.setattr(PaperTraining, "_report", lambda self: told.append(len(self.datasets)))
    training(trained, recorded).run()
    assert told == [4]


def test_the_buffer_is_as_full_as_it_can_be_where_episodes_ended_early(tmp_path: Path) -> None:
    """The second epoch's might have had 24 steps, and have 8."""
    run = training(tmp_path / "run")
    for name, boards, steps in (("000", 3, 6), ("001", 4, 2)):
        dataset = make_dataset(tmp_path / name, boards=boards, finished=())
        for index in range(boards):
            write_episode(dataset.episode_path(index), make_episode(index, steps=steps))
        dataset.write_tables()
        run.datasets.append(dataset)
    samples = run.buffer(1)
    assert len(samples) == 20 and samples.first == 6 and list(np.bincount(samples.dataset)) == [12, 8]


@pytest.mark.long
def test_killed_and_continued_it_ends_in_the_same_weights(
    trained: Path, recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learn, calls = PaperAffordanceLearner.learn, []

    def dies(self: PaperAffordanceLearner, samples: Samples, rng: np.random.Generator) -> float:
        calls.append(1)
        if len(calls) in (2, 6):
            raise KeyboardInterrupt
        return learn(self, samples, rng)

    monkeypatch.setattr(PaperAffordanceLearner, "learn", dies)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            training(tmp_path / "run", recorded).run()
    training(tmp_path / "run", recorded).run()
    assert weights(tmp_path / "run") == weights(trained)
    assert len(weights(trained)) == 2


@pytest.mark.long
def test_offline_it_repeats_the_training_from_its_own_rounds(trained: Path, recorded: Path, tmp_path: Path) -> None:
    shutil.copytree(recorded, tmp_path / "run" / "rounds")
    training(tmp_path / "run").run()
    assert weights(tmp_path / "run") == weights(trained)


def test_where_nothing_can_be_learned_there_is_no_model(tmp_path: Path) -> None:
    """No step of the only epoch was rewarded."""
    dataset = make_dataset(tmp_path / "000", boards=1, finished=())
    episode = make_episode(0, steps=4)
    unrewarded = [replace(step, reward=0) for step in episode.steps]
    write_episode(dataset.episode_path(0), replace(episode, steps=unrewarded))
    dataset.write_tables()
    (tmp_path / "rounds").mkdir()
    dataset.path.rename(tmp_path / "rounds" / "000")
    run = training(tmp_path / "run", tmp_path / "rounds", CONFIG.model_copy(update={"epochs": 1, "random_epochs": 1}))
    with pytest.raises(BusybotError, match="no recorded action succeeded"):
        run.run()
    assert not (tmp_path / "run" / "model").exists()


def test_the_model_is_loaded_like_any_other(trained: Path, recorded: Path) -> None:
    model = load_model(trained)
    assert isinstance(model, PaperModel) and model.info.variant == "paper"
    model.bfloat16 = False  # which processors round so is not asked here
    assert model.info.training["rounds"]["epochs"] == 4 and model.info.training["rounds"]["steps"] == 72
    assert usual_mode(str(trained)) == "ucb"
    policy = LearnedPolicyFactory(str(trained)).provenance()["policy"]
    own = {"candidates": "kmeans", "cluster_belief": "middle", "blur": 1, "prior": 0.5, "caution": 0, "temperature": 1}
    own |= dict.fromkeys(("component_penalty", "failure_penalty", "responder_penalty", "trigger_bonus"), 0)
    assert policy == PolicyConfig.model_validate(own).provenance()
    episode = read_episode(recorded / "000" / "episodes" / "000000.mcap")
    rays, seen = Rays(episode.camera), episode.observation(0)
    view = model.look(seen, rays)
    assert view.affordance.shape == seen.depth.shape
    elevated = np.nan_to_num(rays.heights(seen.depth), nan=-1) > 0.002
    assert ((view.affordance > NOT_ELEVATED) == elevated).all()
    with torch.no_grad():
        softmax = model.networks["position"](torch.from_numpy(view.features)[None])[0].softmax(0)[1].numpy()
    assert np.allclose(sigmoid(view.affordance)[elevated], softmax[elevated], atol=1e-5)
    pixels = np.array([[40, 60], [80, 60], [159, 119]])
    position, directions = model.directions(view, pixels)
    assert np.array_equal(position, view.affordance[pixels[:, 1], pixels[:, 0]])
    assert directions.shape == (3, 18) and ((directions > 0) & (directions < 1)).all()
    assert np.allclose(model.directions(view, pixels[1:2])[1], directions[1:2], atol=1e-5)


def test_it_acts_by_the_papers_policy_unless_another_mode_is_asked_for(trained: Path, recorded: Path) -> None:
    episode = read_episode(recorded / "000" / "episodes" / "000000.mcap")
    rays, draws = Rays(episode.camera), generator(0, "", 0, "test")
    kinds = {"ucb": PaperPolicy, "greedy": PaperPolicy, "collect": PaperPolicy, "evaluate": LearnedPolicy}
    for mode, kind in kinds.items():
        policy = LearnedPolicyFactory(str(trained), mode_named(mode)).make_policy(rays)
        assert type(policy) is kind and policy.name == policy_name(mode_named(mode))
        pixels, seen = [], episode.observation(0)
        for _ in range(3):
            action = policy.select_action(seen, draws)
            assert action is not None
            policy.observe(action, action.directions, 0, seen)
            pixels.append(action.pixel)
        assert len(action.directions) == 1
        if mode != "collect":
            assert (len(set(pixels)) == 1) == (mode == "greedy")
    for mode, name in (("collect", "collect"), ("ucb", "clusters"), ("greedy", "ucb_c")):
        with pytest.raises(BusybotError, match=f"learned.{name} changes nothing in mode {mode} of the paper's model"):
            LearnedPolicyFactory(str(trained), mode_named(mode), {name: 1}).provenance()


def test_pictures_of_another_size_are_refused(trained: Path) -> None:
    from tests.episodes.synthetic import make_episode

    episode = make_episode(0, width=128, height=96)
    with pytest.raises(BusybotError, match="128 x 96 pixels, the model was trained on 160 x 120"):
        load_model(trained).look(episode.observation(0), Rays(episode.camera))


def test_weights_of_former_versions_are_refused(trained: Path, tmp_path: Path) -> None:
    shutil.copytree(trained / "model", tmp_path / "model")
    network: nn.Module = nn.Sequential(nn.Conv2d(4, 32, 3), nn.ReLU())
    card = read_info(tmp_path / "model", AffordanceInfo)
    file = tmp_path / "model" / "position.safetensors"
    save_tensors(file, network.state_dict())
    write_info(tmp_path / "model", card, [file])
    with pytest.raises(BusybotError, match=r"position\.safetensors: .*as its networks were before") as caught:
        load_model(tmp_path)
    assert "train the model again" in str(caught.value)
    network = PaperPositionNet(4)
    network.stem = nn.Sequential(network.stem, nn.Conv2d(32, 32, 3))  # two convolutions at full resolution
    save_tensors(file, network.state_dict())
    write_info(tmp_path / "model", card, [file])
    with pytest.raises(BusybotError, match="as its networks were before"):
        load_model(tmp_path)


def test_recorded_pictures_that_are_too_small_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="pictures of 160 x 48 pixels: .* need 64 a side"):
        training(tmp_path / "run").begin((48, 160))


def test_as_many_datasets_as_epochs(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="4 datasets for 400 epochs"):
        training(tmp_path / "run", recorded, PaperConfig())
