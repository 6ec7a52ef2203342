"""The notebooks run as they stand, and what they show is what a run shows, small and without places of a machine."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 150_000
"""Of an output, characters."""


def code_cells(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


def shown(cells: list[Any]) -> list[str]:
    """What the cells print, and the tables that they show."""
    outputs = [out for cell in cells for out in cell["outputs"]]
    told = [out.get("text") or out.get("data", {}).get("text/plain", "") for out in outputs]
    return ["".join(text) for text in told]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_they_were_executed_in_order_without_errors(path: Path) -> None:
    cells = code_cells(path)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [out for cell in cells for out in cell["outputs"]]
    assert outputs and not [out for out in outputs if out["output_type"] == "error"]
    assert not [out for out in outputs if out.get("name") == "stderr"]
    assert any("image/jpeg" in out.get("data", {}) for out in outputs)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_small_and_name_no_places(path: Path) -> None:
    for cell in code_cells(path):
        for out in cell["outputs"]:
            text = json.dumps(out)
            assert len(text) < LARGEST
            words = re.sub(r'"image/[a-z]+": "[^"]*"', "", text)
            assert not re.search(r"/(home|root|tmp|work|usr|Users)/", words)


LONG = [pytest.param(path, marks=[] if path.stem == "3-results" else pytest.mark.long) for path in NOTEBOOKS]
"""The third reads results alone: seconds, and whoever changes what reads them knows it at once."""


@pytest.mark.parametrize("path", LONG, ids=[path.stem for path in NOTEBOOKS])
def test_they_run_and_show_the_same(path: Path) -> None:
    from notebooks.run import execute

    again = [cell for cell in execute(path).cells if cell.cell_type == "code"]
    assert shown(again) == shown(code_cells(path)), f"python notebooks/run.py {path.name}"


@pytest.mark.long
@pytest.mark.parametrize("name", ["1-board", "2-dataset"])
def test_they_run_outside_of_the_repository_with_the_dataset_that_a_command_makes(name: str, tmp_path: Path) -> None:
    from notebooks.run import execute

    path = shutil.copy(FOLDER / f"{name}.ipynb", tmp_path)
    with pytest.raises(Exception, match="busybot dataset tiny"):
        execute(Path(path), tmp_path)
    subprocess.run([sys.executable, "-m", "busybot", "dataset", "tiny"], cwd=tmp_path, check=True)
    again = [cell for cell in execute(Path(path), tmp_path).cells if cell.cell_type == "code"]
    assert shown(again) == shown(code_cells(Path(path)))
