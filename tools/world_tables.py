"""Tables of worlds, scenes and cameras beyond the paper's, from committed results."""

from typing import Any

from benchmarks.studies.disturbances import DISTURBANCES
from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.view.figures.curves import BASELINES, strength_words
from busybot.view.report.page import Items, Text, markdown, plain_grid
from tools.tables import RESULTS, exact, percent, result, whole

SELDOM = 0.05
SET_OBJECTS = ("procedural", "partnet-mobility")


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
        share = percent(one["for_nothing"] / one["still"] if one["still"] else None)
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


def robustness() -> str:
    """Edge-P / Edge-R, and Pred-A behind a comma of those that predict; "-" for who does not see a disturbance."""
    told = result("reason_robustness")
    trained = list(told["models"])
    columns = [*trained, *BASELINES]
    lines = []
    for name, rows in told["rows"].items():
        for row in rows:
            cells = [_scores(row["models"].get(column)) for column in columns]
            lines.append((_disturbance(told, name, row), [*cells, percent(row["known"])]))
    heads = [f"`{name}`" if name in trained else name for name in columns]
    done = [
        (DISTURBANCES[name].title, told["disturbances"][name]["what"]) for name in told["rows"] if name in DISTURBANCES
    ]
    what = Items(tuple(f"*{title}*: {words}." for title, words in done))
    return markdown([plain_grid((*heads, "known"), lines, "percent"), what])


def real_board() -> str:
    """Precision and recall on the twin of the real board: the hardest camera, then the others."""
    best = sorted(result("real_board")["rows"].items(), key=lambda row: -(row[1]["hardest"]["p"] or 0))
    told, lines = dict(best), []
    for row, cameras in told.items():
        hard, cells = cameras["hardest"], []
        for name in ("p", "r"):
            if hard[name] is None:
                cells.append("-")
                continue
            low, high = (whole(share) for share in hard[f"{name}_interval"])
            least = f", least {percent(hard[f'{name}_least'])}" if len(hard["seeds"]) > 1 else ""
            cells.append(f"{percent(hard[name])} ({low}-{high}{least})")
        lines.append((row, [*cells, str(hard["true"])]))
    alone = list(dict.fromkeys(camera for cameras in told.values() for camera in cameras if camera != "hardest"))
    rows = []
    for camera in alone:
        found = [cameras.get(camera) for cameras in told.values()]
        cells = [f"{percent(one['p'])} / {percent(one['r'])}" if one else "-" for one in found]
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
    told = f"{percent(scores['edge_p'])} / {percent(scores['edge_r'])}"
    return told if scores["pred_a"] is None else f"{told}, {percent(scores['pred_a'])}"


def bounds_symbolic() -> str:
    """Of symbolic boards, the share of responders whose parents, and whose mechanism, is known after some actions."""
    rows = {
        (links, choice): row
        for links, told in result("bounds")["rows"]["table"].items()
        for choice, row in told.items()
    }
    blocks = []
    for measure in ("parents", "mechanism"):
        cells = {name: _after(row[measure], row["boards"]) for name, row in rows.items()}
        lines = [(f"{links}, {choice}", list(told.values())) for (links, choice), told in cells.items()]
        blocks.append(plain_grid(tuple(next(iter(cells.values()))), lines, f"{measure}: links, choice"))
    return markdown(blocks)


def orientation() -> str:
    """What the exact observer knows of gates, told which state of a link is on and not told."""
    rows, words = result("orientation")["rows"], {"told": "told the states", "untold": "not told which is on"}
    lines = []
    for name, told in rows.items():
        cells = []
        for one in (*told["link_parent_f1"].values(), told["mechanism"]):
            low, high = one["interval"]
            cells.append(f"{percent(one['share'])} ({whole(low)}-{whole(high)})")
        lines.append((words[name], cells))
    heads = [f"F1 of links after {action}" for action in rows["told"]["link_parent_f1"]]
    return markdown([plain_grid([*heads, "mechanisms after 21"], lines, "exact observer")])


