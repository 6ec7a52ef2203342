"""The paper's graph networks trained elsewhere: what travels is whole, and weights are those of the usual command."""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from benchmarks.gpu import everything, formats, interact, train
from benchmarks.gpu import pack as packing
from benchmarks.gpu.formats import METRICS, PACK, RUN, PackedBoards, packed, read_pack, read_run, write_pack, write_run
from benchmarks.gpu.unpack import unpack, unpack_interaction
from benchmarks.tables.table2 import Table2Row
from busybot.cli.main import app
from busybot.common.atomic_io import write_json
from busybot.common.errors import BusybotError, UsageError
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.training.config import PaperConfig
from busybot.reason.inputs.sequence import BoardSequence
from busybot.training.checkpoint import load_tensors
from tests.conftest import ROOT
from tests.reason.boards import make_boards
from tests.reason.models.test_imports import ALLOWED, of, strangers

WIDTHS = ("embedding", "edge_embedding", "action", "hidden", "convolution", "recurrent")
SMALL = f"network: {{{', '.join(f'{name}: 4' for name in WIDTHS)}}}\nencoder: embedded\nimages: 9\nepochs: 8\n"
SMALL += "batch: 5\nthreads: 1\n"
"""Networks too small to learn anything, 24 iterations."""

ALONE = """
import runpy, sys

class Only:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        there = top.startswith("_") or top in sys.stdlib_module_names or top in {THERE}
        return self.finder.find_spec(name, path, target) if there else None

sys.meta_path[:] = map(Only, sys.meta_path)
runpy.run_module("{MODULE}", run_name="__main__", alter_sys=True)
"""
THERE = {"benchmarks", "busybot", "numpy", "torch", "torchgen", "functorch"}
THERE |= {"sympy", "mpmath", "networkx", "jinja2", "markupsafe", "filelock", "fsspec", "typing_extensions"}
"""With what torch needs itself; nothing else can be imported but what is packed (`packing.WHEELS`)."""


def equal(one: BoardSequence, other: BoardSequence) -> bool:
    pairs = zip(one.arrays.values(), other.arrays.values(), strict=True)
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs)


def as_stored(boards: Iterable[BoardSequence]) -> list[BoardSequence]:
    """With features of the precision in which they are stored."""
    return [
        BoardSequence(**one.arrays | {"features": one.features.astype(np.float16).astype(np.float32)}) for one in boards
    ]


def test_packed_boards_are_what_they_were() -> None:
    boards = as_stored(board.seen for steps in (4, 30) for board in make_boards(3, seed=steps, steps=steps))
    assert len({len(board.positions) for board in boards}) > 1
    again = PackedBoards([packed(boards[:4]), packed(boards[4:])])
    assert len(again) == 6 and all(map(equal, again, boards))
    long = as_stored(board.seen for board in make_boards(6, noise=0))
    raw = sum(values.nbytes for board in long for values in board.arrays.values())
    assert len(packed(long)) < raw / 15, "an appearance is packed once"


FACTS = {"commit": None, "data": [], "features": "random-0", "oracle": False, "rows": {}}


def test_a_pack_that_was_changed_is_refused(tmp_path: Path) -> None:
    boards = as_stored(board.seen for board in make_boards(5, steps=3))
    info = write_pack(tmp_path, boards, each=2, **FACTS)
    assert (info.boards, len(info.files)) == (5, 3)
    assert all(map(equal, read_pack(tmp_path)[1], boards))
    file = tmp_path / "boards-001.safetensors.xz"
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    with pytest.raises(BusybotError, match="boards-001.*its SHA-256 is not the recorded one"):
        read_pack(tmp_path)
    (tmp_path / PACK).write_text((tmp_path / PACK).read_text().replace('"1"', '"2"'))
    with pytest.raises(BusybotError, match="format"):
        read_pack(tmp_path)


