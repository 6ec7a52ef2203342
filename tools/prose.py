"""Sentences of the documentation that tell numbers of result files."""

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import INTERACTION, NOVEL, PLANNING, REASONING, Table
from busybot.evaluation.results import read_result
from busybot.evaluation.statistics import binomial_interval
from busybot.view.report.page import difference, markdown, plain_grid
from busybot.view.report.results import RowFound, Score, rows_of
from tools.tables import RESULTS, cell, percent, result, the_papers

SPLITS = ("train", "novel-config", "novel-object")


def holds(what: str, is_so: bool) -> None:
    """What is said without a number has to be so.

    Raises:
        BusybotError: it is not.
    """
    if not is_so:
        raise BusybotError(f"the results do not say that {what}", "say something else in tools/prose.py")


def costs() -> str:
    """What a recorded interaction and a long process cost."""
    cost, soak = result("collection"), result("memory")
    last, taken = soak["memory"][-1]["boards"], [moment["rss_mb"] for moment in soak["memory"]]
    holds("no file stays open", soak["more_open_files_over_second_half"] == 0)
    return _filled(
        "A recorded interaction that moved a link (simulated, rendered, read back, encoded and written) costs "
        f"{cost['ratio_to_minimal_frame']:.2f} of one frame of `minimal` lit by a sun with shadows, as boards are "
        f"usually shown with it, and {cost['ratio_to_minimal_frame_without_shadows']:.2f} of one without shadows; our "
        "shaders draw none, only a soft darkening around objects. The simulator keeps the 64 objects used last loaded: "
        f"memory stays between {min(taken)} and {max(taken)} MB over {last} boards, and no file stays open."
    )


def relations() -> str:
    """What counting finds in recordings of both built-in policies."""
    rows = result("splits")["rows"]
    holds("every split was acted on by both policies", _pairs(rows) == set(product(SPLITS, ("scripted", "random"))))
    scripted = [row for row in rows if row["policy"] == "scripted"]
    chance = [row for row in rows if row["policy"] == "random"]
    holds("all is found of scripted actions", all(row["edge_p"] == row["edge_r"] == 1 for row in scripted))
    holds("all datasets are whole", all(row["verified"] for row in rows))
    found = all(row["edge_p"] == 1 and row["edge_r"] == row["edge_r_bound"] for row in chance)
    holds("of random actions all that was visible is found, and nothing wrong", found)
    shares, moved = (sorted(100 * row[key] for row in chance) for key in ("edge_r", "success_share"))
    return _filled(
        f"From the scripted policy's actions on real objects, counting finds all relations of all "
        f"{sum(row['boards'] for row in scripted)} boards and no others (Edge-P 100, Edge-R 100). From random actions, "
        f"of which {moved[0]:.1f} to {moved[-1]:.1f} % move a trigger, it finds what was visible: "
        f"{shares[0]:.1f} to {shares[-1]:.1f} % of the relations, and none that is wrong."
    )


def _filled(text: str) -> str:
    """Lines of at most 120 characters."""
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _pairs(rows: list[dict[str, Any]]) -> set[tuple[str, str]]:
    return {(row["split"], row["policy"]) for row in rows}


def features_speed() -> str:
    """How fast features are computed."""
    told = result("features-speed")
    holds("it was measured with two workers on two cores", (told["workers"], told["cores"]) == (2, 2))
    return _filled(
        f"`{told['encoder']}` encodes {told['frames_per_second']:.0f} frames a second on two cores, "
        f"{told['frames_per_cpu_second']:.0f} per second of processor time, the start of the workers "
        "included ([`features-speed.json`](../../benchmarks/results/features-speed.json)):"
    )


