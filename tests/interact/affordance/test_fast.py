"""A model in its folder, and what it makes of a picture."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.affordance.fast import AffordanceModel
from busybot.interact.affordance.load import find_model, load_model
from busybot.interact.affordance.networks import KINDS, make_network
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.policy.direction_pairs import NOT_ELEVATED
from busybot.objects.resolve import find
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.training.checkpoint import initialise
from tests.episodes.synthetic import make_episode

NO_BOXES = np.empty((0, 4), np.int16)


def untrained(inputs: str = "depth") -> AffordanceModel:
    info = AffordanceInfo(inputs=inputs, thresholds={"explore": 0.3})
    networks = {kind: make_network(kind, info.inputs) for kind in KINDS}
    for network in networks.values():
        initialise(network, torch.Generator().manual_seed(3))
    return AffordanceModel(info, networks)


@pytest.fixture
def seen() -> tuple[Observation, Rays]:
    """A picture without what a learner must not see."""
    episode = make_episode(0)
    return episode.observation(0), Rays(episode.camera)


def test_a_folder_holds_all_of_a_model(tmp_path: Path, seen: tuple[Observation, Rays]) -> None:
    model = untrained()
    model.save(tmp_path / "m")
    loaded = load_model(tmp_path / "m")
    assert loaded.info.model_copy(update={"files": {}}) == model.info
    assert np.array_equal(loaded.look(*seen).affordance, model.look(*seen).affordance)
    assert sum(path.stat().st_size for path in (tmp_path / "m").iterdir()) < 5e6
    assert not [path for path in (tmp_path / "m").iterdir() if path.suffix not in (".json", ".safetensors")]


@pytest.mark.parametrize("inputs", ["depth", "rgb"])
def test_only_elevated_pixels_can_be_acted_on(inputs: str, seen: tuple[Observation, Rays]) -> None:
    view = untrained(inputs).look(*seen)
    image, rays = seen
    assert view.height.shape == view.affordance.shape == image.depth.shape == view.features.shape[1:]
    elevated = np.nan_to_num(rays.heights(image.depth), nan=-1) > 0.002
    assert (view.affordance[~elevated] == NOT_ELEVATED).all()
    assert (view.affordance[elevated] > NOT_ELEVATED).all()


def test_what_is_far_from_every_object_does_not_change_what_is_seen(seen: tuple[Observation, Rays]) -> None:
    """The position network is run around what is elevated, wherever in the picture that is."""
    image, rays = seen
    board = 4.0
    lone = np.full_like(image.depth, board)
    lone[60:80, 90:110] = 3.7
    view = untrained().look(replace(image, depth=lone), rays)
    assert ((view.affordance > NOT_ELEVATED) == (lone < board)).all()
    empty = untrained().look(replace(image, depth=np.full_like(lone, board)), rays)
    assert (empty.affordance == NOT_ELEVATED).all()


@pytest.fixture(scope="module")
def scene() -> BoardScene:
    library = find("procedural")
    board = next(iter(generate_boards(BoardConfig(boards=1, seed=1, group_size=1), library)))
    return Simulator(library, RenderConfig()).board(board)


def test_around_what_is_elevated_it_sees_what_it_sees_in_the_whole_picture(
    scene: BoardScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the window leaves out is board, which says next to nothing about what stands on it."""
    model, picture, rays = load_model("procedural"), scene.observe().observation(scene.camera), Rays(scene.camera)
    model.bfloat16 = False
    part = model.look(picture, rays)
    monkeypatch.setattr("busybot.interact.affordance.fast.MARGIN", 640)
    whole = model.look(picture, rays)
    assert part.kept and part.kept.window and whole.kept and whole.kept.window == (slice(0, 480), slice(0, 640))
    assert max(side.stop - side.start for side in part.kept.window) < 640
    elevated = whole.affordance > NOT_ELEVATED
    given, wanted = (1 / (1 + np.exp(-view.affordance[elevated])) for view in (part, whole))
    assert np.ptp(wanted) > 0.9, "the picture has something to tell apart"
    assert np.abs(given - wanted).max() < 0.05


@pytest.mark.parametrize("inputs", ["depth", "rgb"])
def test_looking_again_sees_what_a_first_look_sees(scene: BoardScene, inputs: str) -> None:
    """Whatever moved, and whatever a responder did."""
    model = load_model("procedural") if inputs == "depth" else untrained("rgb")
    rays, view, windows = Rays(scene.camera), None, set()
    model.bfloat16 = False
    for number, trigger in enumerate(scene.triggers):
        scene.set_trigger(number, (trigger.state + 1) % 2)
        picture = scene.observe().observation(scene.camera)
        view, anew = model.look(picture, rays, view), model.look(picture, rays)
        assert np.array_equal(view.features, anew.features) and np.array_equal(view.height, anew.height)
        np.testing.assert_allclose(view.affordance, anew.affordance, rtol=1e-5, atol=1e-4)
        assert view.kept and anew.kept and view.kept.position is not anew.kept.position
        windows.add(id(view.kept.position))
    assert len(windows) < len(scene.triggers), "most of these looks went on from the one before"