def test_a_pack_whose_files_do_not_hold_what_it_says_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    boards = as_stored(board.seen for board in make_boards(2, steps=3))
    short = [replace(board, actions=board.actions[:-1]) for board in boards]
    write_pack(tmp_path / "short", short, each=2, **FACTS)
    with pytest.raises(BusybotError, match="damaged: acted has 6 rows, its boards 4"):
        read_pack(tmp_path / "short")
    write_pack(tmp_path / "pack", boards, each=2, **FACTS)
    told = (tmp_path / "pack" / PACK).read_text()
    (tmp_path / "pack" / PACK).write_text(told.replace('"boards": 2', '"boards": 7'))
    with pytest.raises(BusybotError, match="2 boards of 7"):
        read_pack(tmp_path / "pack")
    monkeypatch.setattr(formats, "MAX_BOARDS_BYTES", 1 << 10)
    with pytest.raises(BusybotError, match="damaged: cut off, or more than 0 MiB"):
        read_pack(tmp_path / "pack")


@pytest.mark.parametrize("words", [("--seed", "-1"), ("--checkpoint", "0")])
def test_what_would_be_told_after_the_training_is_told_before(
    words: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = [word for name in ("--pack", "--work", "--out") for word in (name, str(tmp_path / name[2:]))]
    monkeypatch.setattr(sys, "argv", ["train", *places, "--row", "paper", *words])
    monkeypatch.setattr(train, "train", lambda arguments: pytest.fail("it trains"))
    with pytest.raises(SystemExit):
        train.main()
    assert "--seed counts from 0, --checkpoint from 1" in capsys.readouterr().err
    with pytest.raises(UsageError, match="--each 0"):
        packing.main(["--data", str(tmp_path), "--out", str(tmp_path / "pack"), "--each", "0"])


@pytest.mark.parametrize("half", [False, True])
def test_weights_travel_in_files_of_a_size(tmp_path: Path, half: bool) -> None:
    tensors = {f"{number}.weight": torch.randn(50, 50) for number in range(5)} | {"bias": torch.randn(50)}
    tensors["count"] = torch.tensor(7)
    facts = {"pack": "0", "row": "paper", "seed": 0, "iterations": 1, "schedule": 2, "seconds": 1.0, "figures": {}}
    facts |= {"machine": {}, "versions": {}, "commit": None, "half": half}
    write_run(tmp_path, tensors, b"{}\n", 600, **facts)
    told, again = read_run(tmp_path)
    assert len(told.files) > 20, "one tensor lies in several files"
    assert all(torch.allclose(again[name], value, atol=2e-3 * half, rtol=0) for name, value in tensors.items())
    info = write_run(tmp_path, tensors, b"{}\n", 12_000, **facts)
    assert len(info.files) == 1 + (3 if half else 5), "losses and weights"
    assert {file.name for file in tmp_path.iterdir()} == {*info.files, RUN}, "what is not of this run is gone"
    assert all((tmp_path / name).stat().st_size < 12_000 for name in info.files)
    told, again = read_run(tmp_path)
    assert told == info and again.keys() == tensors.keys()
    assert all(torch.allclose(again[name], value, atol=2e-3 * half, rtol=0) for name, value in tensors.items())
    assert torch.equal(again["bias"], tensors["bias"]) and again["count"].dtype == torch.int64


def test_rows_are_those_of_table_2_that_train_on_all_boards() -> None:
    found = packing.trainings(["paper", "paper-without-inference"], None)
    assert [config.inference for config in found.values()] == [True, False]
    assert {(config.epochs, config.batch, config.network.pairs) for config in found.values()} == {(200, 64, "all")}
    for name, words in (("paper-short", "not train on all boards"), ("event", "none of the paper's networks")):
        with pytest.raises(BusybotError, match=words):
            packing.trainings([name], None)


def test_packages_come_in_the_locks_versions() -> None:
    text = packing.locked(list(packing.WHEELS))
    assert text.count("==") == len(packing.WHEELS) and text.count("sha256:") >= len(packing.WHEELS)
    with pytest.raises(BusybotError, match="lock.txt has no nosuchpackage"):
        packing.locked(["nosuchpackage"])


def test_training_imports_nothing_but_what_computes() -> None:
    found = [strangers(of(module), {}) for module in (train, formats, everything)]
    assert set().union(*found) - ALLOWED == {"benchmarks"}


def alone(module: str, there: set[str], *words: object) -> list[str]:
    """A command where nothing but this can be imported."""
    code = ALONE.replace("{THERE}", repr(sorted(there))).replace("{MODULE}", module)
    return [sys.executable, "-c", code, *map(str, words)]


def training(folder: Path, *words: str) -> list[str]:
    """The command where nothing but what trains can be imported."""
    there = THERE | {name.replace("-", "_") for name in packing.WHEELS}
    places = ("--pack", folder / "pack", "--row", "paper", "--work", folder / "work", "--out", folder / "out")
    return alone("benchmarks.gpu.train", there, *places, "--checkpoint", "3", *words)


def usual(folder: Path, data: Path, out: str) -> list[str]:
    words = ["train", "reason", "--variant", "paper", "--data", str(data), "--out", str(folder / out)]
    return [*words, "--config", str(folder / "small.yaml"), "--workers", "1", "--json"]


@pytest.mark.long
def test_there_and_back_with_a_kill_between(tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "small.yaml").write_text(SMALL)
    places = ["--data", str(tiny), "--out", str(tmp_path / "pack"), "--config", str(tmp_path / "small.yaml")]
    monkeypatch.setitem(packing.ROWS, "paper", Table2Row(train=("--variant", "paper")))  # no encoder to download
    packing.main([*places, "--rows", "paper", "--workers", "1"])
    environment = os.environ | {"PYTHONPATH": str(ROOT)}

    checkpoint = tmp_path / "work" / "checkpoints" / "paper.safetensors"
    killed = subprocess.Popen(training(tmp_path), env=environment, stderr=subprocess.DEVNULL)
    while killed.poll() is None and not checkpoint.exists():
        time.sleep(0.005)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert checkpoint.exists() and not (tmp_path / "out").exists()
    out_of_time = subprocess.run([*training(tmp_path), "--minutes", "0.0001"], env=environment, capture_output=True)
    assert out_of_time.returncode == 0, out_of_time.stderr
    told, _ = read_run(tmp_path / "out")
    assert told.iterations < told.schedule == 24
    unpack(tmp_path / "pack", tmp_path / "out", tmp_path / "unfinished")
    assert not (tmp_path / "unfinished" / "train.json").exists(), "it is no row of the table"
    done = subprocess.run(training(tmp_path), env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr
    told, tensors = read_run(tmp_path / "out")
    assert told.iterations == told.schedule and len((tmp_path / "out" / METRICS).read_text().splitlines()) == 5

    run = CliRunner().invoke(app, usual(tmp_path, tiny, "straight"))
    assert run.exit_code == 0, run.stderr
    expected = load_tensors(tmp_path / "straight" / "model" / "weights.safetensors").tensors
    assert expected.keys() == tensors.keys()
    assert all(torch.equal(tensors[name], value) for name, value in expected.items())

    at_once = ["--pack", tmp_path / "pack", "--work", tmp_path / "all", "--out", tmp_path / "back", "--minutes", "5"]
    command = [sys.executable, "-m", "benchmarks.gpu.everything", *map(str, at_once), "--device", "cpu"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and "paper: 24 of 24 in" in done.stdout, done.stderr
    assert all(torch.equal(tensors[name], value) for name, value in read_run(tmp_path / "back" / "paper")[1].items())

    unpack(tmp_path / "pack", tmp_path / "out", tmp_path / "paper-0")
    again = CliRunner().invoke(app, usual(tmp_path, tiny, "paper-0"))
    assert again.exit_code == 0, again.stderr
    card = json.loads(again.stdout)["training"]
    assert card["pack_sha256"] == told.pack and card["machine"]["gpu"] is None, "found trained, not trained again"
    assert card["iterations"] == 24 and card["boards"] == 12
    judged = CliRunner().invoke(app, ["eval", "reason", str(tiny), "--reasoner", str(tmp_path / "paper-0"), "--json"])
    assert judged.exit_code == 0, judged.stderr
    assert json.loads(judged.stdout)["boards"] == 12


def test_one_command_has_the_minutes_for_all_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Graph networks to their end, then interaction networks in equal parts of what is left; what failed is told."""
    boards = as_stored(board.seen for board in make_boards(2, steps=3))
    for name, rows in (("one", {"b": {}, "a": {}}), ("two", {"c": {}})):
        write_pack(tmp_path / name, boards, each=2, **FACTS | {"rows": rows})
    words = ["--pack", *(str(tmp_path / name) for name in ("one", "two")), "--work", str(tmp_path / "work")]
    words += ["--out", str(tmp_path / "out"), "--assets", "objects", "--interact", "paper", "paper-rgb", "--half"]
    facts = {"pack": None, "seed": 0, "figures": {}, "machine": {}, "versions": {}, "commit": None, "half": False}
    ran: list[dict[str, str]] = []

    def run(command: list[str]) -> subprocess.CompletedProcess[str]:
        asked = dict(zip(command, command[1:], strict=False))
        out, whole = Path(asked["--out"]), asked["--row"] in ("a", "b")
        ran.append(asked)
        if asked["--row"] != "paper":
            share = {"iterations": 8 if whole or out.exists() else 2, "schedule": 8, "seconds": 120.0}
            write_run(out, {}, b"", 1, row=asked["--row"], **facts, **share)
        return subprocess.CompletedProcess(command, int(asked["--row"] == "paper"))

    monkeypatch.setattr(subprocess, "run", run)
    assert everything.main([*words, "--minutes", "30"]) == 1, "one failed"
    assert [(one["-m"].rpartition(".")[2], one["--row"]) for one in ran] == [
        ("train", "a"), ("train", "b"), ("train", "c"), ("interact", "paper"), ("interact", "paper-rgb")
    ]  # fmt: skip
    minutes = [float(one["--minutes"]) for one in ran]
    assert minutes == pytest.approx([29.5, 29.5, 29.5, 12.5, 27.5], abs=0.1)
    ran.clear()
    everything.main([*words, "--minutes", "10"])
    assert [one["--row"] for one in ran] == ["c", "paper", "paper-rgb"], "what came to its end is left out"
    assert float(ran[0]["--minutes"]) == pytest.approx(9.5, abs=0.1)
    (tmp_path / "out" / "c" / METRICS).write_text("killed while it wrote")
    assert everything.brought_back(tmp_path / "out" / "c") is not None, "weights are looked at later"
    ran.clear()
    assert everything.main([*words, "--minutes", "0.1"]) == 0 and not ran
    with pytest.raises(BusybotError, match="a, b: trained twice"):
        everything.main([*words[:2], *words[1:2], *words[3:]])
    places = words[3:7]
    for wrong, told in (([], "name a --pack"), (["--interact", "paper"], "--interact needs --assets")):
        with pytest.raises(SystemExit):
            everything.main([*places, *wrong])
        assert told in capsys.readouterr().err


def test_a_run_of_another_pack_is_refused(tmp_path: Path) -> None:
    boards = as_stored(board.seen for board in make_boards(2, steps=3))
    write_pack(tmp_path / "pack", boards, each=2, **FACTS)
    facts = {"pack": "0", "row": "paper", "seed": 0, "iterations": 1, "schedule": 1, "seconds": 1.0, "figures": {}}
    write_run(tmp_path / "run", {}, b"", 1, **facts, machine={}, versions={}, commit=None, half=False)
    with pytest.raises(BusybotError, match="trained on another pack"):
        unpack(tmp_path / "pack", tmp_path / "run", tmp_path / "out")
    assert not (tmp_path / "out").exists() and (tmp_path / "run" / RUN).exists()


FEW = """
epochs: 3
boards: 4
steps: 10
random_epochs: 1
all_directions_epochs: 2
joint_epochs: 2
position: {batch: 2, iterations: 2}
direction: {batch: 2, iterations: 2}
threads: 1
render: {width: 160, height: 120}
interaction: {delta: 10}
"""


def normalised(package: str) -> str:
    return package.lower().replace("_", "-")


def test_a_share_of_the_schedule_in_larger_epochs_has_that_share_of_everything() -> None:
    whole = PaperConfig()
    assert PaperConfig.model_validate(interact.scaled(1, 1) | {"checkpoint": whole.checkpoint}) == whole
    half = PaperConfig.model_validate(interact.scaled(0.5, 4))
    assert (half.epochs, half.boards) == (whole.epochs // 8, 4 * whole.boards)
    for kind in KINDS:
        assert _iterations(half, kind) / _iterations(whole, kind) == pytest.approx(0.5, abs=0.05)
        assert 4 * _random_epochs(half, kind) / _random_epochs(whole, kind) == pytest.approx(0.5, abs=0.05)
    for share, merge in ((0, 4), (1.5, 4), (0.001, 4), (1, 0), (1, -4), (1, 401)):
        with pytest.raises(BusybotError, match="no epoch is left"):
            interact.scaled(share, merge)


def _iterations(config: PaperConfig, kind: Kind) -> int:
    return config.learn(kind).iterations * sum(kind in config.trained(epoch) for epoch in range(config.epochs))


def _random_epochs(config: PaperConfig, kind: Kind) -> float:
    return sum(config.epsilon(kind, epoch) for epoch in range(config.epochs))


def test_what_another_training_learned_is_not_brought_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`busybot train interact` refuses a folder of other parameters; what lies there has another row's name."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "weights").write_text("of another row")
    monkeypatch.setattr(interact, "train", lambda command, minutes, enough: 1)
    monkeypatch.setattr(interact, "bring_back", lambda arguments, seconds: pytest.fail("brought back"))
    with pytest.raises(BusybotError, match="ended with code 1, and learned nothing"):
        interact.main(["--assets", "x", "--row", "paper-rgb", "--work", str(work), "--out", str(tmp_path / "back")])
    assert not (tmp_path / "back").exists() and not (tmp_path / "work.seconds.json").exists()


ENDLESS = """import pathlib, sys, time
pathlib.Path(sys.argv[1], "began").touch()
try:
    time.sleep(60)
except KeyboardInterrupt:
    pathlib.Path(sys.argv[1], "interrupted").touch()
"""
"""A training that ends only if it is interrupted."""


def test_a_training_is_interrupted_after_so_many_epochs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interact.runner, "BUSYBOT", (sys.executable, "-c", ENDLESS))
    monkeypatch.setattr(interact, "LOOK_S", 0.05)
    assert interact.epochs_learned(tmp_path) == 0, "nothing was asked where to act"

    def enough() -> bool:
        if (tmp_path / "began").exists():
            write_json(tmp_path / "current" / "model.json", {"training": {"epochs": 21}})
        return interact.epochs_learned(tmp_path) >= 21

    assert interact.train((str(tmp_path),), 1, enough) is None and (tmp_path / "interrupted").exists()


@pytest.mark.long
def test_interaction_networks_there_and_back(tmp_path: Path, few_objects: Callable[[int], Path]) -> None:
    """Interrupted before anything is learned, then to the end, where nothing can be imported but what travels."""
    (tmp_path / "few.yaml").write_text(FEW)
    work, back, model = tmp_path / "work", tmp_path / "back", tmp_path / "model"
    options = ("--assets", few_objects(0), "--config", tmp_path / "few.yaml", "--workers", "1")
    there = [*map(str, ("--row", "paper", "--work", work, "--out", back, "--half", "--file-mb", "10", *options))]
    with pytest.raises(BusybotError, match="no network was asked yet"):
        interact.main([*there, "--minutes", "0.0001"])
    travel = {*packing.WHEELS, *packing.SIMULATOR}
    there_too = {name for name, packages in packages_distributions().items() if travel & set(map(normalised, packages))}
    asked = ("train", "interact", "--variant", "paper", "--out", work, *options)
    done = subprocess.run(
        alone("busybot", THERE | there_too, *asked),
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    interact.main(there)
    told, _ = read_run(back)
    assert (told.iterations, told.schedule, told.row, told.pack) == (3, 3, "paper", None) and told.seconds > 0
    assert all((back / name).stat().st_size <= 10_000_000 for name in told.files)
    of = [json.loads(line)["of"] for line in (back / METRICS).read_text().splitlines()]
    assert of.count("epochs") == 3
    unpack_interaction(back, model)
    first, second = load_model(work), load_model(model)
    assert second.info.training["machine"]["gpu"] is None and second.info.training["epochs"] == 3
    for kind, network in first.networks.items():
        others = second.networks[kind].state_dict()
        assert all(torch.allclose(value, others[name], atol=1e-3) for name, value in network.state_dict().items())
    with pytest.raises(BusybotError, match="it exists"):
        unpack_interaction(back, model)
    with pytest.raises(BusybotError, match="leave --pack out"):
        write_pack(tmp_path / "pack", as_stored(b.seen for b in make_boards(1, steps=3)), each=1, **FACTS)
        unpack(tmp_path / "pack", back, tmp_path / "graph")

    before = Path(work, "current")
    (work / "model").rename(tmp_path / "ended")
    arguments = argparse.Namespace(work=work, out=tmp_path / "cut", row="paper", seed=0, file_mb=100, half=False)
    cut = interact.bring_back(arguments, 1.0)
    assert cut.iterations < cut.schedule == 3, "cut off, what comes back is of the last whole epoch"
    unpack_interaction(tmp_path / "cut", tmp_path / "unfinished")
    for kind, network in load_model(before).networks.items():
        others = load_model(tmp_path / "unfinished").networks[kind].state_dict()
        assert all(torch.equal(value, others[name]) for name, value in network.state_dict().items())


@pytest.mark.parametrize(
    ("names", "words"),
    [(("a", "a#0"), "of a there are"), (("a#0", "a#2"), "of a there are the pieces 0, 2"), (("a#x",), "the pieces x")],
)
def test_pieces_that_are_no_whole_are_refused(tmp_path: Path, names: tuple[str, ...], words: str) -> None:
    facts = {"pack": None, "row": "paper", "seed": 0, "iterations": 1, "schedule": 2, "seconds": 1.0, "figures": {}}
    facts |= {"machine": {}, "versions": {}, "commit": None, "half": False}
    write_run(tmp_path, {name: torch.ones(2, 2) for name in names}, b"", 10_000, **facts)
    with pytest.raises(BusybotError, match=words):
        read_run(tmp_path)


def test_a_card_of_other_networks_is_refused(tmp_path: Path) -> None:
    facts = {"pack": None, "row": "paper", "seed": 0, "iterations": 1, "schedule": 2, "seconds": 1.0}
    facts |= {"machine": {}, "versions": {}, "commit": None, "half": False}
    for figures, words in (({}, "variant fast, not paper"), ({"variant": "other"}, "run.json: variant")):
        write_run(tmp_path, {}, b"", 1000, **facts, figures=figures)
        with pytest.raises(BusybotError, match=words):
            unpack_interaction(tmp_path, tmp_path / "model")
    assert not (tmp_path / "model").exists()
