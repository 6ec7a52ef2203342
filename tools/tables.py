"""Tables of the documentation, from the files in benchmarks/results."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.speed import scale_growth as growing
from benchmarks.studies.disturbances import DISTURBANCES
from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import INTERACTION, NOVEL, PLANNING, REASONING, TABLES, Table
from busybot.evaluation.results import read_result
from busybot.view.figures.curves import BASELINES, strength_words
from busybot.view.report.page import Entry, Grid, Items, Text, markdown, number, plain_grid, spread
from busybot.view.report.results import Results, RowFound, read_results, rows_of
from busybot.view.report.sections import table_grid

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"
KINDS = ("one-to-one", "one-to-many")
MORE = {"boards": 1000, "objects": 1, "pixels": 1_000_000}
SET_OBJECTS = ("procedural", "partnet-mobility")
TIMES = {"cpu": "processors", "wall": "by the clock"}


def result(name: str) -> dict[str, Any]:
    """A committed result by the name of its file."""
    return read_result(RESULTS / f"{name}.json")


def _table(number: int, name: str = "") -> tuple[Results, dict[str, RowFound]]:
    found = read_results([RESULTS / f"{name or f'table{number}'}.json"])
    return found, found.tables[number]


def _percent(share: float | None) -> str:
    return "-" if share is None else number(100 * share)


@dataclass(frozen=True)
class Line:
    """A line of the overview: which of our rows, and which of their numbers."""

    words: str
    table: Table
    rows: tuple[str, ...]
    key: str


FREE, STRICT = (tuple(f"{mode}-{seed}" for seed in range(3)) for mode in ("free", "strict"))
LINES = (
    Line("actions that move something", INTERACTION, FREE, "precision"),
    Line("links found", INTERACTION, FREE, "recall"),
    Line("actions that move something, *strict*", INTERACTION, STRICT, "precision"),
    Line("links found, *strict*", INTERACTION, STRICT, "recall"),
    Line("relations: precision", REASONING, ("event",), "edge_p"),
    Line("relations: recall", REASONING, ("event",), "edge_r"),
    Line("predicted steps, all responders right", REASONING, ("event",), "pred_a"),
    Line("goals reached, one-to-one", PLANNING, ("search",), "one-to-one"),
    Line("goals reached, one-to-many", PLANNING, ("search",), "one-to-many"),
)


def overview() -> str:
    """Our rows of Tables 1 to 3, each with the worst of its training seeds, beside the paper's and the gates."""
    found = {table.number: _table(table.number)[1] for table in TABLES}
    lines = [(one.words, [cell for s in NOVEL for cell in _short(one, found[one.table.number], s)]) for one in LINES]
    heads = [head for words in NOVEL.values() for head in (words, "paper", "gate")]
    return markdown([plain_grid(heads, lines, "percent")])


def _short(line: Line, rows: dict[str, RowFound], split: str) -> tuple[str, str, str]:
    """Ours, the paper's and the gate; a gate that is missed is bold."""
    told = [rows[name].cells.get((split, line.key)) for name in line.rows if name in rows]
    values = [one.low if one.several and one.low is not None else one.value for one in told if one is not None]
    row = next(row for row in line.table.rows if row.name == line.rows[0])
    assert row.paper is not None and row.gate is not None
    paper = line.table.at(line.table.paper[row.paper], split, line.key)
    gate = line.table.at(line.table.gates[row.gate], split, line.key)
    ours = number(min(values)) if values else "missing"
    missed = values and gate is not None and round(min(values), 6) < gate
    return (f"**{ours}**" if missed else ours, f"{paper:g}", f"{gate:g}")


def table1() -> str:
    """Table 1, and what its trainings took."""
    found, rows = _table(1)
    return markdown([table_grid(INTERACTION, rows), Text(trained_in(rows.values(), found.about[1]["machine"]))])


def further_boards() -> str:
    """Rows of Table 1 that were judged on other boards, too."""
    return markdown([table_grid(INTERACTION, _table(1, "further-boards")[1], beside=False)])


def smaller_networks() -> str:
    """Rows of Table 1 with smaller networks, on other boards."""
    return markdown([table_grid(INTERACTION, _table(1, "smaller-networks")[1], beside=False)])


