"""Sentences of the documentation that tell numbers of result files."""

import re
import textwrap
from itertools import product
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError
from busybot.evaluation.results import read_result
from tools.tables import RESULTS, result

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
    last, growth = soak["memory"][-1]["boards"], soak["growth_mb_over_second_half"]
    holds("no file stays open", soak["more_open_files_over_second_half"] == 0)
    return _filled(
        "A recorded interaction that moved a link (simulated, rendered, read back, encoded and written) costs "
        f"{cost['ratio_to_minimal_frame']:.2f} of one frame of `minimal` lit by a sun with shadows, as boards are "
        f"usually shown with it, and {cost['ratio_to_minimal_frame_without_shadows']:.2f} of one without shadows; our "
        "shaders draw none, only a soft darkening around objects. The simulator keeps the 64 objects used last loaded: "
        f"memory grows by {growth} MB over the last {last // 2} of {last} boards, and no file stays open."
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
        f"`{told['encoder']}` encodes {told['frames_per_second']:.0f} frames a second on two cores, which had other "
        f"work, too, {told['frames_per_cpu_second']:.0f} per second of processor time, the start of the workers "
        "included ([`features-speed.json`](../../benchmarks/results/features-speed.json)):"
    )


def frames_speed() -> str:
    """How many pictures a second a learner gets."""
    told = result("frames-speed")
    rate = {name: row["per_cpu_second"] for name, row in told["rows"].items()}
    holds("a core decodes at least 600 pictures a second", min(rate["RGB"], rate["RGB, first pass"]) >= 600)
    return _filled(
        f"In random order, {told['width']} x {told['height']}, through a `DataLoader` of one process, a second of "
        f"processor time gives {rate['RGB']} RGB pictures or {rate['depth']} of depth once the encoded pictures are in "
        f"memory, {rate['RGB, first pass']} in the first pass, which reads the recordings, and "
        f"{rate['RGB, nothing kept']} if nothing is kept and every picture is read from its file alone: then the order "
        "of `frames.shuffled(seed)` is the one to take, which stays with some episodes for a while. With a worker it "
        f"is {rate['RGB, one worker']}, both processes counted: batches are handed over in shared memory, whose pages "
        "the system makes anew for each."
    )


def laptop() -> str:
    """How long the committed run of the profile `laptop` took, and what it reached."""
    run = RESULTS / "laptop"
    stages = read_result(run / "tables" / "stages.json", "stages")["stages"]
    holds("every stage was done", all(stage["done"] for stage in stages.values()))
    holds("no gate was missed", _missed(run / "report.md") == 0)
    minutes = sum(stage["seconds"] for stage in stages.values()) / 60
    return _filled(
        f"A run of `laptop` took {minutes:.0f} minutes on two cores that did other work, too, from nothing to its "
        "report, and reached every gate that it measures: [Tables 1 to 3, pictures and what every stage "
        "took](../../benchmarks/results/laptop/report.md). What it does not measure, further seeds and strict rows "
        "among it, the report names."
    )


def _missed(report: Path) -> int:
    found = re.search(r"^- \*\*(\d+)\*\* gates missed", report.read_text(encoding="utf-8"), re.MULTILINE)
    return -1 if found is None else int(found[1])
