"""`busybot annotate DATASET`: boxes and roles of imported recordings, drawn by hand in a page on this machine."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from busybot.cli.common import print_json, say, tell
from busybot.cli.options import JsonOption
from busybot.common.errors import BusybotError


def annotate(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset that was imported.")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="To listen on; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the usual browser.")] = False,
    json: JsonOption = False,
) -> None:
    """Draw boxes around the objects of imported recordings, and set their roles, until Done or Ctrl-C.

    The page is on this machine only; the address has a token without which nothing is shown or changed.
    """
    from busybot.datasets.dataset import Dataset
    from busybot.view.annotate import AnnotationServer

    found = Dataset.open(dataset)
    if not found.finished():
        raise BusybotError(f"{dataset}: it has no recordings", "`busybot dataset import` makes some")
    with AnnotationServer(found, port) as server:
        if json:
            print_json({"url": server.url})
        else:
            tell(server.url)
            say("open this address in a browser on this machine; Done in the page, or Ctrl-C, ends it")
        if browser:
            webbrowser.open(server.url)
        server.serve_forever()
