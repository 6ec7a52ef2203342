"""Tables of what everything costs, from committed results."""

from typing import Any

from benchmarks.speed import scale_growth as growing
from busybot.evaluation.reference_tables import NOVEL, PLANNING
from busybot.view.report.page import Entry, Grid, Text, markdown, plain_grid
from tools.tables import KINDS, percent, result

MORE = {"boards": 1000, "objects": 1, "pixels": 1_000_000}
TIMES = {"cpu": "processors", "wall": "by the clock"}


STEPS = {
    "record": "boards generated and acted on",
    "train": "the model trained",
    "judge": "the row judged, told the world and not told",
}
"""What a row in the table of worlds takes."""


def world_row() -> str:
    """What a seed of the `mechanism` model costs, from nothing to its row."""
    told = result("world-row")["rows"]
    rows = [(words, [f"{told[step][key]:,.0f}" for key in _SPENT]) for step, words in STEPS.items()]
    sums = [f"{sum(told[step][key] for step in STEPS):,.0f}" for key in ("minutes", "cpu_minutes")]
    rows.append(("all", [*sums, f"{max(told[step]['megabytes'] for step in STEPS):,}"]))
    return markdown(
        [plain_grid(("minutes", "of a core", "MB"), [*rows, ("asked: at most", ["90", "", "2,000"])], "step")]
    )


_SPENT = ("minutes", "cpu_minutes", "megabytes")


def interact_speed() -> str:
    """Milliseconds of what training and acting consist of."""
    told = result("interact")
    rows, trained = [], []
    for size, kinds in told["iteration"].items():
        for kind, one in kinds.items():
            minutes = one["milliseconds"] * one["of_a_training"] / 60_000
            cells = [str(one["batch"]), f"{one['milliseconds']:.0f}", f"{one['ratio_to_limit']:.1f}"]
            trained.append((f"{size}, {kind}", [*cells, f"{one['of_a_training']:,}", f"{minutes:.1f}"]))
    for threads, milliseconds in told["milliseconds_per_look"].items():
        counted = f"{threads} thread{'s' if int(threads) > 1 else ''}"
        rows.append((f"affordance of a whole picture, {counted}, by the clock", milliseconds))
    acted = told["milliseconds"]
    rows.append(("recorded action, `scripted`: simulated, rendered, written", acted["scripted"]["action"]))
    corner = f"milliseconds, {told['machine']['processor']}, one thread"
    learned = [
        (name, [f"{one['first_decision']:.0f}", f"{one['decision']:.0f}", f"{one['action']:.0f}",
                       f"{one['to_scripted']:.2f}", percent(one["rewarded"])])
        for name, one in acted["learned"].items()
    ]  # fmt: skip
    heads = ("first decision", f"mean of {acted['steps']}", "recorded action", "to scripted", "percent rewarded")
    limit = "times one matrix product of as many operations"
    return markdown([
        plain_grid(["crops", "ms", limit, "iterations of a training", "minutes of a core"], trained, "iteration of"),
        plain_grid([""], [(words, [f"{value:.0f}"]) for words, value in rows], corner),
        plain_grid(heads, learned, "learned, model"),
    ])  # fmt: skip


def waiting() -> str:
    """What commands, boards and actions cost before and after, in matrix products."""
    told = result("waiting")
    names = list(told["commits"])
    rows = []
    for what, one in told["rows"].items():
        rows.append((what, [*(f"{one[name]:.1f}" for name in names), f"{one['ratio']:.2f}"]))
    heads = [f"{name} (`{commit[:7]}`)" for name, commit in told["commits"].items()]
    words = (
        f"One product takes {told['product_milliseconds']:.1f} ms on the machine where this was measured "
        f"({told['machine']['processor']}, one thread)."
    )
    return markdown([plain_grid([*heads, "ratio"], rows, told["unit"]), Text(words)])


