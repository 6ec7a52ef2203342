"""The constants of the learned policy, one varied at a time, on training objects that the model has not seen.

    python -m benchmarks.studies.policy_constants --assets DIR --work FOLDER --other MODEL \
        --out benchmarks/results/policy_constants.json
    python -m benchmarks.studies.policy_constants coverage --data DATASET --model MODEL --out FILE
    python -m benchmarks.studies.policy_constants patches --data DATASET --model MODEL --out FILE

Of the training objects some are held out: a copy of the library calls them novel and has no real novel object at all. A
strict model is trained on the others and judged, under the veto, on boards of those that were held out, where it makes
the mistakes that the constants are for. What differs without the veto is varied without it, there, on new boards of the
objects that the model knows, and, with `--other`, with a model that was trained on all training objects without the
veto, on new boards of them. Run it again with the same FOLDER after an interruption: it goes on.

`coverage` counts the links that the policy would touch when it collects, by the least promise that it accepts. On the
first picture of each recorded board: of the trigger links those whose best candidate promises less (they are never
touched, as long as the board looks like that), and the candidates elsewhere that promise as much (they waste a step
each). `PolicyConfig.collect` was chosen by this on boards of training objects.

`patches` tells how many small patches of one colour on triggers are links, by what is believed of candidates on them as
of any others and as of patches (`colour_patches.on_patches`), and which line through logits foretells that best. The
line was chosen by this on boards of training objects.
"""

import argparse
import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.runner import busybot, chosen, finish, generating, one_of, option, parser, settings
from busybot.datasets.dataset import Dataset
from busybot.episodes.camera import Rays
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import read_result
from busybot.interact.policy.candidates import find_candidates, held
from busybot.interact.policy.colour_patches import EVEN, STEEPER, from_patches, patches_of
from busybot.interact.policy.config import STRICT_POLICY, PolicyConfig
from busybot.interact.policy.direction_pairs import logit, sigmoid
from busybot.interact.policy.policy_factory import fingerprint, load_once, policy_config

KIND, SEED = "policy-constants", 78
OBJECTS, MODEL = "objects", "model"
HELD_OUT = {
    "Switch": ("100849", "100906", "100934", "100976", "100979", "100981", "102812", "102836"),
    "Lamp": ("13491",),
    "Door": ("8903", "8994"),
}
"""One of two sliders, one of two levers that are annotated as buttons, six drawn switches, a drawn lamp, two doors."""
VALUES: dict[str, tuple[float, ...]] = {
    "explore": (0.2, 0.5),
    "caution": (0.0, 3.0),
    "insist": (0.05, 0.5),
    "temperature": (1.0, 2.0, 5.0),
    "component_penalty": (0.3, 2.0),
    "failure_penalty": (0.3, 1.4),
    "dense_weight": (0.5, 1.0),
    "peak_radius": (2, 6),
    "responder_penalty": (0.0, 1.0),
    "trigger_bonus": (1.2,),
}
"""Values beside the default."""
BEFORE = {
    "explore": 0.35,
    "insist": 0.35,
    "caution": 0,
    "temperature": 1,
    "after_failure": "null",
    "dense_weight": 0.5,
    "trigger_bonus": 0,
}
"""What was there before doubt on new objects was: one row varies them together."""
KEYS = ("precision", "recall", "precision_exploring", "intervals", "failures_by_object", "missed_links")
BELIEFS = (0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1)
PROMISES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)


@dataclass(frozen=True)
class Place:
    """Which model is judged on which boards.

    Attributes:
        name: of the boards: `novel-object` for held-out objects, `novel-config` for those that the model knows, `other`
            for the other model on boards of what it knows.
        folder: of the boards.
    """

    name: str
    model: Path
    library: Path
    folder: Path
    split: str
    boards: int

    def judge(self, out: Path, *options: str) -> dict[str, Any]:
        """All metrics of the model with these options; what was judged before is read."""
        busybot(*generating(self.folder, self.split, self.boards, SEED, self.library))
        command = ("eval", "interact", str(self.folder), "--model", str(self.model), "--assets", str(self.library))
        values = busybot(*command, *options, "--out", str(out))
        shares = f"P {100 * values['precision']:5.1f} R {100 * values['recall']:5.1f}"
        print(f"{out.name:60} {shares}", file=sys.stderr, flush=True)
        return values


def places(arguments: argparse.Namespace) -> list[Place]:
    """Held-out objects first; the other model only if one is named."""
    work, count = arguments.work, arguments.boards
    own = (work / MODEL, work / OBJECTS)
    found = [
        Place("novel-object", *own, work / "boards", "novel-object", count),
        Place("novel-config", *own, work / "boards-novel-config", "novel-config", count),
    ]
    if arguments.other:
        boards = (work / "boards-other", "novel-config", arguments.other_boards)
        found.append(Place("other", arguments.other, arguments.assets, *boards))
    return found


