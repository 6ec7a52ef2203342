"""Models of relations are trained where neither simulator nor recordings can be read: what importing them takes."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import busybot
from busybot.reason.inputs import board_dataset, feature_store, sequence
from busybot.reason.models import base, message_passing
from busybot.reason.models.event import learner as event_learner
from busybot.reason.models.paper import learner as paper_learner

PACKAGE = Path(busybot.__file__).parent
ALLOWED = {"torch", "torch_geometric", "numpy", "pydantic", "safetensors"}
MODELS = [board_dataset, sequence, base, message_passing, event_learner, paper_learner]
"""Each stands for all that it imports."""


def at_import_time(node: ast.AST) -> Iterator[ast.AST]:
    for child in ast.iter_child_nodes(node):
        for_types = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        if not for_types and not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield child
            yield from at_import_time(child)


def imported(path: Path) -> Iterator[str]:
    """Modules, and names of modules, as far as they are imported when this one is."""
    for node in at_import_time(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def file_of(name: str) -> Path:
    """Of a module of the package, or of one that has what is named."""
    parts = name.split(".")[1:]
    places = [PACKAGE.joinpath(*some) for some in (parts, parts[:-1])]
    files = [file for place in places for file in (place.with_suffix(".py"), place / "__init__.py")]
    return next(file for file in files if file.is_file())


def strangers(path: Path, known: dict[Path, set[str]]) -> set[str]:
    """What a module imports of other people's, by itself and through the package."""
    if path not in known:
        known[path] = set()
        for name in imported(path):
            top = name.split(".")[0]
            if top == "busybot":
                known[path] |= strangers(file_of(name), known)
            elif top not in sys.stdlib_module_names:
                known[path].add(top)
    return known[path]


def of(module: ModuleType) -> Path:
    assert module.__file__
    return Path(module.__file__)


def test_importing_a_model_takes_nothing_but_what_computes() -> None:
    found = {module.__name__: strangers(of(module), {}) - ALLOWED for module in MODELS}
    assert not {name: extra for name, extra in found.items() if extra}


@pytest.mark.parametrize(("module", "needs"), [(feature_store, "mcap"), (event_learner, "torch_geometric")])
def test_the_rule_sees_what_is_imported_on_the_way(module: ModuleType, needs: str) -> None:
    assert needs in strangers(of(module), {})
