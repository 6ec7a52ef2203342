"""Factories are plain data that name a model; what decides the actions is recorded, where the model lies is not."""

import multiprocessing
import shutil
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.interact.affordance.fast import AffordanceModel
from busybot.interact.affordance.networks import KINDS, make_network
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.policy.exploration import GuidedExplorer, UnguidedExplorer
from busybot.interact.policy.learned import LearnedPolicy, mode_named
from busybot.interact.policy.policy_factory import (
    ExplorePolicyFactory,
    LearnedPolicyFactory,
    candidates_config,
    policy_config,
)
from tests.episodes.synthetic import make_camera, make_episode


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models") / "untrained"
    networks = {kind: make_network(kind, "depth") for kind in KINDS}
    AffordanceModel(AffordanceInfo(thresholds={"explore": 0.6}), networks).save(folder)
    return folder


def test_the_card_comes_before_the_defaults_and_overrides_before_the_card() -> None:
    info = AffordanceInfo(prior=0.3, thresholds={"explore": 0.6, "collect": 0.7})
    config = policy_config(info, {"collect": 0.8})
    assert (config.prior, config.explore, config.collect, config.peak_radius) == (0.3, 0.6, 0.8, 3)
    with pytest.raises(BusybotError, match="parameter explor of the learned policy"):
        policy_config(info, {"explor": 1})


def test_constants_of_former_cards_are_known_with_the_value_that_they_have_now(model: Path) -> None:
    former = {"effect": 150, "failure_sigma": 6, "opening": 5, "same_link": 0.25, "explore": 0.6}
    assert policy_config(AffordanceInfo(thresholds=former), {}) == policy_config(
        AffordanceInfo(thresholds={"explore": 0.6}), {}
    )
    recorded = LearnedPolicyFactory(str(model)).provenance()["policy"]
    assert former.items() <= recorded.items()  # what was recorded before goes on
    with pytest.raises(ValidationError, match="effect: it is 150 in every model now, not 75"):
        AffordanceInfo(thresholds={"effect": 75})
    with pytest.raises(BusybotError, match=r"parameter opening: it is 5 in every model now, not 9"):
        policy_config(AffordanceInfo(), {"opening": 9})


def test_constants_that_a_mode_does_not_read_are_refused(model: Path) -> None:
    for mode, read, unread in (
        ("evaluate", {"explore": 0.2, "caution": 0.5}, {"collect": 0.2}),
        ("collect", {"collect": 0.2, "untried_first": False}, {"insist": 0.3}),
        ("greedy", {"blur": 5}, {"prior": 0.2}),
        ("ucb", {"ucb_c": 1.0, "blur": 5}, {"explore": 0.2}),
    ):
        kept = LearnedPolicyFactory(str(model), mode_named(mode), read).provenance()["policy"]
        assert read.items() <= kept.items()
        with pytest.raises(BusybotError, match=f"learned.{next(iter(unread))} changes nothing in mode {mode}"):
            LearnedPolicyFactory(str(model), mode_named(mode), unread).provenance()


def test_of_candidates_nobody_changes_how_the_policy_would_choose() -> None:
    info = AffordanceInfo(thresholds={"explore": 0.6})  # what a card says of it is left alone
    assert candidates_config(info, {"caution": 0.5, "most": 7}) == policy_config(info, {"caution": 0.5, "most": 7})
    for name in ("explore", "insist", "collect", "persist", "untried_first", "ucb_c"):
        with pytest.raises(BusybotError, match=f"learned.{name} changes nothing where somebody else chooses"):
            candidates_config(info, {name: 1})


def test_provenance_knows_the_weights_and_not_the_place(model: Path, tmp_path: Path) -> None:
    copy = tmp_path / "untrained"
    shutil.copytree(model, copy)
    here, there = LearnedPolicyFactory(str(model)), LearnedPolicyFactory(str(copy))
    assert here.provenance() == there.provenance() and here.name == there.name
    assert here.provenance()["policy"]["explore"] == 0.6
    assert LearnedPolicyFactory(str(model), "ucb").provenance() != here.provenance()
    (copy / "position.safetensors").write_bytes((copy / "position.safetensors").read_bytes()[:-1] + b"x")
    assert here.provenance()["model"]["sha256"] != there.provenance()["model"]["sha256"]


def test_factories_make_policies_of_their_kind(model: Path) -> None:
    rays = Rays(make_camera())
    seen = make_episode().observation(0)
    kinds = (
        (LearnedPolicyFactory(str(model)), LearnedPolicy),
        (LearnedPolicyFactory(str(model), "collect"), LearnedPolicy),
        (ExplorePolicyFactory(None), UnguidedExplorer),
        (ExplorePolicyFactory(str(model)), GuidedExplorer),
    )
    for factory, kind in kinds:
        policy = factory.make_policy(rays)
        assert isinstance(policy, kind) and policy.name == factory.name
        action = policy.select_action(seen, np.random.default_rng(0))
        assert action is not None and min(action.pixel) >= 0
        assert action.pixel[0] < seen.depth.shape[1] and action.pixel[1] < seen.depth.shape[0]


@pytest.mark.long
def test_factories_go_to_other_processes(model: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        name = pool.apply(_name, (LearnedPolicyFactory(str(model), "collect"),))
    assert name == "learned"


def _name(factory: LearnedPolicyFactory) -> str:
    return factory.make_policy(Rays(make_camera())).name


def test_an_unknown_model_is_told() -> None:
    with pytest.raises(BusybotError, match="no model of that name"):
        LearnedPolicyFactory("nonsense").provenance()


def test_constants_of_the_other_candidates_are_refused() -> None:
    for overrides, where in (
        ({"clusters": 3}, "learned.clusters changes nothing in mode evaluate with candidates=peaks"),
        ({"candidates": "kmeans", "peak_logit": 3.0}, "learned.peak_logit changes nothing .* with candidates=kmeans"),
    ):
        with pytest.raises(BusybotError, match=where):
            LearnedPolicyFactory("procedural", overrides=overrides).provenance()
    LearnedPolicyFactory("procedural", overrides={"candidates": "kmeans", "clusters": 3}).provenance()
