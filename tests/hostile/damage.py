"""Ways to damage a file, from bad luck to malice; every copy comes from a seed and a number."""

import csv
import gzip
import io
import json
import os
import pickle
import re
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

Json = Any
Damage = Callable[[bytes, np.random.Generator], bytes]
PATHS = (
    "../../../../etc/passwd",
    "/etc/passwd",
    "..\\..\\x",
    "a/../../b",
    "~root/x",
    "\\\\host\\share",
    "x\0y",
    "/dev/zero",
)
NUMBERS = (b"1e999", b"-1", b"99999999999999999999", b"NaN", b"Infinity", b"null", b"true", b"-0", b"1e-320", b'"1"')
BOMB_BYTES = 200_000_000


CELLS = (*(number.decode() for number in NUMBERS), "1e308", "-1e-320", "1_0", "0x1F", " 3 ", "3.0", "99:99", "[1, 2")


def truncated(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data)))]


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """One to eight bits."""
    changed = bytearray(data)
    for position in rng.integers(len(data), size=int(rng.integers(1, 9))):
        changed[position] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def zeroed(data: bytes, rng: np.random.Generator) -> bytes:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 5000))
    return data[:start] + bytes(len(data[start : start + length])) + data[start + length :]


def removed(data: bytes, rng: np.random.Generator) -> bytes:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 300))
    return data[:start] + data[start + length :]


def repeated(data: bytes, rng: np.random.Generator) -> bytes:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 2000))
    part = data[start : start + length]
    return data[:start] + part * int(rng.integers(2, 50)) + data[start + length :]


