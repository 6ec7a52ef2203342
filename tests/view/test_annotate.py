"""The page in which boxes are drawn: only with its token, only from this machine; what is saved is in the dataset."""

import http.client
import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.boards.spec import BODY
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.importing.recording import KnownObject
from busybot.datasets.importing.redraw import redraw
from busybot.datasets.importing.sources import import_source
from busybot.datasets.verify import verify
from busybot.episodes.codec import decode_rgb
from busybot.reason.evaluation.evaluate import ReasonEvaluation, judge_episode
from busybot.view.annotate import AnnotationServer
from tests.datasets.camera_folders import write_camera_folder
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode


def dataset_of(folder: Path, boxes: bool = True) -> Dataset:
    for index in (0, 1):
        made = write_camera_folder(folder / "source" / f"{index}", make_episode(index), relations=boxes)
        if not boxes:
            (made / "objects.csv").unlink()
    done = import_source(folder / "source", folder / "set").dataset
    assert done is not None
    return done


@pytest.fixture
def server(tmp_path: Path) -> Iterator[AnnotationServer]:
    with AnnotationServer(dataset_of(tmp_path, boxes=False)) as found:
        thread = threading.Thread(target=found.serve_forever, args=(0.01,))
        thread.start()
        yield found
        found.shutdown()
        thread.join()


def ask(server: AnnotationServer, path: str, body: Any = None, **headers: str) -> tuple[int, bytes, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=20)
    given = {"Authorization": f"Bearer {server.token}"} | headers
    data = body if isinstance(body, bytes | None) else json.dumps(body).encode()
    connection.request("GET" if body is None else "POST", path, data, given)
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


def drawn() -> dict[str, Any]:
    episode = make_episode(0)
    boxes, objects = episode.image(0).boxes.tolist(), episode.board.objects
    return {
        "objects": [
            {"name": f"{one.category}", "role": one.role, "box": box, "was": None}
            for one, box in zip(objects, boxes, strict=True)
        ]
    }


def test_a_port_that_is_taken_is_told(server: AnnotationServer) -> None:
    with pytest.raises(BusybotError, match="port .* cannot be listened on: Address already in use(.|\n)*--port"):
        AnnotationServer(server.dataset, server.server_address[1])


def test_nothing_is_shown_or_changed_without_the_token(server: AnnotationServer, capfd: pytest.CaptureFixture) -> None:
    before = server.dataset.hashes()
    for headers in ({"Authorization": ""}, {"Authorization": "Bearer wrong"}, {"Host": "evil.example"}):
        for path, body in (("/api/recordings", None), ("/api/recordings/0", drawn()), ("/api/done", {})):
            status, data, _ = ask(server, path, body, **headers)
            assert status == 403 and b"whole address" in data
    assert server.token in server.url and server.url.index("#") < server.url.index(server.token)
    assert server.server_address[0] == "127.0.0.1" and server.dataset.hashes() == before
    assert ask(server, "/", None, Host="evil.example")[0] == 404
    assert server.token not in "".join(capfd.readouterr())


def test_the_page_loads_nothing_from_elsewhere(server: AnnotationServer) -> None:
    status, data, headers = ask(server, "/", Authorization="")
    page, policy = data.decode(), headers["Content-Security-Policy"]
    assert status == 200 and server.token not in page and "http" not in page.replace("http-equiv", "")
    assert "default-src 'none'" in policy and "unsafe" not in policy and "NONCE" not in page
    nonce = policy.split("'nonce-")[1].split("'")[0]
    assert page.count(f'nonce="{nonce}"') == 2 and "innerHTML" not in page
    assert nonce not in ask(server, "/")[2]["Content-Security-Policy"]


def test_what_is_drawn_is_in_the_dataset(server: AnnotationServer) -> None:
    assert [one["objects"] for one in json.loads(ask(server, "/api/recordings")[1])] == [[], []]
    picture = decode_rgb(ask(server, "/api/picture/0/3")[1], 160, 120)
    assert np.array_equal(picture, make_episode(0).image(3).rgb)
    status, data, _ = ask(server, "/api/recordings/0", drawn())
    assert status == 200 and [one["was"] for one in json.loads(data)["objects"]] == list(range(5))
    dataset = Dataset.open(server.dataset.path)
    assert verify(dataset.path).ok
    episode = dataset[0]
    assert dataset.board(0) == episode.board and np.isfinite(episode.positions).all()
    assert np.array_equal(episode.image(0).boxes, make_episode(0).image(0).boxes)
    assert judge_episode(episode, ReasonEvaluation("count", 7)).graph.claimed(6).sum() == 2
    assert not dataset[1].board.objects
    assert ask(server, "/api/recordings/0", {"objects": drawn()["objects"][:2]})[0] == 200
    assert len(Dataset.open(dataset.path)[0].board.objects) == 2 and verify(dataset.path).ok


