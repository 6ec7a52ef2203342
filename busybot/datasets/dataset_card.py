"""The card of a frozen dataset: a README with the front matter that Hugging Face reads."""

import json
import re

from busybot.datasets.manifest import Manifest
from busybot.episodes.schema import TABLES, public_columns
from busybot.objects.license import UNKNOWN

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
_SPDX = re.compile(r"^[A-Za-z0-9.+-]+$")
_TEXT = """
# {name}

{boards} boards of the split `{split}` and what happened on each of them: {steps} proposed actions of the policy
`{policy}`, recorded by busybot with images, depth, segmentation and the simulator's truth.

| | |
|---|---|
| episodes | {boards}, one per board{partial}{tasks} |
| schema version | {schema} |
| board hash | `{hashes.board}` |
| trace hash | `{hashes.trace}` |
| content hash | `{hashes.content}` |
| seeds | boards {board_seed}, policy {policy_seed} |
| generator | {generator} |
| recorded with | {versions} |
| renderer | {renderers} |
| objects | {objects} |

## Use it

    busybot dataset verify DATASET         every file against the manifest, every episode read back
    busybot view DATASET                   look at an episode
    busybot dataset regenerate DATASET --out DIR    make it again and compare

`boards/` holds a board per line of JSON, `episodes/` an MCAP file per board, `tables/` three Parquet tables:

    import pandas as pd
    steps = pd.read_parquet("tables/steps")

{columns}
All else in the tables is privileged: what no camera shows, or what the simulator alone knows exactly.
`manifest.json` lists every file with its SHA-256, the whole configuration, and every object with its hash and licence.
The files are read-only; before deleting or moving the folder, `chmod -R u+w` it.
"""


def card(manifest: Manifest) -> str:
    """The text of README.md; it follows from the manifest (without its files) alone."""
    versions = {json.dumps(origin.versions, sort_keys=True): origin.versions for origin in manifest.origins}
    renderers = [f"{o.renderer.get('device', 'unknown')}, shader {o.renderer.get('shader')}" for o in manifest.origins]
    partial = f"; {len(manifest.partial)} saved in part: {manifest.partial}" if manifest.partial else ""
    kind = manifest.generator.config.get("tasks")
    columns = [f"- `{name}`: learners may read {', '.join(public_columns(name))}." for name in TABLES]
    text = _TEXT.format(
        name=manifest.name,
        boards=manifest.boards,
        split=manifest.split,
        steps=manifest.steps,
        policy=manifest.collect.policy,
        partial=partial,
        tasks=f"; {kind} tasks, each with a goal image" if kind else "",
        schema=manifest.schema_version,
        hashes=manifest.hashes,
        board_seed=manifest.board_seed,
        policy_seed=manifest.policy_seed,
        generator=manifest.generator.version,
        versions="; ".join(", ".join(f"{k} {v}" for k, v in sorted(found.items())) for found in versions.values()),
        renderers="; ".join(dict.fromkeys(renderers)),
        objects=_objects(manifest),
        columns="\n".join(columns) + "\n",
    )
    return _front_matter(manifest) + text


def _objects(manifest: Manifest) -> str:
    licences = sorted({entry.licence for entry in manifest.assets.values()})
    carried = sum(entry.carried for entry in manifest.assets.values())
    place = f"{carried} in `objects/`" if carried else "not in this dataset"
    return f"{len(manifest.assets)}, {place}; licence: {'; '.join(licences) or 'unknown'}"


def _front_matter(manifest: Manifest) -> str:
    licences = {entry.licence for entry in manifest.assets.values()}
    only = next(iter(licences)) if len(licences) == 1 else UNKNOWN
    licence = only.lower() if only != UNKNOWN and _SPDX.match(only) else "other"
    size = next((name for limit, name in _SIZES if manifest.boards < limit), "n>1M")
    lines = ["---", f"pretty_name: {json.dumps(manifest.name)}"]
    lines += [f"license: {licence}", "task_categories:", "- robotics", "- reinforcement-learning", "tags:"]
    lines += [f"- {tag}" for tag in ("busybot", "manipulation", "causal-discovery", "simulation", "mcap")]
    lines += ["size_categories:", f"- {size}", "configs:"]
    for name in TABLES:
        lines += [f"- config_name: {name}", f"  data_files: tables/{name}/*.parquet"]
    return "\n".join([*lines, "---", ""])
