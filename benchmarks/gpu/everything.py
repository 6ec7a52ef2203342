"""All that a machine with a GPU is lent for, in one command of so many minutes.

    python -m benchmarks.gpu.everything --pack PACK PACK2 --interact paper --assets OBJECTS --minutes 30 --work WORK
        --out BACK

Every row of the packs is trained to its end, one after the other (`benchmarks.gpu.train`), then the named rows of the
interaction networks have what is left of the minutes, in equal parts (`benchmarks.gpu.interact`); named without a pack,
they have all. Out of minutes, or killed, the same command goes on in WORK: what has come to its end is left out. BACK
has a folder for each row, with weights, losses and timings, to be unpacked one by one (`benchmarks.gpu.unpack`).

What fails is told, and the others are trained all the same; the exit code is 1 then. So it is with interaction networks
that had too few minutes for their first epochs. For another pack, name another WORK and BACK. Nothing is imported here
but what `benchmarks.gpu.train` needs.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.gpu.formats import RUN, RunInfo, read_pack_info, read_run_info
from busybot.common.errors import BusybotError

INTERACTION = "interact-"
"""Before the names of interaction networks, which have rows of the same names."""
RESERVE, INTERACTION_RESERVE = 0.5, 2.5
"""Minutes of a training's share in which it starts and writes what travels; interaction networks end an epoch's work
first."""


def planned(options: argparse.Namespace) -> dict[str, list[str]]:
    """The command of each training, by its row, but for its minutes.

    Raises:
        BusybotError: two trainings have one name.
    """
    found: dict[str, list[str]] = {}
    graphs = [(row, pack) for pack in options.pack for row in sorted(read_pack_info(pack)[0].rows)]
    names = [row for row, _ in graphs] + [f"{INTERACTION}{row}" for row in options.interact]
    if twice := {name for name in names if names.count(name) > 1}:
        raise BusybotError(f"{', '.join(sorted(twice))}: trained twice", "name each pack, and each row, once")
    shared = ["--device", options.device, *(["--half"] if options.half else [])]
    for row, pack in graphs:
        exact = ["--inexact"] if options.inexact else []
        found[row] = ["benchmarks.gpu.train", "--this-call", "--pack", str(pack), "--row", row, *exact, *shared]
    for row in options.interact:
        config = ["--config", str(options.config)] if options.config else []
        schedule = config or ["--share", str(options.share), "--merge", str(options.merge)]
        asked = ["benchmarks.gpu.interact", "--assets", options.assets, "--row", row, *schedule, *shared]
        found[f"{INTERACTION}{row}"] = asked
    return found


def brought_back(folder: Path) -> RunInfo | None:
    """What is said of what a training left so far; its weights are looked at when they are unpacked."""
    return read_run_info(folder) if (folder / RUN).exists() else None


def trained(options: argparse.Namespace, end: float) -> Iterator[tuple[str, int | None]]:
    """Run what has not come to its end; yields each row and its exit code, None for one that got no minutes."""
    commands = planned(options)
    waiting = [name for name in commands if not _ended(options.out / name)]
    for place, name in enumerate(waiting):
        left = (end - time.monotonic()) / 60
        if name.startswith(INTERACTION):  # they come last, and none to its end
            minutes = left / (len(waiting) - place) - INTERACTION_RESERVE
        else:
            minutes = left - RESERVE
        if minutes <= 0:
            yield name, None
            continue
        places = ["--work", str(options.work / name), "--out", str(options.out / name)]
        done = subprocess.run([sys.executable, "-m", *commands[name], *places, "--minutes", f"{minutes:.3f}"])
        yield name, done.returncode


def _ended(folder: Path) -> bool:
    told = brought_back(folder)
    return told is not None and told.iterations == told.schedule


def main(words: Sequence[str] | None = None) -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--pack", type=Path, nargs="*", default=[], help="folders of benchmarks.gpu.pack")
    options.add_argument("--interact", nargs="*", default=[], help="rows of Table 1, for the interaction networks")
    options.add_argument("--assets", help="folder of objects, for these")
    options.add_argument("--minutes", type=float, default=30.0, help="of this call")
    options.add_argument("--work", type=Path, required=True, help="folder of the trainings; continued if it exists")
    options.add_argument("--out", type=Path, required=True, help="folder for what travels back")
    options.add_argument("--share", type=float, default=1.0, help="of the interaction networks' schedule")
    options.add_argument("--merge", type=int, default=1, help="epochs of theirs that become one")
    options.add_argument("--config", type=Path, help="YAML file with their parameters, in place of these two")
    options.add_argument("--half", action="store_true", help="round matrices to float16")
    options.add_argument("--inexact", action="store_true", help="do not ask a GPU to repeat exactly")
    options.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    arguments = options.parse_args(words)
    if arguments.interact and arguments.assets is None:
        options.error("--interact needs --assets")
    if not arguments.pack and not arguments.interact:
        options.error("name a --pack, or rows to --interact")
    failed = False
    for name, code in trained(arguments, time.monotonic() + 60 * arguments.minutes):
        failed |= bool(code)
        told = brought_back(arguments.out / name)
        done = f"{told.iterations} of {told.schedule} in {told.seconds / 60:.1f} minutes" if told else "nothing yet"
        words = "no minutes were left; " if code is None else ""
        print(f"{name}: {words}{done}{f'; exit code {code}' if code else ''}", flush=True)
    return int(failed)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except BusybotError as error:
        sys.exit(f"error: {error}")