def table2() -> str:
    """Table 2, and what our trainings took."""
    found, rows = _table(2)
    return markdown([table_grid(REASONING, rows), Text(trained_in([rows["event"]], found.about[2]["machine"]))])


def table3() -> str:
    """Table 3, and how the learned agents were trained."""
    rows = _table(3)[1]
    told = [Text(f"`{name}`: {_practised(one)}") for name, row in rows.items() for one in row.trainings]
    return markdown([table_grid(PLANNING, rows), *told])


def plan_procedural() -> str:
    """The agents of Table 3 with what ships with busybot."""
    rows = rows_of(3, result("plan-procedural")["agents"])
    return markdown([table_grid(PLANNING, rows, beside=False)])


def trained_in(rows: Iterable[RowFound], machine: dict[str, Any]) -> str:
    """A sentence on time and memory of the trainings that nothing interrupted; empty if there is none."""
    trainings = [training for row in rows for training in row.trainings]
    costs = [training["cost"] for training in trainings if training.get("cost")]
    if not costs:
        return ""
    least, most = (f"{end(cost['seconds'] for cost in costs) / 60:.0f}" for end in (min, max))
    return (
        f"From nothing to a trained model: {least if least == most else f'{least} to {most}'} minutes and at most "
        f"{max(cost['megabytes'] for cost in costs) / 1000:.1f} GB of memory on {machine['cores']} cores "
        f"({len(costs)} of {len(trainings)} trainings; what was interrupted is not timed)."
    )


def _practised(told: dict[str, Any]) -> str:
    """What a learned agent was trained on and for how long."""
    held_out = f"{100 * told['held_out']['success']:.1f} % on {told['boards_held_out']} boards held out"
    return (
        f"{told['minutes']:.0f} of {told['minutes_allowed']:.0f} minutes, {told['iterations']:,} iterations on "
        f"{told['boards']} boards of training objects with {told['states_explored']:,} states, seed {told['seed']}; "
        f"{held_out}, at its best iteration, {told['best_iteration']:,}."
    )


def changed_pixels() -> str:
    """Of the moves on each kind of board, how many pixels change, and the share above each threshold."""
    splits, words = result("changed_pixels")["splits"], {"train": "training objects", "novel-object": "novel objects"}
    deltas = sorted(splits["train"]["with"]["exceeding"], key=int)
    moves, alone, named = [], [], []
    for split, objects in words.items():
        for name, told in splits[split].items():
            pixels = [f"{told['pixels'][key]:.0f}" for key in ("least", "median", "most")]
            shares = [f"{_percent(told['exceeding'][delta]['share_of_moves'])} %" for delta in deltas]
            moves.append((f"{objects}, {name} responders", [*pixels, *shares]))
        without = splits[split]["without"]
        above = {delta: without["exceeding"][delta] for delta in deltas}
        cells = [f"{len(one['ever'])} ({len(one['mostly'])})" for one in above.values()]
        alone.append((f"{objects}, {len(without['triggers'])} switches", cells))
        names = {delta: ", ".join(name.removeprefix("Switch/") for name in one["ever"]) for delta, one in above.items()}
        named += [Text(f"Above {delta}, {objects}: {which}.") for delta, which in names.items() if which]
    heads = ["least", "median", "most", *(f"above {delta}" for delta in deltas)]
    switches = "switches above it without responders: ever (in most moves)"
    return markdown([plain_grid(heads, moves, "changed pixels"), plain_grid(deltas, alone, switches), *named])


def policy_constants() -> str:
    """A line for each setting: which constant, its default, the other value, and what it brings in percent.

    The second table is without the veto, on objects that were held out, on those that the model knows, and with another
    model on all that it knows.
    """
    told, keys = result("policy_constants"), INTERACTION.keys
    strict = [_setting(name, told["default_strict"], [row]) for name, row in told["rows"].items()]
    places = {"novel-object": "held out", "novel-config": "known", "other": "free seed 0"}
    columns = [f"{words}: {keys[key]}" for words in places.values() for key in ("precision", "recall")]
    free = [
        _setting(name, told["default"], [row.get(place) for place in places], ("precision", "recall"))
        for name, row in told["free"].items()
    ]
    first = plain_grid(("default", "here", *keys.values()), strict, "under the veto")
    return markdown([first, plain_grid(("default", "here", *columns), free, "without")])