def frames_speed() -> str:
    """How many pictures a second a learner gets."""
    told = result("frames-speed")
    rate = {name: row["per_cpu_second"] for name, row in told["rows"].items()}
    holds("a core decodes at least 600 pictures a second", min(rate["RGB"], rate["RGB, first pass"]) >= 600)
    holds("with a worker, too", min(rate["RGB, one worker"], rate["RGB, one worker, frames.collate"]) >= 600)
    return _filled(
        f"In random order, {told['width']} x {told['height']}, through a `DataLoader` of one process, a second of "
        f"processor time gives {rate['RGB']} RGB pictures or {rate['depth']} of depth once the encoded pictures are in "
        f"memory, {rate['RGB, first pass']} in the first pass, which reads the recordings, and "
        f"{rate['RGB, nothing kept']} if nothing is kept and every picture is read from its file alone: then the order "
        "of `frames.shuffled(seed)` is the one to take, which stays with some episodes for a while. With a worker it "
        f"is {rate['RGB, one worker']}, both processes counted: batches are handed over in shared memory, whose pages "
        "the system makes anew for each, which costs more than the pictures. With `collate_fn=frames.collate`, which "
        f"uses that memory again, it is {rate['RGB, one worker, frames.collate']}."
    )


def streaming() -> str:
    """How long it takes until there is a first batch of a dataset in S3."""
    told = result("streaming")
    rows, first = told["rows"], [row["seconds"]["first_batch"] for row in told["rows"]]
    most = rows[-1]
    holds("the first batch is there within 5 s", max(first) < 5)
    holds("no more than a tenth of the largest dataset is read for it", most["bytes_received"] < most["bytes"] / 10)
    table = ["| recordings | MB | opened, s | tables, s | first batch, s | MB received |", "|" + "---|" * 6]
    for row in rows:
        seconds = " | ".join(f"{row['seconds'][name]:.1f}" for name in ("opened", "tables", "first_batch"))
        held, received = row["bytes"] / 1e6, row["bytes_received"] / 1e6
        table.append(f"| {row['episodes']} | {held:.0f} | {seconds} | {received:.1f} |")
    text = f"A batch is {told['batch']} steps in the order of `frames.shuffled`, RGB of 640 x 480, in one process."
    return "\n".join([*table, "", _filled(text)])


def laptop() -> str:
    """How long the committed run of the profile `laptop` took, and what it reached."""
    run = RESULTS / "laptop"
    stages = read_result(run / "tables" / "stages.json", "stages")["stages"]
    holds("every stage was done", all(stage["done"] for stage in stages.values()))
    holds("no gate was missed", _missed(run / "report.md") == 0)
    minutes = sum(stage["seconds"] for stage in stages.values()) / 60
    return _filled(
        f"A run of `laptop` took {minutes:.0f} minutes on two cores, from nothing to its report, and reached "
        "every gate that it measures: [Tables 1 to 3, pictures and what every stage took]"
        "(../../benchmarks/results/laptop/report.md). What it does not measure, further seeds and strict rows among "
        "it, the report names."
    )


def _missed(report: Path) -> int:
    found = re.search(r"^- \*\*(\d+)\*\* gates missed", report.read_text(encoding="utf-8"), re.MULTILINE)
    return -1 if found is None else int(found[1])


@dataclass(frozen=True)
class Claim:
    """What a claim of the paper is judged by: rows of a table of ours, columns, and the paper's rows."""

    table: Table
    rows: tuple[str, ...]
    keys: tuple[str, ...]
    paper: tuple[str, ...]


ACTING, GOALS = ("precision", "recall"), ("one-to-one", "one-to-many")
CLAIMS = {
    "exploration": Claim(INTERACTION, ("greedy", "ucb", "free-0"), ACTING, ("without exploration", "BusyBot")),
    "image-reward": Claim(INTERACTION, ("oracle", "free-0"), ACTING, ("oracle", "BusyBot")),
    "colours": Claim(INTERACTION, ("rgb", "free-0"), (*ACTING, "precision_exploring"), ("RGB", "BusyBot")),
    "inference": Claim(
        REASONING,
        ("event-without-inference", "event", "paper-short-without-inference", "paper-short"),
        ("pred_a",),
        ("without inference", "BusyBot"),
    ),
    "planning": Claim(PLANNING, ("relation", "predictive", "busybot"), GOALS, ("Relation", "Predictive", "BusyBot")),
}
"""The paper's five claims."""
Cells = dict[tuple[str, str, str], Score]
"""By row, split and column."""


