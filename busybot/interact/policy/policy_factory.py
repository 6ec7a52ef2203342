"""Factories of learned policies: plain data that worker processes receive; models are loaded there at first use.

What a model is, its card tells: who only asks that need not import PyTorch.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from busybot.common.errors import UsageError
from busybot.episodes.camera import Rays
from busybot.interact.policy.config import AffordanceInfo, PolicyConfig, without_fixed
from busybot.interact.policy.exploration import ExplorationConfig, GuidedExplorer, UnguidedExplorer
from busybot.interact.policy.learned import LearnedPolicy, Mode, policy_name
from busybot.interact.policy.paper import PaperPolicy, PaperRules
from busybot.sim.policy import Policy
from busybot.training.model_cards import INFO_FILE, file_hashes, find_folder, read_info

if TYPE_CHECKING:
    from busybot.interact.affordance.fast import AffordanceModel

DEFAULT_MODEL = "procedural"
"""The shipped model that commands use when none is named."""
_OF_THE_BONUS = frozenset({"ucb_c", "ucb_window"})
_OF_EVALUATING, _OF_COLLECTING = frozenset({"explore", "insist"}), frozenset({"collect", "persist", "untried_first"})
_OF_CHOOSING = _OF_THE_BONUS | _OF_EVALUATING | _OF_COLLECTING
_NOT_READ: dict[Mode, frozenset[str]] = {
    "evaluate": _OF_THE_BONUS | _OF_COLLECTING,
    "collect": _OF_THE_BONUS | _OF_EVALUATING,
    "greedy": frozenset(PolicyConfig.model_fields) - {"blur"},
    "ucb": frozenset(PolicyConfig.model_fields) - {"blur", "prior"} - _OF_THE_BONUS,
}
"""Constants that change nothing in a mode."""
_OF_OTHER_CANDIDATES = {"peaks": frozenset({"clusters", "cluster_belief"}), "kmeans": frozenset({"peak_logit", "most"})}
"""Constants that only the other way to find candidates reads."""
_READ_AS_PAPER: dict[Mode, frozenset[str]] = {
    "collect": frozenset({"clusters", "cluster_belief"}),
    "greedy": frozenset(),
    "ucb": _OF_THE_BONUS,
}
"""Constants that the paper's policy reads, which acts with a paper model in these modes."""