def absurd_length(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes that may say how long something is, as large as they can be."""
    width = int(rng.choice([4, 8]))
    start = int(rng.integers(max(len(data) - width, 1)))
    value = struct.pack("<I" if width == 4 else "<Q", int(rng.choice([2**31, 2**32 - 1, 2**24])))
    return data[:start] + value + data[start + width :]


def array_header(data: bytes, rng: np.random.Generator) -> bytes:
    """A header of NumPy's that is no dictionary, or one of an absurd array; of the length that the file tells."""
    texts = (
        "{'a': (",
        "[" * 4000,
        "-" * 9000 + "1",
        '"""',
        "{'descr': 'O'}",
        "  1\n 2",
        "\\",
        "\0",
        "lambda: 0",
        "f'{'",
    )
    shape = (2 ** int(rng.integers(40, 63)), *(2,) * int(rng.integers(70)))
    absurd = (f"{{'descr': '<f2', 'fortran_order': False, 'shape': {s}}}" for s in (shape, (-1, 3), (1.5,), "((2,),)"))
    choices = [*texts, *absurd]
    text = choices[int(rng.integers(len(choices)))].encode("latin1") + b"\n"
    version = int(rng.integers(1, 4))
    length = struct.pack("<H" if version == 1 else "<I", len(text))
    return b"\x93NUMPY" + bytes([version, 0]) + length + text + data[128:]


def other_number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number of a text becomes one that nobody expects."""
    return _replace(rb"-?\d+(?:\.\d+)?(?:[eE]-?\d+)?", data, NUMBERS[int(rng.integers(len(NUMBERS)))], rng)


def other_path(data: bytes, rng: np.random.Generator) -> bytes:
    """A quoted word, or a file name, becomes a path that leads out."""
    path = PATHS[int(rng.integers(len(PATHS)))]
    quoted = b'"' + path.replace("\\", "\\\\").replace("\0", "\\u0000").encode() + b'"'
    if rng.random() < 0.5:
        return _replace(rb'"[^"\n]{1,80}"', data, quoted, rng)
    return _replace(rb"[\w\-/]+\.(?:obj|mtl|png|jpg|mcap|parquet|json)", data, path.encode(), rng)


def lost_word(data: bytes, rng: np.random.Generator) -> bytes:
    return _replace(rb"\w{3,}", data, b"", rng)


def huge_word(data: bytes, rng: np.random.Generator) -> bytes:
    return _replace(rb"\w{2,}", data, b"A" * 2_000_000, rng)


def deep(data: bytes, rng: np.random.Generator) -> bytes:
    """Nested far deeper than any reader should follow."""
    opening = (b"[", b'{"a":', b"<a>", b"- ")[int(rng.integers(4))]
    place = int(rng.integers(len(data)))
    return data[:place] + opening * 100_000 + data[place:]


def laughs(data: bytes, rng: np.random.Generator) -> bytes:
    """Text that grows beyond all bounds when its names are replaced by what they stand for."""
    if rng.random() < 0.5:
        entities = b"".join(b'<!ENTITY e%d "%s">' % (n, b"&e%d;" % (n - 1) * 10) for n in range(1, 12))
        return b'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e0 "lol">' + entities + b"]><robot name='r'>&e11;</robot>"
    lines = [b"a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [b"a%d: &a%d [%s]" % (n, n, b", ".join([b"*a%d" % (n - 1)] * 9)) for n in range(1, 12)]
    return b"\n".join(lines)


class _Malice:
    """What a pickle may do to who opens it: here it makes a file that should not be there."""

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, ("pickle-was-run",)


def pickled(data: bytes, rng: np.random.Generator) -> bytes:
    """A pickle where something else is expected, bare or inside of what looks like arrays or weights."""
    kind = int(rng.integers(4))
    bare = pickle.dumps(_Malice())
    if kind == 0:
        return bare
    file = io.BytesIO()
    if kind == 1:
        np.save(file, np.array([_Malice()], dtype=object), allow_pickle=True)
    elif kind == 2:
        np.savez(file, a=np.array([_Malice()], dtype=object))
    else:
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("archive/data.pkl", bare)
            archive.writestr("archive/version", "3\n")
    return file.getvalue()


def bomb(data: bytes, rng: np.random.Generator) -> bytes:
    """A little that becomes a lot when it is unpacked."""
    if rng.random() < 0.5:
        return gzip.compress(bytes(BOMB_BYTES), 1)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("../../outside.txt", bytes(BOMB_BYTES // 4))
    return file.getvalue()


def nothing(data: bytes, rng: np.random.Generator) -> bytes:
    return b""


def garbage(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(12))] + rng.bytes(int(rng.integers(1, 20_000)))


TEXTS = (
    "[/red]",
    "[link=https://example.com]x[/link]",
    "[bold",
    "\x1b]0;owned\x07\x1b[2J",
    "\x9b31m",
    "\u202egnp.exe",
    "a\0b",
    "\ud800",
    "<script>alert(1)</script>",
    "[x](https://example.com)",
    "$\\frac{$",
    "a\r\nb",
    "x" * 5000,
    "",
)
ODD: tuple[Json, ...] = (
    *(float("nan"), float("inf"), -1, 0, 2**31, 2**63, 10**30, 1e308, -0.0, 5e-324),
    *(None, True, [], {}, [[]], {"": {}}, ["x"], {"a": 1}, "1", *TEXTS),
)


def odd_value(data: bytes, rng: np.random.Generator) -> bytes:
    """A value somewhere in JSON becomes one of another type, size or meaning."""
    return _with_value(data, rng, ODD)


def odd_text(data: bytes, rng: np.random.Generator) -> bytes:
    """A string somewhere in JSON becomes one that means something to terminals, pages, encoders or file systems."""
    return _with_value(data, rng, TEXTS, str)


def odd_key(data: bytes, rng: np.random.Generator) -> bytes:
    """A name in JSON becomes such a text."""
    value = json.loads(data)
    places = [holder for holder, _ in _places(value) if isinstance(holder, dict)]
    holder = places[int(rng.integers(len(places)))]
    key = list(holder)[int(rng.integers(len(holder)))]
    holder[TEXTS[int(rng.integers(len(TEXTS)))]] = holder.pop(key)
    return json.dumps(value).encode()


def _with_value(data: bytes, rng: np.random.Generator, values: tuple[Json, ...], kind: type = object) -> bytes:
    value = json.loads(data)
    found = list(_places(value))
    places = [(holder, key) for holder, key in found if isinstance(holder[key], kind)] or found
    holder, key = places[int(rng.integers(len(places)))]
    holder[key] = values[int(rng.integers(len(values)))]
    return json.dumps(value).encode()


def _places(value: Json) -> Iterator[tuple[Json, Json]]:
    """(what holds it, key or index) of every value inside."""
    for key in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield value, key
        yield from _places(value[key])


def odd_csv(data: bytes, rng: np.random.Generator) -> bytes:
    """A cell of a table is another one, a column or a line is gone, there twice, or there without end."""
    rows = list(csv.reader(io.StringIO(data.decode(), newline="")))
    row, column = int(rng.integers(len(rows))), int(rng.integers(len(rows[0])))
    kind, odd = int(rng.integers(8)), (*(text for text in TEXTS if text.isascii()), *CELLS)
    cell = odd[int(rng.integers(len(odd)))]
    if kind < 3:
        rows[row][column] = cell
    elif kind == 3:
        rows = [own[:column] + own[column + 1 :] for own in rows]
    elif kind == 4:
        rows = [[*own, cell if rng.random() < 0.5 else own[column]] for own in rows]
        rows[0][-1] = rows[0][column]
    elif kind == 5:
        rows[row : row + 1] = [rows[row]] * int(rng.choice([0, 2, 100_000]))
    elif kind == 6:
        rows[row] = [*rows[row][: int(rng.integers(len(rows[0]) + 1))], *[cell] * int(rng.choice([0, 3, 10_000]))]
    else:
        rows[1:] = [own[::-1] for own in rows[:0:-1]]
    text = io.StringIO()
    csv.writer(
        text, delimiter=",;\t"[int(rng.integers(30)) // 28], lineterminator="\r\n"[int(rng.integers(3)) :]
    ).writerows(rows)
    return (b"", b"\xef\xbb\xbf", b"\xff\xfe")[int(rng.integers(20)) // 18] + text.getvalue().encode()


def odd_weights(data: bytes, rng: np.random.Generator) -> bytes:
    """Some weights become NaN or infinite; all else stays right."""
    start = 8 + int.from_bytes(data[:8], "little")
    values = np.frombuffer(data[start:], np.float32).copy()
    values[rng.integers(len(values), size=int(rng.integers(1, 50)))] = (np.nan, np.inf)[int(rng.integers(2))]
    return data[:start] + values.tobytes()


NUMBER_KINDS = {"F8_E4M3": 1, "F8_E5M2": 1, "F8_E8M0": 1, "C64": 8, "F16": 2, "F64": 8, "I32": 4, "BOOL": 1}
"""What safetensors knows, with the bytes that one takes."""


def odd_tensors(data: bytes, rng: np.random.Generator) -> bytes:
    """The last tensor holds another kind of numbers, or what stands beside the tensors is nested without end."""
    start = 8 + int.from_bytes(data[:8], "little")
    head, body = json.loads(data[8:start]), data[start:]
    if rng.random() < 0.25:
        head["__metadata__"] = {"values": "[" * 100_000}
    else:
        tensors = [one for name, one in head.items() if name != "__metadata__"]
        last = max(tensors, key=lambda one: one["data_offsets"][1])
        last["dtype"] = sorted(NUMBER_KINDS)[int(rng.integers(len(NUMBER_KINDS)))]
        begin, end = last["data_offsets"]
        size = (end - begin) // 4 * NUMBER_KINDS[last["dtype"]]
        last["data_offsets"], body = [begin, begin + size], body[:begin] + (body[begin:end] * 2)[:size]
    text = json.dumps(head).encode()
    return struct.pack("<Q", len(text)) + text + body


def _replace(pattern: bytes, data: bytes, by: bytes, rng: np.random.Generator) -> bytes:
    """One of the pattern's places, or garbage where there is none."""
    found = list(re.finditer(pattern, data))
    if not found:
        return garbage(data, rng)
    match = found[int(rng.integers(len(found)))]
    return data[: match.start()] + by + data[match.end() :]


ANY: tuple[Damage, ...] = (
    truncated,
    flipped,
    zeroed,
    removed,
    repeated,
    absurd_length,
    pickled,
    bomb,
    nothing,
    garbage,
)
JSON: tuple[Damage, ...] = (odd_value, odd_value, odd_text, odd_key)
"""Of what is JSON all over: the file stays valid."""
TEXT: tuple[Damage, ...] = (
    *ANY,
    other_number,
    other_number,
    other_path,
    other_path,
    lost_word,
    huge_word,
    deep,
    laughs,
)


def damage(file: Path, ways: tuple[Damage, ...], rng: np.random.Generator) -> str:
    """Damage the file, or put something else in its place; returns what was done."""
    if rng.random() < 0.08:
        return _replaced(file, rng)
    way = ways[int(rng.integers(len(ways)))]
    file.write_bytes(way(file.read_bytes(), rng))
    return way.__name__


def _replaced(file: Path, rng: np.random.Generator) -> str:
    """A link out of the folder, to itself or to a device that never ends; a pipe; a folder; a hole of 30 GB."""
    targets = ("/etc/passwd", file.name, "/dev/zero", "../outside")
    kind = int(rng.integers(len(targets) + 3))
    file.unlink()
    if kind < len(targets):
        file.symlink_to(targets[kind])
        return f"link to {targets[kind]}"
    if kind == len(targets):
        os.mkfifo(file)
    elif kind == len(targets) + 1:
        file.mkdir()
    else:
        with open(file, "wb") as sparse:
            sparse.truncate(30_000_000_000)
    return ("pipe", "folder", "hole of 30 GB")[kind - len(targets)]
