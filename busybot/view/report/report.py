"""The report: Tables 1 to 3 with plots, as Markdown and as one HTML file, from files of results.

What is missing is shown as missing, and every gate that is missed is named.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from busybot import __version__
from busybot.common.atomic_io import copy_file, make_folder, regular_files, write_atomically
from busybot.common.errors import BusybotError
from busybot.common.text import unlinked
from busybot.datasets.dataset import INFO_FILE, Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.reference_tables import TABLES, Table
from busybot.evaluation.statistics import LEAST_PAIRS
from busybot.plan.agent_policy import is_rollout
from busybot.view.figures.curves import Course, courses_figure, table_figure
from busybot.view.figures.sequences import sequence_figure
from busybot.view.report import sections
from busybot.view.report.gates import Verdict, count_gates, gate_blocks, summary_tiles, verdicts
from busybot.view.report.page import Block, Fold, Heading, Items, Picture, Text, document, markdown
from busybot.view.report.results import InteractResult, ReasonResult, Results, TableFile, read_results
from busybot.view.report.worlds import world_blocks

TITLE = "BusyBot, measured"
MARKDOWN, HTML, FIGURES = "report.md", "report.html", "figures"
INTRODUCTIONS = {
    1: "Ten actions on each board. Precision: share of actions that moved a trigger. Recall: share of the movable "
    "links that were moved. New links: precision of the actions that did not repeat a link. Behind ± is half the width "
    "of the 95 % interval over boards; shares of 0 and 100 have exact bounds, in brackets. In square brackets stands "
    "the 95 % interval over objects and their boards, where it was told; with few objects it is still too narrow.",
    2: "From 23 images: which trigger controls which responder (P, R over pairs), and what every later action does "
    "(Pred-A: all responders of the board right; successful: the same over actions that moved a trigger).",
    3: "At most 8 actions a task; share of the affectable responders in their goal state, mean over tasks, for tasks "
    "with one-to-one and with one-to-many relations.",
}
NO_TABLES = "The paper's three tables and the gates: none of their rows was given"
WRITTEN = f"Written by busybot {__version__} from the files [at the end](#files)."
LEAD = (
    "Agents that learn to interact, to reason about cause and effect and to plan on toy boards, beside the paper "
    "BusyBot (Liu, Xu, Song; CoRL 2022). Every number is measured by the commands beneath its table. A gate is the "
    "least value that a number must have for the paper's claim to count as reproduced: it is reached (✓), missed (✗), "
    f"or nothing was measured. {WRITTEN}"
)
TRIAL = (
    "**These numbers mean nothing.** The profile `smoke` only tries whether everything runs: few boards, and networks "
    "that hardly learned. That gates are missed here is no fault. `make reproduce PROFILE=laptop` measures something. "
    "Pictures may be reduced on this page; the folder `figures` beside it has them in full."
)
TRIALS = (
    "**Some numbers mean nothing**: those of {0}, and what else the same runs made. The profile `smoke` only tries "
    "whether everything runs."
)
TRIAL_FILE = (
    "**These numbers mean nothing.** The profile `smoke` only tries whether everything runs. They stand here alone: no "
    "gate is judged by them, and no other part of this page has them."
)
TABLE_PLOT = "Dots are ours with their intervals, diamonds the paper's, lines the gates; no dot: not run."
TRIAL_PICTURES_BYTES = 1_800_000
"""Of all pictures within the page of a trial, which is to be sent around."""
LEAD_SINGLES = f"Single evaluations, beside the paper BusyBot (Liu, Xu, Song; CoRL 2022). {WRITTEN}"
MOST_COURSES = 12
"""Panels of a figure."""
FILE_LETTERS = 40
"""Of a file's name above a panel."""
MOST_SEQUENCES = 8
"""Folders of rollouts that are shown."""
LOOKED_AT = 20
"""Among so many rollouts of a folder the first of at least `TELLING` actions is shown, else the first."""
TELLING = 2
NO_SEQUENCE = (
    "**Missing**: planning sequences. `busybot eval plan DATASET --record DIR` records rollouts; name DIR, too."
)
WANTED = {"affordance": "what the policy believes", "refinement": "how the inferred graph grows"}