def _setting(
    setting: str, default: dict[str, Any], judged: list[Any], keys: Iterable[str] = tuple(INTERACTION.keys)
) -> tuple[str, list[str]]:
    """Name, default and value of a varied constant; rows that vary none or several have a name."""
    name, _, value = setting.partition("=")
    cells = [_with_interval(one, key) for one in judged for key in keys]
    if not value:
        return f"*{name}*", ["", "", *cells]
    return f"`{name}`", [f"{default[name]:g}", f"{float(value):g}", *cells]


def _with_interval(judged: dict[str, Any] | None, key: str) -> str:
    if judged is None or judged[key] is None:
        return "missing" if judged is None else "-"
    low, high = (100 * end for end in judged["intervals"][key] or (judged[key], judged[key]))
    return f"{_percent(judged[key])} {spread(low, high)}"


def interact_speed() -> str:
    """Milliseconds of what training and acting consist of."""
    told = result("interact")
    rows = []
    for kind, one in told["iteration"].items():
        limit = f"{one['ratio_to_limit']:.1f} times as long as one matrix product of as many operations takes"
        rows.append((f"iteration of the {kind} network, {one['batch']} crops ({limit})", one["milliseconds"]))
    for threads, milliseconds in told["milliseconds_per_look"].items():
        counted = f"{threads} thread{'s' if int(threads) > 1 else ''}"
        rows.append((f"affordance of a whole picture, {counted}, by the clock", milliseconds))
    rows.append(("decision, from the first picture of a board", told["milliseconds_per_decision"]))
    for policy, milliseconds in told["milliseconds_per_recorded_action"].items():
        rows.append((f"recorded action, policy `{policy}`: simulated, rendered, written", milliseconds))
    corner = f"milliseconds, {told['machine']['processor']}, one thread"
    return markdown([plain_grid([""], [(words, [f"{value:.0f}"]) for words, value in rows], corner)])


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
    """What a run of the smoke profile costs, stage by stage."""
    told = result("reproduce")
    rows = [(stage, [f"{seconds:.0f}"]) for stage, seconds in told["stages"].items()]
    words = (
        f"A run of `{told['profile']}` takes {told['cpu_seconds'] / 60:.1f} CPU-minutes, "
        f"{told['seconds'] / 60:.1f} minutes "
        f"on {told['machine']['cores']} cores, with {told['commands']} commands:"
    )
    return markdown([Text(words), plain_grid(["seconds"], rows, "stage")])


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


def world_costs() -> str:
    """What an interaction costs in each world, beside the paper's, and how many boards are drawn in a second."""
    told, drawn = result("world-costs"), result("drawing")
    rows = []
    for world, one in told["rows"].items():
        cells = [f"{one['ms']:.1f}", f"{one['ratio']:.2f}", f"{one['pictures']:.2f}", f"{one['policy_ms']:.1f}"]
        rows.append((f"`{world}`", [*cells, f"{drawn['rows'][world]['boards_per_second']:.0f}"]))
    heads = (
        "an interaction, ms",
        "to the paper's",
        "pictures an action",
        "scripted policy, ms",
        "boards drawn a second",
    )
    locks = {name: one for name, one in drawn["rows"].items() if "depth" in name}
    deep = [(name, [f"{one['boards_per_second']:.1f}"]) for name, one in locks.items()]
    words = f"{told['boards']} boards of each world, {told['steps']} actions each, the objects of {told['assets']}."
    return markdown([plain_grid(heads, rows, "world"), plain_grid(["boards a second"], deep, "locks"), Text(words)])


def real_camera() -> str:
    """How often the reward from photos is wrong, by policy."""
    told, rows = result("real_camera"), []
    for one in told["rows"]:
        share = _percent(one["for_nothing"] / one["still"] if one["still"] else None)
        cells = [f"{one['without_reward']} of {one['moved']}", f"{one['for_nothing']} of {one['still']}", share]
        rows.append((f"{one['camera']}, `{one['policy']}`", cells))
    heads = ("moved a link, no reward", "moved nothing, a reward", "percent of these")
    return markdown([plain_grid(heads, rows, "camera, policy")])