def claim(name: str) -> str:
    """A claim's figures, ours and the paper's, after a look at whether what the page says of them is so.

    Raises:
        BusybotError: it is not, or a row has no such figure.
    """
    one = CLAIMS[name]
    rows = result(f"table{one.table.number}")["rows"]
    found = rows_of(one.table.number, rows)
    cells = {(row, *place): _known(found[row], place) for row in one.rows for place in product(NOVEL, one.keys)}
    for what, is_so in _said(name, cells, found):
        holds(what, is_so)
    words = {row.name: row.words for row in one.table.rows}
    lines = [(words[row], [cell(cells[row, *place]) for place in product(NOVEL, one.keys)]) for row in one.rows]
    lines += [the_papers(one.table, row, product(NOVEL, one.keys)) for row in one.paper]
    heads = [f"{words}: {one.table.keys[key]}" for words, key in product(NOVEL.values(), one.keys)]
    more = {
        "exploration": _exploration_of_the_papers_networks,
        "image-reward": _rewards_of_a_real_camera,
        "colours": _colours_of_the_papers_networks,
        "planning": _plans,
    }
    grids = [plain_grid(heads, lines, "percent")]
    if apart := _apart(one, words, rows):
        grids.append(plain_grid(heads, apart, "points on the same boards (p)"))
    table = markdown(grids)
    return f"{table}\n{more[name]()}" if name in more else table


def _apart(one: Claim, words: dict[str, str], rows: dict[str, Any]) -> list[tuple[str, list[str]]]:
    """Rows that were compared with another one board by board, by the first training of both."""
    lines = []
    for name in one.rows:
        splits = rows[name].get("splits", rows[name])
        told = [splits[split].get("compared") for split in NOVEL]
        if all(told):
            cells = [difference(tests[key]["difference"], tests[key]["p"]) for tests, key in product(told, one.keys)]
            lines.append((f"{words[name]} against {words[told[0]['against']]}", cells))
    return lines


def _known(row: RowFound, place: tuple[str, str]) -> Score:
    told = row.cells.get(place)
    if told is None:
        raise BusybotError(f"a row has no {' '.join(place)}", "claims are judged by rows that were run")
    return told


def _above(one: Score, other: Score) -> bool:
    """Whether both intervals are apart."""
    return one.low is not None and other.high is not None and one.low > other.high


def _said(name: str, cells: Cells, found: dict[str, RowFound]) -> Iterator[tuple[str, bool]]:
    """What docs/results/claims.md says of a claim without numbers, and whether it is so."""
    match name:
        case "exploration":
            weights = [result("table1")["rows"][row]["policy"]["model_sha256"] for row in ("greedy", "ucb", "free-0")]
            yield "all three act by the same networks", weights[0] == weights[1] == weights[2]
            for split, row in product(NOVEL, ("ucb", "free-0")):
                wins = _above(cells[row, split, "recall"], cells["greedy", split, "recall"])
                yield f"{row} finds more links than always the best place, {split}", wins
        case "image-reward":
            both = [result("table1")["rows"][row] for row in ("oracle", "free-0")]
            recorded = [[one["content_hash"] for one in row["training"]["rounds"]] for row in both]
            yield "both rewards recorded the same data", recorded[0] == recorded[1]
            yield from _one_reward(both, "")
            papers = [result("table1-paper")["rows"][row] for row in ("paper-oracle", "paper")]
            yield from _one_reward(papers, ", with the paper's networks")
        case "colours":
            for split, key in product(NOVEL, ("recall", "precision_exploring")):
                yield f"depth is ahead, {split}, {key}", _above(cells["free-0", split, key], cells["rgb", split, key])
            config, other = (cells["rgb", split, "precision_exploring"] for split in NOVEL)
            yield "colours fail more often at new links of new objects", _above(config, other)
            config, other = (cells["rgb", split, "recall"] for split in NOVEL)
            yield "whether they also find fewer is open", not _above(config, other)
        case "inference":
            for split in NOVEL:
                change = cells["event", split, "pred_a"].value - cells["event-without-inference", split, "pred_a"].value
                yield f"without inference predictions stay within a quarter of a point, {split}", abs(change) < 0.25
            for split in NOVEL:
                both = [cells[row, split, "pred_a"] for row in ("paper-short", "paper-short-without-inference")]
                yield f"the paper's network predicts better with inference, {split}", _above(*both)
            yield "the whole schedule was not run", not {"paper", "paper-without-inference"} & found.keys()
        case "planning":
            for place in product(NOVEL, GOALS):
                told = result("table3")["compared"][", ".join(place)]
                yield f"relations beside predictions change nothing, {place}", told["predictive"]["differing"] == 0
            for split in NOVEL:
                told = result("table3")["compared"][f"{split}, {GOALS[1]}"]["search"]
                ahead = told["difference"] > 0 and told["p_success"] < 0.05
                yield f"searching effects is ahead of both on one-to-many tasks, {split}", ahead
            for split in NOVEL:
                ahead = _above(cells["predictive", split, GOALS[1]], cells["relation", split, GOALS[1]])
                yield f"relations alone are far behind on one-to-many tasks, {split}", ahead