def perception_costs() -> str:
    """What is seen wrongly in pictures, and F1 of links with and without that."""
    lines = []
    for name, told in result("perception-costs")["rows"].items():
        wrong, after = told["mistakes"], {way: list(one.values()) for way, one in told["ways"].items()}
        seen = " / ".join(percent(one["share"]) for one in after["seen"])
        cells = [
            str(told["boards"]),
            f"{wrong['links moved']} of {wrong['links']}",
            f"{percent(wrong['link states wrong'] / wrong['link states'])}, {wrong['links not seen']}, "
            f"{wrong['links that are none']}",
            f"{percent(wrong['responder states wrong'] / wrong['responder states'])}, "
            f"{wrong['responders not seen to']} of {wrong['responders changed']}",
            seen,
            *(_more(one[-1]) for way, one in after.items() if way != "seen"),
        ]
        lines.append((name.replace("-real", ", a real camera"), cells))
    heads = (
        "boards", "links moved", "of these, states wrong, not seen, and none",
        "responders: states wrong, not seen to change", "F1 of links after 10 / 22 / 30",
        "more with true links, after 30", "with true responders", "with both",
    )  # fmt: skip
    return markdown([plain_grid(heads, lines, "percent, or points")])


def _more(told: dict[str, Any]) -> str:
    low, high = told["ahead_interval"]
    return f"{100 * told['ahead']:+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"


def mechanisms() -> str:
    """Parents that the network finds on true states, beside the exact observer's."""
    rows = []
    for world, told in result("mechanisms")["rows"].items():
        cells = [f"{percent(one['network']['share'])} ({percent(one['bound']['share'])})" for one in told.values()]
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
                    told = _after(row[measure], row["boards"], "f1" if measure in ("link", "object") else "")
                    heads = tuple(told)
                    lines.append((f"{world}, {split}, {choice}", list(told.values())))
        blocks.append(plain_grid(heads, lines, words))
    return markdown(blocks)


WORLD_ROWS = {
    "observer": "exact observer, truth",
    "observer-detected": "exact observer, pictures",
    "mechanism": "network",
    "mechanism, world not told": "network, world not told",
    "mechanism from pictures alone": "from pictures alone",
    "mechanism from pictures alone, world not told": "from pictures alone, world not told",
    "event": "event",
    "count": "counting",
    "lookup": "lookup",
    "pc": "PC",
    "granger": "Granger",
    "persistence": "persistence",
}
"""Rows of the table of worlds, in its order."""


def worlds() -> str:
    """For every world and row: parents at both levels; mechanisms, predictions and calibration; each with how far it is
    from the network on the same boards."""
    parents, more = [], []
    for world, parts in result("worlds")["rows"].items():
        rows = {**parts["rows"], **parts["discovery"], **parts["learned"]}
        for name, words in WORLD_ROWS.items():
            row, ahead = rows[name], parts["compared"].get(name, {})
            f1 = [_over_actions(row[level]) if level in row else "-" for level in ("object", "link")]
            found = " / ".join(whole(row["object"]["22"][key]) for key in ("p", "r"))
            parents.append((f"{world}: {words}", [f1[0], _ahead(ahead, "object"), found, f1[1], _ahead(ahead, "link")]))
            if row["mechanism_accuracy"] is not None:
                named = [whole(row[f"{what}_accuracy"]) for what in ("mechanism", "kind", "lag")]
                asked = [whole(row.get(key)) for key in ("what_if", "pred_a")]
                sure = f"{whole(row['ece_uncertain'])} ({row['uncertain_pairs']})" if row["uncertain_pairs"] else "-"
                more.append((f"{world}: {words}", [named[0], _ahead(ahead, "mechanism"), *named[1:], *asked, sure]))
    to_network = "to the network"
    heads = ("F1, objects", to_network, "P / R at 22", "F1, links", to_network)
    asked_heads = ("mechanism", to_network, "kind", "lag", "what if", "Pred-A", "ECE (pairs)")
    return markdown(
        [plain_grid(heads, parents, "percent after 10 / 22 / 30"), plain_grid(asked_heads, more, "percent after 22")]
    )


