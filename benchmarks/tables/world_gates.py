"""The gates of worlds: what a model of relations reaches on the frozen boards of every world, and what it misses.

    python -m benchmarks.tables.world_gates --work FOLDER --assets DIR --out benchmarks/results/world-gates.json
        [--policy FOLDER[,FOLDER]] [--models mechanism,FOLDER] [--sets validation] [--only gates,time] [--boards 200]
        [--curious] [--camera real] [--no-what-if]

The boards are those of `datasets/worlds`, whose hashes are compared. A learned interaction policy acts on them, 30
actions each, and the models are judged, together, by `busybot eval reason`, which logs each judging of a test set. Sets
are `validation`, on which choices may be made, and the three test splits. The exact observer of the true states is
judged beside, on the same recordings.

The policy is a training's folder. The shipped one, which acts without `--policy`, learned from procedural objects and
misses many links of real ones: what it records tells less. Recordings of each policy, and before each camera, have a
folder of their own. Of as many policies as models each acts for the model in its place, so that a row has a seed of all
that is learned. With `--curious` the model that ships chooses among the candidates on triggers, as `collect --policy
curious` does. Without questions "what if" nothing is told of mechanisms, and judging takes a third of the time.

Every command resumes, so this one does; what a model was judged on already is not judged again.
"""

import argparse
import hashlib
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.runner import assets_name, busybot, chosen, earlier, finish, generating, one_of, parser, told_rows
from busybot.boards.spec import PAPER
from busybot.boards.worlds import WORLDS
from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError, UsageError
from busybot.datasets.dataset import Dataset
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.plan.curious import REASONER
from busybot.training.model_cards import file_hashes, find_folder

frozen: Any = import_module("datasets.worlds")
"""`datasets/worlds.py`; a folder of the same name hides it from type checkers."""
KIND, STEPS, AFTER, SEED = "world-gates", 30, (10, 22, 30), frozen.SEED
FIGURES = (
    "mechanism_accuracy", "mechanism_bound", "mechanism_accuracy_met", "mechanism_bound_met", "mechanisms_met",
    "mechanism_missed_because", "parent_p", "parent_r", "shd", "shd_bound", "kind_accuracy", "kind_bound",
    "lag_accuracy", "lag_bound", "what_if", "what_if_bound", "what_if_pairs", "what_if_missed_because", "pred_a",
    "pred_a_successful", "rewirings", "rewired_found", "rewired_found_bound", "rewired_placed", "rewired_placed_bound",
    "rewired_missed_because", "rewired_false_alarms", "cause_intervals",
)  # fmt: skip
ALL = (*WORLDS, PAPER)
POINT = ("parent_f1", "parent_f1_bound", "link_parent_f1", "link_parent_f1_bound")


def recorded(world: str, name: str, policy: str | None, options: argparse.Namespace) -> Path:
    """A set's first boards, acted on by a policy: a training's folder, or None for the one that ships.

    Raises:
        BusybotError: the boards are not those that were frozen.
    """
    folder: Path = options.work / f"{digest_of(policy_hashes(policy))}{_suffix(options)}" / world / name
    chosen_by = "curious" if options.curious else "learned"
    busybot(*generating(folder, frozen.SETS[name], options.boards, SEED, options.assets), "--world", world)
    dataset = Dataset.open(folder)
    cards = read_json(frozen.FILES / f"{world}.json")["objects"].get(assets_name(options.assets), {})
    if name not in cards or frozen.unlike(cards[name], dataset):
        raise BusybotError(
            f"{world}/{name}: not the frozen boards", "draw them with the same objects; see datasets/worlds/README.md"
        )
    acting = ("--policy", chosen_by, *(("--model", policy) if policy else ()))
    drawing = ("--steps", str(STEPS), "--seed", str(SEED), "--assets", str(options.assets), "--camera", options.camera)
    busybot("collect", str(folder), *acting, *drawing)
    return folder


def _suffix(options: argparse.Namespace) -> str:
    asked = f"-{digest_of(curious_hashes())}" if options.curious else ""
    return asked if options.camera == "clean" else f"{asked}-{options.camera}"


def curious_hashes() -> dict[str, str]:
    """Hashes of the files of the model that is curious."""
    return file_hashes(find_folder(REASONER, "reason"))


def policy_hashes(policy: str | None) -> dict[str, str]:
    """Hashes of the files of an interaction policy."""
    return file_hashes(find_folder(policy or DEFAULT_MODEL, "interact"))


def models_by_policy(options: argparse.Namespace) -> dict[str | None, list[str]]:
    """The models that are judged on what each policy records.

    Raises:
        UsageError: two models have one name, or there are neither one policy nor as many as models.
    """
    models, policies = options.models.split(","), options.policy.split(",") if options.policy else [None]
    if len({Path(model).name for model in models}) < len(models):
        raise UsageError(f"{options.models}: two models have one name", "name each folder of a model otherwise")
    if len(policies) == 1:
        return {policies[0]: models}
    if len(set(policies)) < len(policies) or len(policies) != len(models):
        what = f"{options.policy}: {len(policies)} policies for {len(models)} models"
        raise UsageError(what, "name one policy for all models, or another one for each")
    return {policy: [model] for policy, model in zip(policies, models, strict=True)}