def world_runs() -> str:
    """Of each world what went through everything that is done with datasets, over its splits and both kinds of objects.

    Raises:
        BusybotError: something was wrong on the way.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for name in ("worlds-procedural", "worlds-real"):
        for case, row in result(name)["rows"].items():
            found.setdefault(case.split("/")[0], []).append(row)
    if faults := [fault for rows in found.values() for row in rows for fault in row["faults"]]:
        raise BusybotError(
            f"boards of every world: {faults[0]}", "mend it, and run benchmarks.reliability.worlds again"
        )
    keys = ("boards", "actions", "steps_put_back", "boards_with_locks", "boards_rewired_meanwhile")
    lines = []
    for world, rows in found.items():
        kills = sum(len(row["killed_with_episodes"]) for row in rows)
        lines.append(
            (f"`{world}`", [str(len(rows)), *(f"{sum(row[key] for row in rows):,}" for key in keys), str(kills)])
        )
    heads = ("splits x objects", "boards", "actions", "put back", "with locks", "rewired meanwhile", "kills")
    return markdown([plain_grid(heads, lines, "world")])


def world_sets() -> str:
    """The sets of boards of every world: how many links and locks, and the hash over their boards."""
    rows = []
    for file in sorted((RESULTS.parents[1] / "datasets" / "worlds").glob("*.json")):
        told = read_json(file)
        for name in next(iter(told["objects"].values())):
            cards = [told["objects"][objects][name] for objects in SET_OBJECTS]
            hashes = [f"`{card['board_hash'][:12]}`" for card in cards]
            rows.append((f"`{told['world']}/{name}`", [str(cards[0]["boards"]), *_links_and_locks(cards), *hashes]))
    heads = ("boards", "links", "with locks", "rewired", *(f"board hash, {objects}" for objects in SET_OBJECTS))
    return markdown([plain_grid(heads, rows, "set")])


def _links_and_locks(cards: list[dict[str, Any]]) -> list[str]:
    """Mean number of links, of boards with locks and of rewired ones, for each card's objects."""
    links, locked, rewired = [], [], []
    for on_them in (card["on_them"] for card in cards):
        counts = {int(count): boards for count, boards in on_them["by_links"].items()}
        links.append(f"{sum(count * boards for count, boards in counts.items()) / sum(counts.values()):.1f}")
        locked.append(str(sum(on_them["by_locks"].values())))
        rewired.append(str(on_them["rewired"]))
    return [" / ".join(values) for values in (links, locked, rewired)]


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
        read = [", ".join(_percent(shares[kind]) for kind in ("Lamp", "Door", "Toy")) for shares in decoded]
        oracle = " (oracle)" if told["oracle"] else ""
        rows.append((f"`{name}`{oracle}", [least, *read, _percent(novel["decoders"]["all of a frame"])]))
    heads = ("smallest change, novel config / object", *(f"lamp, door, toy of {words}" for words in NOVEL.values()))
    return markdown([plain_grid((*heads, "whole board, new objects"), rows, "encoder")])


def reason_procedural() -> str:
    """What the shipped model of relations does on procedural objects."""
    rows = []
    for split, told in result("reason-procedural")["splits"].items():
        bounded = [f"{_percent(told[key])} ({_percent(told[f'{key}_bound'])})" for key in ("edge_r", "pred_a")]
        rest = [_percent(told[key]) for key in ("pred_a_successful", "failing")]
        rows.append((split, [_percent(told["edge_p"]), *bounded, *rest]))
    heads = ("Edge-P", "Edge-R (bound)", "Pred-A (bound)", "successful", "steps that fail")
    return markdown([plain_grid(heads, rows, "percent")])


def robustness() -> str:
    """Edge-P / Edge-R, and Pred-A behind a comma of those that predict; "-" for who does not see a disturbance."""
    told = result("reason_robustness")
    trained = list(told["models"])
    columns = [*trained, *BASELINES]
    lines = []
    for name, rows in told["rows"].items():
        for row in rows:
            cells = [_scores(row["models"].get(column)) for column in columns]
            lines.append((_disturbance(told, name, row), [*cells, _percent(row["known"])]))
    heads = [f"`{name}`" if name in trained else name for name in columns]
    done = [
        (DISTURBANCES[name].title, told["disturbances"][name]["what"]) for name in told["rows"] if name in DISTURBANCES
    ]
    what = Items(tuple(f"*{title}*: {words}." for title, words in done))
    return markdown([plain_grid((*heads, "known"), lines, "percent"), what])


