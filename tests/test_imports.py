"""The import rules that keep the house in order, read from the source of every module."""

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "busybot"
MODULES = sorted(PACKAGE.rglob("*.py"))
HEAVY = {"sapien", "rerun", "torch", "torch_geometric", "cv2", "pandas", "pyarrow", "scipy", "matplotlib", "trimesh"}
LIGHT_FOLDERS = {"boards", "datasets", "episodes", "evaluation", "objects"}
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


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def uses(path: Path) -> frozenset[str]:
    """Full names of all modules and names that a file imports, wherever it does."""
    return frozenset(imported(tree_of(path)))


def room(path: Path) -> str:
    return name_of(path).split("/")[0]


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


@pytest.mark.long
def test_sapien_only_in_sim() -> None:
    assert [name_of(path) for path in MODULES if "sapien" in tops(uses(path)) and room(path) != "sim"] == []


def test_rerun_only_in_view() -> None:
    assert [name_of(path) for path in MODULES if "rerun" in tops(uses(path)) and room(path) != "view"] == []


def test_plain_data_needs_no_simulator_viewer_or_learner() -> None:
    plain = [path for path in MODULES if room(path) in LIGHT_FOLDERS or path.name == "metrics.py"]
    found = {name_of(path): tops(uses(path)) & {"sapien", "rerun", "torch", "torch_geometric"} for path in plain}
    assert len(plain) > 50 and {name: heavy for name, heavy in found.items() if heavy} == {}


def test_stages_need_the_package_and_each_other() -> None:
    """Nothing of the repository besides; a copy of the pipeline runs wherever the package is."""
    own = {folder.name for folder in PACKAGE.parent.iterdir() if folder.is_dir()}
    for path in sorted((PACKAGE.parent / "pipelines").glob("*.py")):
        assert tops(uses(path)) & own <= {"busybot", "pipelines"}, path.name


def test_data_flows_one_way() -> None:
    """Objects know nothing of boards, boards nothing of simulation, recordings nothing of skills or views."""
    order = ("common", "objects", "boards", "episodes", "datasets", "sim", "skills", "view", "cli")
    skills = {"training": "skills", "evaluation": "skills", "interact": "skills", "reason": "skills", "plan": "skills"}
    for path in MODULES:
        own = skills.get(room(path), room(path))
        if own in order:  # else it is at the top, and brings rooms together
            later = set(order[order.index(own) + 1 :])
            used = {name.split(".")[1] for name in uses(path) if name.startswith("busybot.")}
            assert not {skills.get(one, one) for one in used} & later, name_of(path)


def _graph() -> dict[str, set[str]]:
    """The modules that each module of the package imports, anywhere in it."""
    names = {name_of(path).removesuffix(".py").replace("/", ".").removesuffix(".__init__"): path for path in MODULES}
    graph = {}
    for name, path in names.items():
        used = {one.removeprefix("busybot.") for one in imported(tree_of(path)) if one.startswith("busybot.")}
        # of `from a.b import c`, c is a module or something in a.b
        graph[name] = {one if one in names else one.rpartition(".")[0] for one in used} & set(names) - {name}
    return graph


def circles(graph: dict[str, set[str]]) -> list[tuple[str, ...]]:
    """Those modules that can be reached from themselves, by the set that reaches each other."""
    reached = {name: set(used) for name, used in graph.items()}
    for middle in graph:
        for name in graph:
            if middle in reached[name]:
                reached[name] |= reached[middle]
    return sorted({tuple(sorted(b for b in reached[a] if a in reached[b])) for a in graph if a in reached[a]})


def test_no_circle_of_imports() -> None:
    """Also none that is hidden in functions: what needs each other is one module, or a third one knows both."""
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [("a", "b", "c")]
    graph = _graph()
    assert "objects.library" in graph["objects.resolve"] and "reason.models.base" in graph["reason.models.registry"]
    assert not circles(graph)


def test_the_command_line_imports_what_is_heavy_inside_functions() -> None:
    allowed = (
        "busybot.cli.",
        "busybot.common.errors.",
        "busybot.common.device.",
        "busybot.common.quiet.",
        "busybot.common.remote.",
        "busybot.common.text.",
        "busybot.__version__",
    )
    for path in MODULES:
        if room(path) == "cli":
            at_once = imported(tree_of(path), anywhere=False)
            assert not tops(at_once) & (HEAVY | {"numpy"}), name_of(path)
            own = {name for name in at_once if name.startswith("busybot.")}
            assert [name for name in own if not name.startswith(allowed)] == [], name_of(path)


def test_nothing_happens_at_import_time() -> None:
    """Modules define and assign; calls stand only in assignments, decorators and behind `if __name__`.

    The one exception is the module whose import is Gymnasium's way to register an environment.
    """
    for path in MODULES:
        for node in tree_of(path).body:
            docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            guarded = isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "__name__ == '__main__'")
            fine = (
                docstring
                or guarded
                or isinstance(node, DECLARATIONS)
                or name_of(path) in ("sim/registration.py", "reason/pyg.py")
            )
            assert fine, f"{name_of(path)}:{node.lineno}: {ast.unparse(node)[:80]}"


def test_package_inits_are_empty_or_the_public_face() -> None:
    """What a folder offers to others, and nothing else: a docstring, imports, `__all__`."""
    for path in PACKAGE.rglob("*/__init__.py"):
        for node in tree_of(path).body:
            said = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            offered = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
            assert said or offered or isinstance(node, ast.ImportFrom), f"{name_of(path)}:{node.lineno}"


def test_no_pickle_and_no_global_randomness() -> None:
    for path in MODULES:
        refused = tops(uses(path)) & {"pickle", "dill", "cloudpickle", "shelve", "marshal", "random"}
        assert not refused, f"{name_of(path)}: {refused}"
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Attribute) and _is_numpys_random(node.value):
                known = node.attr in ("Generator", "PCG64", "SeedSequence", "BitGenerator")
                assert known, f"{name_of(path)}:{node.lineno}: {ast.unparse(node)}"


def _is_numpys_random(node: ast.expr) -> bool:
    named = isinstance(node, ast.Attribute) and node.attr == "random" and isinstance(node.value, ast.Name)
    return named and node.value.id in ("np", "numpy")


def test_modules_say_what_they_are() -> None:
    silent = [path for path in MODULES if path.name != "__init__.py" and not ast.get_docstring(tree_of(path))]
    assert [name_of(path) for path in silent] == [], "a module starts with a docstring"