def _ahead(told: dict[str, dict[str, Any]], level: str) -> str:
    """Points to the row that others are compared with; a star where chance alone seldom makes so many."""
    one = told.get(level)
    if one is None or one["difference"] is None:
        return ""
    points = round(100 * one["difference"])
    return f"{f'{points:+d}' if points else '0'}{'*' if one['p'] < SELDOM else ''}"


def rewirings() -> str:
    """Who notices that a mechanism was exchanged: the network and, in brackets, the exact observer."""
    lines = []
    for world, parts in result("worlds")["rows"].items():
        for name, row in parts.get("learned", {}).items():
            if row["rewired_false_alarms"] is None:  # of a model that does not say
                continue
            shares = [[row[f"rewired_{what}{who}"] for who in ("", "_bound")] for what in ("found", "placed")]
            told = [f"{whole(own)} ({whole(bound)})" for own, bound in shares]
            alarms = [row[f"rewired_false_alarms{who}"] for who in ("", "_bound")]
            of_board = ["-" if one is None else f"{one:.2f}" for one in alarms]
            words = f"{world}{name.removeprefix('mechanism')}"
            lines.append((words, [str(row["rewirings"]), *told, f"{of_board[0]} ({of_board[1]})"]))
    return markdown([plain_grid(("rewirings", "found", "placed", "false alarms a board"), lines, "percent")])


def _over_actions(told: dict[str, Any], key: str = "f1") -> str:
    """F1 after each number of actions, with the interval of the middle one."""
    low, high = told["22"]["interval"]
    first, middle, last = (whole(one[key]) for one in told.values())
    within = f" ({whole(low)}-{whole(high)})" if low < high else ""
    return f"{first} / {middle}{within} / {last}"


PLANNERS = ("mechanism", "search", "busybot", "predictive", "relation", "bc", "ppo", "random", "noop", "oracle")
"""Agents of the table of planning in worlds, in its order; some play in some worlds."""


def world_plans() -> str:
    """For every world and agent: success, tasks that were solved, and steps over the shortest plan."""
    lines = []
    for world, told in result("world-plans")["rows"].items():
        for name in (one for one in PLANNERS if one in told["agents"]):
            row = told["agents"][name]
            low, high = exact(row["micro"], row["micro_intervals"]["objects"], told["tasks"])
            lowest, highest = row["solved_interval"]
            over = row["steps_over_shortest"]
            cells = [
                str(told["tasks"]),
                whole(row["success"]),
                f"{whole(row['micro'])} ({whole(low)}-{whole(high)})",
                f"{whole(row['solved'])} ({whole(lowest)}-{whole(highest)})",
                "-" if over is None else f"{over:.2f}",
                _behind(told["compared"].get(name)),
            ]
            lines.append((f"{world}: {name}", cells))
    heads = (
        "tasks",
        "success",
        "responders pooled",
        "tasks solved",
        "steps over shortest",
        "success to `mechanism` (p)",
    )
    return markdown([plain_grid(heads, lines, "percent")])


def _behind(told: dict[str, Any] | None) -> str:
    """Points of success to the agent that all are compared with, and how probable so many are by chance."""
    return "" if told is None else f"{100 * told['difference']:+.1f} ({told['p_success']:.2g})"


def kitchens() -> str:
    """F1 of relations in a kitchen and a room, by way of acting, beside rows that look at no effect."""
    lines, blind = [], ("nearest", "random", "all pairs")
    for name, told in result("kitchens")["rows"].items():
        rows = told["rows"]
        cells = [f"{told['objects'][0]}-{told['objects'][1]}", f"{whole(told['success'])}, {whole(told['controls'])}"]
        for reasoner in ("event", "mechanism", "count"):
            found = rows[reasoner]
            worst = min(found["60"]["seeds"])
            cells.append(" / ".join([percent(found["30"]["f1"]), percent(found["60"]["f1"]), percent(worst)]))
        lines.append((name, [*cells, " / ".join(percent(rows[one]["60"]["f1"]) for one in blind)]))
    seen = "F1 after 30 / 60 actions / worst seed"
    heads = (
        "objects",
        "actions that moved, controls moved",
        *(f"`{one}`: {seen}" for one in ("event", "mechanism", "count")),
    )
    return markdown([plain_grid((*heads, "nearest / random / all pairs"), lines, "scene, way of acting; percent")])


