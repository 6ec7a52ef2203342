"""The reference of the dataset format, from the schema itself.

    python -m busybot.episodes.reference docs/dataset-format.md

Writes everything below the line that begins with `<!-- from here on`; a test compares.
"""

import sys
from pathlib import Path

from busybot.episodes import mcap_topics as topics
from busybot.episodes.protobuf import PACKAGE
from busybot.episodes.schema import SCHEMA_VERSION, STEP_FIELDS, TABLES, Column, StepField
from busybot.pages import renew, renewed

_VALUES = """\
Where each value is stored, which hash it enters, and what `dataset diff` calls a difference in it. What enters no hash
follows from other values. Floats are hashed and compared as the table stores them. One list (`schema.STEP_FIELDS`)
makes messages, reader, writer, table, hashes and comparison, and this page."""
MARK = "<!-- from here on made by `python -m busybot.episodes.reference`: change the schema, not this text -->"


def reference() -> str:
    """Tables, values of a step and channels as Markdown."""
    parts = [f"Version of the schema: {SCHEMA_VERSION}.", "## Tables"]
    for name, columns in TABLES.items():
        parts.append(f"### `tables/{name}`\n\n{_table(columns)}")
    parts.append(f"## Values of a step\n\n{_VALUES}\n\n{_values()}")
    parts.append(f"## Channels of an episode's MCAP file\n\n{_channels()}")
    return "\n\n".join(parts) + "\n"


def _table(columns: tuple[Column, ...]) -> str:
    lines = ["| column | type | unit, frame | meaning |", "|---|---|---|---|"]
    for column in columns:
        measure = ", ".join(filter(None, (column.unit, column.frame.split(":")[0])))
        told = "**privileged**: " if column.privileged else ""
        null = "; may be null" if column.nullable else ""
        lines.append(f"| `{column.name}` | {_type(column)} | {measure} | {told}{column.description}{null} |")
    return "\n".join(lines)


def _type(column: Column) -> str:
    return str(column.type).replace("list<element: ", "list of ").replace(">", "")


def _values() -> str:
    lines = ["| value | message, number and type | columns | hash | difference | since |", "|---|---|---|---|---|---|"]
    for field in STEP_FIELDS:
        columns = ", ".join(f"`{column.name}`" for column in field.columns)
        hashed = field.hashed.digest if field.hashed else ""
        compared = (field.compared or "") + (f", beyond {field.tolerance:g}" if field.tolerance else "")
        lines.append(f"| `{field.name}` | {_wire(field)} | {columns} | {hashed} | {compared} | {field.since} |")
    return "\n".join(lines)


def _wire(field: StepField) -> str:
    if field.wire is None:
        return ""
    several = len(field.wire_names) - 1
    numbers = f"{field.wire.number}-{field.wire.number + several}" if several else str(field.wire.number)
    repeated = "repeated " if field.shape and not field.wire.each else ""
    return f"`{'StepTruth' if field.privileged else 'Step'}` {numbers}, {repeated}{field.wire.type}"


def _channels() -> str:
    lines = ["| topic | message | |", "|---|---|---|"]
    for topic, schema in (topics.FOXGLOVE | topics.OWN).items():
        package = "foxglove" if topic in topics.FOXGLOVE else PACKAGE
        told = "privileged" if topic.startswith("/truth") else ""
        lines.append(f"| `{topic}` | `{package}.{schema}` | {told} |")
    return "\n".join(lines)


def page(text: str) -> str:
    """The page with its generated part renewed."""
    return renewed(text, MARK, reference())


def main() -> None:
    renew(Path(sys.argv[1]), page)


if __name__ == "__main__":
    main()