def hardware() -> str:
    """Pictures, interactions and iterations of training a second, by number of workers."""
    told, blocks = result("hardware"), []
    workers = sorted({number for one in told["frames"].values() for number in one}, key=int)
    rows = []
    for what, one in told["frames"].items():
        cells = [f"{one[n]['per_second']:.0f} ({one[n]['megapixels']:.1f})" if n in one else "-" for n in workers]
        rows.append((f"pictures, {what} (megapixels)", cells))
    for what, one in told["interactions_per_second"].items():
        rows.append((f"interactions, {what}", [f"{one[n]['per_second']:.1f}" if n in one else "-" for n in workers]))
    blocks.append(plain_grid([f"{number} worker{'s' * (number != '1')}" for number in workers], rows, "a second"))
    rows = [(what, [f"{one['seconds']:.3g}"]) for what, one in told["iterations"].items()]
    blocks.append(plain_grid(["seconds"], rows, "an iteration of training"))
    hours = told["paper_profile"]["minutes"]["all"] / 60
    machine = told["machine"]
    words = (
        f"{machine['processor']}, {machine['cores']} cores, drawn by {machine['renderer']}, networks on the "
        f"{machine['device']}. The `paper` profile would take {hours:,.0f} hours there, most of them the training of "
        "the paper's graph network: it wants a GPU."
    )
    return markdown([*blocks, Text(words)])


def reproduced() -> str:
    """What a run of the smoke profile costs, by the folders that its stages write into."""
    told = result("reproduce")
    rows = [(stage, [f"{seconds:.0f}"]) for stage, seconds in told["stages"].items()]
    words = (
        f"A run of `{told['profile']}` takes {told['cpu_seconds'] / 60:.1f} CPU-minutes, "
        f"{told['seconds'] / 60:.1f} minutes "
        f"on {told['machine']['cores']} cores, with {told['commands']} commands:"
    )
    return markdown([Text(words), plain_grid(["CPU-seconds"], rows, "folder")])


def scale() -> str:
    """What each command costs along each curve, in matrix products, with its slope in words."""
    told = result("scale")
    product, grids = told["product_milliseconds"] / 1e3, []
    for name in (growing.SMALL, growing.FULL, "objects", "pixels"):
        curve = told["curves"][name]
        more, rows = MORE[curve["variable"]], []
        for command in growing.COMMANDS:
            if all(command in point["costs"] for point in curve["points"]):
                values = [f"{seconds / product:,.0f}" for seconds in growing.costs(curve, command)]
                how = growing.along(curve, command)
                rows.append((f"`{command}`", [*values, f"{more * how.each / product:,.1f}", how.words]))
        heads = [*(f"{x:,.0f}" for x in growing.variables(curve)), f"{more:,} more", "slope"]
        grids.append(plain_grid(heads, rows, f"matrix products, {name}"))
    words = (
        f"One product of two 1024 x 1024 matrices takes {1e3 * product:.1f} ms on the machine where this was measured "
        f"({told['machine']['processor']}, one thread)."
    )
    return markdown([*grids, Text(words)])


def scale_memory() -> str:
    """Memory of each command's first process, and of a worker, against boards; bytes and files."""
    curve = result("scale")["curves"][growing.SMALL]
    heads = [*(f"{x:,.0f}" for x in growing.variables(curve)), "KB for one more of the last", "slope"]
    rows = [(f"`{name}`", _megabytes(curve, name, "mb")) for name in growing.COMMANDS]
    rows.insert(2, ("a worker of `collect`", _megabytes(curve, "collect", "worker_mb")))
    return markdown([plain_grid(heads, rows, "MB at most, boards at 64 x 48")])


def _megabytes(curve: dict[str, Any], command: str, figure: str) -> list[str]:
    values = growing.costs(curve, command, figure)
    how = growing.along(curve, command, figure)
    return [*(f"{value:,.0f}" for value in values), f"{1e3 * how.lately:.2f}", how.words]


def scale_disk() -> str:
    """Bytes and files of one more board in a frozen dataset, by resolution and actions."""
    curves = result("scale")["curves"]
    rows = []
    for name in (growing.SMALL, growing.FULL, growing.USUAL):
        kinds = ("episode_bytes", "table_bytes", "manifest_bytes")
        each = [growing.on_disk(curves[name], kind).each / 1e3 for kind in kinds]
        steps = curves[name]["points"][-1]["steps"]
        size = " x ".join(map(str, curves[name]["points"][-1]["size"]))
        files = growing.on_disk(curves[name], "files").each
        rows.append((f"{size}, {steps} actions", [*(f"{value:.2f}" for value in each), f"{files:.3f}"]))
    heads = ("KB of its episode", "in tables", "in the manifest", "files")
    return markdown([plain_grid(heads, rows, "one more board")])


