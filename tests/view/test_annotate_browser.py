"""The page in which boxes are drawn, in a real browser without a window: boxes are dragged, given roles, and saved."""

import json
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.datasets.dataset import Dataset
from busybot.datasets.verify import verify
from busybot.view.annotate import AnnotationServer
from tests.episodes.synthetic import make_episode
from tests.view.test_annotate import dataset_of

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(BROWSER is None, reason="Chromium is absent: apt-get install chromium-headless-shell"),
]
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--window-size=1200,800")


class Page:
    """A page of a browser, told what to do through the pipes of the Chrome DevTools Protocol."""

    def __init__(self, given: int, said: int):
        self._given, self._said, self._count = given, os.fdopen(said, "rb", buffering=0), 0
        self._session: dict[str, str] = {}

    def open(self, url: str) -> None:
        target = self.do("Target.createTarget", url=url)["targetId"]
        self._session = {"sessionId": self.do("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]}

    def do(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        told = {"id": self._count, "method": method, "params": parameters, **self._session}
        os.write(self._given, json.dumps(told).encode() + b"\0")
        while True:
            answer = json.loads(b"".join(iter(lambda: self._said.read(1), b"\0")))
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def value(self, script: str) -> Any:
        found = self.do("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait_for(self, condition: str, seconds: float = 20.0) -> None:
        """Ask until it holds; before a page has loaded, nothing that it asks for is defined."""
        until = time.monotonic() + seconds
        while not self.do("Runtime.evaluate", expression=f"Boolean({condition})")["result"].get("value"):
            assert time.monotonic() < until, condition
            time.sleep(0.02)

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.do("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, button="left", buttons=1, clickCount=1)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        self.mouse("Pressed", *start)
        for share in (0.3, 0.7, 1.0):
            self.mouse("Moved", *(a + share * (b - a) for a, b in zip(start, end, strict=True)))
        self.mouse("Released", *end)

    def click(self, name: str) -> None:
        """On the element with this id."""
        x, y, width, height = self._place(name)
        for kind in ("Pressed", "Released"):
            self.mouse(kind, x + width / 2, y + height / 2)

    def key(self, name: str) -> None:
        for kind in ("keyDown", "keyUp"):
            self.do("Input.dispatchKeyEvent", type=kind, key=name)

    def at(self, u: float, v: float) -> tuple[float, float]:
        """Where a pixel of the picture is in the window."""
        x, y, width, height = self._place("picture")
        return x + u / 160 * width, y + v / 120 * height

    def _place(self, name: str) -> tuple[float, float, float, float]:
        script = f"(({{x, y, width, height}}) => [x, y, width, height])(at('{name}').getBoundingClientRect())"
        x, y, width, height = self.value(script)
        return x, y, width, height


@contextmanager
def browser(folder: Path) -> Iterator[Page]:
    """A browser of its own, which is gone afterwards."""
    (read, given), (said, written) = os.pipe(), os.pipe()
    line = f'exec "$0" "$@" 3<&{read} 4>&{written}'
    command = ("bash", "-c", line, str(BROWSER), *FLAGS, f"--user-data-dir={folder / 'browser'}")
    with subprocess.Popen(command, pass_fds=(read, written), stderr=subprocess.DEVNULL) as process:
        try:
            yield Page(given, said)
        finally:
            process.kill()


def test_boxes_are_dragged_given_roles_moved_and_saved(tmp_path: Path) -> None:
    episode = make_episode(0)
    boxes, objects = episode.image(0).boxes.tolist(), episode.board.objects
    with AnnotationServer(dataset_of(tmp_path, boxes=False)) as server, browser(tmp_path) as page:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        page.open(server.url)
        page.wait_for("now && image")
        for (u0, v0, u1, v1), one in zip(boxes, objects, strict=True):
            page.drag(page.at(u0, v0), page.at(u1, v1))
            page.key(one.role[0])
        assert page.value("now.objects.map(one => one.role)") == [one.role for one in objects]
        page.key("ArrowRight")
        page.key("ArrowLeft")
        assert page.value("document.getElementById('objects').children.length") == len(objects)
        page.drag(page.at(2, 2), page.at(20, 14))
        page.key("Delete")
        page.click("save")
        page.wait_for("at('said').className")
        assert page.value("at('said').textContent") == f"saved {len(objects)} objects of recording 0"
        page.click("done")
        thread.join(20)
        assert not thread.is_alive()
    saved = Dataset.open(server.dataset.path)
    assert np.abs(saved[0].image(0).boxes - np.array(boxes)).max() <= 1
    assert [one.role for one in saved.board(0).objects] == [one.role for one in objects]
    assert not saved.board(1).objects and verify(saved.path).ok


def test_what_is_drawn_while_another_recording_is_saved_is_kept(tmp_path: Path) -> None:
    with AnnotationServer(dataset_of(tmp_path, boxes=False)) as server, browser(tmp_path) as page:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        page.open(server.url)
        page.wait_for("now && image")
        page.drag(page.at(10, 10), page.at(40, 40))
        with server.saving:
            page.click("save")
            page.drag(page.at(60, 10), page.at(90, 40))
            assert page.value("at('save').disabled")
            page.do("Runtime.evaluate", expression="open(1)", awaitPromise=True)
            page.drag(page.at(10, 60), page.at(40, 90))
        page.wait_for("at('said').className === 'good'")
        assert page.value("recordings.map(one => one.objects.map(each => each.was))") == [[0, None], [None]]
        assert page.value("[now.index, [...dirty], at('save').disabled]") == [1, [0, 1], False]
        for index in (1, 0):
            page.do("Runtime.evaluate", expression=f"open({index})", awaitPromise=True)
            page.click("save")
            page.wait_for(f"!dirty.has({index})")
        server.shutdown()
        thread.join()
    assert [len(board.objects) for board in Dataset.open(server.dataset.path).boards()] == [2, 1]


def test_without_its_token_the_page_says_so(tmp_path: Path) -> None:
    with AnnotationServer(dataset_of(tmp_path)) as server, browser(tmp_path) as page:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        page.open(server.url.split("#")[0])
        page.wait_for("at('said').className === 'bad'")
        assert "whole address" in page.value("at('said').textContent")
        server.shutdown()
        thread.join()