@dataclass(frozen=True)
class LearnedPolicyFactory:
    """Makes the policy of a trained model.

    Attributes:
        model: name of a shipped model, or a folder.
        mode: see `interact.policy.learned`.
        overrides: values of `PolicyConfig` that take precedence over those on the model's card.
    """

    model: str
    mode: Mode = "evaluate"
    overrides: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Depends on the mode alone: the same draws wherever the model lies."""
        return policy_name(self.mode)

    def make_policy(self, rays: Rays) -> Policy:
        model, constants = load_once(self.model), self._constants()
        if self._acts_as_paper(model.info):
            read = {name: getattr(constants, name) for name in _READ_AS_PAPER[self.mode]}
            return PaperPolicy(model, rays, PaperRules.model_validate({"ucb_c": 0, **read}), self.name)
        return LearnedPolicy(model, rays, constants, self.mode)

    def provenance(self) -> dict[str, Any]:
        """Everything that decides the choices, JSON values; two models are the same if this is."""
        return {"mode": self.mode, "policy": self._constants().provenance(), "model": fingerprint(self.model)}

    def _constants(self) -> PolicyConfig:
        """The policy's constants.

        Raises:
            UsageError: an override names no constant, has no allowed value, or one that this mode does not read.
        """
        info = card_of(self.model)
        config = policy_config(info, self.overrides)
        unread, where = _NOT_READ[self.mode], f"in mode {self.mode}"
        if self._acts_as_paper(info):
            unread = frozenset(PolicyConfig.model_fields) - _READ_AS_PAPER[self.mode]
            where += " of the paper's model"
        _refuse_unread(self.overrides, unread, where)
        _refuse_other_candidates(self.overrides, config, f"{where} ")
        return config

    def _acts_as_paper(self, info: AffordanceInfo) -> bool:
        return info.variant == "paper" and self.mode in _READ_AS_PAPER


@dataclass(frozen=True)
class ExplorePolicyFactory:
    """Makes the policy that collects a training round, or an epoch of the `paper` variant's training.

    Attributes:
        model: that of the round or epoch before; None in the first round, and where rules leave everything to chance.
        config: how it explores; `PaperRules` for the paper's policy.
    """

    model: str | None
    config: ExplorationConfig | PaperRules = ExplorationConfig()

    @property
    def name(self) -> str:
        if isinstance(self.config, PaperRules):
            return "explore-paper"
        return UnguidedExplorer.name if self.model is None else GuidedExplorer.name

    def make_policy(self, rays: Rays) -> Policy:
        model = None if self.model is None else load_once(self.model)
        if isinstance(self.config, PaperRules):
            return PaperPolicy(model, rays, self.config, self.name)
        return UnguidedExplorer(rays, self.config) if model is None else GuidedExplorer(model, rays, self.config)

    def provenance(self) -> dict[str, Any]:
        """Everything that decides the choices, JSON values."""
        model = None if self.model is None else fingerprint(self.model)
        return {"explore": self.config.model_dump(mode="json"), "model": model}


def usual_mode(model: str) -> Mode:
    """The mode in which a model is judged if none is asked for: the paper's variant with the paper's policy."""
    return "ucb" if card_of(model).variant == "paper" else "evaluate"


def card_of(name_or_path: str) -> AffordanceInfo:
    """What the model's card says; its weights are not read.

    Raises:
        BusybotError: there is no such model, or its card is damaged.
    """
    return read_info(find_folder(name_or_path, "interact"), AffordanceInfo)


def policy_config(info: AffordanceInfo, overrides: dict[str, Any]) -> PolicyConfig:
    """The defaults, then the model's card, then the overrides.

    Raises:
        BusybotError: there is no such parameter, or its value is not allowed.
    """
    try:
        own = {"prior": info.prior, "after_failure": info.after_failure, **info.thresholds}
        return PolicyConfig.model_validate(without_fixed({**own, **overrides}))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        known = f"the learned policy's parameters are {', '.join(PolicyConfig.model_fields)}"
        raise UsageError(f"parameter {place} of the learned policy: {first['msg']}", known) from None
    except ValueError as error:
        raise UsageError(f"parameter {error}", "leave it out") from None


def candidates_config(info: AffordanceInfo, overrides: dict[str, Any]) -> PolicyConfig:
    """`policy_config` for candidates among which somebody else chooses.

    Raises:
        BusybotError: as there; or an override is of what only the policy's own choice reads.
    """
    config = policy_config(info, overrides)
    _refuse_unread(overrides, _OF_CHOOSING, "where somebody else chooses among the candidates")
    _refuse_other_candidates(overrides, config)
    return config


def _refuse_other_candidates(overrides: dict[str, Any], config: PolicyConfig, where: str = "") -> None:
    unread = _OF_OTHER_CANDIDATES[config.candidates]
    _refuse_unread(overrides, unread, f"{where}with candidates={config.candidates}")


def _refuse_unread(overrides: dict[str, Any], unread: frozenset[str], where: str) -> None:
    for name in sorted(unread.intersection(overrides)):
        raise UsageError(f"learned.{name} changes nothing {where}", "leave it out")


def fingerprint(name_or_path: str) -> dict[str, Any]:
    """What a model is, without where it lies: hashes of its files, and its card."""
    folder = find_folder(name_or_path, "interact")
    card = card_of(name_or_path).model_dump(mode="json", exclude={"files"})  # they are in `sha256`
    return {"name": folder.name, "sha256": file_hashes(folder), "card": card}


def load_once(name_or_path: str) -> "AffordanceModel":
    """The model, read anew when its card on disk changed."""
    folder = find_folder(name_or_path, "interact")
    return _load(str(folder), (folder / INFO_FILE).stat().st_mtime_ns)


@lru_cache(maxsize=2)
def _load(folder: str, changed: int) -> "AffordanceModel":
    from busybot.interact.affordance.load import load_model

    return load_model(folder)
