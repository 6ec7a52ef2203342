"""`busybot assets`: which objects there are; make procedural ones, fetch and import real ones, check a folder."""

import os
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from busybot.cli.common import answer, check_file, console, counted, episode_progress, print_json, say, tell
from busybot.cli.options import DeviceOption, JsonOption, SeedOption
from busybot.common.errors import BusybotError
from busybot.common.text import one_line

if TYPE_CHECKING:
    from busybot.objects.importing.annotation_edits import Overrides
    from busybot.objects.importing.importer import ImportOutcome
    from busybot.objects.library import Library

app = typer.Typer(add_completion=False, no_args_is_help=True, help="List, make and check objects.")

LibraryArgument = Annotated[str, typer.Argument(metavar="[DIR]", help="`procedural`, or a library's folder.")]


@app.command("list")
def list_objects(folder: LibraryArgument = "procedural", json: JsonOption = False) -> None:
    """Show a library: every object with its role, links, split and sampling weight."""
    from busybot.objects.resolve import find

    library = find(folder)
    rows = _rows(library)
    if json:
        print_json({"name": library.name, "folder": library.folder, "sha256": library.sha256, "objects": rows})
    else:
        _print_table(library, rows)


@app.command()
def make(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; it must not exist or be empty.")],
    seed: SeedOption = 0,
    drawn: Annotated[
        int, typer.Option(min=0, max=999, help="So many novel switches whose shapes the seed draws, in place of ours.")
    ] = 0,
    json: JsonOption = False,
) -> None:
    """Make procedural switches, lamps, doors and toys, as annotated folders. The same seed gives the same bytes."""
    from busybot.objects.procedural.build import make_library
    from busybot.objects.resolve import load_and_remember

    keys = make_library(out, seed, drawn)
    library = load_and_remember(out)
    answer(
        json,
        {"folder": out, "seed": seed, "sha256": library.sha256, "objects": keys},
        f"{counted(len(keys), 'object')} in {out} (seed {seed}, sha256 {library.sha256[:12]})",
        _next("list", out),
    )


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A library, one object's folder, or raw objects.")],
    json: JsonOption = False,
) -> None:
    """Say what is wrong with each object, what its import doubted, and which are raw.

    Exits with 1 if any is bad or raw.
    """
    from busybot.objects.partnet.check import check_objects

    findings = check_objects(folder)
    bad = [finding for finding in findings if not finding.ok]
    asked = [finding for finding in findings if finding.question]
    checked = len({finding.name for finding in findings})
    if json:
        print_json({"ok": not bad, "checked": checked, "problems": bad, "questions": asked})
    else:
        for finding in asked:
            tell(one_line(f"{finding.name}: question: {finding.question} (hint: {finding.hint})"))
        for finding in bad:
            tell(one_line(f"{finding.name}: {finding.problem} (hint: {finding.hint or 'see the documentation'})"))
        names = len({finding.name for finding in bad})
        doubts = f", {counted(len(asked), 'question')}" if asked else ""
        tell(f"{folder}: {checked} checked, {f'{names} bad' if bad else 'nothing is wrong'}{doubts}")
    if bad:
        raise typer.Exit(1)


@app.command("import")
def import_raw(
    raw: Annotated[list[Path], typer.Argument(metavar="RAW...", help="Raw objects' folders, or folders of them.")],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="The library; made if it is absent.")] = None,
    review: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the annotation as YAML to edit.")] = None,
    overrides: Annotated[Path | None, typer.Option(metavar="FILE", help="YAML that a person has reviewed.")] = None,
    split: Annotated[
        Literal["train", "novel"] | None, typer.Option(help="By default the paper's for its objects, train for others.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace objects that the library has otherwise.")] = False,
    json: JsonOption = False,
) -> None:
    """Annotate raw PartNet-Mobility objects by rules and overrides, and put them into a library.

    Without --out nothing is imported: --review alone shows what the rules propose. Exits with 1 if any is refused.
    """
    from busybot.objects.importing.annotation_edits import read_overrides, write_review
    from busybot.objects.importing.importer import import_objects, raw_folders

    if out is None and review is None:
        raise typer.BadParameter("nothing to do: give --out DIR, --review FILE or both", param_hint="--out")
    if review is not None and review.exists():
        raise BusybotError(f"{review}: exists, perhaps with somebody's changes", "name another file for the proposal")
    check_file("--review", review, "review.yaml")
    given = read_overrides(overrides) if overrides else None
    folders = raw_folders(raw)
    outcomes = []
    for outcome in import_objects(folders, out, given, split, replace):
        done = f"{outcome.name}: {outcome.done}{f' as {outcome.key}' if outcome.key else ''}{_refusal(outcome)}"
        say("\n  ".join(map(one_line, (done, *outcome.notes, *(f"question: {one}" for one in outcome.questions)))))
        outcomes.append(outcome)
    if review is not None:
        proposals = {one.name: (one.choices, one.notes, one.questions) for one in outcomes if one.choices}
        write_review(review, proposals, {outcome.name: outcome.problem for outcome in outcomes if outcome.problem})
    refused = any(outcome.problem for outcome in outcomes)
    facts = {"folder": out, "review": review, "objects": outcomes, "unused": _unused(given, folders)}
    hints = []
    if out is not None and any(outcome.done in ("imported", "unchanged") for outcome in outcomes):
        hints.append(_next("check", out))
    elif out is None and any(outcome.choices for outcome in outcomes):
        again = " ".join(quote(str(path)) for path in raw)
        hints.append(
            f"next: edit {review}; busybot assets import {again} --overrides {quote(str(review))} --out LIBRARY"
        )
    answer(json, {"ok": not refused, **facts}, *hints)
    if refused:
        raise typer.Exit(1)


