"""`busybot dataset`: look at a dataset, check, mend, freeze, compare, make again, export, import, share it."""

import math
import re
from itertools import zip_longest
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from busybot.cli.common import (
    answer,
    check_file,
    counted,
    episode_progress,
    kept_in,
    print_json,
    processes,
    say,
    tell,
    warn,
)
from busybot.cli.dataset import printing
from busybot.cli.options import AssetsOption, DeviceOption, JsonOption, WorkersOption
from busybot.common.errors import BusybotError, UsageError
from busybot.common.text import one_line

if TYPE_CHECKING:
    from busybot.datasets.dvc_remote import Shared

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Look at a dataset, check, mend, freeze, compare, export, import, share it.",
)

DatasetArgument = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of the dataset.", show_default=False)]
RemoteOption = Annotated[
    str,
    typer.Option(help="A folder, or an address for DVC: s3://bucket/path, ssh://host/path.", envvar="BUSYBOT_REMOTE"),
]
EndpointOption = Annotated[str | None, typer.Option(help="Of S3-compatible storage that is not Amazon's.")]


@app.command()
def info(
    dataset: Annotated[
        str,
        typer.Argument(metavar="DATASET", help="Folder of the dataset, or its address, s3://BUCKET/FOLDER."),
    ],
    json: JsonOption = False,
) -> None:
    """What is in a dataset, with the hashes over its boards, traces and content.

    At an address the tables are read, the recordings are only listed, and there are no hashes. Options of its file
    system come from fsspec's configuration, as FSSPEC_S3_ENDPOINT_URL.
    """
    from busybot.common.remote import place_of
    from busybot.datasets.summary import summarise

    place = place_of(dataset)
    summary = summarise(place)
    if json:
        print_json(summary)
    else:
        printing.summary(place, summary)


@app.command()
def verify(
    dataset: DatasetArgument,
    assets: Annotated[str | None, typer.Option(help="Compare these objects with the recorded hashes.")] = None,
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Check structure, checksums and boards, tables against episodes, and of a frozen dataset all files.

    Objects are compared with the recorded hashes where they are found. Exits with 1 if something is wrong.
    """
    from busybot.datasets.dataset import Dataset
    from busybot.datasets.verify import verify as verify_dataset

    with episode_progress("verifying") as progress:
        report = verify_dataset(dataset, processes(workers), progress, assets)
    for problem, following in zip_longest(report.problems, report.problems[1:]):
        hint = "" if following and following.hint == problem.hint else f"\n  hint: {one_line(problem.hint)}"
        warn(one_line(f"{problem.file}: {problem.what}") + hint)  # what one thing mends is told together
    if json:
        print_json({"ok": report.ok, **vars(report)})
    else:
        verdict = "nothing is wrong" if report.ok else counted(len(report.problems), "problem")
        manifest = "all files against the manifest, " if report.frozen else ""
        objects = "objects not found" if report.objects is None else counted(report.objects, "object")
        if Dataset.open(dataset).info.generator.imported:
            objects = "imported, so without models of objects"
        have = f"episodes for {report.episodes} of {counted(report.boards, 'board')}"
        tell(f"{dataset}: {counted(report.episodes, 'episode')} checked, {manifest}{objects}: {verdict}; {have}")
    if not report.ok:
        raise typer.Exit(1)


@app.command()
def tiny(
    out: Annotated[Path, typer.Option(help="New folder.")] = Path("datasets/tiny"),
    json: JsonOption = False,
) -> None:
    """Get the frozen dataset of 12 boards that comes with busybot, which tests, notebooks and examples use."""
    from busybot.datasets.freeze import copy_tiny

    count = copy_tiny(out)
    if json:
        print_json({"out": out, "files": count})
        return
    tell(f"{out}: {counted(count, 'file')}; next: busybot view {quote(str(out))}")


@app.command()
def freeze(
    dataset: DatasetArgument,
    objects: Annotated[bool, typer.Option(help="Put copies of the objects in, if their licences allow it.")] = True,
    licence: Annotated[str | None, typer.Option(help="Of objects that you made: an SPDX identifier.")] = None,
    assets: AssetsOption = None,
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Give a finished dataset a manifest and a card, and make it read-only. Nothing is collected into it any more."""
    from busybot.datasets.bundled_assets import check_licence, library_of
    from busybot.datasets.dataset import Dataset
    from busybot.datasets.freeze import freeze as freeze_dataset
    from busybot.datasets.freeze import refuse_unfinished
    from busybot.datasets.manifest import is_frozen
    from busybot.objects.license import UNKNOWN

    check_licence(licence)
    target, library = Dataset.open(dataset), None
    if (assets or (objects and target.info.assets.sha256)) and not is_frozen(dataset):
        refuse_unfinished(target)
        try:
            library = library_of(target, assets)
        except BusybotError as error:
            otherwise = "--no-objects freezes without them" if objects else "leave --assets out"
            raise BusybotError(error.what, f"{error.hint}; or {otherwise}") from None
    with episode_progress("verifying") as progress:
        done = freeze_dataset(dataset, library, objects, licence, processes(workers), progress)
    carried = sum(entry.carried for entry in done.manifest.assets.values())
    if json:
        facts = {"dataset": dataset, "new": done.new, "files": len(done.manifest.files), "objects_carried": carried}
        facts["bytes"] = sum(entry.bytes for entry in done.manifest.files.values())
        print_json({**facts, "left_out": done.left_out, "hashes": done.manifest.hashes})
        return
    for reason in done.left_out:
        mend = "; for objects that you made freeze a copy with --licence, as --licence MIT" if reason == UNKNOWN else ""
        say(f"the objects are not put in; licence: {reason}{mend}")
    state = "is frozen" if done.new else "was frozen already"
    tell(f"{dataset} {state}: {counted(len(done.manifest.files), 'file')}, {counted(carried, 'object')} among them")


@app.command()
def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A dataset.", show_default=False)],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another.", show_default=False)],
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Say what differs: settings, boards, actions, states, images, versions. Exits with 1 if anything does."""
    from busybot.datasets.diff import diff as compare

    with episode_progress("comparing") as progress:
        found = compare(first, second, processes(workers), progress)
    if json:
        print_json({"equal": found.equal, **vars(found)})
    else:
        printing.difference(first, second, found)
    if not found.equal:
        raise typer.Exit(1)


@app.command()
def repair(
    dataset: DatasetArgument,
    out: Annotated[
        Path | None, typer.Option(help="Write the repaired dataset here; leave the damaged one alone.")
    ] = None,
    partial: Annotated[bool, typer.Option(help="Keep episodes that can be saved in part only.")] = True,
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Save what can be saved of damaged episodes and make the tables again; originals are kept in `damaged`.

    With `--no-partial` an episode that cannot be saved entirely is dropped, and `busybot collect` records it again.
    """
    from busybot.datasets.repair import repair as repair_dataset

    with episode_progress("looking") as progress:
        done = repair_dataset(dataset, out, partial, processes(workers), progress)
    if json:
        print_json(done)
    else:
        printing.repaired(done)


