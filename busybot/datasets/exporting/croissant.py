"""A dataset as Parquet tables with their description in Croissant 1.1: what each column is, where all comes from.

The tables are those of `hugging_face`; `croissant.json` beside them has a SHA-256 per file, the responsible-AI part
that large venues ask for, and the provenance. Who publishes adds what nobody else knows: `url`, `creator`,
`datePublished`, and `license` unless the dataset is frozen with one licence for all of its objects.
"""

from pathlib import Path
from typing import Any

import pyarrow as pa

from busybot import __version__
from busybot.common.atomic_io import scan, sha256_of, write_json
from busybot.datasets.exporting import hugging_face
from busybot.datasets.exporting.folder import Source
from busybot.datasets.exporting.frames import IMAGE, PRIVILEGED, TABLES, table_names
from busybot.episodes.schema import Column

CROISSANT_FILE = "croissant.json"
MIME = "application/x-parquet"
"""Of Parquet files, as mlcroissant knows it."""

_OWN = (
    "citeAs column conformsTo containedIn equivalentProperty extract field fileObject fileProperty fileSet format"
    " includes isArray arrayShape isLiveDataset jsonPath key md5 parentField path recordSet references regex repeated"
    " replace samplingRate separator source subField transform"
)
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "prov": "http://www.w3.org/ns/prov#",
    "dct": "http://purl.org/dc/terms/",
    "sc": "https://schema.org/",
    **{name: f"cr:{name}" for name in _OWN.split()},
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
}


def finish(folder: Path, source: Source) -> None:
    """The tables put together, and their description."""
    hugging_face.finish(folder, source)
    write_json(folder / CROISSANT_FILE, description(folder, source), folder)


def description(folder: Path, source: Source) -> dict[str, Any]:
    """The JSON-LD of the tables in a folder."""
    names = table_names(source.privileged)
    steps = sum(row["steps"] for row in source.rows)
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": source.info.name,
        "description": f"{len(source.rows)} recordings of toy boards with {steps} actions: the picture before and after"
        " each, what was done and what changed.",
        "version": "1.0.0",
        **({"license": f"https://spdx.org/licenses/{source.licence}"} if source.licence else {}),
        "keywords": [
            "causal discovery",
            "robotics",
            "interaction",
            *([] if source.info.generator.imported else ["simulation"]),
        ],
        "isLiveDataset": False,
        **_responsible(source),
        **_provenance(source),
        "distribution": [part for name in names for part in _distribution(folder, name)],
        "recordSet": [_record_set(name) for name in names],
    }


def _responsible(source: Source) -> dict[str, Any]:
    """Of imported recordings less: who is in the pictures, who annotated what, and whether anything was drawn by a
    computer, whoever recorded them has to add."""
    imported, policies = source.info.generator.imported, ", ".join(sorted({str(row["policy"]) for row in source.rows}))
    drawn = (
        []
        if imported
        else ["Objects, their places and the relations are drawn from a generator's distributions, not from homes."]
    )
    who, where = ("Somebody or something", ", elsewhere, and imported") if imported else ("A simulated agent", "")
    return {
        "rai:dataCollection": f"{who} took hold of one point of a board an action and pulled; pictures were taken"
        f" before and after{where}. Actions were chosen by {policies}.",
        "rai:dataBiases": [*drawn, "Which links are moved how often depends on the policy that collected."],
        "rai:dataUseCases": ["Learning to interact with articulated objects, and to infer which one controls which."],
        "rai:dataSocialImpact": "None is expected; a robot that learned from it must not be relied on for safety.",
        **({"rai:dataCollectionType": ["Others"]} if imported else _simulated(source)),
    }


def _simulated(source: Source) -> dict[str, Any]:
    truth = (
        "a recording's own truth, in tables whose names begin with `privileged`" if source.privileged else "left out"
    )
    return {
        "rai:dataCollectionType": ["Software Collection", "Experiments"],
        "rai:dataLimitations": [
            "Pictures are rendered; what is learned from them is not known to hold for photographs.",
            "Boards stand still but for the object that is moved and those that it switches.",
        ],
        "rai:personalSensitiveInformation": ["None: nobody is in it, no text was written by a user."],
        "rai:dataAnnotationProtocol": [f"No human annotated anything; what the simulator knows is {truth}."],
        "rai:hasSyntheticData": True,
    }


def _provenance(source: Source) -> dict[str, Any]:
    info, collect = source.info, source.info.collect
    how = (
        f"policy {collect.policy}, {collect.steps} actions a board, seed {collect.seed}" if collect else "not recorded"
    )
    made = [f"boards drawn by generator {info.generator.version}", f"recorded in simulation: {how}"]
    if source.info.generator.imported:
        made = ["recorded elsewhere", "imported by busybot"]
    return {
        "prov:wasDerivedFrom": {
            "@id": f"urn:busybot:content:{source.hashes.content}",
            "prov:label": f"recordings of the dataset {info.name}, split {info.split}, seed {info.seed}",
        },
        "prov:wasGeneratedBy": [
            {"@type": "prov:Activity", "prov:label": label} for label in (*made, f"exported by busybot {__version__}")
        ],
        "prov:wasAttributedTo": {"@type": "prov:SoftwareAgent", "prov:label": f"busybot {__version__}"},
    }


def _distribution(folder: Path, table: str) -> list[dict[str, Any]]:
    """The files of a table, each with its hash, and the set of them, which records are read from."""
    found = {f"data/{table}/{name}": size for name, size in scan(folder / "data" / table).files.items()}
    files: list[dict[str, Any]] = [
        {
            "@type": "cr:FileObject",
            "@id": name,
            "name": name,
            "contentUrl": name,
            "contentSize": f"{size} B",
            "encodingFormat": MIME,
            "sha256": sha256_of(folder / name),
        }
        for name, size in found.items()
    ]
    whole = {"@type": "cr:FileSet", "@id": f"{table}-files", "name": f"{table}-files", "encodingFormat": MIME}
    return [*files, {**whole, "includes": f"data/{table}/*.parquet"}]


def _record_set(table: str) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": table,
        "name": table,
        "description": "for judging alone: only the simulator knows it" if table.startswith(PRIVILEGED) else "for all",
        "key": [{"@id": f"{table}/{column.name}"} for column in TABLES[table] if column.name in _KEYS],
        "field": [_field(table, column) for column in TABLES[table]],
    }


_KEYS = ("episode", "frame", "object")


def _field(table: str, column: Column) -> dict[str, Any]:
    kind = column.type
    field: dict[str, Any] = {
        "@type": "cr:Field",
        "@id": f"{table}/{column.name}",
        "name": f"{table}/{column.name}",
        "description": column.description + (f" ({column.unit})" if column.unit else ""),
        "dataType": _data_type(kind.value_type if pa.types.is_list(kind) else kind),
        "source": {"fileSet": {"@id": f"{table}-files"}, "extract": {"column": column.name}},
    }
    if pa.types.is_list(kind):
        field |= {"isArray": True, "arrayShape": "-1"}
    if kind == IMAGE:
        field["source"]["transform"] = {"jsonPath": "bytes"}
    return field


def _data_type(kind: pa.DataType) -> str:
    if kind == IMAGE:
        return "sc:ImageObject"
    if pa.types.is_boolean(kind):
        return "sc:Boolean"
    if pa.types.is_integer(kind):
        return f"cr:Int{kind.bit_width}"
    return f"cr:Float{kind.bit_width}" if pa.types.is_floating(kind) else "sc:Text"
