"""The cluster engine: the same datasets as the local one, faults told, the dead replaced, nobody listens outside."""

import contextlib
import ipaddress
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
import yaml

from busybot.common.errors import BusybotError
from busybot.common.process_pool import LOOPBACK, ONLY_HERE, run_on_ray

os.environ[ONLY_HERE] = "0"  # Ray reads it when it is imported

ray = pytest.importorskip("ray", reason="Ray is not installed: `make extras`")
pytestmark = pytest.mark.long
GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "cluster"


@pytest.fixture(scope="module", autouse=True)
def no_cluster_of_others() -> Iterator[None]:
    assert "RAY_ADDRESS" not in os.environ, "these tests start a cluster of their own"
    yield


def is_local(address: str) -> bool:
    parsed = ipaddress.ip_address(address)
    inner = getattr(parsed, "ipv4_mapped", None)
    return (inner or parsed).is_loopback


def squares(offset: int) -> Callable[[int], int]:
    return lambda task: task * task + offset


def dying(folder: str) -> Callable[[int], int]:
    def work(task: int) -> int:
        marker = Path(folder) / str(task)
        if task == 1 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return task

    return work


def faulty() -> Callable[[int], int]:
    def work(task: int) -> int:
        raise BusybotError(f"board {task} is broken", "mend it")

    return work


def test_every_task_is_done_once_and_nobody_listens_outside() -> None:
    results, open_to_all = {}, set()
    for task, result in run_on_ray(range(20), squares, (7,), workers=2, recycle=6):
        results[task] = result
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                listening = [one for one in process.net_connections("inet") if one.status == psutil.CONN_LISTEN]
                open_to_all |= {(process.name(), one.laddr) for one in listening if not is_local(one.laddr.ip)}
    assert results == {task: task * task + 7 for task in range(20)}
    assert not open_to_all
    assert not ray.is_initialized(), "it ends with the work"


def test_a_worker_that_dies_is_replaced(tmp_path: Path) -> None:
    assert dict(run_on_ray(range(4), dying, (str(tmp_path),), workers=2)) == {task: task for task in range(4)}


def test_faults_are_told_as_they_are() -> None:
    with pytest.raises(BusybotError, match="is broken") as error:
        list(run_on_ray(range(2), faulty, (), workers=1))
    assert error.value.hint == "mend it"


def test_it_records_what_the_local_engine_records(tmp_path: Path) -> None:
    from tests.cli.commands import busybot
    from tests.cli.test_generate_collect import SMALL

    hashes = []
    for engine in ("local", "ray"):
        folder = str(tmp_path / engine)
        assert busybot("generate", folder, "--boards", "3", "--seed", "2").returncode == 0
        done = busybot("collect", folder, "--engine", engine, *SMALL)
        assert done.returncode == 0, done.stderr
        hashes.append(busybot("dataset", "info", folder, "--json").stdout.split('"content_hash": ')[1][:70])
    assert hashes[0] == hashes[1]


def test_a_worker_without_room_keeps_nothing_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "node_ip_address": LOOPBACK})
    monkeypatch.setenv("RAY_ADDRESS", cluster.address)
    try:
        started = time.monotonic()
        results = dict(run_on_ray(range(4), squares, (0,), workers=3, task_seconds=60))
    finally:
        cluster.shutdown()
    assert results == {task: task * task for task in range(4)} and time.monotonic() - started < 60


def working_under(raylet: int) -> bool:
    return any("ray::_Work" in " ".join(child.cmdline()) for child in psutil.Process(raylet).children(recursive=True))


