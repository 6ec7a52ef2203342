"""Fixtures for all tests: the real objects where they are, what the test processes of one run share, and work that
is done in the test's own process; and at the end the number of skipped tests.

Each test process computes with one thread: several processes run at a time, and their threads would only wait for each
other.
"""

import fcntl
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when torch and numpy are imported, here and in child processes
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("BUSYBOT_WORKERS", "1")  # commands of several tests share the cores already

Once = Callable[[str, Callable[[Path], object]], Path]
"""See the fixture `once`."""
FEW = {
    *("rocker", "toggle", "rockers", "joystick"),
    *("bulb", "cone", "globe", "tube"),
    *("flush", "safe", "duck", "car"),
}
"""Families of the fixture `few_objects`: a switch of each role, lamps, doors, toys."""
LONGEST = ("test_reproduce", "test_readme", "test_guides", "test_demo")
"""Modules with tests of minutes: they come first, else one process would be at the last of them when all others have
nothing left to do."""


def real_objects(variable: str, folder: str) -> Path | None:
    """The folder that the environment names, else `../shared/FOLDER` beside the repository, else None."""
    named = os.environ.get(variable)
    path = Path(named) if named else ROOT.parent / "shared" / folder
    return path if path.is_dir() else None


@pytest.fixture(scope="session")
def partnet() -> Path:
    """The 58 annotated PartNet-Mobility objects of the paper (folders Switch, Door, Lamp, Toy)."""
    path = real_objects("BUSYBOT_PARTNET_DIR", "partnet-mobility")
    if path is None:
        pytest.skip("the annotated PartNet-Mobility objects are absent; BUSYBOT_PARTNET_DIR can name their folder")
    return path


@pytest.fixture(scope="session")
def partnet_raw() -> Path:
    """PartNet-Mobility objects as downloaded, without annotation (folders named by id)."""
    path = real_objects("BUSYBOT_PARTNET_RAW_DIR", "partnet-mobility-raw")
    if path is None:
        pytest.skip("raw PartNet-Mobility objects are absent; BUSYBOT_PARTNET_RAW_DIR can name their folder")
    return path


@pytest.fixture(scope="session")
def tiny() -> Path:
    """The small frozen dataset of procedural objects in `datasets/tiny`: 12 boards, 13 steps on each."""
    return ROOT / "datasets" / "tiny"


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A temporary folder of the whole run, the same in all of its processes."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def once(run_folder: Path) -> Once:
    """`once(name, make)`: the folder that `make(folder)` fills, called by the first process that asks for `name`.

    Others wait and get the same folder. It is not to be changed: tests that change something copy from it.
    """

    def shared(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = run_folder / "shared" / name, run_folder / "shared" / f"{name}.done"
        done.parent.mkdir(exist_ok=True)
        with done.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                make(folder)
                done.touch()
        return folder

    return shared


@pytest.fixture(scope="session", autouse=True)
def own_cache(run_folder: Path, once: Once) -> Iterator[None]:
    """Tests leave the user's cache alone: one cache of the whole run, with a procedural library that is made once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BUSYBOT_CACHE", str(run_folder / "busybot-cache"))
        if "PYTEST_XDIST_WORKER" in os.environ:  # else who needs it makes it
            from busybot.objects.procedural.build import procedural_library

            once("library", lambda folder: procedural_library())
        yield


@pytest.fixture(scope="session")
def few_objects(once: Once) -> Callable[[int], Path]:
    """`few_objects(seed)`: a library of a dozen procedural objects, enough for training boards of all kinds.

    With seed 0 they are among those of the default library, with another seed they are not.
    """

    def make(folder: Path, seed: int) -> None:
        from busybot.objects.procedural import build

        families = tuple(replace(family, count=1) for family in build.FAMILIES if family.name in FEW)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(build, "FAMILIES", families)
            build.make_library(folder, seed)

    return lambda seed: once(f"few-objects-{seed}", lambda folder: make(folder, seed))


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[EntryPoint]]:
    """Entry points that installed packages register."""
    from busybot.boards.mechanisms import available
    from busybot.common import plugins
    from busybot.reason.encoders.registry import make_extractor

    def forget() -> None:
        for remembered in (available, plugins.load, plugins.packages, plugins._points, make_extractor):
            remembered.cache_clear()  # type: ignore[attr-defined]

    points: list[EntryPoint] = []
    monkeypatch.setattr(plugins, "entry_points", lambda group: [one for one in points if one.group == group])
    forget()
    yield points
    forget()


def run_tasks_here(
    tasks: Iterable[int],
    make_work: Callable[..., Callable[[int], Any]],
    arguments: tuple[Any, ...],
    workers: int,
    recycle: int = 0,
    task_seconds: float = 0,
    given: Sequence[Any] | None = None,
) -> Iterator[tuple[int, Any]]:
    """As `run_tasks`, without processes; what would go to a process and come back is pickled all the same."""
    import pickle

    from busybot.common.errors import BusybotError

    make_work, arguments = pickle.loads(pickle.dumps((make_work, arguments)))
    work = None
    for task in tasks:
        try:
            work = work or make_work(*arguments)
            result = pickle.loads(
                pickle.dumps(work(task if given is None else pickle.loads(pickle.dumps(given[task]))))
            )
        except BusybotError as error:
            raise BusybotError(*pickle.loads(pickle.dumps((error.what, error.hint)))) from None
        except Exception as error:
            raise BusybotError(f"task {task}: {type(error).__name__}: {error}") from error
        yield task, result


@pytest.fixture(scope="session")
def work_here() -> Callable[[], AbstractContextManager[None]]:
    """In `with work_here():` worker processes' work is done here, for fixtures that outlive a test.

    The code is changed, not the name: modules have `run_tasks` under names of their own.
    """
    from busybot.common.process_pool import run_tasks

    @contextmanager
    def patched() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(run_tasks, "__code__", run_tasks_here.__code__)
            yield

    return patched


@pytest.fixture
def in_process(work_here: Callable[[], AbstractContextManager[None]]) -> Iterator[None]:
    """Work for worker processes is done here: a test about something else does not wait until they have started."""
    with work_here():
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONGEST.index(item.path.stem) if item.path.stem in LONGEST else len(LONGEST))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--require-extras", action="store_true", help="fail if a test is skipped for want of a package")


def reasons(config: pytest.Config) -> list[str]:
    """Why tests were skipped, once each."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    skipped = reporter.stats.get("skipped", []) if reporter is not None else []
    return sorted({str(report.longrepr[2]) for report in skipped if isinstance(report.longrepr, tuple)})


def pytest_sessionfinish(session: pytest.Session) -> None:
    absent = [reason for reason in reasons(session.config) if "not installed" in reason]
    if absent and session.config.getoption("--require-extras"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    terminalreporter.write_line(f"skipped tests: {len(terminalreporter.stats.get('skipped', []))}")
    for reason in reasons(terminalreporter.config):
        terminalreporter.write_line(f"  {reason}")
