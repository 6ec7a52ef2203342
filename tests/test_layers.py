"""What skills share stands in `training` and `evaluation`: skills use each other's models, not how these came about."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "busybot"
SKILLS = ("interact", "reason", "plan")
OWN = ("train", "plan.learn", "fit", "learner", "round", "evaluat", "judge", "metrics", "summary")
"""Modules whose full names hold one of these are about a skill's training or evaluation."""
LATER = {
    "training": {"objects", "boards", "sim", "episodes", "evaluation", *SKILLS, "view", "cli"},
    "evaluation": {"sim", *SKILLS, "view", "cli"},
}


def imports(path: Path) -> set[str]:
    """Modules of the package that a module imports, anywhere in it; names from them are left out."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    used = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    for node in nodes:
        if isinstance(node, ast.Import):
            used |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):  # `from busybot.reason import metrics`
            used |= {f"{node.module}.{one.name}" for one in node.names if is_module(f"{node.module}.{one.name}")}
    return {name for name in used if name.startswith("busybot.")}


def is_module(name: str) -> bool:
    return (PACKAGE.parent / Path(*name.split("."))).with_suffix(".py").exists()


def test_skills_do_not_import_each_others_training_or_evaluation() -> None:
    found = {}
    for skill in SKILLS:
        for path in sorted((PACKAGE / skill).rglob("*.py")):
            for name in imports(path):
                other = name.split(".")[1]
                if other in SKILLS and other != skill and any(own in name for own in OWN):
                    found[path.relative_to(PACKAGE).as_posix()] = name
    assert not found


TRUTH = {"busybot.reason.evaluation." + name for name in ("ground_truth", "hypotheses", "upper_bound")}
"""Modules that know what only the simulator knows."""
JUDGES = ("reason/evaluation/", "cli/eval/")


def test_only_evaluators_know_the_truth() -> None:
    assert all(is_module(name) for name in TRUTH)
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).as_posix()
        assert place.startswith(JUDGES) or not imports(path) & TRUTH, place


def test_what_skills_share_knows_none_of_them() -> None:
    for folder, later in LATER.items():
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            assert not {name.split(".")[1] for name in imports(path)} & later, path.name
