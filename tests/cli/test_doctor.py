"""The doctor finishes whatever is broken, and every failure comes with its mend."""

import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from busybot.cli import doctor
from busybot.sim import vulkan_check as probe
from tests.cli.commands import busybot
from tests.conftest import ROOT

# A package of this name that comes first on the path and fails like a missing shared library.
BROKEN = "raise ImportError('libGL.so.1: cannot open shared object file')"


def run(*args: str, **environment: str) -> tuple[int, dict[str, Any]]:
    command = [sys.executable, "-m", "busybot", "doctor", "--json", *args]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)
    return done.returncode, json.loads(done.stdout)


def row(report: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [check for check in report["checks"] if check["name"] == name]
    return dict(found)


@pytest.mark.long
def test_json_has_the_documented_keys_and_agrees_with_the_exit_code() -> None:
    done = busybot("doctor", "--json")
    code, report = done.returncode, json.loads(done.stdout)
    assert set(report) == {"ok", "checks"}
    assert all(set(check) == {"name", "ok", "value", "hint"} for check in report["checks"])
    assert report["ok"] == all(check["ok"] for check in report["checks"]) == (code == 0)
    assert all(check["hint"] for check in report["checks"] if not check["ok"])


def test_works_when_sapien_and_torch_cannot_be_imported(tmp_path: Path) -> None:
    for name in ("sapien", "torch"):
        (tmp_path / f"{name}.py").write_text(BROKEN)
    code, report = run(PYTHONPATH=str(tmp_path))
    assert code == 1 and report["ok"] is False
    for name in ("import sapien", "import torch", "rendering"):
        assert not row(report, name)["ok"]
        assert "libGL.so.1" in row(report, name)["value"]
        assert "make setup" in row(report, name)["hint"]
    assert row(report, "packages")["ok"], "they are installed all the same"


@pytest.mark.long
def test_a_driver_that_cannot_render_is_named(tmp_path: Path) -> None:
    code, report = run(VK_DRIVER_FILES=str(tmp_path / "none.json"))
    assert code == 1
    assert not row(report, "rendering")["ok"]
    assert row(report, "rendering")["hint"].startswith("unset VK_DRIVER_FILES")
    assert row(report, "import sapien")["ok"]


def test_a_named_folder_without_objects_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSYBOT_PARTNET_DIR", str(tmp_path))
    real = doctor.assets()[-1]
    assert not real.ok and str(tmp_path) in real.value and real.hint is not None
    (tmp_path / "Lamp" / "13491").mkdir(parents=True)
    real = doctor.assets()[-1]
    assert real.ok and real.value.endswith(": 1 Lamp")


def test_real_objects_are_counted(partnet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSYBOT_PARTNET_DIR", str(partnet))
    assert doctor.assets()[-1].value.endswith("41 Switch, 10 Door, 5 Lamp, 2 Toy")


def test_the_device_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for named, ok, words in ((None, True, "auto: "), ("cpu", True, "cpu"), ("cuda:99", False, "cuda:99 is not there")):
        if named:
            monkeypatch.setenv("BUSYBOT_DEVICE", named)
        *_, check = doctor.gpu()
        assert check.name == "device" and check.ok is ok and check.value.startswith(words)
        assert (check.hint is None) is ok


FAKE_TORCH = """
class cuda:
    is_available = staticmethod(lambda: True)

class ones:
    def __init__(self, rows, columns, device):
        assert device == "cuda"
        self.count = rows * columns
    def sum(self):
        return self
    def item(self):
        return self.count
"""


def gpu_beside(tmp_path: Path, sapien: str, monkeypatch: pytest.MonkeyPatch) -> list[doctor.Check]:
    """What is told where a driver lists a GPU, torch uses it, and sapien does this when it is imported."""
    (tmp_path / "nvidia-smi").write_text("#!/bin/sh\necho 'NVIDIA Imagined'\n")
    (tmp_path / "nvidia-smi").chmod(0o755)
    (tmp_path / "torch.py").write_text(FAKE_TORCH)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    sapien_that(tmp_path, sapien, monkeypatch)
    return doctor.gpu()


def test_without_a_gpu_nothing_is_drawn_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor.shutil, "which", lambda name: None)
    assert [check.name for check in doctor.gpu()] == ["GPU", "device"]


@pytest.mark.parametrize(
    ("sapien", "limit", "words"),
    [
        ("import time; time.sleep(600)", 1.0, "did not end within 1 s"),
        ("import os; os.abort()", 60.0, "ended with code -6"),
        (BROKEN, 60.0, "libGL.so.1"),
    ],
)
def test_a_gpu_that_cannot_draw_while_it_computes_is_named(
    tmp_path: Path, sapien: str, limit: float, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "_device", lambda: doctor.Check("device", True, "auto"))
    monkeypatch.setattr(doctor, "TOGETHER_S", limit)
    gpus, together, _ = gpu_beside(tmp_path, sapien, monkeypatch)
    assert gpus.ok and gpus.value == "NVIDIA Imagined, CUDA"
    assert together.name == "CUDA and rendering" and not together.ok and words in together.value
    assert together.hint is not None and "pictures on the cores" in together.hint


DRAWS = """
import sys, torch
sys.modules["__main__"]._red_box_is_seen = lambda *_: True
Device = str
class render:
    class RenderSystem:
        def __init__(self, *on):
            pass
        class device:
            name = "Imagined"
"""


def test_torch_computes_before_and_after_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    together = gpu_beside(tmp_path, DRAWS, monkeypatch)[1]
    assert together.ok and together.value == "Imagined draws while torch computes" and together.hint is None
    together = gpu_beside(tmp_path, f"{DRAWS}\ntorch.ones.item = lambda self: 0", monkeypatch)[1]
    assert not together.ok and "does not compute as before" in together.value


@pytest.mark.long
def test_a_report_for_a_bug_tells_the_machine_but_not_whose_it_is(tmp_path: Path) -> None:
    home = tmp_path / "home of" / "ada-lovelace"
    (home / "secret-project").mkdir(parents=True)
    environment = {
        "HOME": str(home),
        "USER": "ada-lovelace",
        "LOGNAME": "ada-lovelace",
        "HF_TOKEN": "hf_abcdefgh12345",
        "BUSYBOT_PARTNET_DIR": str(home / "secret-project"),
        "BUSYBOT_CACHE": str(home / "cache of mine"),
    }
    command = [sys.executable, "-m", "busybot", "doctor", "--report"]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env=os.environ | environment | {"PYTHONPATH": path},
        cwd=home / "secret-project",
    )
    assert done.returncode == 0, done.stderr
    private = ("lovelace", "secret-project", "home of", "of mine", "hf_abc")  # "ada" a hash may hold by chance
    for words in (*private, str(tmp_path), sys.prefix, str(ROOT)):
        assert words not in done.stdout, words
    for words in ("| busybot | 0.1.0", platform.python_version(), "numpy ", "BUSYBOT_PARTNET_DIR", "What I did"):
        assert words in done.stdout
    assert "FAIL | PartNet-Mobility objects" in done.stdout


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("HOME/data/a.mcap is damaged", "(a path) is damaged"),
        ("cache HOME: full", "cache (a path): full"),
        ("C:\\Users\\ada\\x.mcap", "(a path)"),
        ("/data/clients/acme,/usr/share/vulkan/icd.d/a.json", "(a path),/usr/share/vulkan/icd.d/a.json"),
        ("s3 https://ada:pw1234@host/x", "s3 https://***@host/x"),
        ("token tok-123456 of grace-hopper.", "token *** of (the user)."),
        ("and/or, 3/4, cuda:0, 1e-5", "and/or, 3/4, cuda:0, 1e-5"),
    ],
)
def test_places_names_and_secrets_are_taken_out(text: str, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/grace-hopper")
    monkeypatch.setenv("LOGNAME", "grace-hopper")
    monkeypatch.setenv("MY_API_KEY", "tok-123456")
    assert doctor.nameless()(text.replace("HOME", "/home/grace-hopper")) == told


def test_packages_that_differ_have_a_row_each(monkeypatch: pytest.MonkeyPatch) -> None:
    versions = {"numpy": "1.0", "torch": "2.13.0+cpu", "sapien": None}
    wanted = ["numpy>=2.0", 'torch>=2.1; extra == "learn"', 'sapien>=3; extra == "sim"', 'moto; extra == "s3-server"']
    monkeypatch.setattr(doctor.metadata, "requires", lambda name: wanted)
    monkeypatch.setattr(doctor, "_pins", lambda: {"numpy": "2.4.6", "torch": "2.13.0", "sapien": "3.0.3", "rich": "1"})
    monkeypatch.setattr(doctor, "_version", versions.get)
    summary, numpy, sapien = doctor.packages()
    assert (summary.ok, summary.value) == (False, "1 of 3 as pinned")
    assert numpy.value == "1.0, pinned is 2.4.6"
    assert sapien.value == "absent, pinned is 3.0.3"
    monkeypatch.setattr(doctor, "_pins", dict)  # outside of the repository: what a light install needs
    assert [check.value for check in doctor.packages()] == ["1 of 1 are there"]


def test_the_lock_and_the_build_of_torch_are_what_is_pinned() -> None:
    pins = doctor._pins()
    assert {"numpy", "sapien", "torch", "rerun-sdk"} <= pins.keys() and all(pins[name][0].isdigit() for name in pins)
    (summary,) = [check for check in doctor.packages() if check.name == "packages"]
    assert summary.value.endswith("as pinned")


def test_a_deleted_folder_is_a_fault(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    (check,) = doctor.disk()
    assert not check.ok and "deleted" in check.value and "change into a folder" in str(check.hint)


def test_a_full_disk_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LEAST_FREE_BYTES", 1 << 60)
    (check,) = doctor.disk()
    assert not check.ok and check.hint is not None


def test_an_unforeseen_failure_is_a_row() -> None:
    def broken() -> list[doctor.Check]:
        raise RuntimeError("boom")

    (check,) = doctor._guarded(broken)
    assert (check.name, check.ok, check.value) == ("broken", False, "RuntimeError: boom")


def sapien_that(tmp_path: Path, does: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sapien.py").write_text(does)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def test_the_probe_survives_a_crash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sapien_that(tmp_path, "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", monkeypatch)
    found = probe.run()
    assert not found["renders"] and "code -11" in found["error"]


def test_the_probe_survives_a_hang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sapien_that(tmp_path, "import time; time.sleep(600)", monkeypatch)
    start = time.monotonic()
    found = probe.run(time_limit_s=1.0)
    assert not found["renders"] and "within 1 s" in found["error"]
    assert time.monotonic() - start < 300


def test_the_probe_survives_a_python_that_is_absent() -> None:
    assert "did not start" in probe.run("/no/such/python")["error"]


def test_the_probe_renders_here() -> None:
    """The set-up has brought a driver, and the driver tells its name and version."""
    found = probe.run()
    assert found["renders"], found["error"]
    assert found["device"] and found["driver"]
