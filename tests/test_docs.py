"""What the pages in docs/ say works: their code runs, their links lead somewhere."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from busybot.cli.main import load_command

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
TEXTS = {page.stem: page.read_text(encoding="utf-8") for page in PAGES}
CODE = [
    pytest.param(block, id=f"{name}-{number}")
    for name, text in TEXTS.items()
    for number, block in enumerate(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
]

COMMANDS = [
    pytest.param(command, id=f"{page.stem}-{number}")
    for page in PAGES
    if page.stem != "commands"  # made of the commands themselves
    for number, command in enumerate(
        re.findall(
            r"^    ((?:busybot|python) .*)$", page.read_text(encoding="utf-8").replace("\\\n", " "), re.MULTILINE
        )
    )
]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_there_with_these_options(command: str) -> None:
    """Read as they would be when typed, without being run; the walks in README and docs/reproduce.md are run."""
    name, *words = shlex.split(command, comments=True)
    if name == "python":
        module = words[1] if words[0] == "-m" else words[0].removesuffix(".py").replace("/", ".")
        file = ROOT / f"{module.replace('.', '/')}.py"
        assert file.is_file()
        said = file.read_text(encoding="utf-8")
        if "table3 import" in said and "parsed" in said:  # whose options it has
            said += (ROOT / "benchmarks" / "table3.py").read_text(encoding="utf-8")
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
    (tmp_path / "example.py").write_text(code)
    done = subprocess.run(
        [sys.executable, "example.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (page.parent / target).exists(), target


def test_the_format_reference_is_the_schemas() -> None:
    from busybot.episodes.reference import page

    written = (ROOT / "docs" / "dataset-format.md").read_text(encoding="utf-8")
    assert page(written) == written, "python -m busybot.episodes.reference docs/dataset-format.md"


@pytest.mark.parametrize("name", ["table1", "further-boards"])
def test_table_1_is_that_of_the_results(name: str) -> None:
    from benchmarks.table1_page import page

    written = (ROOT / "docs" / "interact.md").read_text(encoding="utf-8")
    result = json.loads((ROOT / "benchmarks" / "results" / f"{name}.json").read_text(encoding="utf-8"))
    assert page(written, result) == written, "python -m benchmarks.table1_page"


def test_the_table_of_robustness_is_that_of_the_results() -> None:
    from benchmarks.robustness_page import page

    written = (ROOT / "docs" / "reason.md").read_text(encoding="utf-8")
    result = ROOT / "benchmarks" / "results" / "reason_robustness.json"
    if result.exists():
        expected = page(written, json.loads(result.read_text(encoding="utf-8")))
        assert expected == written, "python -m benchmarks.robustness_page"
    else:
        assert "<!-- robustness -->\n<!-- end of robustness -->" in written, "a table without its result"


@pytest.mark.parametrize(
    ("where", "name"),
    [
        ("interact", "changed_pixels"),
        ("interact", "interact"),
        ("interact", "paper_interact"),
        ("interact", "policy_constants"),
        ("plan", "decision_time"),
        ("plan", "plan-procedural"),
    ],
)
def test_tables_beside_tables_1_and_3_are_those_of_the_results(where: str, name: str) -> None:
    from benchmarks import interact_pages, plan_pages

    page = {"interact": interact_pages.page, "plan": plan_pages.page}[where]
    written = (ROOT / "docs" / f"{where}.md").read_text(encoding="utf-8")
    result, place = ROOT / "benchmarks" / "results" / f"{name}.json", name.replace("_", "-")
    if result.exists():
        assert page(written, json.loads(result.read_text(encoding="utf-8"))) == written, f"benchmarks.{where}_pages"
    else:
        assert f"<!-- {place} -->\n<!-- end of {place} -->" in written, "a table without its result"


def test_the_command_reference_is_the_commands() -> None:
    from busybot.cli.reference import page

    written = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert page(written) == written, "python -m busybot.cli.reference docs/commands.md"


def test_the_tests_that_the_checklist_names_exist() -> None:
    named = re.findall(r"(tests/[\w/]+\.py)::(test_\w+)", (ROOT / "docs" / "reproduce.md").read_text(encoding="utf-8"))
    assert len(named) > 30
    for file, name in named:
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}::{name}"


def test_the_contents_name_every_page() -> None:
    contents = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if f"]({page.name})" not in contents and page.name != "index.md"] == []


def test_the_picture_is_that_of_its_script(tmp_path: Path) -> None:
    images = ROOT / "docs" / "images"
    script = tmp_path / "data_flow.py"
    script.write_bytes((images / "data_flow.py").read_bytes())
    subprocess.run([sys.executable, str(script)], check=True, timeout=60)
    assert (tmp_path / "data-flow.svg").read_bytes() == (images / "data-flow.svg").read_bytes()


def test_the_procedural_figures_of_reasoning_are_those_of_the_results() -> None:
    result = json.loads((ROOT / "benchmarks" / "results" / "reason-procedural.json").read_text(encoding="utf-8"))
    written = (ROOT / "docs" / "reason.md").read_text(encoding="utf-8")
    for split, told in result["splits"].items():
        keys = ("edge_p", "edge_r", "edge_r_bound", "pred_a", "pred_a_bound", "pred_a_successful", "failing")
        p, r, r_bound, a, a_bound, successful, failing = (f"{100 * told[key]:.1f}" for key in keys)
        assert f"| {split} | {p} | {r} ({r_bound}) | {a} ({a_bound}) | {successful} | {failing} |" in written


def test_the_speed_of_features_is_that_of_the_result() -> None:
    told = json.loads((ROOT / "benchmarks" / "results" / "features-speed.json").read_text(encoding="utf-8"))
    assert (told["encoder"], told["workers"], told["cores"]) == ("embedded", 2, 2)
    written = (ROOT / "docs" / "reason.md").read_text(encoding="utf-8")
    assert f"encodes {told['frames_per_second']:.0f} frames a second on two cores" in written
    assert f"{told['frames_per_cpu_second']:.0f} per second of processor time" in written


def test_the_run_of_the_laptop_profile_took_what_the_page_says() -> None:
    run = ROOT / "benchmarks" / "results" / "laptop"
    stages = json.loads((run / "tables" / "stages.json").read_text(encoding="utf-8"))["stages"]
    assert all(stage["done"] for stage in stages.values())
    minutes = sum(stage["seconds"] for stage in stages.values()) / 60
    assert f"| {minutes:.0f} minutes on two cores ([report]" in (ROOT / "docs" / "reproduce.md").read_text(
        encoding="utf-8"
    )
    assert "- **0** gates missed" in (run / "report.md").read_text(encoding="utf-8")


def test_table_2_is_that_of_the_results() -> None:
    from benchmarks.table2_page import page

    written = (ROOT / "docs" / "reason.md").read_text(encoding="utf-8")
    result = json.loads((ROOT / "benchmarks" / "results" / "table2.json").read_text(encoding="utf-8"))
    assert page(written, result) == written, "python -m benchmarks.table2_page"


def test_table_3_is_that_of_the_results() -> None:
    from benchmarks.table3_page import page

    written = (ROOT / "docs" / "plan.md").read_text(encoding="utf-8")
    result = json.loads((ROOT / "benchmarks" / "results" / "table3.json").read_text(encoding="utf-8"))
    assert page(written, result) == written, "python -m benchmarks.table3_page"
