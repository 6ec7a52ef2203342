"""Tables beside Table 1 as Markdown, from their result files into docs/interact.md, which has places for them.

python -m benchmarks.interact_pages benchmarks/results/own-motion.json docs/interact.md
python -m benchmarks.interact_pages benchmarks/results/paper_interact.json docs/interact.md
"""

from typing import Any

from benchmarks.pages import put, write_page

SPLITS = {"train": "training objects", "novel-object": "novel objects"}


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the result's table in its place."""
    if "extrapolated" in result:
        return put(text, "paper-interact", paper_cost(result))
    return put(text, "own-motion", own_motion(result["splits"]))


def own_motion(splits: dict[str, Any]) -> str:
    """For each threshold: the share of true changes above it, and how many triggers' median change is."""
    heads = [f"{words}: {what}" for words in SPLITS.values() for what in ("changes", "switches")]
    lines = ["| changed pixels above | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|"]
    for delta in splits["train"]["exceeding"]:
        cells = []
        for split in SPLITS:
            above = splits[split]["exceeding"][delta]
            cells += [
                f"{100 * above['share_of_steps']:.1f} %",
                f"{len(above['triggers'])} of {splits[split]['triggers']}",
            ]
        lines.append(f"| {delta} | {' | '.join(cells)} |")
    pixels = {words: splits[split]["pixels"] for split, words in SPLITS.items()}
    told = (f"{words} {one['median']:.0f} and {one['most']:.0f}" for words, one in pixels.items())
    return "\n".join([*lines, "", f"Median and most changed pixels: {', '.join(told)}."])


def paper_cost(result: dict[str, Any]) -> str:
    """What an iteration of each network costs, and the whole schedule by extrapolation."""
    threads, total = result["machine"]["threads"], result["extrapolated"]
    lines = [
        "| network | parameters | batch | measured iterations | seconds each | of CPU | iterations of the schedule |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, one in result["networks"].items():
        seconds = f"{one['seconds_median']:.1f} | {one['cpu_seconds_median']:.1f}"
        size = f"{one['parameters'] / 1e6:.1f} million | {one['batch']} | {one['iterations']}"
        lines.append(f"| {kind} | {size} | {seconds} | {total['iterations'][kind]} |")
    hours, cpu = total["hours"], total["cpu_hours"]
    machine = f"{result['machine']['processor']}, {threads} thread{'s' if threads > 1 else ''}"
    told = (
        f"By extrapolation ({machine}) the {total['epochs']} epochs take {hours['both']:.0f} hours, of CPU "
        f"{cpu['both']:.0f}: {cpu['training']:.0f} for training and at least {cpu['collecting']:.0f} for collecting."
    )
    return "\n".join([*lines, "", told])


if __name__ == "__main__":
    write_page(__doc__, page)
