"""A child process that is asked and answers by lines, within limits of time and size, and believed in nothing.

It is started without a shell, in a process group of its own, and killed with it. Should this process be killed first,
as workers are after Ctrl-C, a watcher does so: often the program is what another one started (`sh run.sh`, `uv run`),
and of that the system knows nothing. It is not shut in: it may do what the user may do.
"""

import json
import os
import selectors
import shlex
import shutil
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import IO, Any, Literal

from busybot.common.errors import BusybotError, UsageError
from busybot.common.process_pool import end_with
from busybot.common.text import plain

MOST_LINE = 1 << 16
"""Bytes of an answer, where nobody asks for more."""
READ = 1 << 16
"""Bytes that are read at once."""
KEPT = 2000
"""Bytes of its standard error that are kept, the last ones."""
TOLD = 300
"""Characters of it that are told."""
END_SECONDS = 3.0
"""A program that may not be killed is waited for so long."""
WATCHER = ("/bin/sh", "-c", 'read -r group && { read -r _; kill -s KILL -- "-$group"; }')
"""Is told a process group, and kills it when its input ends: when who told it has ended, in whatever way."""

Reason = Literal["timeout", "died", "line too long"]


class NoAnswerError(Exception):
    """The child answers no more."""

    def __init__(self, end: Reason):
        self.end: Reason = end


class Child:
    """A program that is asked by lines, within limits; `close` kills it with its process group, and so does the end of
    this process."""

    def __init__(self, words: Sequence[str], timeout_s: float, most_line: int = MOST_LINE):
        self._most_line = most_line
        self._timeout_s, self._unsent, self._came, self._said, self._ended = timeout_s, b"", b"", b"", False
        self._watcher = _watcher()
        try:
            self._process = _started(words)
        except OSError:
            _end(self._watcher)
            raise
        process = self._process
        assert process.stdin and process.stdout and process.stderr and self._watcher.stdin
        with suppress(BrokenPipeError):  # somebody ended the watcher alone
            self._watcher.stdin.write(b"%d\n" % process.pid)
        self._stdin, self._stdout = process.stdin.fileno(), process.stdout.fileno()
        self._stderr = process.stderr.fileno()
        self._selector = selectors.DefaultSelector()
        for descriptor in (self._stdin, self._stdout, self._stderr):
            os.set_blocking(descriptor, False)
        for descriptor in (self._stdout, self._stderr):
            self._selector.register(descriptor, selectors.EVENT_READ)

    def ask(self, message: dict[str, Any]) -> bytes:
        """Send a message and wait for a line.

        Raises:
            NoAnswerError: none came in time, it is too long, or none will come.
        """
        self._send(json.dumps(message).encode() + b"\n")
        until = time.monotonic() + self._timeout_s
        while True:
            line, found, rest = self._came.partition(b"\n")
            if len(line) > self._most_line:
                raise NoAnswerError("line too long")
            if found or (self._ended and line):
                self._came = rest
                return line
            left = until - time.monotonic()
            if self._ended or left <= 0:
                raise NoAnswerError("died" if self._ended else "timeout")
            for key, _ in self._selector.select(left):
                self._serve(key.fd)

    def _send(self, data: bytes) -> None:
        if not self._unsent:
            self._selector.register(self._stdin, selectors.EVENT_WRITE)
        self._unsent += data

    def _serve(self, descriptor: int) -> None:
        if descriptor == self._stdin:
            try:
                self._unsent = self._unsent[os.write(descriptor, self._unsent) :]
            except BrokenPipeError:  # whether it still says something is seen at its output
                self._unsent = b""
            if not self._unsent:
                self._selector.unregister(descriptor)
            return
        data = os.read(descriptor, READ)
        if descriptor == self._stderr:
            self._said = (self._said + data)[-KEPT:]
        else:
            self._came, self._ended = self._came + data, not data
        if not data:
            self._selector.unregister(descriptor)

    def close(self) -> str:
        """End it; returns the end of what it wrote to standard error, plain text.

        A program of another user, as `sudo` starts one, may not be killed. It hears that nobody asks any more, has
        `END_SECONDS` to end, and is left alone then.
        """
        process = self._process
        with suppress(ProcessLookupError, PermissionError):  # it was not waited for: the number is still its own
            os.killpg(process.pid, signal.SIGKILL)
        _end(self._watcher)
        self._selector.close()
        _close(process.stdin, process.stdout)
        with suppress(subprocess.TimeoutExpired):
            process.wait(END_SECONDS)
        with suppress(OSError):
            self._said = (self._said + os.read(self._stderr, READ))[-KEPT:]
        _close(process.stderr)
        return plain(self._said.decode(errors="replace").strip())[-TOLD:]


def _started(words: Sequence[str]) -> subprocess.Popen[bytes]:
    """The program: no shell, and a process group of its own; if this process is killed, so is what was started here."""
    return subprocess.Popen(
        list(words),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,
        start_new_session=True,
        preexec_fn=partial(end_with, os.getpid()),
    )


def _watcher() -> subprocess.Popen[bytes]:
    """In a session of its own, which the terminal's Ctrl-C does not reach. Its input is open in this process alone."""
    null = subprocess.DEVNULL
    return subprocess.Popen(WATCHER, stdin=subprocess.PIPE, stdout=null, stderr=null, bufsize=0, start_new_session=True)


def _end(watcher: subprocess.Popen[bytes]) -> None:
    """Killed before its input ends: it kills nobody."""
    watcher.kill()
    watcher.wait()
    _close(watcher.stdin)


def _close(*streams: IO[bytes] | None) -> None:
    for stream in streams:
        if stream is not None:
            stream.close()


def command_words(command: str) -> tuple[str, ...]:
    """The words of a command, which is given to no shell.

    Raises:
        BusybotError: it has none, or its program is not there.
    """
    try:
        words = tuple(shlex.split(command))
    except ValueError as error:
        raise UsageError(f"--agent {command!r}: {error}", "quote it as in a shell") from None
    if not words:
        raise UsageError("--agent is empty", "name a program with its arguments")
    if shutil.which(words[0]) is None:
        raise BusybotError(f"--agent: there is no program {words[0]!r}", "name one on PATH, or by its path")
    return words