def real_board() -> str:
    """Precision and recall on the twin of the real board: the hardest camera, then the others."""
    told = result("real_board")["rows"]
    lines = []
    for row, cameras in told.items():
        hard, cells = cameras.get("hardest"), []
        for name in ("p", "r"):
            if hard is None or hard[name] is None:
                cells.append("-")
                continue
            low, high = (_whole(share) for share in hard[f"{name}_interval"])
            least = f", least {_percent(hard[f'{name}_least'])}" if len(hard["seeds"]) > 1 else ""
            cells.append(f"{_percent(hard[name])} ({low}-{high}{least})")
        lines.append((row, [*cells, str(hard["true"]) if hard else "-"]))
    alone = list(dict.fromkeys(camera for cameras in told.values() for camera in cameras if camera != "hardest"))
    rows = []
    for camera in alone:
        found = [cameras.get(camera) for cameras in told.values()]
        cells = [f"{_percent(one['p'])} / {_percent(one['r'])}" if one else "-" for one in found]
        rows.append((camera, cells))
    heads = ("precision (95 %, least of a seed)", "recall", "relations")
    return markdown([plain_grid(heads, lines, "the hardest camera"), plain_grid(tuple(told), rows, "P / R alone")])


def _disturbance(told: dict[str, Any], name: str, row: dict[str, Any]) -> str:
    if name not in DISTURBANCES:
        return f"{name}, {row['boards']} boards"
    return f"{DISTURBANCES[name].title}, {strength_words(told, name, row['strength'])}"


def _scores(scores: dict[str, Any] | None) -> str:
    if scores is None:
        return "-"
    told = f"{_percent(scores['edge_p'])} / {_percent(scores['edge_r'])}"
    return told if scores["pred_a"] is None else f"{told}, {_percent(scores['pred_a'])}"


def bounds_symbolic() -> str:
    """Of symbolic boards, the share of responders whose parents, and whose mechanism, is known after some actions."""
    measures, lines = ("parents", "mechanism"), []
    rows = {
        (links, choice): row
        for links, told in result("bounds")["rows"]["table"].items()
        for choice, row in told.items()
    }
    for (links, choice), row in rows.items():
        lines.append((f"{links}, {choice}", [" / ".join(_after(row[measure]).values()) for measure in measures]))
    when = " / ".join(next(iter(rows.values()))["parents"])
    return markdown([plain_grid([f"{measure} after {when}" for measure in measures], lines, "links, choice")])


def mechanisms() -> str:
    """Parents that the network finds on true states, beside the exact observer's."""
    rows = []
    for world, told in result("mechanisms")["rows"].items():
        cells = [f"{_percent(one['network']['share'])} ({_percent(one['bound']['share'])})" for one in told.values()]
        rows.append((world, cells))
    actions = list(next(iter(result("mechanisms")["rows"].values())))
    return markdown([plain_grid([f"after {count} actions" for count in actions], rows, "F1, network (exact observer)")])


def bounds_worlds() -> str:
    """For every world, split and choice: F1 of parents at link and at object level, and the share of mechanisms."""
    blocks: list[Any] = []
    measures = {"parents, link by link: F1": "link", "parents, objects: F1": "object", "mechanism": "mechanism"}
    rows = {name: one for name, one in result("bounds")["rows"].items() if name != "table"}
    for words, measure in measures.items():
        lines: list[tuple[str, list[str]]] = []
        heads: tuple[str, ...] = ()
        for world, splits in rows.items():
            for split, choices in splits.items():
                for choice, row in choices.items():
                    told = _after(row[measure], "f1" if measure in ("link", "object") else "")
                    heads = tuple(told)
                    lines.append((f"{world}, {split}, {choice}", list(told.values())))
        blocks.append(plain_grid(heads, lines, words))
    return markdown(blocks)


WORLD_ROWS = {
    "observer": "exact observer, truth",
    "observer-detected": "exact observer, detected",
    "mechanism": "mechanism network, pictures",
    "count": "counting",
    "lookup": "lookup",
    "pc": "PC",
    "granger": "Granger",
    "persistence": "persistence",
}
"""Rows of the table of worlds, in its order."""


