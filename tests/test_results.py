"""The committed results speak of the project alone."""

from pathlib import Path

import pytest

RESULTS = Path(__file__).parents[1] / "benchmarks" / "results"


@pytest.mark.parametrize("file", sorted({*RESULTS.rglob("*.json"), *RESULTS.rglob("*.md")}), ids=lambda path: path.stem)
def test_no_result_names_a_folder_of_the_machine_that_made_it(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert not any(
        f"{before}/{place}/" in text for place in ("tmp", "home", "root", "work") for before in ('"', " ", "=")
    )
