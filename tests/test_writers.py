"""Only one module writes: a look at the source of all others for whatever opens, makes, renames or removes files."""

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from busybot.common.atomic_io import write_atomically

PACKAGE = Path(__file__).resolve().parents[1] / "busybot"
WRITER = Path(inspect.getsourcefile(write_atomically) or "")
_NEVER = (
    "write_bytes write_text touch mkdir makedirs symlink_to hardlink_to unlink rmdir removedirs rename renames lchmod"
    " chmod truncate mkfifo mknod rmtree copyfile copy2 copytree copymode copystat mkstemp mkdtemp NamedTemporaryFile"
    " TemporaryFile SpooledTemporaryFile FileHandler imwrite imsave VideoWriter save_file tofile savetxt to_csv"
    " to_parquet to_json to_excel to_hdf extractall print_figure write_feather write_dataset urlretrieve"
)
NEVER = set(_NEVER.split())
"""Names that are called nowhere else, whatever they belong to."""
IN_MODULE = {
    "os": {"rename", "replace", "link", "symlink", "remove", "chown"},
    "shutil": {"copy", "move", "copyfileobj", "make_archive", "unpack_archive"},
}
"""And those that are plain words elsewhere."""
INTO = {"save": 0, "savez": 0, "savez_compressed": 0, "savefig": 0, "print_png": 0, "ParquetWriter": 0}
INTO |= {"pq.write_table": 1, "json.dump": 1, "yaml.dump": 1, "yaml.safe_dump": 1}
"""Functions that write into a path or an open file: the place of that argument. It must be one that `files` opened, or
lie in memory."""
OURS = ("busybot.", "safetensors.torch.save ")
"""What is imported from there is looked at itself, or returns bytes."""
OPENERS = {"BytesIO", "StringIO", "replacing", "replacing_by_path", "new_file"}
WRITING_FLAGS = re.compile(r"O_(WRONLY|RDWR|CREAT|TRUNC|APPEND|TMPFILE)")
MODELS = {
    "final.save",
    "model.save",
    "self._model({'epochs': epoch}).save",
    "AffordanceModel(info, {job.kind: network_of(job) for job in jobs}).save",
}
"""Methods of ours with a name that others have: they write with `save_tensors`."""


def writes(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and callee of what may write."""
    opened = {name for node in ast.walk(tree) for name in _opened(node)}
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    ours = {alias.name for node in imports for alias in node.names if f"{node.module}.{alias.name} ".startswith(OURS)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in IN_MODULE:
            taken = {alias.name for alias in node.names} & (NEVER | IN_MODULE[node.module] | {"open"})
            yield from ((node.lineno, f"from {node.module} import {name}") for name in taken)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) not in ours and _may_write(node, opened):
            yield node.lineno, ast.unparse(node.func)


def _opened(node: ast.AST) -> Iterator[str]:
    """Names that are bound to an open file of `files`, or one in memory."""
    if isinstance(node, ast.Assign):
        pairs = [(node.value, target) for target in node.targets]
    elif isinstance(node, ast.With):
        pairs = [(item.context_expr, item.optional_vars) for item in node.items if item.optional_vars]
    else:
        return
    for value, target in pairs:
        if isinstance(value, ast.Call) and isinstance(target, ast.Name) and _name(value.func)[1] in OPENERS:
            yield target.id


def _name(callee: ast.expr) -> tuple[str, str]:
    """What it belongs to, and its own name."""
    if isinstance(callee, ast.Attribute):
        return ast.unparse(callee.value), callee.attr
    return "", callee.id if isinstance(callee, ast.Name) else ""


def _may_write(call: ast.Call, opened: set[str]) -> bool:
    owner, name = _name(call.func)
    if name in NEVER or name in IN_MODULE.get(owner, ()):
        return True
    if name == "open":
        return _opens_for_writing(call, owner)
    if name == "memmap":
        return not any(isinstance(value, ast.Constant) and value.value == "r" for value in call.args)
    if name == "replace":  # of a path: text is replaced by text, and dates and data classes take keywords
        return bool(owner) and len(call.args) == 1 and not call.keywords
    place = INTO.get(name, INTO.get(f"{owner}.{name}", len(call.args)))
    if place >= len(call.args):  # not such a function, or nothing to write into: it returns what it made
        return name in INTO and bool(call.keywords)
    into = call.args[place]
    return not (isinstance(into, ast.Name) and into.id in opened)


def _opens_for_writing(call: ast.Call, owner: str) -> bool:
    given = [*call.args[0 if owner else 1 :], *(word.value for word in call.keywords)]
    if owner == "os":
        return bool(WRITING_FLAGS.search(ast.unparse(call))) or not isinstance(call.args[1], ast.BinOp | ast.Attribute)
    if not owner and given and not isinstance(given[0], ast.Constant):
        return True  # a mode that is not known here
    modes = [str(value.value) for value in given if isinstance(value, ast.Constant)]
    return any(re.fullmatch("[rwaxbtU+]+", mode) and set(mode) & set("wax+") for mode in modes)


def test_only_one_module_writes() -> None:
    found, used = list[str](), set[str]()
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        for line, callee in writes(ast.parse(path.read_text(encoding="utf-8"))) if path != WRITER else ():
            used.add(callee)
            found += [] if callee in MODELS else [f"{name}:{line}: {callee}"]
    assert not found, f"these write; let {WRITER.name} do it:\n" + "\n".join(found)
    assert used == MODELS, "allowed, but not there any more"


@pytest.mark.parametrize(
    "code",
    [
        "open(path, 'w')",
        "open(path, mode='ab')",
        "open(path, how)",
        "io.open(path, 'r+')",
        "path.open('x')",
        "gzip.open(path, 'wb')",
        "os.open(path, os.O_WRONLY | os.O_CREAT)",
        "os.open(path, flags)",
        "os.replace(made, path)",
        "path.replace(other)",
        "made.rename(path)",
        "from os import rename",
        "shutil.copy(path, other)",
        "from shutil import rmtree",
        "path.parent.mkdir()",
        "(path / 'x').write_text('')",
        "path.symlink_to(other)",
        "np.save(path, values)",
        "np.savez(file=path, a=a)",
        "figure.savefig(path)",
        "image.save(path)",
        "pq.ParquetWriter(path, schema)",
        "pq.write_table(rows, path)",
        "cv2.imwrite(str(path), image)",
        "from safetensors.torch import save_file\nsave_file(tensors, path)",
        "json.dump(values, file)",
        "np.memmap(path, np.uint8)",
    ],
)
def test_what_writes_is_found(code: str) -> None:
    assert list(writes(ast.parse(code)))


@pytest.mark.parametrize(
    "code",
    [
        "open(path)",
        "open(descriptor, 'rb')",
        "Dataset.open(path)",
        "Image.open(file, formats=('PNG',))",
        "os.open(path, os.O_RDONLY | os.O_NOFOLLOW)",
        "text.replace('a', 'b')",
        "replace(value, name='x')",
        "scene.save()",
        "buffer = BytesIO()\nnp.save(buffer, values)",
        "with replacing(path) as file, pq.ParquetWriter(file, schema) as writer:\n    writer.write_table(rows)",
        "from busybot.common.atomic_io import rename\nrename(made, path)",
        "from safetensors.torch import save\nsave(tensors, header)",
        "json.dumps(values)",
        "np.memmap(path, np.uint8, 'r')",
        "yaml.safe_dump(values)",
    ],
)
def test_what_only_reads_is_not(code: str) -> None:
    assert not list(writes(ast.parse(code)))
