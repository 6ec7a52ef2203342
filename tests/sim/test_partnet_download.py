"""Fetching with a downloader that stands in for SAPIEN's: what comes is inspected, and the token is seen nowhere."""

import io
import os
import stat
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from busybot.common.atomic_io import unfinished
from busybot.common.errors import BusybotError
from busybot.objects.importing.raw import read_raw
from busybot.sim.partnet_download import fetch
from tests.objects.raw_objects import ROCKER, make_raw

TOKEN = "secret+token/with=signs"
HEAD = """
import io, os, sys, zipfile
def download_partnet_mobility(model_id, token=None, directory=None):
    print("downloading from https://example.org/" + model_id + "?token=" + token)
    print("to stderr", token, file=sys.stderr)
"""
UNPACK = """
    archive = os.path.join(os.path.dirname(__file__), "archive.zip")
    zipfile.ZipFile(archive).extractall(directory)
"""


def downloader(monkeypatch: pytest.MonkeyPatch, folder: Path, body: str) -> None:
    """Let a package `sapien` with this downloader come first on the path of new processes."""
    (folder / "sapien").mkdir(parents=True)
    (folder / "sapien" / "__init__.py").write_text("")
    (folder / "sapien" / "asset.py").write_text(HEAD + body)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")])))


def archive(fake: Path, files: dict[str, bytes], links: dict[str, str] | None = None) -> None:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            packed.writestr(name, content)
        for name, target in (links or {}).items():
            info = zipfile.ZipInfo(name)
            info.external_attr = (stat.S_IFLNK | 0o777) << 16
            packed.writestr(info, target)
    (fake / "sapien" / "archive.zip").write_bytes(data.getvalue())


def packed_object(folder: Path) -> dict[str, bytes]:
    make_raw(folder / "77", "Switch", ROCKER)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    downloader(monkeypatch, tmp_path / "fake", UNPACK)
    return tmp_path / "fake"