def worlds() -> str:
    """For every world and row: parents at both levels, mechanisms, predictions and calibration."""
    lines = []
    for world, parts in result("worlds")["rows"].items():
        rows = {**parts["rows"], **parts.get("discovery", {}), **parts.get("learned", {})}
        for name, words in WORLD_ROWS.items():
            if name in rows:
                row = rows[name]
                middle = row["object"]["22"]
                found = " / ".join(_whole(middle[key]) for key in ("p", "r"))
                sure = f"{_whole(row['ece_uncertain'])} ({row['uncertain_pairs']})" if row["uncertain_pairs"] else "-"
                f1 = [_over_actions(row[level]) if level in row else "-" for level in ("object", "link")]
                asked = [_whole(row.get(key)) for key in ("mechanism_accuracy", "pred_a")]
                lines.append((f"{world}: {words}", [str(row["boards"]), f1[0], found, f1[1], *asked, sure]))
    heads = ("boards", "F1, objects", "P / R at 22", "F1, links", "mechanism", "Pred-A", "ECE (pairs)")
    return markdown([plain_grid(heads, lines, "percent after 10 / 22 / 30")])


def _over_actions(told: dict[str, Any]) -> str:
    """F1 after each number of actions, with the interval of the middle one."""
    low, high = told["22"]["interval"]
    first, middle, last = (_whole(one["f1"]) for one in told.values())
    return f"{first} / {middle} ({_whole(low)}-{_whole(high)}) / {last}"


def _whole(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f}"


PLANNERS = ("mechanism", "search", "random", "noop", "oracle")
"""Agents of the table of planning in worlds, in its order."""


def world_plans() -> str:
    """For every world and agent: success, tasks that were solved, and steps over the shortest plan."""
    lines = []
    for world, told in result("world-plans")["rows"].items():
        for name in PLANNERS:
            row = told["agents"][name]
            low, high = row["micro_intervals"]["objects"]
            lowest, highest = row["solved_interval"]
            over = row["steps_over_shortest"]
            cells = [
                str(told["tasks"]),
                _whole(row["success"]),
                f"{_whole(row['micro'])} ({_whole(low)}-{_whole(high)})",
                f"{_whole(row['solved'])} ({_whole(lowest)}-{_whole(highest)})",
                "-" if over is None else f"{over:.2f}",
            ]
            lines.append((f"{world}: {name}", cells))
    heads = ("tasks", "success", "responders pooled", "tasks solved", "steps over shortest")
    return markdown([plain_grid(heads, lines, "percent")])


def kitchens() -> str:
    """F1 of relations in a kitchen and a room, by way of acting, beside rows that look at no effect."""
    lines, blind = [], ("nearest", "random", "all pairs")
    for name, told in result("kitchens")["rows"].items():
        rows = told["rows"]
        cells = [f"{told['objects'][0]}-{told['objects'][1]}", f"{_whole(told['success'])}, {_whole(told['controls'])}"]
        for reasoner in ("event", "mechanism", "count"):
            found = rows[reasoner]
            worst = min(found["60"]["seeds"])
            cells.append(" / ".join([_percent(found["30"]["f1"]), _percent(found["60"]["f1"]), _percent(worst)]))
        lines.append((name, [*cells, " / ".join(_percent(rows[one]["60"]["f1"]) for one in blind)]))
    seen = "F1 after 30 / 60 actions / worst seed"
    heads = (
        "objects",
        "actions that moved, controls moved",
        *(f"`{one}`: {seen}" for one in ("event", "mechanism", "count")),
    )
    return markdown([plain_grid((*heads, "nearest / random / all pairs"), lines, "scene, way of acting; percent")])


def exploring() -> str:
    """What the exact observer knows of links after random, coverage-first and greedy choice."""
    lines = []
    for world, parts in result("worlds")["rows"].items():
        if "exploring" in parts:
            told = parts["exploring"].values()
            lines.append((world, [" / ".join(_after(one["link"], "f1").values()) for one in told]))
    return markdown([plain_grid(("random", "coverage first", "greedy"), lines, "F1 of links after 10 / 22 / 30")])