def scale_workers() -> str:
    """Processor and wall time of the same work by one, two and more workers."""
    told = result("scale")
    curve, product = told["curves"]["workers"], told["product_milliseconds"] / 1e3
    rows = []
    for point in curve["points"]:
        cells = [f"{point['costs'][name][kind] / product:,.0f}" for name in ("collect", "verify") for kind in TIMES]
        rows.append((str(point["workers"]), [*cells, f"{point['load'][0]:.1f}"]))
    heads = [f"`{name}`, {words}" for name in ("collect", "verify") for words in TIMES.values()]
    boards, cores = curve["points"][0]["boards"], told["machine"]["cores"]
    return markdown([plain_grid([*heads, "load of the machine"], rows, f"workers, {boards} boards, {cores} cores")])


def million() -> str:
    """What a million boards take on 1, 10 and 100 machines."""
    told = growing.million(result("scale")["curves"])
    heads = [f"{count} machine{'s' if count > 1 else ''}" for count in growing.MACHINES]
    rows = [(f"`{name}`, hours", [_few(value) for value in hours]) for name, hours in told.hours.items()]
    most = {name: told.memory_gb[name] for name in told.memory_gb if name not in ("generate", "info", "read")}
    rows += [(f"`{name}`, GB of memory", [_few(value) for value in values]) for name, values in most.items()]
    on_each = [growing.BOARDS / count for count in growing.MACHINES]
    rows.append(("boards on each", [f"{boards:,.0f}" for boards in on_each]))
    rows.append(("GB of disk on each", [f"{boards * told.disk['bytes'] / 1e9:,.0f}" for boards in on_each]))
    rows.append(("files on each", [f"{boards * told.disk['files']:,.0f}" for boards in on_each]))
    rows.append(("MB of manifest on each", [_few(boards * told.disk["manifest_bytes"] / 1e6) for boards in on_each]))
    together = [told.files_per_second(count) for count in growing.MACHINES]
    rows.append(("files a second, all together", [f"{value:,.0f}" for value in together]))
    rows.append(("MB a second, all together", [f"{value * told.disk['bytes'] / 1e6:,.0f}" for value in together]))
    return markdown([plain_grid(heads, rows, f"one million boards, {growing.CORES} cores a machine")])


def million_limits() -> str:
    """What comes to its end first on one machine, and when one process cannot feed any more."""
    told = growing.million(result("scale")["curves"])
    rows = [(words, [f"{boards:,.0f}"]) for words, boards in told.limits.items()]
    fed = (
        f"One process that stores what others record, as `collect` has it, keeps {told.cores_fed:,.0f} cores busy, "
        f"{told.cores_fed / growing.CORES:,.1f} machines: more cannot record into one dataset at full speed."
    )
    return markdown([plain_grid(["boards in one dataset"], rows, "on one machine"), Text(fed)])


def _few(value: float) -> str:
    """Two digits that say something."""
    return f"{value:,.0f}" if value >= 10 else f"{value:.1f}" if value >= 1 else f"{value:.2f}"


def collection_parts() -> str:
    """Where the time of a recorded interaction and of building a board goes, beside what its result costs by itself."""
    told = result("collection-parts")
    heads = ("ms", "matrix products", "% of all", "by itself, ms", "times that", "which is")
    grids = []
    for kind, words in (("interaction", "a recorded interaction"), ("board", "building a board")):
        rows = []
        for part, one in told[kind].items():
            if not one["ms"]:
                continue  # nothing is left over
            least = [f"{one['limit_ms']:.2f}", f"{one['ratio']:.1f}", one["limit"]] if "limit" in one else ["-"] * 3
            rows.append((part, [f"{one['ms']:.2f}", f"{one['products']:.3f}", f"{100 * one['share']:.1f}", *least]))
        grids.append(plain_grid(heads, rows, words))
    speed = told["megabytes_a_second"]
    words = (
        f"Measured on {told['boards']} boards and {told['interactions']} interactions with the objects of "
        f"{told['assets']} ({told['machine']['processor']}): one matrix product takes "
        f"{told['product_milliseconds']:.1f} ms, memory moves {speed['memory'] / 1e3:.1f} GB a second, SHA-256 hashes "
        f"{speed['SHA-256'] / 1e3:.1f}, the disk takes {speed['disk'] / 1e3:.2f}."
    )
    return markdown([*grids, Text(words)])