def proposed_boxes() -> str:
    """Measures of relations with the true objects and with those that pictures propose, and how many of these exist."""
    heads = ("P", "R", "F1", "F1 of links", "mechanisms", "what if", "Pred-A")
    keys = ("parent_p", "parent_r", "parent_f1", "link_parent_f1", "mechanism_accuracy", "what_if", "pred_a")
    lines, found = [], []
    for world, reasoners in result("proposed-boxes")["rows"].items():
        for name, ways in reasoners.items():
            cells = [" / ".join(_measured(one, key) for one in ways.values()) for key in keys]
            lines.append((f"{world}: {name}", cells))
        told = next(iter(reasoners.values()))["proposed"]
        shares = ("proposal_r", "proposal_r_triggers", "proposal_r_responders", "proposal_p")
        found.append((world, [str(told["boards"]), *(percent(told[key]) for key in shares)]))
    objects = ("boards", "found", "triggers", "responders", "of the proposed are there")
    return markdown(
        [plain_grid(objects, found, "objects, percent"), plain_grid(heads, lines, "percent, given / proposed")]
    )


def _measured(one: dict[str, Any], key: str) -> str:
    """A share, with its interval over objects and their boards where the evaluation tells it."""
    within = one.get("object_intervals", {}).get(key)
    return percent(one[key]) + (f" [{whole(within[0])}-{whole(within[1])}]" if within and one[key] is not None else "")


def exploring() -> str:
    """What the exact observer knows of links after random, coverage-first and greedy choice."""
    lines = []
    for world, parts in result("worlds")["rows"].items():
        if "exploring" in parts:
            told = parts["exploring"].values()
            lines.append((world, [" / ".join(_after(one["link"], one["boards"], "f1").values()) for one in told]))
    return markdown([plain_grid(("random", "coverage first", "greedy"), lines, "F1 of links after 10 / 22 / 30")])


def patches() -> str:
    """How many candidates on small patches of one colour on triggers are links, by what a model believes of them as of
    any others: their number, the mean of several models, and the least and the most of these."""
    lines = []
    for found in zip(*(one["by_belief"] for one in result("patches")["models"].values()), strict=True):
        first, shares = found[0], [one["links"] / one["candidates"] for one in found if one["candidates"]]
        believed = [one["believed"] for one in found if one["candidates"]]
        count = round(sum(one["candidates"] for one in found) / len(found))
        cells = [str(count), *map(_from_to, (shares, believed))]
        lines.append((f"{100 * first['from']:g} to {100 * first['to']:g}", cells))
    return markdown([plain_grid(("candidates", "links", "believed as patches"), lines, "believed, percent")])


def _from_to(shares: list[float]) -> str:
    """Percent, the least and the most of some shares."""
    ends = dict.fromkeys((f"{100 * end:.1f}" for end in (min(shares), max(shares))) if shares else ("-",))
    return " to ".join(ends)