def held_out_library(assets: Path, folder: Path) -> Path:
    """A copy in which the held-out objects are the novel ones; made once."""
    if folder.exists():
        return folder
    split = json.loads((assets / "data.json").read_text())
    changed: dict[str, dict[str, list[str]]] = {}
    for category, lists in split["Reason"].items():
        held = HELD_OUT.get(category, tuple(lists["train"]))  # the only toy is on both sides
        kept = [name for name in lists["train"] if name not in held] or list(held)
        changed[category] = {"train": kept, "test": list(held)}
    unfinished = folder.with_name(folder.name + ".part")
    shutil.rmtree(unfinished, ignore_errors=True)
    for category, lists in changed.items():
        for name in {*lists["train"], *lists["test"]}:
            shutil.copytree(assets / category / name, unfinished / category / name)
    (unfinished / "data.json").write_text(json.dumps({"Interact": split["Interact"], "Reason": changed}))
    unfinished.rename(folder)
    return folder


def constants(values: dict[str, Any]) -> tuple[str, ...]:
    """Options that set constants of the learned policy."""
    return settings(*(f"learned.{name}={value}" for name, value in values.items()))


def main(words: list[str]) -> None:
    arguments = parsed(words)
    names, work = chosen(arguments.constants, VALUES), arguments.work
    work.mkdir(parents=True, exist_ok=True)
    library = str(held_out_library(arguments.assets, work / OBJECTS))
    made = ("--out", str(work / MODEL), "--assets", library, "--strict", *option("--config", arguments.config))
    trained = busybot("train", "interact", *made)["training"]
    known = read_result(arguments.out, KIND) if arguments.out.exists() else {"training": trained}
    if known["training"] != trained:
        raise SystemExit(f"{arguments.out} has rows of another model: name another file, or remove it")
    default = PolicyConfig().model_dump(include=set(VALUES))
    result: dict[str, Any] = {
        "assets": arguments.assets.name,
        "held_out": HELD_OUT,
        "default": default,
        "default_strict": {**default, **STRICT_POLICY},
        "training": trained,
        **{part: known.get(part, {}) for part in ("boards", "models", "rows", "free")},
    }
    held_out, *_ = everywhere = places(arguments)
    free = {name: default[name] for name in STRICT_POLICY}  # the model's card has the veto's
    for row, values in without_veto().items():
        result["free"][row] = dict(known.get("free", {}).get(row, {}))
        for place in everywhere:
            told = place.judge(work / f"judged-free-{place.name}-{row}", *constants({**free, **values}))
            result["free"][row][place.name] = {key: told[key] for key in KEYS}
            result["boards"][place.name] = {key: told["dataset"][key] for key in ("boards", "board_hash")}
            result["models"][place.name] = told["provenance"]["model"]["sha256"]
        _write(arguments, result)
    varied: dict[str, dict[str, Any]] = {"defaults": {}, "before": BEFORE}
    varied |= {f"{name}={value}": {name: value} for name in names for value in VALUES[name]}
    for row, values in varied.items():
        told = held_out.judge(work / f"judged-{row}", "--strict", *constants(values))
        result["rows"][row] = {key: told[key] for key in KEYS}
        _write(arguments, result)


def _write(arguments: argparse.Namespace, result: dict[str, Any]) -> None:
    boards = {name: {"board_hash": one["board_hash"]} for name, one in result["boards"].items()}
    finish(KIND, arguments, result, hashes={"models": result["models"], "data": boards}, seed=SEED)


def without_veto() -> dict[str, dict[str, Any]]:
    """What is varied without the veto: all that differs under it together, and one by one."""
    alone = {f"{name}={value}": {name: value} for name, value in STRICT_POLICY.items()}
    return {"defaults": {}, "strict": dict(STRICT_POLICY), **alone}


def parsed(words: list[str]) -> argparse.Namespace:
    options = parser(__doc__, assets=False)
    options.add_argument("--assets", type=Path, required=True, help="folder of annotated objects")
    options.add_argument("--work", type=Path, required=True, help="for library, model and boards; continued")
    options.add_argument("--boards", type=int, default=60)
    options.add_argument("--other", type=Path, help="a model trained on all training objects, without the veto")
    options.add_argument("--other-boards", type=int, default=200)
    options.add_argument("--constants", default=",".join(VALUES))
    options.add_argument("--config", type=Path, help="YAML file with parameters of the training")
    return options.parse_args(words)


