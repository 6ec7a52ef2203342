"""What the pages in docs/ say works: code runs, links lead somewhere; `tests/tools` has the generated parts."""

import ast
import os
import re
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import busybot
from busybot import __version__
from busybot.cli.eval import printing
from busybot.cli.main import load_command
from busybot.cli.options import RENAMED, UNTIL

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / name for name in ("benchmarks/README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
]
PLACES = {page: page.relative_to(ROOT).as_posix() for page in PAGES}
TEXTS = {place: page.read_text(encoding="utf-8") for page, place in PLACES.items()}
CODE = [
    pytest.param(block, id=f"{name}-{number}")
    for name, text in TEXTS.items()
    for number, block in enumerate(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
]

COMMANDS = [
    pytest.param(command, id=f"{place}-{number}")
    for place, text in TEXTS.items()
    if place != "docs/reference/commands.md"  # made of the commands themselves
    for number, command in enumerate(
        re.findall(r"`(python -m [^`]*)`", text.replace("\\\n", " "), re.MULTILINE)
        if place.startswith("benchmarks")
        else re.findall(r"^    ((?:busybot|python) .*)$", text.replace("\\\n", " "), re.MULTILINE)
    )
]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_there_with_these_options(command: str) -> None:
    """Read as they would be when typed, without being run; the walks in README and docs/guides/reproduce.md are run."""
    name, *words = shlex.split(command, comments=True)
    if name == "python":
        module = words[1] if words[0] == "-m" else words[0].removesuffix(".py").replace("/", ".")
        file = ROOT / f"{module.replace('.', '/')}.py"
        assert file.is_file()
        said = file.read_text(encoding="utf-8") + (ROOT / "benchmarks" / "runner.py").read_text(encoding="utf-8")
        if words[0] == "-m" and len(words) > 2 and not words[2].startswith("-"):  # one of a module's benchmarks
            assert f"{words[2].replace('-', '_')}=" in said
        assert [word for word in words if word.startswith("--") and f'"{word}"' not in said] == []
        return
    found = load_command(words[0])
    while hasattr(found, "commands"):
        words = words[1:]
        found = found.commands[words[0]]
    found.make_context(words[0], words[1:])


@pytest.mark.long
@pytest.mark.parametrize("code", CODE)
def test_code_runs_as_it_stands(code: str, tmp_path: Path) -> None:
    if "stable_baselines3" in code:
        pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: `make extras`")
    if "rerun.experimental" in code:
        pytest.importorskip("datafusion", reason="Rerun's catalogue is absent: `make check-loader` runs the example")
    (tmp_path / "example.py").write_text(code)
    done = subprocess.run(
        [sys.executable, "example.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr


def anchors(page: Path) -> set[str]:
    """What links to headings of a page name them by."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", page.read_text(encoding="utf-8")):
        place = page.parent / target if target else page
        assert target.startswith("https://") or place.exists(), target
        assert not anchor or anchor in anchors(place), f"{target}#{anchor}"


def test_the_tests_that_the_checklist_names_exist() -> None:
    named = re.findall(r"(tests/[\w/]+\.py)::(test_\w+)", TEXTS["docs/guides/reproduce.md"])
    assert len(named) > 30
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}::{name}"


def test_what_departures_names_stands_in_the_file_that_it_links() -> None:
    links = re.findall(r"\[((?:`[\w.]+`(?:, )?)+)\]\(\.\./\.\./([\w/]+\.py)\)", TEXTS["docs/reference/departures.md"])
    assert len(links) > 50
    for names, file in links:
        for name in re.findall(r"`([\w.]+)`", names):
            found = (ROOT / file).name if name.endswith(".py") else (ROOT / file).read_text(encoding="utf-8")
            assert all(part in found for part in ([name] if name.endswith(".py") else name.split("."))), (name, file)


def test_the_contents_name_every_page() -> None:
    contents = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = [place.removeprefix("docs/") for place in TEXTS if place.startswith("docs/") and place != "docs/index.md"]
    assert [page for page in pages if f"]({page})" not in contents] == []


def test_the_reference_has_what_is_offered_from_python() -> None:
    named = re.findall(r"^::: (.*)$", TEXTS["docs/reference/api.md"], re.MULTILINE)
    found = [getattr(import_module(module), name) for module, _, name in (place.rpartition(".") for place in named)]
    offered = [getattr(busybot, name) for name in busybot.__all__ if not name.startswith("__")]
    assert [one for one in offered if one not in found] == []
    assert all(one.__doc__ for one in found)


def test_the_changes_name_this_version_and_options_with_old_names() -> None:
    text = TEXTS["CHANGELOG.md"]
    versions = re.findall(r"^## (\d+\.\d+\.\d+)(.*)$", text, re.MULTILINE)
    released = [version for version, words in versions if "not released" not in words]
    assert released[0] == __version__ and len(versions) - len(released) <= 1
    numbers = [tuple(map(int, version.split("."))) for version, _ in versions]
    assert numbers == sorted(numbers, reverse=True)
    flat = " ".join(text.split())
    for renamed in RENAMED.values():
        for old, new in renamed.items():
            assert re.search(rf"{old}` is `{new}`", flat), f"{old} to {new}"
    assert f"until version {UNTIL} and say so" in flat and f"until version {UNTIL} and say so" in " ".join(
        TEXTS["docs/reference/commands.md"].split()
    )


def test_measures_say_which_key_each_printed_header_is() -> None:
    section = TEXTS["docs/reference/measures.md"].split("## What tables print\n")[1].split("\n## ")[0]
    explained = {name for line in section.splitlines() for name in re.findall("`([^`]+)`", line[1:].split("|")[0])}
    source = Path(printing.__file__).read_text(encoding="utf-8")
    tables = [call for call in ast.walk(ast.parse(source)) if isinstance(call, ast.Call) and _is_table(call)]
    headers = {word.value for call in tables for word in ast.walk(call.args[1]) if isinstance(word, ast.Constant)}
    assert len(tables) == 5 and {"pooled", "looks", "distance", "by board"} <= headers
    assert headers | {name.strip() for name in printing.ACTIONS.values()} <= explained


def _is_table(call: ast.Call) -> bool:
    return isinstance(call.func, ast.Name) and call.func.id == "_table"


def test_targets_that_contributors_are_told_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    told = re.findall(r"(?:`|^    )make ([a-z-]+)", "\n".join(TEXTS.values()), re.MULTILINE)
    assert len(told) > 3 and [name for name in told if f"\n{name}:" not in makefile] == []


def test_the_picture_is_that_of_its_script(tmp_path: Path) -> None:
    images = ROOT / "docs" / "images"
    script = tmp_path / "data_flow.py"
    script.write_bytes((images / "data_flow.py").read_bytes())
    subprocess.run([sys.executable, str(script)], check=True, timeout=60)
    assert (tmp_path / "data-flow.svg").read_bytes() == (images / "data-flow.svg").read_bytes()