def test_two_looks_may_begin_with_the_same_one(scene: BoardScene) -> None:
    """What follows an image is tried more than once by whoever compares actions."""
    model, rays = load_model("procedural"), Rays(scene.camera)
    model.bfloat16 = False
    first = model.look(scene.observe().observation(scene.camera), rays)
    for number, trigger in enumerate(scene.triggers[:3]):
        before = scene.save()
        scene.set_trigger(number, (trigger.state + 1) % 2)
        picture = scene.observe().observation(scene.camera)
        scene.restore(before)
        given, wanted = (model.look(picture, rays, earlier).affordance for earlier in (first, None))
        np.testing.assert_allclose(given, wanted, rtol=1e-5, atol=1e-4)


def test_a_card_with_a_constant_that_does_not_exist_is_refused_by_its_file(tmp_path: Path) -> None:
    untrained().save(tmp_path)
    card = tmp_path / "model.json"
    for thresholds, message in (('"explor": 0.3', "explor: Extra"), ('"explore": 3.0', "explore: Input should be")):
        card.write_text(card.read_text().replace('"explore": 0.3', thresholds))
        with pytest.raises(BusybotError, match=rf"model\.json: thresholds: .*{message}"):
            load_model(tmp_path)
        card.write_text(card.read_text().replace(thresholds, '"explore": 0.3'))


def test_directions_of_some_pixels(seen: tuple[Observation, Rays]) -> None:
    model = untrained()
    view = model.look(*seen)
    pixels = np.array([[0, 0], [80, 60], [159, 119]])  # crops at the border reach outside of the picture
    position, probabilities = model.directions(view, pixels)
    assert position.shape == (3,) and probabilities.shape == (3, 18)
    assert ((probabilities > 0) & (probabilities < 1)).all()
    alone = model.directions(view, pixels[1:2])[1]
    assert np.allclose(alone, probabilities[1:2], atol=0.02)
    assert model.directions(view, np.empty((0, 2), int))[1].shape == (0, 18)


def test_what_is_no_model_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="nowhere: no model of that name"):
        find_model("nowhere")
    untrained().save(tmp_path)
    weights = tmp_path / "position.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(BusybotError, match=r"position\.safetensors: damaged"):
        load_model(tmp_path)


def test_weights_of_other_inputs_are_refused(tmp_path: Path) -> None:
    untrained("rgb").save(tmp_path / "rgb")
    untrained().save(tmp_path / "depth")
    (tmp_path / "rgb" / "position.safetensors").replace(tmp_path / "depth" / "position.safetensors")
    with pytest.raises(BusybotError, match="its SHA-256 is"):
        load_model(tmp_path / "depth")
    card = json.loads((tmp_path / "depth" / "model.json").read_text())
    (tmp_path / "depth" / "model.json").write_text(json.dumps(card | {"files": {}}))  # as older models have it
    with pytest.raises(BusybotError, match="not the weights of this network"):
        load_model(tmp_path / "depth")


def test_a_trainings_folder_stands_for_its_model(tmp_path: Path) -> None:
    untrained().save(tmp_path / "model")
    assert find_model(tmp_path) == tmp_path / "model"


def test_a_closer_look_is_taken_again_only_where_something_changed(
    seen: tuple[Observation, Rays], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, (image, rays) = untrained(), seen
    sizes: list[int] = []
    run = model._run
    monkeypatch.setattr(model, "_run", lambda kind, x: (sizes.append(len(x)), run(kind, x))[1])
    pixels = np.array([[20, 30], [120, 80], [125, 82]])
    first = model.look(image, rays)
    model.directions(first, pixels)
    moved = image.depth.copy()
    moved[78:84, 118:124] -= 0.3
    after = replace(image, depth=moved)
    position, probabilities = model.directions(model.look(after, rays, first), pixels[::-1])
    assert sizes == [3, 2], "the crop around (20, 30) is as it was"
    anew = model.directions(model.look(after, rays), pixels[::-1])
    assert np.allclose(position, anew[0], atol=1e-5) and np.allclose(probabilities, anew[1], atol=1e-5)


@pytest.mark.parametrize("able", [False, True])
def test_numbers_are_rounded_where_that_is_faster_and_mean_the_same(
    able: bool, seen: tuple[Observation, Rays], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without bfloat16 in the processor, imitating it would cost several times as much as not rounding."""
    monkeypatch.setattr("busybot.interact.affordance.fast.multiplies_bfloat16", lambda: able)
    model, exact = load_model("procedural"), load_model("procedural")
    exact.bfloat16 = False
    assert model.bfloat16 is able
    given, wanted = (1 / (1 + np.exp(-one.look(*seen).affordance)) for one in (model, exact))
    assert np.array_equal(given, wanted) is not able
    assert np.abs(given - wanted)[wanted > 1e-3].mean() < 0.02
