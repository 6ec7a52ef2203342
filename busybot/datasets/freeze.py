"""Freezing: a finished dataset gets a manifest and a card, and becomes read-only.

The card is a README with the front matter that Hugging Face reads. Everything is written before the manifest, and the
manifest appears whole or not at all: a dataset that was being frozen when the process was killed is either not frozen,
or frozen and perhaps not yet read-only. Freezing it again continues.
"""

import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from busybot import __version__
from busybot.common.atomic_io import (
    LOCK_FILE,
    copy_file,
    forbid_writing,
    make_folder,
    read_regular,
    refuse_taken,
    remove,
    remove_abandoned,
    rename,
    scan,
    unfinished,
    write_atomically,
    write_json,
)
from busybot.common.errors import BusybotError
from busybot.common.installed import installed_version
from busybot.common.limits import MAX_JSON_BYTES
from busybot.common.text import markdown_code, markdown_text
from busybot.datasets.bundled_assets import Assets, check_licence, plan_assets, write_carried
from busybot.datasets.dataset import DAMAGED_FOLDER, HASHED, INFO_FILE, OBJECTS_FOLDER, Dataset
from busybot.datasets.info import collect_command
from busybot.datasets.manifest import (
    CARD_FILE,
    MANIFEST_FILE,
    Manifest,
    Origin,
    file_entries,
    is_frozen,
    plain_files,
    read_manifest,
)
from busybot.datasets.verify import is_partial, verify
from busybot.episodes.schema import TABLES, public_columns
from busybot.objects.library import Library

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
_TEXT = """
# {name}

{manifest.boards} boards of the split {split} and what happened on each of them: \
{manifest.steps} proposed actions of the policy
{policy}, recorded by busybot with images, depth, segmentation and the simulator's truth.

| | |
|---|---|
| episodes | {manifest.boards}, one per board{partial}{tasks} |
| schema version | {manifest.schema_version} |
| board hash | `{manifest.hashes.board}` |
| trace hash | `{manifest.hashes.trace}` |
| content hash | `{manifest.hashes.content}` |
| seeds | boards {manifest.board_seed}, policy {manifest.policy_seed} |
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


_IMPORTED_TEXT = {
    ", recorded by busybot with images, depth, segmentation and the simulator's truth.": ", recorded elsewhere and"
    " imported by busybot: pictures, actions and what else somebody told.",
    "    busybot dataset regenerate DATASET --out DIR    make it again and compare\n": "",
}
"""What is said otherwise of recordings that nobody simulated."""


def card(manifest: Manifest) -> str:
    """The text of README.md; it follows from the manifest (without its files) alone."""
    versions = {json.dumps(origin.versions, sort_keys=True): origin.versions for origin in manifest.origins}
    renderers = [f"{o.renderer.get('device', 'unknown')}, shader {o.renderer.get('shader')}" for o in manifest.origins]
    partial = f"; {len(manifest.partial)} saved in part: {manifest.partial}" if manifest.partial else ""
    kind = manifest.generator.config.get("tasks")
    columns = [f"- `{name}`: learners may read {', '.join(public_columns(name))}." for name in TABLES]
    text = _TEXT.format(
        manifest=manifest,
        name=markdown_text(manifest.name),
        split=markdown_code(manifest.split),
        policy=markdown_code(manifest.collect.policy),
        generator=markdown_text(manifest.generator.version),
        partial=partial,
        tasks=f"; {markdown_text(str(kind))} tasks, each with a goal image" if kind else "",
        versions=markdown_text(
            "; ".join(", ".join(f"{k} {v}" for k, v in sorted(found.items())) for found in versions.values())
        ),
        renderers=markdown_text("; ".join(dict.fromkeys(renderers))),
        objects=_objects(manifest),
        columns="\n".join(columns) + "\n",
    )
    if manifest.generator.imported:
        for simulated, imported in _IMPORTED_TEXT.items():
            text = text.replace(simulated, imported)
    return _front_matter(manifest) + text


def _objects(manifest: Manifest) -> str:
    licences = sorted({entry.licence for entry in manifest.assets.values()})
    carried = sum(entry.carried for entry in manifest.assets.values())
    place = f"{carried} in `objects/`" if carried else "not in this dataset"
    return f"{len(manifest.assets)}, {place}; licence: {markdown_text('; '.join(licences)) or 'unknown'}"


def _front_matter(manifest: Manifest) -> str:
    licence = manifest.licence.lower() if manifest.licence else "other"
    size = next((name for limit, name in _SIZES if manifest.boards < limit), "n>1M")
    lines = ["---", f"pretty_name: {json.dumps(manifest.name)}"]
    lines += [f"license: {licence}", "task_categories:", "- robotics", "- reinforcement-learning", "tags:"]
    made = () if manifest.generator.imported else ("simulation",)
    lines += [f"- {tag}" for tag in ("busybot", "manipulation", "causal-discovery", *made, "mcap")]
    lines += ["size_categories:", f"- {size}", "configs:"]
    for name in TABLES:
        lines += [f"- config_name: {name}", f"  data_files: tables/{name}/*.parquet"]
    return "\n".join([*lines, "---", ""])


_TOLD = ("steps", "renderer", "versions", "settings")
FREEZING_PACKAGES = ("pyarrow", "mcap", "opencv-python")


@dataclass(frozen=True)
class Frozen:
    """What freezing did.

    Attributes:
        left_out: licences because of which the objects are not carried.
        new: False if the dataset was frozen already.
    """

    manifest: Manifest
    left_out: tuple[str, ...] = ()
    new: bool = True


def freeze(
    path: Path,
    library: Library | None,
    carry: bool = True,
    licence: str | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Frozen:
    """Freeze a dataset; of a frozen one only the read-only marks are made complete.

    Args:
        library: with the dataset's objects; None if they are not at hand.
        carry: put copies of the objects into the dataset, if all their licences allow it.
        licence: of objects that the user made, an SPDX identifier.
        progress: of the verification: episodes done and all.

    Raises:
        BusybotError: episodes are missing, something is wrong with the dataset or does not belong to it, a link is in
            it, or another process writes into it; or a manifest cannot tell the licence.
    """
    check_licence(licence)
    dataset = Dataset.open(path)
    if is_frozen(path):
        manifest = read_manifest(path)
        _finish(path)
        return Frozen(manifest, new=False)
    with dataset.locked():
        refuse_unfinished(dataset)
        dataset.remove_leftovers()
        assets = plan_assets(dataset, library, carry, licence)
        _refuse_strangers(dataset, assets)
        dataset.write_tables()
        write_carried(path, assets)
        report = verify(path, workers, progress)
        if not report.ok:
            first = report.problems[0]
            what = f"{path}: {len(report.problems)} problems, first {first.file}: {first.what}"
            place = shlex.quote(str(path))
            raise BusybotError(what, f"`busybot dataset repair {place}`, then `busybot dataset verify {place}`")
        manifest = _write_manifest(dataset, assets, workers)
        _finish(path)
    return Frozen(manifest, assets.left_out)


def refuse_unfinished(dataset: Dataset) -> None:
    """A dataset can be frozen when every board has an episode."""
    done, boards = len(dataset.finished()), dataset.info.boards
    if done < boards or dataset.info.collect is None or not boards:
        what = f"{dataset.path}: the dataset is not finished: {done} of {boards} boards have an episode"
        raise BusybotError(what, collect_command(dataset.path, dataset.info))


def _refuse_strangers(dataset: Dataset, assets: Assets) -> None:
    found = plain_files(dataset.path)
    known = {INFO_FILE, LOCK_FILE, CARD_FILE, *assets.files}
    folders = ("boards", "episodes", *(f"tables/{name}" for name in TABLES))  # `verify` looks at the names in these
    strangers = [name for name in found if name not in known and name.rpartition("/")[0] not in folders]
    strangers += [name for name in found if name.rpartition("/")[2].startswith(".") and name not in known]
    if not strangers:
        return
    first = strangers[0].split("/")[0]
    hint = {
        DAMAGED_FOLDER: "move the folder `damaged`, which `repair` left, out of the dataset",
        OBJECTS_FOLDER: "remove the folder `objects`; freezing makes it again if the licences allow it",
    }.get(first, "move what does not belong to the dataset out of it")
    raise BusybotError(f"{dataset.path / strangers[0]}: not part of a dataset, {len(strangers)} such files", hint)


def _write_manifest(dataset: Dataset, assets: Assets, workers: int) -> Manifest:
    path, info = dataset.path, dataset.info
    assert info.collect is not None
    table = dataset.episodes_table(columns=[*HASHED, *_TOLD])
    alike = table.group_by(["renderer", "versions"], use_threads=False).aggregate([([], "count_all")]).to_pylist()
    saved = [settings for settings in table["settings"].unique().to_pylist() if is_partial(settings)]
    manifest = Manifest(
        schema_version=info.schema_version,
        name=info.name,
        split=info.split,
        boards=info.boards,
        steps=sum(table["steps"].to_pylist()),
        hashes=dataset.hashes(table),
        board_seed=info.seed,
        policy_seed=info.collect.seed,
        generator=info.generator,
        collect=info.collect,
        origins=[
            Origin(renderer=json.loads(o["renderer"]), versions=json.loads(o["versions"]), episodes=o["count_all"])
            for o in sorted(alike, key=lambda origin: -origin["count_all"])
        ],
        partial=table.filter(pc.is_in(table["settings"], pa.array(saved, pa.string())))["episode"].to_pylist(),
        boards_again=assets.boards_again,
        assets=assets.entries,
        frozen_with={"busybot": __version__, **{name: installed_version(name) for name in FREEZING_PACKAGES}},
        files={},
    )
    _write_card(path, card(manifest))
    names = [name for name in plain_files(path) if name != LOCK_FILE]
    manifest = manifest.model_copy(update={"files": file_entries(path, names, workers)})
    write_json(path / MANIFEST_FILE, manifest.model_dump(mode="json"))
    return manifest


def _write_card(path: Path, text: str) -> None:
    file = path / CARD_FILE
    data = text.encode()
    if file.exists() and read_regular(file, MAX_JSON_BYTES) != data:
        raise BusybotError(f"{file}: it is there and not the card that freezing writes", "move or remove it")
    write_atomically(file, data)


def _finish(path: Path) -> None:
    """Remove the lock, which a frozen dataset needs no more, and take away all write permissions, the folder's last."""
    remove(path / LOCK_FILE)
    files = [path / name for name in plain_files(path)]
    folders = sorted({parent for file in files for parent in file.parents if parent.is_relative_to(path)})
    for place in [*files, *reversed(folders)]:
        forbid_writing(place, path)


def copy_tiny(out: Path) -> int:
    """Copy the frozen dataset that comes with the package to a new folder; returns the number of its files.

    Raises:
        BusybotError: something is there, or the package came without it.
    """
    here = Path(__file__).parent
    places = [here / "tiny", here.parents[1] / "datasets/tiny"]  # of a wheel, of a checkout
    source = next((place for place in places if (place / INFO_FILE).is_file()), None)
    if source is None:
        raise BusybotError(f"{places[0]}: this package came without it", "install busybot from a wheel or a checkout")
    refuse_taken(out)
    make_folder(out.parent)
    remove_abandoned(out.parent, out.name)
    names = scan(source).files
    with unfinished(out.parent, out.name) as partial:
        for name in names:
            copy_file(source / name, partial / name)
        rename(partial, out)
    return len(names)