@dataclass(frozen=True)
class Shown:
    """An episode to draw the paper's figures of.

    Attributes:
        episode: its file.
        model: of interaction, by name or folder; None to leave affordances out.
        reasoner: by name or folder.
    """

    episode: Path
    model: str | None = None
    reasoner: str = "count"


@dataclass(frozen=True)
class Report:
    """What was written, and the gates."""

    markdown: Path
    html: Path
    figures: tuple[Path, ...]
    verdicts: tuple[Verdict, ...]

    def count(self, reached: bool | None) -> int:
        """Gates that are reached, missed (False) or not measured (None)."""
        return count_gates(self.verdicts, reached)


def write_report(paths: Sequence[Path], out: Path, shown: Shown | None = None) -> Report:
    """Read results and write `report.md`, `report.html` and `figures/` into a folder; older ones are replaced.

    Args:
        paths: files of results, pictures, and folders of both.

    Raises:
        BusybotError: nothing that was given is a result, or one of them is damaged.
    """
    figures = out / FIGURES
    results = read_results(paths, figures)
    if not results.files:
        what = f"{', '.join(map(str, paths))}: no result lies there"
        what += f", only {results.without_kind} JSON files without a known `kind`" if results.without_kind else ""
        raise BusybotError(what, "`busybot eval ... --out FILE` makes one")
    if out.exists() and not out.is_dir():
        raise BusybotError(f"{out}: it is a file", "name a folder")
    judged = verdicts(results)
    make_folder(figures, out)
    blocks: list[Block] = [Heading(TITLE, 1), *_measured(results, judged, figures)]
    files = tuple(f"`{unlinked(name)}`, SHA-256 `{digest}`" for name, digest in results.files.items())
    looks = [*sequence_blocks(paths, figures), *_pictures(results, figures, shown)]
    if results.trial:
        blocks = [blocks[0], Text(TRIAL), *looks, Heading("Numbers"), *blocks[1:]]
    else:
        trials = [f"`{file.name}`" for file in results.table_files.values() if file.trial]
        blocks[1:1] = [Text(TRIALS.format(", ".join(trials)))] if trials else []
        blocks += looks
    blocks += [Heading("Files"), Items(files)]
    write_atomically(out / MARKDOWN, markdown(blocks, out).encode())
    most = TRIAL_PICTURES_BYTES if results.trial else None
    write_atomically(out / HTML, document(TITLE, blocks, most).encode())
    drawn = tuple(block.path for block in blocks if isinstance(block, Picture))
    return Report(out / MARKDOWN, out / HTML, drawn, tuple(judged))


def _measured(results: Results, judged: list[Verdict], figures: Path) -> list[Block]:
    """All numbers: the tables first, or single evaluations if nothing else was given."""
    tables: list[Block] = [summary_tiles(judged, results)]
    tables += [Heading("Gates that are missed"), *gate_blocks(judged, results)]
    for table in TABLES:
        tables += _table(table, results, figures)
    singles: list[Block] = []
    if results.singles or results.plans:
        singles = [Heading("Single evaluations"), *sections.single_blocks(results)]
    worlds = world_blocks(results.worlds, figures)
    rest = [*_courses(results, figures), *_beside(results, figures)]
    if worlds and not (singles or results.table_files):
        return [Text(LEAD_SINGLES), *worlds, Fold(NO_TABLES, (*tables, *rest))]
    if singles and not results.table_files:
        return [Text(LEAD_SINGLES), *worlds, *singles, Fold(NO_TABLES, tuple(tables)), *rest]
    return [Text(LEAD), *tables, *worlds, *rest, *singles]