@app.command()
def regenerate(
    dataset: DatasetArgument,
    out: Annotated[Path, typer.Option(help="Folder for the dataset that is made again.", show_default=False)],
    assets: AssetsOption = None,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Make the boards again, execute the recorded actions again, and compare. Exits with 1 if it does not hold.

    Boards and discrete states must be equal, joints within 1e-5, images equal under the same renderer, else at most
    0.1 % of their pixels beyond 2/255.
    """
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.sim.regenerate import regenerate as make_again

    library = library_of(Dataset.open(dataset), assets)
    with episode_progress("replaying") as progress:
        found = make_again(dataset, out, library, processes(workers), progress)
    if json:
        print_json({"ok": found.ok, **vars(found)})
    else:
        printing.regenerated(found)
    if not found.ok:
        raise typer.Exit(1)


@app.command()
def export(
    dataset: DatasetArgument,
    out: Annotated[Path, typer.Option(help="Folder to make.", show_default=False)],
    to: Annotated[
        Literal["causal", "lerobot", "hf", "parquet", "croissant", "images"],
        typer.Option("--to", "--format", help="Format, see above."),
    ] = "causal",
    privileged: Annotated[
        bool, typer.Option("--privileged", help="Also what only the simulator knows, under names that say so.")
    ] = False,
    assets: AssetsOption = None,
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Write a dataset in another form, for people who use other tools. A call that was cut is repeated and goes on.

    `lerobot`: LeRobot 3.0, lossless pictures. `parquet`: tables with pictures in them; `hf`: with a card for Hugging
    Face; `croissant`: with a description in Croissant 1.1. `images`: JPEG, PNG and CSV. `causal`: states, interventions
    and the true graph as tables without pictures, all of it privileged.
    """
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.datasets.exporting.causal import export_causal
    from busybot.datasets.exporting.folder import unfinished_place
    from busybot.datasets.exporting.targets import export_recordings

    if assets is not None and to != "causal":
        raise UsageError(f"--to {to} tells what was recorded, for which no objects are needed", "leave --assets out")
    source = Dataset.open(dataset)
    with episode_progress("exporting") as progress:
        if to == "causal":
            tables = export_causal(source, library_of(source, assets), out, processes(workers), progress)
        else:
            with kept_in(unfinished_place(out)):
                done = export_recordings(source, to, out, privileged, processes(workers), progress)
    if to == "causal":
        rows = ", ".join(f"{count} rows of {name}" for name, count in tables.rows.items())
        answer(json, {"format": to, **vars(tables)}, f"{out}: {counted(tables.boards, 'board')}; {rows}")
    else:
        size = f"{counted(done.files, 'file')}, {done.bytes / 1e6:.1f} MB"
        answer(
            json,
            {"format": to, **vars(done)},
            f"{out}: {counted(done.episodes, 'episode')}, {done.frames} frames; {size}",
        )


@app.command("import")
def import_(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="Folder with pictures and tables.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the dataset; not needed for --dry-run.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be read, and write nothing.")] = False,
    boxes: Annotated[
        Literal["given", "proposed"],
        typer.Option(help="Propose boxes and roles from motion and depth where no objects.csv tells them."),
    ] = "given",
    fps: Annotated[
        float | None, typer.Option(min=0.001, help="Frames per second of a video without frames.csv.")
    ] = None,
    shift: Annotated[float, typer.Option(help="Seconds to add to the times of actions: another clock or zone.")] = 0.0,
    width: Annotated[int | None, typer.Option(min=16, help="Make wider pictures so wide, in pixels.")] = None,
    camera: Annotated[str | None, typer.Option(help="Of HDF5, MCAP or LeRobot with several.")] = None,
    tables: Annotated[
        Path | None, typer.Option(help="Folder with actions of a LeRobot dataset: DIR/000000/actions.csv and so on.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Make a dataset of recordings that nobody here simulated: a camera's folder, events of AI2-THOR, a LeRobot dataset
    or what `export` wrote as images, Parquet, Hugging Face or Croissant.

    A camera's folder has pictures or a video, and actions.csv (docs/guides/own-recordings.md). What it does not hold is
    missing in the dataset, too: states, often relations and depth.
    """
    from busybot.datasets.importing.camera_folder import ImportOptions
    from busybot.datasets.importing.sources import import_source

    if out is None and not dry_run:
        raise UsageError("where is the dataset to be?", "give --out DATASET, or --dry-run")
    options = ImportOptions(fps, shift, width, camera, tables, boxes == "proposed")
    with episode_progress("importing") as progress:
        done = import_source(source, None if dry_run else out, options, progress)
    facts = {"dataset": done.dataset and done.dataset.path, "kind": done.kind, "episodes": len(done.recordings)}
    if json:
        print_json({**facts, "recordings": done.recordings})
    else:
        printing.imported(done)


@app.command()
def calibrate(
    pictures: Annotated[Path, typer.Argument(metavar="PICTURES", help="Folder with pictures of a checkerboard.")],
    corners: Annotated[str, typer.Option(help="Inner corners, as 7x5: one less than squares, in a row and a column.")],
    side: Annotated[float, typer.Option(min=1e-6, max=1e6, help="Of a square, in any unit.")],
    width: Annotated[float, typer.Option(min=1e-6, max=1e6, help="Of your board, in the same unit.")],
    flat: Annotated[str, typer.Option(help="The picture in which it lies in the middle of the board.")],
    out: Annotated[Path, typer.Option(help="File to write: camera.json of a camera's folder.")],
    json: JsonOption = False,
) -> None:
    """Find the camera's matrix and pose from pictures of a checkerboard, for `dataset import`."""
    from busybot.common.atomic_io import refuse_taken, write_json
    from busybot.datasets.importing.checkerboard import Checkerboard, calibrate

    told = re.fullmatch("([0-9]{1,2})x([0-9]{1,2})", corners)
    columns, rows = map(int, told.groups()) if told else (0, 0)
    if min(columns, rows) < 3:
        what = f"--corners {corners[:40]!r} is no number of corners"
        raise UsageError(what, "give those of a row and a column, 3 to 99, as 7x5")
    if math.isnan(side + width):  # which no range of an option refuses
        raise UsageError("--side and --width are lengths", "give both in the same unit, as 2.5")
    check_file("--out", out, "camera.json")
    refuse_taken(out)
    found = calibrate(pictures, Checkerboard(columns, rows, side), flat, width)
    write_json(out, found["camera"])
    focal = found["camera"]["matrix"][0][0]
    line = f"{out}: from {found['pictures']} pictures, focal length {focal:.1f} pixels, error {found['error']} pixels"
    answer(json, {"out": out, **found}, line)


@app.command()
def push(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a frozen dataset.", show_default=False)],
    remote: RemoteOption,
    endpoint: EndpointOption = None,
    json: JsonOption = False,
) -> None:
    """Send a frozen dataset to shared storage; a pointer for version control, DATASET.dvc, is written beside it.

    Credentials come from the environment, as the storage's own tools read them (AWS_ACCESS_KEY_ID, ...).
    """
    from busybot.datasets.dvc_remote import push as run

    shared = run(dataset, remote, endpoint)
    answer(json, vars(shared), f"sent {dataset}{_size(shared)}", f"keep {shared.pointer} in version control")


@app.command()
def pull(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Its pointer, DATASET.dvc, lies beside it.")],
    remote: RemoteOption,
    endpoint: EndpointOption = None,
    json: JsonOption = False,
) -> None:
    """Fetch the dataset that a pointer means, and compare every file with its manifest. Ctrl-C loses nothing."""
    from busybot.datasets.dvc_remote import pull as run

    shared = run(dataset, remote, endpoint)
    done = f"fetched {dataset}" if shared.new else f"{dataset} is there and whole"
    answer(json, vars(shared), f"{done}{_size(shared)}")


def _size(shared: "Shared") -> str:
    return f": {shared.files} files, {shared.bytes / 1e6:.1f} MB"