def paper_interact_speed() -> str:
    """What an iteration of each of the paper's interaction networks costs, and the whole schedule by extrapolation."""
    told = result("paper_interact")
    machine, total = told["machine"], told["extrapolated"]
    heads = ("parameters", "batch", "measured iterations", "seconds each", "of CPU", "iterations of the schedule")
    rows = []
    for kind, one in told["networks"].items():
        size = [f"{one['parameters'] / 1e6:.1f} million", str(one["batch"]), str(one["iterations"])]
        seconds = [f"{one['seconds_median']:.1f}", f"{one['cpu_seconds_median']:.1f}"]
        rows.append((kind, [*size, *seconds, str(total["iterations"][kind])]))
    hours, cpu = total["hours"], total["cpu_hours"]
    where = f"{machine['processor']}, {machine['threads']} thread{'s' if machine['threads'] > 1 else ''}"
    whole = (
        f"By extrapolation ({where}) the {total['epochs']} epochs take {hours['both']:.0f} hours, of CPU "
        f"{cpu['both']:.0f}: {cpu['training']:.0f} for training and at least {cpu['collecting']:.0f} for collecting."
    )
    return markdown([plain_grid(heads, rows, "network"), Text(whole)])


def paper_reason_speed() -> str:
    """What an iteration of the paper's graph networks costs in each of their forms, and the whole schedule."""
    forms = result("paper_reason")["forms"]
    rows = [(name, [f"{one['cpu_seconds']:.1f}", f"{one['schedule_cpu_hours']:.0f}"]) for name, one in forms.items()]
    return markdown([plain_grid(("CPU seconds an iteration", "CPU hours for the schedule"), rows, "form")])


def features() -> str:
    """How large the smallest change is for each encoder, and what decoders read from objects that they never saw."""
    rows = []
    for name, told in result("features")["encoders"].items():
        known, novel = (told["splits"][split] for split in NOVEL)
        least = " / ".join(f"{one['changed_distance']['least']:.2f}" for one in (known, novel))
        decoded = [one["decoders"] for one in (known, novel)]
        read = [", ".join(percent(shares[kind]) for kind in ("Lamp", "Door", "Toy")) for shares in decoded]
        oracle = " (oracle)" if told["oracle"] else ""
        rows.append((f"`{name}`{oracle}", [least, *read, percent(novel["decoders"]["all of a frame"])]))
    heads = ("smallest change, novel config / object", *(f"lamp, door, toy of {words}" for words in NOVEL.values()))
    return markdown([plain_grid((*heads, "whole board, new objects"), rows, "encoder")])


def resnet_weights() -> str:
    """What ResNet-50 with a package index's weights answers to photographs."""
    told = result("resnet_weights")
    rows = []
    for one in told["rows"]:
        name, share = one["answers"][0]
        verdict = "right" if one["first"] else "among the first five" if one["among_five"] else "no"
        rows.append((f"`{one['file'].rpartition('/')[2]}`", [", ".join(one["shows"]), name, percent(share), verdict]))
    return markdown([plain_grid(("shows", "first answer", "percent", "right"), rows, "photograph")])


def decision_time() -> str:
    """Milliseconds of every agent of Table 3 on new objects: the mean, and what 95 % of its decisions stay below.

    The gate is for the mean.
    """
    spent = {name: row["splits"]["novel-object"] for name, row in result("table3")["rows"].items()}
    rows = [
        (row.words, _times([spent[row.name][kind]["timing"] for kind in KINDS]))
        for row in PLANNING.rows
        if row.name in spent
    ]
    return markdown([Grid((), ("1-1", "1-many"), tuple(rows), f"CPU-ms for each decision, at most {DECISION_MS:g}")])


DECISION_MS = 50.0
"""At most, of a decision on average, as the protocol asks."""


def _times(timings: list[dict[str, Any]]) -> tuple[Entry, ...]:
    entries = []
    for timing in timings:
        mean = timing["cpu_ms"]
        if mean is None:
            entries.append(Entry("-"))
            continue
        model = mean - timing["cpu_ms_without_model"]
        small = f"(95 %: {timing['cpu_ms_p95']:.1f}; model {model:.1f})"
        entries.append(Entry(f"{mean:.1f}", small, "reached" if mean <= DECISION_MS else "missed"))
    return tuple(entries)


def opening() -> str:
    """Processor time of opening recordings and datasets, before and with the checks."""
    told = result("opening")
    rows = []
    for name, way in told["ways"].items():
        each = [f"{1000 * way[when]:.1f}" for when in ("before", "after")]
        rows.append((name, (*each, f"{way['ratio']:.2f}")))
    return markdown(
        [plain_grid((f"before (`{told['before']}`), ms", "with the checks, ms", "ratio"), rows, "what is opened")]
    )
