"""The import rules that keep the house in order, read from the source of every module."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "busybot"
MODULES = sorted(PACKAGE.rglob("*.py"))
HEAVY = {"sapien", "rerun", "torch", "torch_geometric", "cv2", "pandas", "pyarrow", "scipy", "matplotlib", "trimesh"}
LIGHT_FOLDERS = {"boards", "episodes", "evaluation", "objects"}
# What a module may do when it is imported, besides definitions and assignments.
DECLARATIONS = (
    ast.Import,
    ast.ImportFrom,
    ast.FunctionDef,
    ast.AsyncFunctionDef,
    ast.ClassDef,
    ast.Assign,
    ast.AnnAssign,
    ast.TypeAlias if sys.version_info >= (3, 12) else ast.AnnAssign,
)


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(tree: ast.AST, anywhere: bool = True) -> set[str]:
    """Full names of imported modules, anywhere or only those imported when the module is."""
    nodes = ast.walk(tree) if anywhere else _at_import_time(tree)
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are written in full"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def _at_import_time(tree: ast.AST) -> Iterator[ast.AST]:
    for node in ast.iter_child_nodes(tree):
        for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if not for_types and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield node
            yield from _at_import_time(node)


def tops(names: set[str]) -> set[str]:
    return {name.split(".")[0] for name in names}


@pytest.fixture(params=MODULES, ids=name_of)
def module(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


def test_sapien_only_in_sim(module: Path) -> None:
    if not name_of(module).startswith("sim/"):
        assert "sapien" not in tops(imported(tree_of(module)))


def test_rerun_only_in_view(module: Path) -> None:
    if not name_of(module).startswith("view/"):
        assert "rerun" not in tops(imported(tree_of(module)))


def test_plain_data_needs_no_simulator_viewer_or_learner(module: Path) -> None:
    folder = name_of(module).split("/")[0]
    if folder in LIGHT_FOLDERS or module.name == "metrics.py":
        assert not tops(imported(tree_of(module))) & {"sapien", "rerun", "torch", "torch_geometric"}


@pytest.mark.parametrize("path", sorted((PACKAGE.parent / "pipelines").glob("*.py")), ids=lambda path: path.name)
def test_stages_need_the_package_and_each_other(path: Path) -> None:
    """Nothing of the repository besides; a copy of the pipeline runs wherever the package is."""
    own = {folder.name for folder in PACKAGE.parent.iterdir() if folder.is_dir()}
    assert tops(imported(tree_of(path))) & own <= {"busybot", "pipelines"}


def test_data_flows_one_way(module: Path) -> None:
    """Objects know nothing of boards, boards nothing of simulation, recordings nothing of skills or views."""
    earlier = {
        "objects": {"boards", "sim", "episodes", "interact", "reason", "plan", "view", "cli"},
        "boards": {"sim", "episodes", "interact", "reason", "plan", "view", "cli"},
        "episodes": {"sim", "interact", "reason", "plan", "view", "cli"},
        "sim": {"interact", "reason", "plan", "view", "cli"},
        "training": {"objects", "boards", "sim", "episodes", "interact", "reason", "plan", "view", "cli"},
        "interact": {"view", "cli"},
        "reason": {"view", "cli"},
        "plan": {"view", "cli"},
        "view": {"cli"},
    }.get(name_of(module).split("/")[0], set())
    used = {name.split(".")[1] for name in imported(tree_of(module)) if name.startswith("busybot.")}
    assert not used & earlier


def test_the_command_line_imports_what_is_heavy_inside_functions(module: Path) -> None:
    if name_of(module).startswith("cli/"):
        at_once = imported(tree_of(module), anywhere=False)
        assert not tops(at_once) & (HEAVY | {"numpy"})
        own = {name for name in at_once if name.startswith("busybot.")}
        allowed = ("busybot.cli.", "busybot.errors.", "busybot.__version__")
        assert not [name for name in own if not name.startswith(allowed)]


def test_nothing_happens_at_import_time(module: Path) -> None:
    """Modules define and assign; calls stand only in assignments, decorators and behind `if __name__`.

    The one exception is the module whose import is Gymnasium's way to register an environment.
    """
    if name_of(module) == "sim/registration.py":
        return
    for node in tree_of(module).body:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "__name__ == '__main__'"):
            continue
        assert isinstance(node, DECLARATIONS), f"{name_of(module)}:{node.lineno}: {ast.unparse(node)[:80]}"


def test_package_inits_stay_empty() -> None:
    for path in PACKAGE.rglob("*/__init__.py"):
        assert not path.read_text().strip(), name_of(path)


def test_no_pickle_and_no_global_randomness(module: Path) -> None:
    tree = tree_of(module)
    assert not tops(imported(tree)) & {"pickle", "dill", "cloudpickle", "shelve", "marshal", "random"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and ast.unparse(node).startswith(("np.random.", "numpy.random.")):
            assert node.attr in ("Generator", "PCG64", "SeedSequence", "BitGenerator"), ast.unparse(node)


def test_modules_say_what_they_are(module: Path) -> None:
    if module.name != "__init__.py":
        assert ast.get_docstring(tree_of(module)), "a module starts with a docstring"
