"""Everything in the documentation that programs make: tables of results, the reference of commands and of the format.

    python -m tools.docs            writes the generated parts of all pages
    python -m tools.docs --check    exits with 1 and says which parts are not what they would be

A generated part stands between `<!-- NAME -->` and `<!-- end of NAME -->`; `PAGES` says who makes it. What is between
these lines is replaced, what is around them is written by people.
"""

import argparse
import difflib
import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from busybot.common.atomic_io import write_atomically
from busybot.common.errors import BusybotError
from tools import gate_tables, judgements, prose, provenance, reference_pages, speed_tables, tables, world_tables

ROOT = Path(__file__).resolve().parents[1]
Part = Callable[[], str]

PAGES: dict[str, dict[str, Part]] = {
    "README.md": {"overview": tables.overview},
    "benchmarks/README.md": {"costs": prose.costs, "relations": prose.relations},
    "datasets/worlds/README.md": {"sets": world_tables.world_sets},
    "docs/guides/camera.md": {"real-camera": world_tables.real_camera},
    "docs/guides/reproduce.md": {"reproduced": speed_tables.reproduced, "laptop": prose.laptop},
    "docs/guides/scenes.md": {"kitchens": world_tables.kitchens},
    "docs/guides/worlds.md": {
        "worlds": reference_pages.worlds,
        "mechanisms": reference_pages.mechanisms,
        "world-runs": world_tables.world_runs,
    },
    "docs/reference/commands.md": {"commands": reference_pages.commands},
    "docs/reference/dataset-format.md": {"format": reference_pages.dataset_format},
    "docs/reference/limits.md": {
        "limits": reference_pages.limits,
        "hostile": tables.hostile,
        "opening": speed_tables.opening,
        "provenance": provenance.part,
    },
    "docs/reference/measures.md": {"reason": reference_pages.reason_measures, "plan": reference_pages.plan_measures},
    "docs/results/claims.md": {name: partial(prose.claim, name) for name in prose.CLAIMS},
    "docs/results/interact.md": {
        "table1": tables.table1,
        "new-switches": tables.new_switches,
        "changed-pixels": tables.changed_pixels,
        "policy-constants": tables.policy_constants,
        "interact-speed": speed_tables.interact_speed,
        "table1-paper": tables.table1_paper,
        "paper-interact-speed": speed_tables.paper_interact_speed,
    },
    "docs/results/scale.md": {
        "scale": speed_tables.scale,
        "scale-memory": speed_tables.scale_memory,
        "scale-disk": speed_tables.scale_disk,
        "scale-workers": speed_tables.scale_workers,
        "million": speed_tables.million,
        "million-limits": speed_tables.million_limits,
    },
    "docs/results/speed.md": {
        "waiting": speed_tables.waiting,
        "hardware": speed_tables.hardware,
        "collection-parts": speed_tables.collection_parts,
        "world-costs": world_tables.world_costs,
        "frames-speed": prose.frames_speed,
        "streaming": prose.streaming,
    },
    "docs/results/reason.md": {
        "features": speed_tables.features,
        "resnet-weights": speed_tables.resnet_weights,
        "features-speed": prose.features_speed,
        "paper-reason-speed": speed_tables.paper_reason_speed,
        "table2-gpu": tables.table2_gpu,
        "table2": tables.table2,
        "reason-robustness": world_tables.robustness,
        "reason-procedural": tables.reason_procedural,
    },
    "docs/results/real-board.md": {"real-board": world_tables.real_board},
    "docs/results/judgements.md": {"test-sets": judgements.test_sets},
    "docs/results/worlds.md": {
        "gates-glance": gate_tables.gates_glance,
        "world-gates": gate_tables.world_gates,
        "gates-missed": gate_tables.gates_missed,
        "curious-gates": gate_tables.curious_gates,
        "further-gates": gate_tables.further_gates,
    },
    "docs/results/worlds-figures.md": {
        "gate-figures": gate_tables.gate_figures,
        "gate-intervals": gate_tables.gate_intervals,
        "gate-reasons": gate_tables.gate_reasons,
        "pipeline-gates": gate_tables.pipeline_gates,
        "curious-figures": gate_tables.curious_figures,
        "calibration": gate_tables.calibration,
    },
    "docs/results/worlds-rows.md": {
        "worlds": world_tables.worlds,
        "world-row": speed_tables.world_row,
        "rewirings": world_tables.rewirings,
        "ablations": world_tables.ablations,
    },
    "docs/results/worlds-acting.md": {
        "exploring": world_tables.exploring,
        "patches": world_tables.patches,
        "curiosity": world_tables.curiosity,
        "world-plans": world_tables.world_plans,
    },
    "docs/results/worlds-bounds.md": {
        "bounds-symbolic": world_tables.bounds_symbolic,
        "bounds-worlds": world_tables.bounds_worlds,
        "proposed-boxes": world_tables.proposed_boxes,
        "mechanisms": world_tables.mechanisms,
        "perception-costs": world_tables.perception_costs,
        "orientation": world_tables.orientation,
        "shortcuts": world_tables.shortcuts,
    },
    "docs/results/plan.md": {
        "decision-time": speed_tables.decision_time,
        "learned-agents": tables.learned_agents,
        "learned-plans": tables.learned_plans,
        "table3": tables.table3,
        "whole-pipeline": tables.whole_pipeline,
        "plan-procedural": tables.plan_procedural,
    },
}
"""Pages by their place in the repository, and who makes each of their generated parts."""


def with_part(text: str, name: str, content: str) -> str:
    """The page with the content in the part's place.

    Raises:
        BusybotError: the page has no such place, or more than one.
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise BusybotError(f"no place for the part {name}", f"write a line {begin} and below it {end}")
    before, rest = text.split(begin)
    return f"{before}{begin}\n{content.strip()}\n{end}{rest.split(end)[1]}"


def written(page: str, text: str) -> str:
    """A page's text with all its generated parts made anew.

    Raises:
        BusybotError: it lacks the place of a part, or has one that nobody makes.
    """
    parts = PAGES[page]
    if strangers := set(re.findall(r"<!-- end of ([\w-]+) -->", text)) - set(parts):
        raise BusybotError(f"{page}: nobody makes {', '.join(sorted(strangers))}", "add it to PAGES in tools/docs.py")
    for name, make in parts.items():
        try:
            text = with_part(text, name, make())
        except BusybotError as error:
            raise BusybotError(f"{page}: {error.what}", error.hint) from None
    return text


def differences(root: Path = ROOT) -> dict[str, str]:
    """Pages that are not what they would be, each with the lines that differ."""
    found = {}
    for page in PAGES:
        text = (root / page).read_text(encoding="utf-8")
        if (made := written(page, text)) != text:
            lines = difflib.unified_diff(text.splitlines(), made.splitlines(), page, "made anew", lineterm="", n=0)
            found[page] = "\n".join(lines)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a page differs")
    arguments = parser.parse_args()
    try:
        differing = differences()
        for page in () if arguments.check else differing:
            text = (ROOT / page).read_text(encoding="utf-8")
            write_atomically(ROOT / page, written(page, text).encode())
    except BusybotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    for page, lines in differing.items():
        print(lines if arguments.check else f"wrote {page}")
    if arguments.check and differing:
        print(f"{', '.join(differing)}: not what `python -m tools.docs` writes", file=sys.stderr)
    return int(arguments.check and bool(differing))


if __name__ == "__main__":
    sys.exit(main())
