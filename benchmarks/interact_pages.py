"""Tables beside Table 1 as Markdown, from their result files into docs/interact.md, which has places for them.

python -m benchmarks.interact_pages benchmarks/results/changed_pixels.json docs/interact.md
python -m benchmarks.interact_pages benchmarks/results/paper_interact.json docs/interact.md
python -m benchmarks.interact_pages benchmarks/results/policy_constants.json docs/interact.md
python -m benchmarks.interact_pages benchmarks/results/interact.json docs/interact.md
"""

from typing import Any

from benchmarks.pages import put, with_interval, write_page
from busybot.view.protocol import INTERACTION

SPLITS = {"train": "training objects", "novel-object": "novel objects"}
FREE_SPLITS = {"novel-object": "held out", "novel-config": "known", "other": "free seed 0"}
FREE_KEYS = ("precision", "recall")


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the result's table in its place."""
    if "extrapolated" in result:
        return put(text, "paper-interact", paper_cost(result))
    if "held_out" in result:
        return put(text, "policy-constants", policy_constants(result))
    if "iteration" in result:
        return put(text, "interact", cost(result))
    return put(text, "changed-pixels", changed_pixels(result["splits"]))


def changed_pixels(splits: dict[str, Any]) -> str:
    """Of the moves on each kind of board, how many pixels change, and the share above each threshold."""
    deltas = list(splits["train"]["with"]["exceeding"])
    heads = ["least", "median", "most", *(f"above {delta}" for delta in deltas)]
    lines = ["| changed pixels | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|"]
    for split, words in SPLITS.items():
        for name, told in splits[split].items():
            pixels = [f"{told['pixels'][key]:.0f}" for key in heads[:3]]
            shares = [f"{100 * told['exceeding'][delta]['share_of_moves']:.1f} %" for delta in deltas]
            lines.append(f"| {words}, {name} responders | {' | '.join([*pixels, *shares])} |")
    lines += ["", "| switches above it without responders: ever (in most moves) | " + " | ".join(deltas) + " |"]
    lines.append("|---" * (1 + len(deltas)) + "|")
    for split, words in SPLITS.items():
        alone = splits[split]["without"]
        above = [alone["exceeding"][delta] for delta in deltas]
        cells = [f"{len(one['ever'])} ({len(one['mostly'])})" for one in above]
        lines.append(f"| {words}, {len(alone['triggers'])} switches | {' | '.join(cells)} |")
    for split, words in SPLITS.items():
        for delta, one in splits[split]["without"]["exceeding"].items():
            if one["ever"]:
                names = ", ".join(name.removeprefix("Switch/") for name in one["ever"])
                lines += ["", f"Above {delta}, {words}: {names}."]
    return "\n".join(lines)


def policy_constants(result: dict[str, Any]) -> str:
    """A line for each setting: which constant, its default, the other value, and what it brings in percent.

    The second table is without the veto, on objects that were held out, on those that the model knows, and with another
    model on all that it knows.
    """
    keys = INTERACTION.keys
    lines = [*_heads(["under the veto", "default", "here", *keys.values()])]
    for setting, row in result["rows"].items():
        cells = [with_interval(row, key) for key in keys]
        lines.append(_line(_setting(setting, result["default_strict"]), cells))
    columns = [(split, key) for split in FREE_SPLITS for key in FREE_KEYS]
    words = [f"{FREE_SPLITS[split]}: {keys[key]}" for split, key in columns]
    lines += ["", *_heads(["without", "default", "here", *words])]
    for setting, row in result["free"].items():
        cells = [with_interval(row[split], key) if split in row else "missing" for split, key in columns]
        lines.append(_line(_setting(setting, result["default"]), cells))
    return "\n".join(lines)


def _heads(names: list[str]) -> list[str]:
    return [_line(" | ".join(names), []), "|---" * len(names) + "|"]


def _line(what: str, cells: list[str]) -> str:
    return f"| {' | '.join([what, *cells])} |"


def _setting(setting: str, default: dict[str, Any]) -> str:
    """Name, default and value of a varied constant; rows that vary none or several have a name."""
    name, _, value = setting.partition("=")
    return f"`{name}` | {default[name]:g} | {float(value):g}" if value else f"*{name}* | |"


def cost(result: dict[str, Any]) -> str:
    """Milliseconds of what training and acting consist of."""
    machine, looks = result["machine"], result["milliseconds_per_look"]
    lines = [_line(f"milliseconds, {machine['processor']}, one thread", [""]), "|---|---|"]
    for kind, one in result["iteration"].items():
        what = f"iteration of the {kind} network, {one['batch']} crops"
        limit = f"{one['ratio_to_limit']:.1f} times as long as one matrix product of as many operations takes"
        lines.append(_line(f"{what} ({limit})", [f"{one['milliseconds']:.0f}"]))
    for threads, milliseconds in looks.items():
        counted = f"{threads} thread{'s' if int(threads) > 1 else ''}"
        lines.append(_line(f"affordance of a whole picture, {counted}, by the clock", [f"{milliseconds:.0f}"]))
    lines.append(_line("decision, from the first picture of a board", [f"{result['milliseconds_per_decision']:.0f}"]))
    for policy, milliseconds in result["milliseconds_per_recorded_action"].items():
        lines.append(
            _line(f"recorded action, policy `{policy}`: simulated, rendered, written", [f"{milliseconds:.0f}"])
        )
    return "\n".join(lines)


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