@app.command()
def merge(
    libraries: Annotated[list[str], typer.Argument(metavar="DIR...", help="Libraries' folders, or `procedural`.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to make; it must not exist or be empty.")],
    json: JsonOption = False,
) -> None:
    """Put the objects of several libraries into a new one; each keeps its split and weight."""
    from busybot.objects.merge import merge_libraries
    from busybot.objects.resolve import find, load_and_remember

    merge_libraries([find(name) for name in libraries], out)
    library = load_and_remember(out)
    answer(
        json,
        {"folder": out, "sha256": library.sha256, "objects": list(library.objects)},
        f"{counted(len(library.objects), 'object')} in {out} (sha256 {library.sha256[:12]})",
        _next("list", out),
    )


def _unused(given: "Overrides | None", folders: list[Path]) -> list[str]:
    """Names that were reviewed, but whose objects were not given; says so."""
    unused = sorted(set(given.choices) - {folder.name for folder in folders}) if given else []
    if unused and given:
        say(one_line(f"{given.path}: names objects that were not given: {', '.join(unused[:5])}"))
    return unused


@app.command()
def fetch(
    ids: Annotated[list[str], typer.Argument(metavar="ID...", help="PartNet-Mobility's numbers, for example 100366.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the raw objects.")],
    json: JsonOption = False,
) -> None:
    """Download raw PartNet-Mobility objects with your own access token, through SAPIEN's downloader.

    The token is read from the environment variable SAPIEN_ACCESS_TOKEN, or asked for. PartNet-Mobility's terms of use
    apply to what is downloaded.
    """
    from busybot.sim.partnet_download import fetch as fetch_object

    token = _token()
    fetched = []
    for instance in ids:
        new = fetch_object(instance, out, token)
        say(f"{instance}: {'downloaded' if new else 'is there already'}")
        fetched.append({"id": instance, "folder": out / instance, "new": new})
    answer(json, {"folder": out, "objects": fetched}, f"next: busybot assets import {quote(str(out))} --out LIBRARY")


def _token() -> str:
    """The user's token, from the environment or a hidden prompt."""
    token = os.environ.get("SAPIEN_ACCESS_TOKEN", "").strip()
    if not token and sys.stdin.isatty():
        token = typer.prompt("Access token of PartNet-Mobility", hide_input=True, err=True).strip()
    if not token.isprintable() or not token:
        raise BusybotError(
            "no access token for PartNet-Mobility",
            "get one at https://sapien.ucsd.edu and put it into the environment variable SAPIEN_ACCESS_TOKEN",
        )
    return token


def _refusal(outcome: "ImportOutcome") -> str:
    if not outcome.problem:
        return ""
    return f": {outcome.problem}{f' (hint: {outcome.hint})' if outcome.hint else ''}"


@app.command()
def sheet(
    folder: LibraryArgument = "procedural",
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Picture to write: PNG, JPEG or WebP.")] = Path(
        "sheet.png"
    ),
    cell: Annotated[int, typer.Option(min=48, max=600, help="Side of a portrait, pixels.")] = 150,
    columns: Annotated[int, typer.Option(min=2, max=40, help="Portraits in a row.")] = 12,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Draw a contact sheet: a portrait of every object, by category and split."""
    from busybot.objects.resolve import find
    from busybot.view.figures.contact_sheet import sheet as draw

    check_file("--out", out, "sheet.png")
    with episode_progress("drawing") as progress:
        count = draw(out, find(folder), cell, columns, progress)
    answer(json, {"sheet": out, "objects": count}, f"{counted(count, 'object')} in {out}")


def _next(command: str, out: Path) -> str:
    """What to do with a library that is made."""
    place = quote(str(out))
    return f"next: busybot assets {command} {place}; busybot generate OUT --assets {place}"


def _rows(library: "Library") -> list[dict[str, Any]]:
    from busybot.objects.model import kinds

    rows = []
    for key, model in library.objects.items():
        weights = {split: entries[key] for split, entries in library.splits.items() if key in entries}
        rows.append(
            {
                "key": key,
                "category": model.category,
                "role": model.role,
                "links": [link.name for link in model.trigger_links],
                "kinds": list(kinds(model)),
                "split": list(weights),
                "weight": max(weights.values(), default=0.0),
                "sha256": model.sha256,
            }
        )
    return rows


def _print_table(library: "Library", rows: list[dict[str, Any]]) -> None:
    from collections import Counter

    from rich.table import Table

    table = Table(title=f"{library.name}: {len(rows)} objects", title_justify="left")
    for name in ("object", "role", "links", "kinds", "split", "weight"):
        table.add_column(name, justify="right" if name in ("links", "weight") else "left", no_wrap=name == "object")
    for row in rows:
        counted = Counter(kind.removesuffix("-stage") for kind in row["kinds"])
        described = ", ".join(f"{count} x {kind}" if count > 1 else kind for kind, count in counted.items())
        links = str(len(row["links"]) or "-")
        table.add_row(row["key"], row["role"], links, described, ", ".join(row["split"]), f"{row['weight']:g}")
    console().print(table)
    say(f"{library.folder}, sha256 {library.sha256[:12]}")