def test_a_machine_that_is_lost_midway_changes_nothing(tmp_path: Path) -> None:
    """Two nodes of a cluster on this machine; one is killed, with what runs on it, while both record."""
    from ray.cluster_utils import Cluster

    from tests.cli.commands import busybot
    from tests.cli.test_generate_collect import SMALL

    hashes = {}
    for name in ("here", "there"):
        assert busybot("generate", tmp_path / name, "--boards", "14", "--seed", "2").returncode == 0
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "node_ip_address": LOOPBACK})
    try:
        lost = cluster.add_node(num_cpus=1, node_ip_address=LOOPBACK)
        raylet = lost.all_processes["raylet"][0].process.pid
        command = [sys.executable, "-m", "busybot", "collect", "there", "--engine", "ray", "--workers", "2", *SMALL]
        environment = dict(os.environ, RAY_ADDRESS=cluster.address, PYTHONPATH=os.pathsep.join(filter(None, sys.path)))
        with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as collecting:
            episodes = tmp_path / "there" / "episodes"
            while collecting.poll() is None and not (working_under(raylet) and len(list(episodes.glob("*.mcap"))) > 2):
                time.sleep(0.05)
            before = len(list(episodes.glob("*.mcap")))
            cluster.remove_node(lost, allow_graceful=False)
            _, said = collecting.communicate(timeout=200)
        assert before < 14 and collecting.returncode == 0, said
    finally:
        cluster.shutdown()
    assert busybot("collect", tmp_path / "here", *SMALL).returncode == 0
    for name in ("here", "there"):
        info = json.loads(busybot("dataset", "info", tmp_path / name, "--json").stdout)
        hashes[name] = {key: info[key] for key in ("episodes", "content_hash", "trace_hash")}
    assert hashes["here"] == hashes["there"] and hashes["here"]["episodes"] == 14


def test_the_slurm_script_records_with_two_nodes(tmp_path: Path) -> None:
    """Both on this machine: `srun` and `scontrol` are stand-ins.

    Two nodes of one machine that start at once may take each other's ports, so here the second starts after the first.
    """
    from tests.cli.commands import busybot
    from tests.cli.test_generate_collect import SMALL

    ready = 'until [ "$(ray status --address=$RAY_ADDRESS | grep -c " 1 node_")" = %d ]; do sleep 1; done'
    wait, real = f"timeout 120 bash -c '{ready}'\n", f"exec {sys.executable} -m"
    second = '[[ "$1 $2" != "start --address="* ]] || RAY_ADDRESS=${2#*=} '
    tools = {
        "scontrol": 'test "$1 $2 $3" = "show hostnames a,b" && printf "a\\nb\\n"',
        "srun": 'while [[ $1 == --* ]]; do shift; done; exec "$@"',
        "hostname": f'echo "{LOOPBACK} ::1"',
        "busybot": wait % 2 + f'{real} busybot "$@"',
        "ray": second + wait % 1 + f'{real} ray.scripts.scripts "$@"',
    }
    (tmp_path / "bin").mkdir()
    for name, body in tools.items():
        (tmp_path / "bin" / name).write_text(f"#!/bin/bash\nset -e\n{body}\n")
        (tmp_path / "bin" / name).chmod(0o755)
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    told = {"SLURM_JOB_NODELIST": "a,b", "SLURM_NNODES": "2", "SLURM_CPUS_PER_TASK": "1", "RAY_PORT": str(port)}
    path = os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    environment = os.environ | told | {"PATH": path, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    del environment[ONLY_HERE]  # else Ray refuses a second node
    assert busybot("generate", tmp_path / "data", "--boards", "4", "--seed", "2").returncode == 0
    said = tmp_path / "said.txt"  # a file: what Ray leaves running would keep a pipe open
    with said.open("w") as out:
        options = {"cwd": tmp_path, "env": environment, "stdout": out, "stderr": out, "start_new_session": True}
        with subprocess.Popen(["bash", str(GUIDE / "slurm.sh"), "data", *SMALL], **options) as job:
            try:
                assert job.wait(timeout=280) == 0, said.read_text()
            except subprocess.TimeoutExpired:
                pytest.fail(said.read_text())
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(job.pid, signal.SIGKILL)
    assert json.loads(busybot("dataset", "info", tmp_path / "data", "--json").stdout)["episodes"] == 4


def test_the_launcher_reads_the_cluster_file() -> None:
    from ray.autoscaler._private.util import prepare_config, validate_config
    from ray.scripts.scripts import cli

    config = prepare_config(yaml.safe_load((GUIDE / "ray.yaml").read_text()))
    validate_config(config)
    commands = [*config["head_start_ray_commands"], *config["worker_start_ray_commands"]]
    for words in (shlex.split(command) for command in commands):
        words = [word for word in words if word != "RAY_AUTH_MODE=token"]
        assert words[0].endswith(".venv/bin/ray")
        cli.commands[words[1]].make_context(words[1], words[2:])
    assert len(commands) == 4
