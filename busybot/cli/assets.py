"""`busybot assets`: which objects there are, make procedural ones, check a folder of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from busybot.cli.common import JsonOption, SeedOption, print_json, say

if TYPE_CHECKING:
    from busybot.objects.library import Library

app = typer.Typer(add_completion=False, no_args_is_help=True, help="List, make and check objects.")


@app.command("list")
def list_objects(
    folder: Annotated[str, typer.Argument(metavar="[DIR]", help="`procedural`, or a library's folder.")] = "procedural",
    json: JsonOption = False,
) -> None:
    """Show a library: every object with its role, links, split and sampling weight."""
    from busybot.objects.library import find

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
    json: JsonOption = False,
) -> None:
    """Make procedural switches, lamps, doors and toys, as annotated folders. The same seed gives the same bytes."""
    from busybot.objects.library import Library
    from busybot.objects.procedural.build import make_library

    keys = make_library(out, seed)
    library = Library.load(out)
    if json:
        print_json({"folder": out, "seed": seed, "sha256": library.sha256, "objects": keys})
    else:
        say(f"{len(keys)} objects in {out} (seed {seed}, sha256 {library.sha256[:12]})")
        say(f"next: busybot assets list {out}; busybot generate OUT --assets {out}")


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A library, or one object's folder.")],
    json: JsonOption = False,
) -> None:
    """Say what is wrong with each object. Exits with 1 if any is bad."""
    from busybot.objects.check import check_objects

    findings = check_objects(folder)
    bad = [finding for finding in findings if not finding.ok]
    if json:
        print_json({"ok": not bad, "checked": len(findings), "problems": bad})
    else:
        for finding in bad:
            print(f"{finding.name}: {finding.problem} (mend: {finding.mend or 'see the documentation'})")
        print(f"{folder}: {len(findings)} checked, {f'{len(bad)} bad' if bad else 'nothing is wrong'}")
    if bad:
        raise typer.Exit(1)


@app.command()
def sheet(
    folder: Annotated[str, typer.Argument(metavar="[DIR]", help="`procedural`, or a library's folder.")] = "procedural",
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Picture to write: PNG, JPEG or WebP.")] = Path(
        "sheet.png"
    ),
    cell: Annotated[int, typer.Option(min=48, max=600, help="Side of a portrait, pixels.")] = 150,
    columns: Annotated[int, typer.Option(min=2, max=40, help="Portraits in a row.")] = 12,
    json: JsonOption = False,
) -> None:
    """Draw a contact sheet: a portrait of every object, by category and split."""
    from busybot.objects.library import find
    from busybot.view.sheet import sheet as draw

    count = draw(out, find(folder), cell, columns)
    if json:
        print_json({"sheet": out, "objects": count})
    else:
        say(f"{count} objects in {out}")


def _rows(library: "Library") -> list[dict[str, Any]]:
    from busybot.objects.catalogue import kinds

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

    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{library.name}: {len(rows)} objects", title_justify="left")
    for name in ("object", "role", "links", "kinds", "split", "weight"):
        table.add_column(name, justify="right" if name in ("links", "weight") else "left", no_wrap=name == "object")
    for row in rows:
        counted = Counter(kind.removesuffix("-stage") for kind in row["kinds"])
        described = ", ".join(f"{count} x {kind}" if count > 1 else kind for kind, count in counted.items())
        links = str(len(row["links"]) or "-")
        table.add_row(row["key"], row["role"], links, described, ", ".join(row["split"]), f"{row['weight']:g}")
    Console().print(table)
    say(f"{library.folder}, sha256 {library.sha256[:12]}")
