"""The parts of a report about what no table has: robustness, and what a run cost."""

from pathlib import Path

from busybot.view.report_kinds import Robustness, Stages
from busybot.view.report_page import Block, Entry, Fold, Grid, Items, Picture, Text
from busybot.view.robustness_figure import BASELINES, robustness_figure, strength_words, title_of

ROBUSTNESS_RUN = "python -m benchmarks.reason_robustness --data DATASET --model event=FOLDER --out FILE"
NONE = Entry("-", tone="reference")


def robustness_blocks(robustness: Robustness | None, figures: Path) -> list[Block]:
    """Quality against the strength of every disturbance as a figure, its numbers, and what is done."""
    if robustness is None:
        return [Text(f"**Missing**: what disturbed recordings cost. `{ROBUSTNESS_RUN}` measures it.")]
    told = robustness.model_dump()
    names = [*robustness.models, *(name for name in BASELINES if name not in robustness.models)]
    lines = []
    for name, rows in robustness.rows.items():
        for row in rows:
            shares = [share for model in names for share in _scores(row.models.get(model))]
            entries = tuple(NONE if share is None else Entry(f"{100 * share:.1f}") for share in (*shares, row.known))
            words = "" if name not in robustness.disturbances else f", {strength_words(told, name, row.strength)}"
            lines.append((f"{title_of(told, name)}{words}", entries))
    groups = (*((name, 2) for name in names), ("", 1))
    grid = Grid(groups, (*("edges (F1)", "Pred-A") * len(names), "known"), tuple(lines), "percent")
    done = Items(tuple(f"{title_of(told, name)}: {one.what}" for name, one in robustness.disturbances.items()))
    caption = "Edges and predictions when recordings are disturbed, always in one way at a time; 0 is undisturbed."
    note = (
        f"{robustness.boards} boards. Baselines stand with defaults and with the best of several settings, chosen "
        "with the truth. Known: steps that could be predicted in spite of the disturbance."
    )
    picture = Picture(robustness_figure(figures / "robustness.png", told, figures.parent), caption)
    return [picture, Text(note), Fold("Numbers, and what is done", (grid, done))]


def _scores(scores: object) -> tuple[float | None, float | None]:
    return getattr(scores, "edge_f1", None), getattr(scores, "pred_a", None)


def stage_blocks(stages: Stages | None) -> list[Block]:
    """Wall time of a pipeline's stages, those of one kind together."""
    if stages is None:
        return []
    kinds: dict[str, list[float]] = {}
    for name, stage in stages.stages.items():
        kinds.setdefault("features" if name.endswith(".features") else name.split("/")[0], []).append(stage.seconds)
    lines = [(f"`{kind}`", (Entry(str(len(one))), Entry(f"{sum(one) / 60:.1f}"))) for kind, one in kinds.items()]
    every = [seconds for one in kinds.values() for seconds in one]
    lines.append(("all", (Entry(str(len(every))), Entry(f"{sum(every) / 60:.1f}"))))
    unfinished = [name for name, stage in stages.stages.items() if not stage.done]
    machine = ", ".join(f"{key} {value}" for key, value in stages.machine.items()) or "not recorded"
    words = f"Wall time of the run by output folder, interrupted attempts included. Machine: {machine}."
    words += f" Not finished: {', '.join(unfinished)}." if unfinished else ""
    return [Text(words), Grid((), ("stages", "minutes"), tuple(lines), "run")]
