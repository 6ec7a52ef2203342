"""Seconds and bytes until the first batch of a dataset in S3, by the size of the dataset.

    python -m benchmarks.speed.streaming --server .venv/bin/moto_server --out benchmarks/results/streaming.json

The server is moto's, on loopback; a relay before it counts all bytes that come back and holds every request up, as a
network would. The datasets are the tiny one's recordings, repeated. Each is opened in a process of its own; the clock
runs from the call of `load_dataset`, its packages imported, to the first batch of steps in random order.
"""

import argparse
import asyncio
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from benchmarks.reliability.s3 import BUCKET, CREDENTIALS, TINY, serving
from benchmarks.runner import finish, load_average, one_of, parser
from busybot.datasets.dataset import Dataset
from busybot.episodes.tables import episode_rows

BATCH = 32
CHILD = f"""
import json, sys, time
import s3fs
from torch.utils.data import DataLoader
import busybot, busybot.frames
began = time.monotonic()
data = busybot.load_dataset(sys.argv[1], {{"endpoint_url": sys.argv[2]}})
opened = time.monotonic() - began
frames = data.frames()
listed = time.monotonic() - began
batch = next(iter(DataLoader(frames, {BATCH}, sampler=frames.shuffled(seed=0))))
print(json.dumps({{"opened": opened, "tables": listed, "first_batch": time.monotonic() - began,
                   "frames": len(frames), "pictures": len(batch["rgb"])}}))
"""


class Relay:
    """Passes connections on to a server; `received` counts the bytes that it answered."""

    def __init__(self, port: int, delay: float):
        self.received, self.requests, self._port, self._delay = 0, 0, port, delay
        self._loop = asyncio.new_event_loop()
        started = asyncio.run_coroutine_threadsafe(asyncio.start_server(self._connected, "127.0.0.1", 0), self._loop)
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self.port: int = started.result().sockets[0].getsockname()[1]

    async def _connected(self, client: asyncio.StreamReader, answer: asyncio.StreamWriter) -> None:
        server, ask = await asyncio.open_connection("127.0.0.1", self._port)
        await asyncio.gather(self._pass(client, ask, True), self._pass(server, answer, False))

    async def _pass(self, source: asyncio.StreamReader, target: asyncio.StreamWriter, asked: bool) -> None:
        try:
            while data := await source.read(1 << 16):
                if asked:
                    self.requests += 1
                    await asyncio.sleep(self._delay)
                else:
                    self.received += len(data)
                target.write(data)
                await target.drain()
        except ConnectionError:
            pass
        target.close()


def repeated(folder: Path, episodes: int) -> int:
    """A dataset of the tiny one's recordings, again and again; returns its bytes."""
    tiny = Dataset.open(TINY)
    known, boards = len(tiny), tiny.boards()
    info = tiny.info.model_copy(update={"boards": episodes})
    made = Dataset.create(folder, info, (boards[i % known].model_copy(update={"index": i}) for i in range(episodes)))
    rows = [episode_rows(tiny.episode_path(i), i) for i in range(known)]
    for index in range(episodes):
        shutil.copyfile(tiny.episode_path(index % known), made.episode_path(index))
    made.write_tables({i: {name: _of(i, table) for name, table in rows[i % known].items()} for i in range(episodes)})
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _of(index: int, rows: pa.Table) -> pa.Table:
    """The same rows as those of another episode."""
    place = rows.schema.get_field_index("episode")
    return rows.set_column(
        place, rows.schema.field(place), pa.array([index] * rows.num_rows, rows.schema.field(place).type)
    )


def first_batch(folder: Path, address: str, delay: float) -> dict[str, Any]:
    """What it costs to get the first batch of the dataset `folder` from the server."""
    import s3fs

    port = int(address.rpartition(":")[2])
    s3fs.S3FileSystem(endpoint_url=address).put(str(folder), f"{BUCKET}/{folder.name}", recursive=True)
    relay = Relay(port, delay)
    command = [sys.executable, "-c", CHILD, f"s3://{BUCKET}/{folder.name}", f"http://127.0.0.1:{relay.port}"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    told = json.loads(done.stdout)
    seconds = {name: round(told.pop(name), 2) for name in ("opened", "tables", "first_batch")}
    return {"seconds": seconds, "bytes_received": relay.received, "requests": relay.requests, **told}


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--server", type=Path, required=True)
    options.add_argument("--episodes", type=int, nargs="+", default=[12, 120, 1200])
    options.add_argument("--delay", type=float, default=0.03, help="seconds that a request is held up")
    arguments = options.parse_args(words)
    os.environ |= CREDENTIALS
    load = load_average()
    with tempfile.TemporaryDirectory(prefix="busybot-streaming-") as scratch:
        rows = list(_rows(arguments, Path(scratch)))
    figures = {"batch": BATCH, "rows": rows, "load_before": load[0]}
    print(json.dumps(finish("streaming", arguments, figures), indent=1))


def _rows(arguments: argparse.Namespace, scratch: Path) -> Iterator[dict[str, Any]]:
    for episodes in arguments.episodes:
        folder = scratch / f"d{episodes}"
        size = repeated(folder, episodes)
        with serving(arguments.server) as address:
            yield {"episodes": episodes, "bytes": size, **first_batch(folder, address, arguments.delay)}
        shutil.rmtree(folder)


if __name__ == "__main__":
    one_of(main)