def test_a_damaged_recording_hides_no_other(server: AnnotationServer) -> None:
    server.dataset.episode_path(1).write_bytes(b"no recording")
    one, other = json.loads(ask(server, "/api/recordings")[1])
    assert one["frames"] == 7 and other["index"] == 1 and "000001.mcap" in other["error"]
    assert ask(server, "/api/recordings/0", drawn())[0] == 200


def test_what_cannot_be_stored_is_said(server: AnnotationServer, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise BusybotError("tables: no space left")

    monkeypatch.setattr(Dataset, "store_rows", full)
    status, data, _ = ask(server, "/api/recordings/0", drawn())
    assert status == 400 and "no space left" in json.loads(data)["error"]


WRONG: dict[str, tuple[str, Any, str]] = {
    "a box outside": ("/api/recordings/0", {"box": [0, 0, 161, 9]}, "outside of pictures of 160 x 120"),
    "an empty box": ("/api/recordings/0", {"box": [5, 5, 5, 9]}, "is empty"),
    "two roles": ("/api/recordings/0", {"role": "trigger responder"}, "objects.0.role"),
    "an object that was not there": ("/api/recordings/0", {"was": 3}, "it has 0 objects"),
    "a negative box": ("/api/recordings/0", {"box": [-1, 0, 9, 9]}, "objects.0.box.0"),
    "no such recording": ("/api/recordings/7", {}, "there is no episode 7"),
    "no JSON": ("/api/recordings/0", b"[" * 100_000, "no JSON"),
    "no such frame": ("/api/picture/0/99", None, "has no frame 99"),
    "a path": ("/api/picture/../../etc", None, "there is nothing"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wrong_is_said_and_nothing_written(fault: str, server: AnnotationServer) -> None:
    path, change, message = WRONG[fault]
    before = server.dataset.hashes()
    body = {"objects": [drawn()["objects"][0] | change]} if isinstance(change, dict) else change
    status, data, _ = ask(server, path, body)
    assert status in (400, 404) and message in json.loads(data)["error"]
    assert Dataset.open(server.dataset.path).hashes() == before


def test_done_ends_the_command(tmp_path: Path) -> None:
    with AnnotationServer(dataset_of(tmp_path)) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        assert ask(server, "/api/done", {})[0] == 200
        thread.join(10)
        assert not thread.is_alive()


def test_done_waits_for_what_is_being_saved(tmp_path: Path) -> None:
    with AnnotationServer(dataset_of(tmp_path)) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        with server.saving:
            assert ask(server, "/api/done", {})[0] == 200
            thread.join(0.3)
            assert thread.is_alive()
        thread.join(10)
        assert not thread.is_alive()


def test_relations_follow_their_objects(tmp_path: Path) -> None:
    dataset = dataset_of(tmp_path)
    episode = dataset[0]
    objects = [
        KnownObject(one.category, one.role, tuple(box), None, "here")
        for one, box in zip(episode.board.objects, episode.image(0).boxes.tolist(), strict=True)
    ]
    redraw(dataset, 0, objects[::-1], [4, 3, 2, 1, 0])
    pairs = {(t.object, one.responder) for one in episode.board.relations for t in one.triggers}
    again = dataset[0].board
    assert {(4 - t.object, 4 - one.responder) for one in again.relations for t in one.triggers} == pairs
    assert np.array_equal(dataset[0].positions, episode.positions[::-1])
    turned = [replace(one, role="responder") if number == 1 else one for number, one in enumerate(objects[::-1])]
    redraw(dataset, 0, turned, list(range(5)))
    links = {t.object: t.link for one in dataset[0].board.relations for t in one.triggers}
    assert links[1] == BODY and all(link != BODY for owner, link in links.items() if owner != 1)
    redraw(dataset, 0, objects[::-1], list(range(5)))
    assert dataset[0].board == again
    gone = episode.board.relations[0].responder
    kept = [number for number in range(5) if 4 - number != gone]
    with pytest.raises(BusybotError, match="a relation of it was told"):
        redraw(dataset, 0, [objects[4 - number] for number in kept], kept)
    assert verify(dataset.path).ok


def test_only_what_was_imported_is_drawn_anew(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="the simulator knows"):
        AnnotationServer(make_dataset(tmp_path / "simulated"))
    dataset = dataset_of(tmp_path)
    freeze(dataset.path, None)
    with pytest.raises(BusybotError, match="frozen"):
        AnnotationServer(dataset)