def curiosity() -> str:
    """After how many actions relations are known, by way of choosing them."""
    lines = []
    files = {"drawn": "curiosity", "recorded": "curiosity-recorded", "stopping": "curiosity-stops"}
    for part, name in files.items():
        for world, parts in result(name)["rows"].items():
            for choice, told in parts[part].items():
                most, (low, high) = len(told["f1"]), told["until_interval"]
                until = [f"over {most}" if one > most else f"{one:.0f}" for one in (told["until"], low, high)]
                least, greatest = map(whole, exact(told["f1"][21], told["f1_interval"][21], told["boards"]))
                shares = [whole(told["f1"][after - 1]) for after in (10, 22, 30)]
                shares[1] += f" ({least}-{greatest})"
                stops = told.get("stops")
                knows = f"{stops['boards']} ({stops['wrong']})" if stops else "-"
                times = f"{until[0]} ({until[1]} to {until[2]})"
                entries = [str(told["boards"]), times, " / ".join(shares), knows]
                lines.append((f"{world}, {part}: {choice}", entries))
    heads = ("boards", "actions until 95", "F1 after 10 / 22 / 30", "knows (wrong)")
    regrets = [
        (world, [f"{100 * parts['greedy'][choice]['regret']:.1f}" for choice in ("random", "coverage", "curious")])
        for world, parts in result("curiosity")["rows"].items()
    ]
    behind = plain_grid(("random", "coverage", "curious"), regrets, "regret, points of F1")
    return markdown([plain_grid(heads, lines, "percent"), behind])


ABLATIONS = {
    "labels": "{boards:,} recorded boards, true parents as labels: the whole",
    "labels 100": "{boards} boards",
    "labels 300": "{boards} boards",
    "labels 3000": "{boards:,} boards, of which {drawn:,} are drawn",
    "labels 3000 drawn": "{boards:,} drawn boards, none recorded",
    "labels links not seen": "without how links look: every action flips its link",
    "labels no past": "without time: explanations remember nothing",
    "labels no witnesses": "without pairs of moments in which one input alone differs",
    "labels any function": "without what an input must matter for",
    "labels world not told": "the world is never told",
    "pictures": "from pictures alone",
    "pictures 100": "from pictures alone, {boards} boards",
    "pictures 300": "from pictures alone, {boards} boards",
    "pictures nothing hidden": "from pictures alone, nothing of them hidden",
    "pictures 3000": "from pictures alone, {boards:,} boards, of which {drawn:,} are drawn",
    "pictures links masked": "from pictures alone, a link in seven hidden",
}
"""Rows of the ablations of the mechanism model, the whole first."""


def ablations() -> str:
    """F1 of links that the model finds where it learned from less, or does without something."""
    told, lines = result("mechanism-ablations"), []
    for name, words in ((name, words) for name, words in ABLATIONS.items() if name in told["rows"]):
        row = told["rows"][name]["worlds"]
        cells = [_over_actions(row[world], "share") for world in told["judged"]]
        everywhere = row["all"]["22"]
        ahead = _more(everywhere)
        boards = told["rows"][name]["boards"]
        named = words.format(boards=boards, drawn=boards - told["rows"]["labels"]["boards"])
        lines.append((named, [*cells, percent(everywhere["share"]), "" if name == "labels" else ahead]))
    heads = (*told["judged"], "all, after 22", "points to the whole (95 %)")
    return markdown([plain_grid(heads, lines, "F1 of links after 10 / 22 / 30")])


VIEWS = {"looks": "looks", "picture": "picture", "places": "places", "order": "order", "actions": "actions"}


def shortcuts() -> str:
    """The area under the ROC curve of what sees no effect: which pair is true, and below it which trigger moves one."""
    told, lines = result("shortcuts"), []
    for world, views in told["rows"].items():
        for words, key in (("which pair", "alike"), ("which trigger", "whom")):
            lines.append((f"{world}: {words}", [_area(views[view][key]) for view in VIEWS]))
    return markdown([plain_grid(tuple(VIEWS.values()), lines, "area, percent; chance is 50")])


def _area(one: dict[str, Any]) -> str:
    low, high = one["interval"]
    return f"{percent(one['area'])} ({percent(low)}-{percent(high)})"


def _after(told: dict[str, Any], boards: int, key: str = "") -> dict[str, str]:
    """Shares in whole percent with their intervals by number of actions; of all or none exactly, over the boards."""
    return {actions: _share_within(one[key] if key else one, boards) for actions, one in told.items()}


def _share_within(one: dict[str, Any], boards: int) -> str:
    if one["share"] is None:
        return "-"
    low, high = exact(one["share"], one["interval"], boards)
    return f"{whole(one['share'])} ({whole(low)}-{whole(high)})"