def _one_reward(both: Sequence[dict[str, Any]], whose: str) -> Iterator[tuple[str, bool]]:
    """Whether two trainings, and what judged them, tell no difference between pixels and joint states."""
    weights = [row["policy"]["model_sha256"] for row in both]
    files = ("position.safetensors", "direction.safetensors")
    yield f"both rewards end in the same weights{whose}", all(weights[0][file] == weights[1][file] for file in files)
    judged = [row[split] for row, split in product(both, NOVEL)]
    yield f"pixels and joint states agree{whose}", all(one["reward_agreement"] == 1 for one in judged)


def _plans() -> str:
    """On how many tasks the whole differs from prediction alone, and the paper's agents with the paper's network."""
    told = result("table3")
    same = _never_differing(told["tasks"] * len([*product(NOVEL, GOALS)]), "the first of our models")
    return f"{same}\n\n{_plans_of_the_papers_network()}"


def _never_differing(tasks: int, of: str) -> str:
    _, most = binomial_interval(0, tasks) or (0.0, 1.0)
    return _filled(
        f"With {of}, on none of these {tasks} tasks does the whole reach more or less than prediction alone; the exact "
        f"95 % interval of the share of tasks with these objects on which it does ends at {percent(most)} %."
    )


def _plans_of_the_papers_network() -> str:
    """The paper's agents where predictions are often wrong, and each part against the whole on the same tasks."""
    told = result("plan-network")
    found = rows_of(PLANNING.number, told["agents"])
    words = {row.name: row.words for row in PLANNING.rows}
    places = [*product(NOVEL, GOALS)]
    lines = [(words[row], [cell(_known(one, place)) for place in places]) for row, one in found.items()]
    heads = [f"{objects}: {PLANNING.keys[key]}" for objects, key in product(NOVEL.values(), GOALS)]
    compared = [told["compared"][", ".join(place)] for place in places]
    nothing = all(one["predictive"]["differing"] == 0 for one in compared)
    holds("filtering by the network's relations changes nothing", nothing)
    behind = told["compared"]["novel-object, one-to-many"]["relation"]
    holds("its relations alone are behind", behind["difference"] < 0 and behind["p_success"] < 0.01)
    parts = ("relation", "predictive")
    apart = [
        (
            f"{words[part]} against both",
            [difference(one[part]["difference"], one[part]["p_success"]) for one in compared],
        )
        for part in parts
    ]
    alone = plain_grid(heads, lines, "percent, with the paper's network")
    same = _never_differing(told["tasks"] * len(places), "the paper's network")
    return markdown([alone, plain_grid(heads, apart, "points on the same tasks (p)")]) + "\n" + same


def _exploration_of_the_papers_networks() -> str:
    """The same with the paper's networks after a short training, and both on the same boards."""
    cells, grids = _with_the_papers_networks(("paper-greedy", "paper"), ACTING)
    for split in NOVEL:
        ahead = _above(cells["paper", split, "recall"], cells["paper-greedy", split, "recall"])
        holds(f"exploration finds more links with the paper's networks, {split}", ahead)
    return grids


