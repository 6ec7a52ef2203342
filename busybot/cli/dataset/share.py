"""`busybot dataset push` and `pull`: frozen datasets to shared storage and back."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busybot.cli.common import JsonOption, print_json, say

if TYPE_CHECKING:
    from busybot.datasets.dvc_remote import Shared

RemoteOption = Annotated[
    str,
    typer.Option(help="A folder, or an address for DVC: s3://bucket/path, ssh://host/path.", envvar="BUSYBOT_REMOTE"),
]
EndpointOption = Annotated[str | None, typer.Option(help="Of S3-compatible storage that is not Amazon's.")]


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
    _tell(shared, json, f"sent {dataset}", f"keep {shared.pointer} in version control")


def pull(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Its pointer, DATASET.dvc, lies beside it.")],
    remote: RemoteOption,
    endpoint: EndpointOption = None,
    json: JsonOption = False,
) -> None:
    """Fetch the dataset that a pointer means, and compare every file with its manifest. Ctrl-C loses nothing."""
    from busybot.datasets.dvc_remote import pull as run

    shared = run(dataset, remote, endpoint)
    _tell(shared, json, f"fetched {dataset}" if shared.new else f"{dataset} is there and whole", "")


def _tell(shared: "Shared", json: bool, what: str, after: str) -> None:
    if json:
        print_json(vars(shared))
        return
    say(f"{what}: {shared.files} files, {shared.bytes / 1e6:.1f} MB")
    if after:
        say(after)