def curiosity() -> str:
    """After how many actions relations are known, by way of choosing them."""
    lines = []
    for part, name in (("drawn", "curiosity"), ("recorded", "curiosity-recorded")):
        for world, parts in result(name)["rows"].items():
            for choice, told in parts[part].items():
                most, (low, high) = len(told["f1"]), told["until_interval"]
                until = [f"over {most}" if one > most else f"{one:.0f}" for one in (told["until"], low, high)]
                shares = " / ".join(f"{100 * told['f1'][after - 1]:.0f}" for after in (10, 22, 30))
                stops = told.get("stops")
                knows = f"{stops['boards']} ({stops['wrong']})" if stops else "-"
                entries = [str(told["boards"]), f"{until[0]} ({until[1]} to {until[2]})", shares, knows]
                lines.append((f"{world}, {part}: {choice}", entries))
    heads = ("boards", "actions until 95", "F1 after 10 / 22 / 30", "knows (wrong)")
    regrets = [
        (world, [f"{100 * parts['greedy'][choice]['regret']:.1f}" for choice in ("random", "coverage", "curious")])
        for world, parts in result("curiosity")["rows"].items()
    ]
    behind = plain_grid(("random", "coverage", "curious"), regrets, "regret, points of F1")
    return markdown([plain_grid(heads, lines, "percent"), behind])


VIEWS = {"looks": "looks", "picture": "picture", "places": "places", "order": "order", "actions": "actions"}


def shortcuts() -> str:
    """The area under the ROC curve of what sees no effect: which trigger of a responder, and below it which pair."""
    told, lines = result("shortcuts"), []
    for world, views in told["rows"].items():
        for words, key in (("which pair", "alike"), ("which trigger", "whom")):
            lines.append((f"{world}: {words}", [_area(views[view][key]) for view in VIEWS]))
    return markdown([plain_grid(tuple(VIEWS.values()), lines, "area, percent; chance is 50")])


def _area(one: dict[str, Any]) -> str:
    low, high = one["interval"]
    return f"{_percent(one['area'])} ({_percent(low)}-{_percent(high)})"


def _after(told: dict[str, Any], key: str = "") -> dict[str, str]:
    """Shares in whole percent by number of actions."""
    shares = {actions: (one[key] if key else one)["share"] for actions, one in told.items()}
    return {actions: "-" if share is None else f"{100 * share:.0f}" for actions, share in shares.items()}


def decision_time() -> str:
    """Milliseconds of every agent: the mean, and what 95 % of its decisions stay below; the gate is for the mean."""
    told = result("decision_time")
    rows = [
        (row.words, _times([told["decisions"][row.name][kind] for kind in KINDS], told["gate_ms"]))
        for row in PLANNING.rows
        if row.name in told["decisions"]
    ]
    return markdown(
        [Grid((), ("1-1", "1-many"), tuple(rows), f"CPU-ms for each decision, at most {told['gate_ms']:g}")]
    )


def _times(timings: list[dict[str, Any]], gate: float) -> tuple[Entry, ...]:
    entries = []
    for timing in timings:
        mean = timing["cpu_ms"]
        if mean is None:
            entries.append(Entry("-"))
            continue
        model = mean - timing["cpu_ms_without_model"]
        small = f"(95 %: {timing['cpu_ms_p95']:.1f}; model {model:.1f})"
        entries.append(Entry(f"{mean:.1f}", small, "reached" if mean <= gate else "missed"))
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


def hostile() -> str:
    """Hostile files by class: how many were tried, how reading them ended, and how many led to something else."""
    classes: dict[str, list[dict[str, Any]]] = {}
    for kind in result("hostile")["kinds"].values():
        classes.setdefault(kind["class"], []).append(kind)
    ends = ("refused", "noticed", "same answer", "another answer")
    rows = []
    for name, kinds in classes.items():
        told = [sum(kind["results"].get(end, 0) for kind in kinds) for end in ends]
        counts = (sum(kind["cases"] for kind in kinds), *told, sum(len(kind["findings"]) for kind in kinds))
        rows.append((name, tuple(f"{count:,}" for count in counts)))
    return markdown([plain_grid(("tried", *ends, "failed"), rows, "class")])