def test_an_object_comes_whole_and_once(fake: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    archive(fake, packed_object(tmp_path / "made"))
    out = tmp_path / "out"
    assert fetch("77", out, TOKEN) is True
    assert read_raw(out / "77").category == "Switch"
    assert [path.name for path in out.iterdir()] == ["77"]
    assert fetch("77", out, TOKEN) is False
    shown = capfd.readouterr()
    assert TOKEN not in shown.out + shown.err


FAULTS = {
    "the token in the message": ('    raise Exception("bad url ?token=" + token)\n', "downloader failed"),
    "refused by the server": (
        '    raise Exception("Download PartNet-Mobility failed. Token " + token)\n',
        "the server refused",
    ),
    "offline": ('    raise ConnectionError("no route to host ?token=" + token)\n', "cannot be reached"),
    "offline, as requests says it": (
        "    class RequestException(IOError): pass\n    raise RequestException(token)\n",
        "cannot be reached",
    ),
    "no archive": ("    zipfile.ZipFile(io.BytesIO(token.encode()))\n", "not an archive"),
    "a crash": ("    os.abort()\n", "downloader failed"),
    "nothing comes": ("    pass\n", "no folder 77"),
    "a file instead": ('    open(os.path.join(directory, model_id), "w").close()\n', "no folder 77"),
    "a link instead": ('    os.symlink("/etc", os.path.join(directory, model_id))\n', "no folder 77"),
    "many files": (
        "    for k in range(5000):\n        open(os.path.join(directory, str(k)), 'w').close()\n    import time\n"
        "    time.sleep(60)\n",
        "larger than an object may be",
    ),
    "a file without end": (
        "    with open(os.path.join(directory, 'x'), 'wb') as file:\n        file.truncate(1 << 40)\n",
        "larger than an object may be",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_told_without_the_token(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    body, told = FAULTS[name]
    downloader(monkeypatch, tmp_path / "fake", body)
    with pytest.raises(BusybotError, match=told) as caught:
        fetch("77", tmp_path / "out", TOKEN)
    shown = capfd.readouterr()
    assert TOKEN not in str(caught.value) + repr(caught.value.__dict__) + shown.out + shown.err
    assert caught.value.hint and caught.value.__cause__ is None
    assert list((tmp_path / "out").iterdir()) == []


def test_a_bomb_is_stopped(fake: Path, tmp_path: Path) -> None:
    """Two gigabytes, in files of half the allowed size each."""
    archive(fake, {"77/0.bin": bytes(64 << 20)})
    again = "os.link(os.path.join(directory, '77', '0.bin'), os.path.join(directory, str(k)))"
    body = f"{UNPACK}    for k in range(32):\n        {again}\n"
    (fake / "sapien" / "asset.py").write_text(HEAD + body + "    import time\n    time.sleep(600)\n")
    start = time.monotonic()
    with pytest.raises(BusybotError, match="larger than an object may be"):
        fetch("77", tmp_path / "out", TOKEN)
    assert time.monotonic() - start < 300 and list((tmp_path / "out").iterdir()) == []


def test_a_download_that_hangs_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    downloader(monkeypatch, tmp_path / "fake", "    import time\n    time.sleep(600)\n")
    start = time.monotonic()
    with pytest.raises(BusybotError, match="cannot be reached"):
        fetch("77", tmp_path / "out", TOKEN, time_limit_s=1.0)
    assert time.monotonic() - start < 300


def test_parent_paths_and_links_in_the_archive_stay_inside(fake: Path, tmp_path: Path) -> None:
    files = packed_object(tmp_path / "made")
    archive(
        fake,
        files | {"../../escaped": b"x", "/tmp/busybot-escaped": b"x"},
        {"77/textured_objs/link.obj": "/etc/passwd"},
    )
    fetch("77", tmp_path / "out", TOKEN)  # unpacking makes plain files of them, outside of the object or unused
    assert not list(tmp_path.glob("**/escaped")) and not Path("/tmp/busybot-escaped").exists()
    assert not any(path.is_symlink() for path in (tmp_path / "out").rglob("*"))


def test_what_comes_is_inspected(fake: Path, tmp_path: Path) -> None:
    files = packed_object(tmp_path / "made")
    files["77/textured_objs/body.obj"] = b"mtllib ../../../secret.mtl\nv 0 0 0\nf 1 1 1\n"
    archive(fake, files)
    with pytest.raises(BusybotError, match="secret.mtl") as caught:
        fetch("77", tmp_path / "out", TOKEN)
    assert ".fetch-" not in caught.value.what, "the file is named where it would be"
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("instance", ["", "../1", "1?token=", "abc", "1" * 40])
def test_ids_are_numbers(instance: str, tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="not an id"):
        fetch(instance, tmp_path / "out", TOKEN)
    assert not (tmp_path / "out").exists()


def test_the_real_downloader_is_called_as_it_wants(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SAPIEN's own, with nobody listening behind the proxy: offline, and no token in sight."""
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("NO_PROXY", raising=False)
    monkeypatch.delenv("no_proxy", raising=False)
    with pytest.raises(BusybotError, match="cannot be reached"):
        fetch("100366", tmp_path / "out", TOKEN)


def test_the_token_is_in_no_argument(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    note = tmp_path / "arguments"
    downloader(
        monkeypatch,
        tmp_path / "fake",
        f"    open({str(note)!r}, 'wb').write(open('/proc/self/cmdline', 'rb').read())\n",
    )
    if not sys.platform.startswith("linux"):
        pytest.skip("reads /proc")
    with pytest.raises(BusybotError):
        fetch("77", tmp_path / "out", TOKEN)
    assert b"fetch" in note.read_bytes() and TOKEN.encode() not in note.read_bytes()


@pytest.mark.long
def test_what_a_killed_fetch_left_is_removed_and_its_download_ends(tmp_path: Path, fake: Path) -> None:
    """Also where the object is there already; what another running fetch is making stays."""
    files = packed_object(tmp_path / "made")
    archive(fake, files)
    note = tmp_path / "downloader"
    slow = f"    open({str(note)!r}, 'w').write(str(os.getpid()))\n    import time\n    time.sleep(600)\n"
    (fake / "sapien" / "asset.py").write_text(HEAD + UNPACK + slow)
    out = tmp_path / "out"
    code = "import pathlib, sys; from busybot.sim.partnet_download import fetch\n"
    code += "fetch('77', pathlib.Path(sys.argv[1]), 'token')"
    killed = subprocess.Popen([sys.executable, "-c", code, str(out)])
    wait_until(lambda: note.exists() and note.read_text() != "")
    killed.kill()
    killed.wait()
    wait_until(lambda: not Path(f"/proc/{note.read_text()}").exists())
    (left,) = out.iterdir()
    (fake / "sapien" / "asset.py").write_text(HEAD + UNPACK)
    with unfinished(out, "fetch") as running:
        assert fetch("77", out, TOKEN) and not left.exists() and running.exists()
    left.mkdir()
    assert not fetch("77", out, TOKEN)
    assert [path.name for path in out.iterdir()] == ["77"]


def wait_until(fact: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not fact():
        assert time.monotonic() < deadline
        time.sleep(0.05)