def covered(dataset: Dataset, name: str) -> dict[str, Any]:
    """Untouched links and wasted candidates by promise."""
    model = load_once(name)
    config = policy_config(model.info, {})
    links, untouched, elsewhere = 0, Counter[float](), Counter[float]()
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index), "lazy")
        image = episode.image(0)
        found = find_candidates(model, episode.observation(0), Rays(episode.camera), None, config)
        assert image.segmentation is not None
        codes = image.segmentation[found.pixels[:, 1], found.pixels[:, 0]]
        triggers = [code for code, link in enumerate(episode.links, 1) if link.trigger]
        links += len(triggers)
        for promise in PROMISES:
            enough = found.scores >= promise
            untouched[promise] += sum(not (enough & (codes == code)).any() for code in triggers)
            elsewhere[promise] += int((enough & ~(codes[:, None] == triggers).any(axis=1)).sum())
    origin = {"name": dataset.info.name, "split": dataset.info.split, "board_hash": dataset.hashes().board}
    told = {str(one): {"untouched_links": untouched[one], "elsewhere": elsewhere[one]} for one in PROMISES}
    return {"dataset": origin, "boards": len(dataset.finished()), "links": links, "by_promise": told}


def patched(dataset: Dataset, name: str) -> dict[str, Any]:
    """Candidates on patches of the first pictures, and those of them that are on a link, by belief."""
    model = load_once(name)
    config, beliefs, are = policy_config(model.info, {}), list[float](), list[bool]()
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index), "lazy")
        image, seen, rays = episode.image(0), episode.observation(0), Rays(episode.camera)
        view = model.look(seen, rays)
        boxes = np.array([one for one, it in zip(image.boxes, episode.board.objects, strict=True)
                          if it.role == "trigger"], int).reshape(-1, 4)  # fmt: skip
        found = find_candidates(model, seen, rays, None, config, view, triggers=boxes)
        on = patches_of(seen.rgb, boxes, held(view.affordance)).labels[found.pixels[:, 1], found.pixels[:, 0]] > 0
        triggers = [code for code, link in enumerate(episode.links, 1) if link.trigger]
        assert image.segmentation is not None
        codes = image.segmentation[found.pixels[on, 1], found.pixels[on, 0]]
        beliefs += found.beliefs[on].tolist()
        are += np.isin(codes, triggers).tolist()
    believed, links = np.array(beliefs), np.array(are, bool)
    plain = from_patches(logit(believed))
    without = sigmoid(plain)
    ranges = []
    for low, high in pairwise(BELIEFS):
        inside = (without >= low) & (without < high)
        counted = {"candidates": int(inside.sum()), "links": int(links[inside].sum())}
        means = {"believed": _mean(believed[inside]), "without": _mean(without[inside])}
        ranges.append({"from": low, "to": high, **counted, **means})
    origin = {"name": dataset.info.name, "split": dataset.info.split, "board_hash": dataset.hashes().board}
    told = {"dataset": origin, "boards": len(dataset.finished())}
    return {**told, "fit": _line(plain, links), "used": {"steeper": STEEPER, "even": EVEN}, "by_belief": ranges}


def _line(logits: np.ndarray, links: np.ndarray) -> dict[str, float]:
    """The line through logits by which what are links is likeliest, as `STEEPER` and `EVEN` say it."""

    def unlikely(line: np.ndarray) -> float:
        steeper, even = line
        return float(np.logaddexp(0, np.where(links, -1, 1) * steeper * (logits - even)).sum())

    steeper, even = minimize(unlikely, (1.0, 0.0), method="Nelder-Mead").x
    return {"steeper": float(steeper), "even": float(even)}


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None


def coverage(words: list[str]) -> None:
    _counted("coverage", covered, words)


def patches(words: list[str]) -> None:
    _counted("patches", patched, words)


def _counted(kind: str, count: Callable[[Dataset, str], dict[str, Any]], words: list[str]) -> None:
    """Count something of a dataset for each of some models."""
    options = parser(__doc__, assets=False)
    options.add_argument("--data", type=Path, required=True, help="recorded dataset")
    options.add_argument("--model", nargs="+", required=True)
    arguments = options.parse_args(words)
    names = [path.parent.name if path.name == "model" else path.name for path in map(Path, arguments.model)]
    if len(set(names)) < len(names):
        options.error(f"two models have the same name: {', '.join(names)}")
    dataset, named = Dataset.open(arguments.data), dict(zip(names, arguments.model, strict=True))
    judged = {name: count(dataset, model) for name, model in named.items()}
    models = {name: fingerprint(model)["sha256"] for name, model in named.items()}
    hashes = {"models": models, "data": {dataset.info.name: {"board_hash": dataset.hashes().board}}}
    finish(kind, arguments, {"models": judged}, hashes=hashes)
    print(json.dumps(judged, indent=1))


if __name__ == "__main__":
    one_of(main, coverage=coverage, patches=patches)