def _colours_of_the_papers_networks() -> str:
    """The same with the paper's networks after a short training of each."""
    cells, grids = _with_the_papers_networks(("paper-rgb", "paper"), TRIES)
    row = result("table1-paper")["rows"]["paper-rgb"]
    for split in NOVEL:
        tests = row[split]["compared"]
        behind = tests["precision"]["difference"] < 0 and tests["precision"]["p"] < 0.05
        holds(f"fewer actions work by colours with the paper's networks, {split}", behind)
        holds(f"they find as many links, as far as boards tell, {split}", tests["recall"]["p"] > 0.05)
    config, other = (cells["paper-rgb", split, "precision"] for split in NOVEL)
    holds("colours do no worse on new objects than on known ones", not (_above(config, other) or _above(other, config)))
    return grids


def _with_the_papers_networks(rows: tuple[str, ...], keys: tuple[str, ...]) -> tuple[Cells, str]:
    """Figures of rows of the paper's networks, and these with comparisons on the same boards, for people."""
    told = result("table1-paper")["rows"]
    found, words = rows_of(INTERACTION.number, told), {row.name: row.words for row in INTERACTION.rows}
    places = [*product(NOVEL, keys)]
    cells = {(row, *place): _known(found[row], place) for row in rows for place in places}
    lines = [(words[row], [cell(cells[row, *place]) for place in places]) for row in rows]
    heads = [f"{objects}: {INTERACTION.keys[key]}" for objects, key in product(NOVEL.values(), keys)]
    apart = _apart(Claim(INTERACTION, rows, keys, ()), words, told)
    grid = plain_grid(heads, lines, "percent, with the paper's networks")
    return cells, markdown([grid, plain_grid(heads, apart, "points on the same boards (p)")])


REWARDS = {
    "real-camera-oracle": "reward from joint states",
    "real-camera": "reward from changed pixels",
    "real-camera-clean": "trained before a clean camera, where both rewards are one",
}
"""What was trained, by rows that a real camera judges."""
TRIES = (*ACTING, "precision_exploring")


def _rewards_of_a_real_camera() -> str:
    """Trainings by both rewards where pixels can be wrong, and how often they are."""
    told = result("image-reward")["rows"]
    found = rows_of(INTERACTION.number, {name: told[name] for name in REWARDS})
    cells = {(row, *place): _known(found[row], place) for row in REWARDS for place in product(NOVEL, TRIES)}
    for split in NOVEL:
        for key in ("precision", "precision_exploring"):
            ahead = _above(cells["real-camera-oracle", split, key], cells["real-camera", split, key])
            holds(f"the true reward is ahead, {split}, {key}", ahead)
        both = [cells[row, split, "recall"] for row in ("real-camera", "real-camera-oracle")]
        holds(f"both rewards find about as many links, {split}", not (_above(*both) or _above(*both[::-1])))
    for key in ("precision", "precision_exploring"):
        over_objects = (cells[row, "novel-config", key].objects for row in ("real-camera-oracle", "real-camera"))
        (low, _), (_, high) = (ends or (0, 100) for ends in over_objects)  # percent
        holds(f"the true reward is ahead over objects of new configurations, {key}", low > high)
    lines = [(words, [cell(cells[row, *place]) for place in product(NOVEL, TRIES)]) for row, words in REWARDS.items()]
    heads = [f"{words}: {INTERACTION.keys[key]}" for words, key in product(NOVEL.values(), TRIES)]
    return markdown([plain_grid(heads, lines, "percent, judged before a real camera")]) + "\n" + _wrong_rewards()


def _wrong_rewards() -> str:
    """How often changed pixels are wrong where the camera has noise and the light changes."""
    rows = [row for row in result("real_camera")["rows"] if row["camera"] == "real"]
    holds("no move goes unseen by the real camera", all(row["without_reward"] == 0 for row in rows))
    told = [f"{row['for_nothing']} of {row['still']} ({row['policy']} actions)" for row in rows]
    return _filled(
        f"Under `--camera real` every one of {sum(row['moved'] for row in rows)} recorded moves earned a reward, and "
        f"so did {' and '.join(told)} that moved nothing "
        "([`real_camera.json`](../../benchmarks/results/real_camera.json))."
    )
