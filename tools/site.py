"""What the documentation's site has beside docs/, as a hook of MkDocs (`make site`): the order of its pages, and the
files of the repository that pages link to.

The pages are written to be read in the repository. Its contents, `docs/index.md`, are the navigation. A file outside
docs/ that a page links to becomes a page under `repository/`: Markdown as it is, notebooks with their results, code as
code, folders as a list; anything else is copied.
"""

import json
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = "repository/"
OFF = InclusionLevel.NOT_IN_NAV
CONTENTS = "docs/index.md"
CODE_OR_LINK = re.compile(
    r"^(?:```|~~~~).*?^(?:```|~~~~)$|`[^`\n]+`|(\]\()([^)#\s:]+)((?:#[^)\s]*)?\))", re.DOTALL | re.MULTILINE
)
PLACES: dict[str, str] = {}
"""Path in the repository of each page of the site."""
LANGUAGES = {".py": "python", ".yaml": "yaml", ".yml": "yaml", ".json": "json", ".toml": "toml", ".sh": "bash"}


def on_config(config: Any) -> Any:
    """The navigation: a section for each table of the contents, a page for each of its links."""
    text = (ROOT / CONTENTS).read_text(encoding="utf-8").split("\n## ")[0]
    sections: list[Any] = [{"Contents": "index.md"}]
    placed: set[str] = set()
    for title, rows in re.findall(r"^\| ([a-z ]+) \| \|\n\|[-|]+\|\n((?:\|.*\n?)+)", text, re.MULTILINE):
        links = re.findall(r"\[([^]]+)\]\(([^)]+)\)", rows)
        pages = [{name: uri(resolve(CONTENTS, target))} for name, target in links if target not in placed]
        placed |= {target for _, target in links}
        sections.append({title.capitalize(): pages})
    config.nav = sections
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the files outside docs/ that pages link to, and those that these link to."""
    todo = [f"docs/{file.src_uri}" for file in files if file.src_uri.endswith(".md")]
    known = {f"docs/{file.src_uri}" for file in files}
    while todo:
        place = todo.pop()
        PLACES[uri(place)] = place
        linked = {resolve(place, link) for _, link, _ in CODE_OR_LINK.findall(content(place)) if link} - known
        linked = {target for target in linked if (ROOT / target).exists()}
        known |= linked
        for target in sorted(linked):
            if uri(target).endswith(".md"):
                files.append(File.generated(config, uri(target), content=content(target), inclusion=OFF))
                todo.append(target)
            else:
                files.append(File.generated(config, uri(target), abs_src_path=str(ROOT / target), inclusion=OFF))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead the page's links to where their targets are on the site."""
    here: str = page.file.src_uri

    def led(match: re.Match[str]) -> str:
        if not match[2]:
            return match[0]
        target = uri(resolve(PLACES[here], match[2]))
        return f"{match[1]}{posixpath.relpath(target, posixpath.dirname(here) or '.')}{match[3]}"

    return CODE_OR_LINK.sub(led, markdown)


def resolve(place: str, link: str) -> str:
    """The path in the repository that a link on the page at `place` means."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(place), link))


def uri(place: str) -> str:
    """Where the site has a file or folder of the repository."""
    if place.startswith("docs/"):
        return place.removeprefix("docs/")
    plain = place.endswith(".md") or (ROOT / place).suffix not in {*LANGUAGES, ".ipynb", ""}
    return f"{OUTSIDE}{place}" if plain else f"{OUTSIDE}{place}.md"


def content(place: str) -> str:
    """A file of the repository as Markdown."""
    path = ROOT / place
    if path.is_dir():
        names = sorted(f"{entry.name}/" if entry.is_dir() else entry.name for entry in path.iterdir())
        return f"# {place}\n\n" + "".join(f"- `{name}`\n" for name in names if not name.startswith(("_", ".")))
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        return "\n\n".join(part for cell in json.loads(text)["cells"] for part in cell_parts(cell)) + "\n"
    return text if path.suffix == ".md" else f"# {place}\n\n{fenced(text, LANGUAGES.get(path.suffix, ''))}\n"


def cell_parts(cell: dict[str, Any]) -> Iterator[str]:
    """A notebook's cell: its text, or its code and what came out."""
    text = "".join(cell["source"])
    yield text if cell["cell_type"] == "markdown" else fenced(text, "python")
    for output in cell.get("outputs", []):
        data = output.get("data", {"text/plain": output.get("text", "")})
        if "image/jpeg" in data:
            yield f'<img alt="" src="data:image/jpeg;base64,{"".join(data["image/jpeg"]).strip()}">'
        elif "text/html" in data:
            yield re.sub(r"<style.*?</style>|\n\s*", "", "".join(data["text/html"]), flags=re.DOTALL)
        else:
            yield fenced("".join(data["text/plain"]), "text")


def fenced(text: str, language: str) -> str:
    """A block of code."""
    return f"~~~~{language}\n{text.rstrip()}\n~~~~"
