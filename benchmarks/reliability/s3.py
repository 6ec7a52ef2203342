"""A frozen dataset to S3-compatible storage and back, against a server on this machine.

    python -m benchmarks.reliability.s3 --server .venv/bin/moto_server --out benchmarks/results/s3.json

The server is moto's (`make extras`); it listens on loopback and forgets everything. The tiny dataset is pushed, its
pointer carried elsewhere, pulled there, verified and compared; then once more without credentials, which has to fail
with a message (what a pull had begun stays in a hidden folder, to go on).
"""

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.runner import BUSYBOT, busybot, finish, one_of, parser

TINY = Path(__file__).parents[2] / "datasets" / "tiny"
BUCKET = "frozen"
CREDENTIALS = {"AWS_ACCESS_KEY_ID": "anyone", "AWS_SECRET_ACCESS_KEY": "anything", "AWS_DEFAULT_REGION": "us-east-1"}
START_SECONDS = 60


@contextmanager
def serving(server: Path) -> Iterator[str]:
    """A running server with an empty bucket; yields its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    command = [str(server), "-H", "127.0.0.1", "-p", str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            _make_bucket(address)
            yield address
        finally:
            process.terminate()


def _make_bucket(address: str) -> None:
    request = urllib.request.Request(f"{address}/{BUCKET}", method="PUT")
    until = time.monotonic() + START_SECONDS
    while True:
        try:
            urllib.request.urlopen(request, timeout=5)
            return
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.2)


def trial(server: Path, scratch: Path) -> dict[str, Any]:
    """Push, pull elsewhere, verify, compare."""
    here, there = scratch / "here", scratch / "there"
    here.mkdir()
    there.mkdir()
    shutil.copytree(TINY, here / "tiny")
    with serving(server) as address:
        to = ("--remote", f"s3://{BUCKET}/datasets", "--endpoint", address)
        os.environ |= CREDENTIALS
        pushed = busybot("dataset", "push", str(here / "tiny"), *to)
        shutil.copy(here / "tiny.dvc", there)
        pulled = busybot("dataset", "pull", str(there / "tiny"), *to)
        verified = busybot("dataset", "verify", str(there / "tiny"))
        differs = busybot("dataset", "diff", str(here / "tiny"), str(there / "tiny"))
        refused = _without_credentials(scratch, here / "tiny.dvc", to)
    return {
        "pushed": {key: pushed[key] for key in ("files", "bytes")},
        "pulled": {key: pulled[key] for key in ("files", "bytes")},
        "verified": verified["ok"],
        "equal": differs["equal"],
        "without_credentials": refused,
    }


def _without_credentials(scratch: Path, pointer: Path, to: tuple[str, ...]) -> dict[str, Any]:
    folder = scratch / "refused"
    folder.mkdir()
    shutil.copy(pointer, folder)
    # a profile that is not there: nothing of this machine's own credentials is found either
    kept = {name: value for name, value in os.environ.items() if name not in CREDENTIALS}
    environment = kept | {"AWS_SHARED_CREDENTIALS_FILE": os.devnull, "AWS_EC2_METADATA_DISABLED": "true"}
    command = [*BUSYBOT, "dataset", "pull", str(folder / "tiny"), *to]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    left = sorted(path.name for path in folder.iterdir())
    return {"exit": done.returncode, "traceback": "Traceback" in done.stderr, "left": left}


def main(words: list[str]) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--server", type=Path, required=True)
    arguments = options.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="busybot-s3-") as folder:
        result = trial(arguments.server, Path(folder))
    finish("s3", arguments, {"result": result})
    print(json.dumps(result, indent=1))
    refused = result["without_credentials"]
    well = result["verified"] and result["equal"] and refused["exit"] == 1 and not refused["traceback"]
    sys.exit(0 if well else 1)


if __name__ == "__main__":
    one_of(main)
