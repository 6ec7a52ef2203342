"""A dataset as Parquet tables with pictures in them, and the card that Hugging Face reads its configurations from.

`data/TABLE/part-00000.parquet`, tables as `frames.TABLES` has them, a row group per episode. `parquet` writes these
alone; `hf` the same with README.md, whose configuration `learner` is the table of what a robot has.
"""

import json
from pathlib import Path
from typing import Any

from busybot import __version__
from busybot.common.atomic_io import write_atomically
from busybot.common.text import markdown_code, markdown_text
from busybot.datasets.exporting.folder import Source, merge, write_table
from busybot.datasets.exporting.frames import IMAGE, PRIVILEGED, TABLES, episode_tables, table_names
from busybot.datasets.manifest import CARD_FILE


def write_episode(recording: Path, row: dict[str, Any], privileged: bool, folder: Path) -> None:
    """The tables of one recording, a file each."""
    for name, table in episode_tables(recording, row, privileged).items():
        write_table(folder / f"{name}.parquet", [table], folder)


def finish(folder: Path, source: Source) -> None:
    """The episodes put together."""
    names = table_names(source.privileged)
    merge(folder, source.rows, {f"{name}.parquet": f"data/{name}/part-{{number:05d}}.parquet" for name in names})


def finish_with_card(folder: Path, source: Source) -> None:
    """And README.md."""
    finish(folder, source)
    write_atomically(folder / CARD_FILE, card(source).encode(), folder)


_TEXT = """
# {name}

{episodes} recordings of toy boards with {steps} actions, each with the picture before and the picture after it: a robot
takes hold of one point and pulls in one of 18 directions; what is a switch, and what it switches, is to be found out.
Split {split}, {origin}, actions by the policy {policies}. Made by
`busybot dataset export DATASET --to hf`, busybot {version}.

    from datasets import load_dataset
    frames = load_dataset("FOLDER", "learner", split="train")
    frames[0]["rgb"]

{privileged}

| | |
|---|---|
| board hash | `{hashes.board}` |
| trace hash | `{hashes.trace}` |
| content hash of the recordings | `{hashes.content}` |

Depth is a 16-bit PNG: a value v >= 1 is `depth_offset` + v * `depth_scale` board units (table `episodes`), 0 is
nothing.

## Columns

{columns}
"""
_IMPORTED = "recorded elsewhere and imported"
_LEFT_OUT = "What only the simulator knows is left out: segmentation, relations, states of links and responders."
_INCLUDED = """Configurations whose names begin with `privileged` hold what only the simulator knows: segmentation,
relations, states of links and responders. Nothing that learns may read them; they are for judging."""


def card(source: Source) -> str:
    """The text of README.md."""
    front = ["---", f"pretty_name: {json.dumps(source.info.name)}", "task_categories:", "- robotics", "tags:"]
    front += ["- busybot", "- causal-discovery", "- image"]
    front += [f"license: {source.licence.lower()}"] if source.licence else []
    front += ["configs:"]
    for name in table_names(source.privileged):
        front += [f"- config_name: {config_name(name)}", f"  data_files: data/{name}/*.parquet"]
        front += ["  default: true"] if name == "frames" else []
    return "\n".join([*front, "---", ""]) + _TEXT.format(
        name=markdown_text(source.info.name),
        episodes=len(source.rows),
        steps=sum(row["steps"] for row in source.rows),
        split=markdown_code(source.info.split),
        origin=_IMPORTED if source.info.generator.imported else f"boards drawn with seed {source.info.seed}",
        policies=", ".join(sorted({markdown_code(row["policy"]) for row in source.rows})),
        version=__version__,
        privileged=_INCLUDED if source.privileged else _LEFT_OUT,
        hashes=source.hashes,
        columns="\n\n".join(_columns(name) for name in table_names(source.privileged)),
    )


def config_name(table: str) -> str:
    """Name of the configuration that shows a table."""
    return "learner" if table == "frames" else table


def _columns(table: str) -> str:
    rows = [
        f"| `{column.name}` | {'picture' if column.type == IMAGE else column.type} | {column.description} |"
        for column in TABLES[table]
    ]
    kept = ", for judging alone" if table.startswith(PRIVILEGED) else ""
    return f"### {config_name(table)}{kept}\n\n| column | type | meaning |\n|---|---|---|\n" + "\n".join(rows)