def digest_of(hashes: dict[str, str]) -> str:
    """What tells a model's weights from others."""
    weights = "".join(told for name, told in sorted(hashes.items()) if name.endswith(".safetensors"))
    return hashlib.sha256(weights.encode()).hexdigest()[:12]


def judge(dataset: Path, outs: dict[str, Path], options: argparse.Namespace) -> None:
    """Evaluate these models together, each into its file; those whose file is there are not judged again."""
    missing = {model: out for model, out in outs.items() if earlier(out) is None}
    asked = [word for model, out in missing.items() for word in ("--reasoner", model, "--out", str(out))]
    if missing:
        busybot(
            "eval",
            "reason",
            str(dataset),
            *asked,
            *(["--no-what-if"] if options.no_what_if else []),
            "--assets",
            str(options.assets),
        )


def figures_of(file: Path) -> dict[str, Any]:
    """What counts of an evaluation.

    Raises:
        BusybotError: an earlier version made it, which did not tell all.
    """
    told = read_json(file)
    if missing := [key for key in FIGURES if key not in told]:
        raise BusybotError(f"{file}: {', '.join(missing)}: not told", "delete the file; the same command judges anew")
    points = {point["actions"]: point for point in told["discovery"]}
    return {
        "boards": told["boards"],
        "after": {str(actions): {key: points[actions][key] for key in POINT} for actions in AFTER if actions in points},
        "uncertain": told["uncertain_by_images"],
        **{key: told[key] for key in FIGURES},
    }


def measured(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The result file's content after every set of every world."""
    rows = told_rows(options.out, KIND)
    told = read_json(options.out) if options.out.exists() else {}
    chooser = {"curious": curious_hashes()} if options.curious else {}
    asked = options.camera, chooser.get("curious"), assets_name(options.assets)
    if told and (told.get("camera", "clean"), told.get("curious"), told.get("assets", asked[2])) != asked:
        what = "its boards were seen by another camera, acted on by another policy, or made of other objects"
        raise UsageError(f"{options.out}: {what}", "name another file")
    parts = models_by_policy(options)
    hashes = {model: file_hashes(find_folder(model, "reason")) for models in parts.values() for model in models}
    for world in chosen(options.only, ALL) if options.only else ALL:
        for name in (one for one in chosen(options.sets, tuple(frozen.SETS)) if one in frozen.sets_of(world)):
            cells = rows.setdefault(world, {}).setdefault(name, {})
            for policy, models in parts.items():
                judged = judged_as(world, name, policy, {model: hashes[model] for model in models}, options)
                cells |= {Path(model).name: row for model, row in judged.items()}
            about = {"assets": assets_name(options.assets), "boards": options.boards, "camera": options.camera}
            yield {**about, **chooser, "rows": {one: rows[one] for one in ALL if one in rows}}


def judged_as(
    world: str, name: str, policy: str | None, models: dict[str, dict[str, str]], options: argparse.Namespace
) -> dict[str, dict[str, Any]]:
    """The rows of models on a set on which one policy acted.

    Args:
        models: hashes of the files of each.
    """
    dataset = recorded(world, name, policy, options)
    asked = "-no-what-if" if options.no_what_if else ""
    named = dataset.parent.parent / f"{world}-{name}-{options.boards}{asked}"
    outs = {model: Path(f"{named}-{digest_of(hashes)}.json") for model, hashes in models.items()}
    judge(dataset, outs, options)
    by = policy_hashes(policy)
    return {model: {"model": models[model], "policy": by, **figures_of(outs[model])} for model in models}


def main(words: Sequence[str] | None = None) -> None:
    options = parser(__doc__)
    options.add_argument("--work", type=Path, required=True, help="for recordings and evaluations")
    options.add_argument("--policy", help="trainings of the interaction policy; the shipped one by default")
    options.add_argument("--models", default="mechanism", help="shipped models' names and folders, comma-separated")
    options.add_argument("--sets", default=frozen.VALIDATION, help=f"of {', '.join(frozen.SETS)}, comma-separated")
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    options.add_argument("--boards", type=int, default=200, help="of each set, the first ones")
    options.add_argument("--curious", action="store_true", help="the model that ships chooses what is done")
    options.add_argument("--camera", choices=("clean", "real"), default="clean", help="before which the policy acts")
    options.add_argument("--no-what-if", action="store_true", help="do not ask what would have happened otherwise")
    arguments = options.parse_args(words)
    for figures in measured(arguments):
        finish(KIND, arguments, figures, seed=SEED)


if __name__ == "__main__":
    one_of(main)