def _table(table: Table, results: Results, figures: Path) -> list[Block]:
    """A table's plot, numbers and origins; one after the other of several files, which may be of other objects."""
    files = results.of_table(table)
    blocks: list[Block] = [Heading(f"Table {table.number}: {table.title}"), Text(INTRODUCTIONS[table.number])]
    if not files:
        missing = f"**Missing**: none of its rows was given. `{sections.RUN[table.number]}` measures them."
        blocks += [Text(missing), sections.table_grid(table, {})]
    several = len(files) > 1
    blocks += [sections.several_files(table, files)] if several else []
    for place, file in enumerate(files):
        blocks += [Heading(f"`{file.name}`", 3), sections.about_file(file)] if several else []
        plot = figures / f"table{table.number}{f'-{place}' if place else ''}.png"
        blocks += _trial_file(file) if file.trial and not results.trial else _table_file(file, several, plot)
        blocks.append(sections.provenance(file))
    given = [file for file in results.table_files.values() if file.table.number == table.number]
    return blocks if len(given) == len(files) == 1 else [*blocks, *sections.strange_rows(given)]


def _table_file(file: TableFile, several: bool, plot: Path) -> list[Block]:
    """Plot and numbers of a file; of one of several with the rows alone that it has."""
    table = replace(file.table, rows=file.own) if several else file.table
    drawn = table_figure(plot, table, file.rows, plot.parent.parent)
    caption = TABLE_PLOT + (f" Rows of `{file.name}`." if several else "")
    return [Picture(drawn, caption), sections.table_grid(table, file.rows)]


def _trial_file(file: TableFile) -> list[Block]:
    """What a trial tells on a page that has other numbers, too: these are neither drawn nor set beside the paper's."""
    return [Text(TRIAL_FILE), sections.table_grid(file.table, file.rows, beside=False)]


def _courses(results: Results, figures: Path) -> list[Block]:
    """How scores grow with actions and images, of all results that tell it."""
    told: list[Course] = []
    for run in results.rows():
        if run.row.role == "ours" and run.found:
            judged = [(words, run.found.results.get(split)) for split, words in run.table.splits.items()]
            whose = f"{_end_of(run.file)}\n" if run.file else ""
            told += [Course(run.row.name, f"{whose}{words}", result) for words, result in judged if result]
    for result in results.singles.values():
        told.append(Course(sections.subject(result), str(result.dataset.get("split")), result))
    interact = [one for one in told if isinstance(one.result, InteractResult) and one.result.by_step]
    reason = [one for one in told if isinstance(one.result, ReasonResult) and one.result.by_images]
    captions = {
        "discovery": "Discovery: links found, and how many of the actions with this number succeed.",
        "images": "Relations and predictions after so many images; dotted: what the recordings determine.",
    }
    blocks: list[Block] = [Heading("How scores grow")]
    for (name, caption), courses in zip(captions.items(), (interact, reason), strict=True):
        if courses:
            plot = courses_figure(figures / f"{name}.png", courses[:MOST_COURSES], figures.parent)
            blocks.append(Picture(plot, caption))
        else:
            blocks.append(Text(f"**Missing**. {caption}"))
    return blocks


def _end_of(name: str) -> str:
    """As much of a file's name as has room above a panel."""
    return name if len(name) <= FILE_LETTERS else f"…{name[1 - FILE_LETTERS :]}"


def _beside(results: Results, figures: Path) -> list[Block]:
    """Calibration, robustness and cost."""
    blocks: list[Block] = [Heading("Calibration")]
    explained = (
        "Expected calibration error over the trigger-responder pairs that are doubted (5 to 95 %), behind it how many "
        f"these are: of fewer than {LEAST_PAIRS} nothing is said. Brier score over all pairs. 0 is best."
    )
    grid = sections.calibration_grid(results)
    blocks += [Text(explained), grid] if grid else [Text("**Missing**: no row of Table 2 was given.")]
    blocks += [Heading("Robustness"), *sections.robustness_blocks(results, figures)]
    blocks.append(Heading("Cost"))
    cost = sections.cost_grid(results)
    blocks.append(cost or Text("**Missing**: no training tells its time."))
    return [*blocks, *sections.by_file(results.stages, lambda told, _: sections.stage_blocks(told))]


