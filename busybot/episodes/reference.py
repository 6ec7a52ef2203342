"""The reference of the dataset format, from the schema itself.

    python -m busybot.episodes.reference docs/dataset-format.md

Writes everything below the line that begins with `<!-- from here on`; a test compares.
"""

import sys
from pathlib import Path

from busybot.episodes import mcap_topics as topics
from busybot.episodes.schema import SCHEMA_VERSION, TABLES, Column
from busybot.pages import renew, renewed

MARK = "<!-- from here on made by `python -m busybot.episodes.reference`: change the schema, not this text -->"


def reference() -> str:
    """Tables and channels as Markdown."""
    parts = [f"Version of the schema: {SCHEMA_VERSION}.", "## Tables"]
    for name, columns in TABLES.items():
        parts.append(f"### `tables/{name}`\n\n{_table(columns)}")
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


def _channels() -> str:
    lines = ["| topic | message | |", "|---|---|---|"]
    for topic, schema in (topics.FOXGLOVE | topics.OWN).items():
        package = "foxglove" if topic in topics.FOXGLOVE else "busybot.v1"
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
