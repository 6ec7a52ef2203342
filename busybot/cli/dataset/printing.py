"""Prints the answers of `busybot dataset` for people."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from busybot.cli.common import console, counted, pixel_shares, say, tell
from busybot.common.text import one_line

if TYPE_CHECKING:
    from busybot.datasets.diff import DatasetDifference
    from busybot.datasets.importing.sources import Imported
    from busybot.datasets.repair import Repaired
    from busybot.episodes.episode_diff import Difference
    from busybot.sim.regenerate import Regenerated

MOST_LINES = 20


def summary(dataset: Path, values: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table(title=str(dataset), show_header=False, title_justify="left")
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for key, value in values.items():
        table.add_row(key.replace("_", " "), _readable(key, value))
    console().print(table)


def _readable(key: str, value: Any) -> str:
    if value is None:
        return "-"
    if key == "bytes":
        return f"{value:,} ({value / 1e6:.1f} MB)"
    if key == "links" and isinstance(value, list):
        return "-".join(map(str, value))
    if key.endswith("_share"):
        return f"{value:.1%}"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) and key != "seed" else str(value)


def difference(first: Path, second: Path, found: "DatasetDifference") -> None:
    if found.equal:
        tell(f"{first} and {second} are equal")
        return
    for name, (a, b) in found.settings.items():
        tell(one_line(f"setting {name}: {a!r}, then {b!r}"))
    for name, indices in found.versions.items():
        tell(one_line(f"{name} differs in {_episodes(indices)}"))
    for name in ("boards", "only_in_a", "only_in_b", "actions", "states", "joints", "rewards", "images"):
        indices = getattr(found, name)
        if indices:
            tell(f"{name.replace('_', ' ')}: {_episodes(indices)}")
    for index, one in list(found.episodes.items())[:MOST_LINES]:
        tell(one_line(f"episode {index}: {sentence(one)}"))
    if len(found.episodes) > MOST_LINES:
        tell(f"and {len(found.episodes) - MOST_LINES} more episodes; --json lists all")


def _episodes(indices: list[int]) -> str:
    shown = ", ".join(map(str, indices[:MOST_LINES]))
    return f"{len(indices)} ({shown}{', ...' if len(indices) > MOST_LINES else ''})"


def sentence(one: "Difference") -> str:
    parts = [] if one.board else ["another board"]
    parts += [] if one.scene else ["another camera or other links"]
    parts += [] if one.steps[0] == one.steps[1] else [f"{one.steps[0]} steps, then {one.steps[1]}"]
    for name in ("action", "state", "reward"):
        if getattr(one, name) is not None:
            parts.append(f"{name}s differ from step {getattr(one, name)}")
    parts += [f"joints by {one.joints:.1e}"] if one.joints else []
    if not one.image.equal:
        goal, shares = "" if one.goal else " and of the goal", pixel_shares(one.image)
        parts.append(f"pictures of {len(one.frames)} frames{goal}, at worst beyond the tolerance: {shares}")
    return "; ".join(parts) or "objects seen elsewhere"


def repaired(done: "Repaired") -> None:
    from busybot.datasets.dataset import DAMAGED_FOLDER, Dataset

    for verdict in done.damaged:
        kept = {
            "whole": "saved entirely",
            "partial": f"{verdict.steps} of {verdict.of} steps saved",
            "dropped": "could not be kept",
            "there": "the other recording that is there stays",
        }[verdict.fate]
        tell(one_line(f"episode {verdict.episode}: {kept} ({verdict.why})"))
    if done.damaged:
        say(f"the damaged files are in {done.originals}")
    if (replaced := done.dataset / DAMAGED_FOLDER) != done.originals and replaced.is_dir():
        say(f"what was replaced in {done.dataset} is in {replaced}")
    partial = sum(verdict.fate == "partial" for verdict in done.damaged)
    if partial:
        say(f"shorter now: {counted(partial, 'episode')}; --no-partial drops them, and says how they come back")
    sound = counted(done.sound, "episode")
    if any(verdict.fate == "dropped" for verdict in done.damaged):
        from busybot.datasets.info import collect_command

        say(f"next: {collect_command(done.dataset, Dataset.open(done.dataset).info)}")
    tell(f"{done.dataset}: {sound} sound, {len(done.damaged)} damaged; the tables are up to date")


def imported(done: "Imported") -> None:
    """What was read of each recording, and what to do next."""
    for one in done.recordings[:MOST_LINES]:
        objects = (
            f"{counted(int(str(one['triggers'])), 'trigger')}, {counted(int(str(one['responders'])), 'responder')}"
        )
        parts = [
            f"{one['frames']} frames of {one['width']} x {one['height']}",
            counted(int(str(one["actions"])), "action"),
        ]
        parts += [objects, "relations told" if one["relations"] is not None else "relations unknown"]
        parts += [f"camera {one['camera']}"] if "camera" in one else []
        tell(one_line(f"{one['place']}: {', '.join(parts)}"))
    if len(done.recordings) > MOST_LINES:
        tell(f"and {len(done.recordings) - MOST_LINES} more recordings; --json lists all")
    if done.dataset is None:
        say("nothing was written; --out DATASET in place of --dry-run writes it")
        return
    place = quote(str(done.dataset.path))
    say(f"{done.dataset.path}: {counted(done.dataset.info.boards, 'episode')}, {_states(done.recordings)}")
    if any(not one["triggers"] or not one["responders"] or one.get("boxes") == 0 for one in done.recordings):
        say(f"next, because nothing is inferred without boxes: busybot annotate {place}")
    else:
        say(f"next: busybot eval reason {place}; busybot view {place}")


def _states(recordings: list[dict[str, object]]) -> str:
    """Of how many recordings states were read."""
    told = sum(bool(one.get("states")) for one in recordings)
    if not told:
        return "without states"
    return "with states" if told == len(recordings) else f"{told} of them with states"


def regenerated(found: "Regenerated") -> None:
    """What was replayed, which rules applied and whether they held."""
    if found.boards_from == "configuration":
        tell(f"boards: {found.boards - len(found.boards_unlike)} of {found.boards} made again and equal")
    else:
        tell(f"boards: another version of the generator drew the {found.boards} boards; they could not be made again")
    total, worst = sum(found.episodes.values()), found.image
    there = total - found.replayed
    others = f"; {there} lay in {found.out}, recorded by today's versions and renderer: another --out replays all"
    tell(f"replayed now: {counted(found.replayed, 'episode')}{others if there else ''}")
    rules = {"equal": "equal, same renderer", "close": "at most 0.1 % of pixels beyond 2/255, another renderer"}
    for rule, count in found.episodes.items():
        if count:
            tell(f"images: the rule for {counted(count, 'episode')} is: {rules[rule]}")
    for index, one in list(found.failed.items())[:MOST_LINES]:
        tell(one_line(f"episode {index}: {sentence(one)}"))
    tell(f"joints: within {found.joints:.1e}; pictures: at worst {worst.colour:.3%} of the pixels beyond 2/255")
    tell(f"{total - len(found.failed)} of {total} episodes hold: {'as recorded' if found.ok else 'NOT as recorded'}")