def sequence_blocks(paths: Iterable[Path], figures: Path) -> list[Block]:
    """How agents went to their goals: a rollout of every dataset of rollouts in the folders, drawn into `figures`.

    Raises:
        BusybotError: a dataset in them is damaged.
    """
    blocks: list[Block] = []
    names = [file for path in paths if path.is_dir() for file in regular_files(path, INFO_FILE.__eq__)]
    for folder in [name.parent for name in names]:
        if len(blocks) == MOST_SEQUENCES:
            break
        if (episode := _telling(Dataset.open(folder))) is None:
            continue
        picture = sequence_figure(figures / f"sequence-{len(blocks):02d}.png", episode, figures.parent)
        kind = "" if episode.board.task is None else f", {episode.board.task.kind}"
        caption = f"{episode.policy} on board {episode.board.index} ({episode.board.split}{kind})"
        blocks.append(_picture(picture, caption))
    return [Heading("Planning sequences"), *(blocks or [Text(NO_SEQUENCE)])]


def _telling(dataset: Dataset) -> Episode | None:
    """The rollout to be shown; None if these are no rollouts."""
    first = None
    for number in sorted(dataset.finished())[:LOOKED_AT]:
        episode = read_episode(dataset.episode_path(number), "lazy")
        if not is_rollout(episode) or episode.goal is None:
            return None
        if len(episode.steps) >= TELLING:
            return episode
        first = first or episode
    return first


def _pictures(results: Results, figures: Path, shown: Shown | None) -> list[Block]:
    """The paper's figures, drawn from an episode, and pictures that were given."""
    blocks: list[Block] = [Heading("Pictures")]
    drawn = _drawn(figures, shown) if shown else {}
    for name, words in WANTED.items():
        missing = Text(f"**Missing**: {words}. `--episode FILE --model NAME` draws it.")
        blocks.append(drawn.get(name, missing))
    for place, source in enumerate(results.pictures):
        copy = figures / f"given-{place:02d}{source.suffix.lower()}"
        copy_file(source, copy, figures.parent)
        blocks.append(_picture(copy, "/".join(source.parts[-3:])))
    return blocks


def _picture(path: Path, caption: str) -> Picture:
    """A picture whose caption has words from a recording or a file's name, which are no links."""
    return Picture(path, str(unlinked(caption)))


def _drawn(figures: Path, shown: Shown) -> dict[str, Block]:
    from busybot.interact.policy.policy_factory import load_once, policy_config
    from busybot.interact.policy.policy_trace import retrace
    from busybot.reason.evaluation.prediction import inferred_over_time
    from busybot.view.figures.episode import refinement_figure
    from busybot.view.figures.sequences import affordance_figure

    episode = read_episode(shown.episode, "lazy")
    graph = inferred_over_time(episode, shown.reasoner)
    growing = f"How the graph that {graph.name} infers grows with the steps; true relations are framed."
    drawn = refinement_figure(figures / "refinement.png", episode, graph, root=figures.parent)
    found: dict[str, Block] = {"refinement": _picture(drawn, growing)}
    if shown.model is not None:
        loaded = load_once(shown.model)
        thoughts = list(retrace(episode, loaded, policy_config(loaded.info, {})))
        caption = "What the policy believed before its first actions: affordance in orange, candidates as dots."
        drawn = affordance_figure(figures / "affordance.png", episode, thoughts, root=figures.parent)
        found["affordance"] = Picture(drawn, caption)
    return found
