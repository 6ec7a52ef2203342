"""What an object leads to: for tests of what somebody could read if they looked everywhere."""

import gc
from collections.abc import Iterator
from types import BuiltinFunctionType, FunctionType, ModuleType


def reachable(*roots: object) -> Iterator[object]:
    """All objects that attributes, elements and closures lead to; no globals of functions, and nothing in torch."""
    waiting, known = list(roots), set[int]()
    while waiting:
        one = waiting.pop()
        outside = isinstance(one, type | ModuleType | BuiltinFunctionType) or type(one).__module__.startswith("torch")
        if id(one) in known or outside:
            continue
        known.add(id(one))
        yield one
        if isinstance(one, FunctionType):
            waiting += [cell.cell_contents for cell in one.__closure__ or ()] + list(one.__defaults__ or ())
        else:
            waiting += gc.get_referents(one)
