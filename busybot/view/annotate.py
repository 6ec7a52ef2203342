"""`busybot annotate`: a page on this machine in which boxes are dragged over the first picture and roles are set.

It listens on the loopback interface alone. Whoever has no token gets nothing but the empty page: the token stands
behind the # of the address, which browsers do not send, and comes back in a header. Nothing is logged. The page's code
loads nothing from elsewhere and puts names into it as text only.
"""

import json
import secrets
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from busybot.common.atomic_io import parse_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.datasets.dataset import Dataset
from busybot.datasets.importing.recording import KnownObject
from busybot.datasets.importing.redraw import redraw, refuse_simulated
from busybot.episodes.codec import encode_rgb
from busybot.episodes.mcap.reader import read_episode

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("annotate.html")
MAX_BODY_BYTES = 1 << 20
SILENCE_S = 30.0
"""Whoever says nothing for so long is hung up on."""

Side = Annotated[int, Field(ge=0, le=32767)]


class DrawnObject(FrozenModel):
    """An object as the page sends it; `was` is its number before, null for a new one."""

    name: Annotated[str, Field(max_length=64)]
    role: Literal["trigger", "responder"]
    box: tuple[Side, Side, Side, Side] | None
    was: Annotated[int, Field(ge=0, le=255)] | None = None


class Drawn(FrozenModel):
    """All objects of a recording."""

    objects: Annotated[tuple[DrawnObject, ...], Field(max_length=64)]


class AnnotationServer(ThreadingHTTPServer):
    """Serves the page for one dataset; `url` has the token."""

    daemon_threads = True

    def __init__(self, dataset: Dataset, port: int = 0):
        refuse_simulated(dataset)
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:  # it is taken, or for administrators alone
            what = f"port {port} on {HOST} cannot be listened on: {error.strerror}"
            raise BusybotError(what, "name another --port, or leave it out") from None
        self.dataset, self.token, self.saving = dataset, secrets.token_urlsafe(32), Lock()

    @property
    def origin(self) -> str:
        """Address without the token."""
        return f"http://{HOST}:{self.server_address[1]}"

    @property
    def url(self) -> str:
        return f"{self.origin}/#{self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that hangs up is no fault, and a request is never written down."""

    def recordings(self) -> list[dict[str, Any]]:
        """What the page shows beside pictures, JSON values; of a damaged recording, what is wrong with it."""
        found = []
        for index in sorted(self.dataset.finished()):
            try:
                found.append(self.recording(index))
            except BusybotError as error:
                found.append({"index": index, "error": str(error)})
        return found

    def recording(self, index: int) -> dict[str, Any]:
        episode = read_episode(self.dataset.episode_path(index), "lazy")
        boxes = episode.images[0].boxes.tolist()
        objects = [
            {
                "name": "" if one.category == "Unknown" else one.category,
                "role": one.role,
                "box": None if -1 in box else box,
            }
            for one, box in zip(episode.board.objects, boxes, strict=True)
        ]
        return {
            "index": index,
            "width": episode.camera.width,
            "height": episode.camera.height,
            "frames": len(episode.frame_of),
            "actions": [step.pixel for step in episode.steps],
            "objects": [one | {"was": number} for number, one in enumerate(objects)],
        }

    def picture(self, index: int, frame: int) -> bytes:
        """A frame as PNG.

        Raises:
            BusybotError: there is none.
        """
        episode = read_episode(self.dataset.episode_path(index), "lazy")
        if not 0 <= frame < len(episode.frame_of):
            raise BusybotError(f"recording {index} has no frame {frame}")
        return encode_rgb(episode.rgb[frame], "png")

    def store(self, index: int, drawn: Drawn) -> dict[str, Any]:
        """Write what was drawn into the dataset; returns the recording as it is now."""
        objects = [
            KnownObject(one.name, one.role, one.box, None, f"recording {index}: object {number}")
            for number, one in enumerate(drawn.objects)
        ]
        with self.saving:
            redraw(self.dataset, index, objects, [one.was for one in drawn.objects])
            return self.recording(index)


class _Handler(BaseHTTPRequestHandler):
    server: AnnotationServer
    server_version, sys_version = "busybot", ""
    timeout = SILENCE_S

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is logged."""

    def do_GET(self) -> None:
        path = self.path
        if path in ("/", "/index.html") and self._local():
            nonce = secrets.token_urlsafe(16)
            page = PAGE.read_text(encoding="utf-8").replace("NONCE", nonce)
            policy = f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src blob:; "
            self._send(page.encode(), "text/html; charset=utf-8", f"{policy}connect-src 'self'; base-uri 'none'")
            return
        match path.split("/"):
            case ["", "api", "recordings"]:
                self._answer(self.server.recordings)
            case ["", "api", "picture", index, frame] if index.isdecimal() and frame.isdecimal():
                self._answer(lambda: self.server.picture(int(index[:9]), int(frame[:9])))
            case _:
                self._refuse(HTTPStatus.NOT_FOUND, "there is nothing")

    def do_POST(self) -> None:
        match self.path.split("/"):
            case ["", "api", "recordings", index] if index.isdecimal():
                self._answer(lambda: self.server.store(int(index[:9]), self._body()))
            case ["", "api", "done"]:
                self._answer(lambda: {"done": True})
                if self._allowed():
                    with self.server.saving:  # what is being saved is not torn off
                        self.server.shutdown()
            case _:
                self._refuse(HTTPStatus.NOT_FOUND, "there is nothing")

    def _body(self) -> Drawn:
        size = self.headers.get("Content-Length", "")
        if not size.isdecimal() or int(size[:12]) > MAX_BODY_BYTES:
            raise BusybotError("the request has no length, or is too long")
        try:
            return Drawn.model_validate(parse_json(self.rfile.read(int(size))))
        except ValidationError as error:
            raise BusybotError(first_fault(error)) from None
        except (ValueError, RecursionError) as error:
            raise BusybotError(f"no JSON: {error}") from None

    def _local(self) -> bool:
        """Whether the browser asked for this address: a page of another name that leads here may not read anything."""
        return self.headers.get("Host") == self.server.origin.removeprefix("http://")

    def _allowed(self) -> bool:
        given = self.headers.get("Authorization", "").encode("utf-8", "replace")
        return self._local() and secrets.compare_digest(given, f"Bearer {self.server.token}".encode())

    def _answer(self, make: Callable[[], Any]) -> None:
        if not self._allowed():
            self.close_connection = True  # its body is not read
            self._refuse(HTTPStatus.FORBIDDEN, "open the whole address that `busybot annotate` printed")
            return
        try:
            made = make()
        except (BusybotError, OSError) as error:
            self.close_connection = True
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
            return
        if isinstance(made, bytes):
            self._send(made, "image/png")
        else:
            self._send(json.dumps(made).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._send(json.dumps({"error": why}).encode(), "application/json", status=status)

    def _send(
        self, data: bytes, kind: str, policy: str = "default-src 'none'", status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(data)),
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "X-Frame-Options": "DENY",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(data)
