"""The process beside the recorder that estimates the session so far."""

import multiprocessing
import os
import signal
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from recal.service.watch.interim import InterimRequest, estimated, read
from recal.service.watch.records import FIRST_S, Estimated

# of a core at real time, for estimates: of the 5 % that a session may take
SHARE = 0.03
LEAST_S = 10.0  # between two estimates, by the clock; chosen: 10 times what one takes
NICE = 10
ENDS_S = 2.0  # in which a process that is asked to end does


class Worker:
    """The process that estimates, asked as often as its share of a core allows."""

    def __init__(self, request: InterimRequest) -> None:
        self._request = request
        self.found: Estimated | None = None
        self.faults: list[str] = []
        self._process: Any = None
        self._link: Connection | None = None
        self._asked_s, self._due_s, self._at_s, self._busy = 0.0, FIRST_S, 0.0, False

    def look(self, time_s: float, parts: list[Path]) -> None:
        """Take an answer that has come, and ask again where it is time."""
        if time_s < self._asked_s:  # another part
            self._due_s = time_s + FIRST_S
            self._asked_s = time_s
        try:
            self._look(time_s, parts)
        except (EOFError, OSError):
            self.faults = ["the estimate broke down: it is begun again"]
            self.close()
            self._due_s = time_s + FIRST_S

    def _look(self, time_s: float, parts: list[Path]) -> None:
        if self._busy and self._link is not None and self._link.poll():
            answer = self._link.recv()
            self._busy, self._at_s = False, time.monotonic()
            if isinstance(answer, str):
                self.faults = [f"no estimate: {answer}"]
            elif answer is not None:
                self.found, self.faults = answer, []
                self._due_s = self._asked_s + answer.cpu_s / SHARE
        waited = time.monotonic() - self._at_s >= LEAST_S
        if self._busy or not parts or time_s < self._due_s or not waited:
            return
        if self._link is None:
            context = multiprocessing.get_context("spawn")
            self._link, far = context.Pipe()
            self._process = context.Process(target=_serve, args=(far,))
            self._process.start()
            far.close()
        self._asked_s, self._due_s, self._busy = time_s, time_s + LEAST_S, True
        self._link.send((list(parts), self._request))

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.terminate()
            self._process.join(ENDS_S)
            self._process.kill()
            self._process.join()
        if self._link is not None:
            self._link.close()
        self._process, self._link, self._busy = None, None, False


def _serve(link: Connection) -> None:
    """Answer until the other end is gone, by a child each where the system forks safely: with its
    end its memory goes back to the system.
    """
    os.nice(NICE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that records
    answer = _by_child if sys.platform == "linux" else _answer
    while True:
        try:
            parts, request = link.recv()
        except EOFError:
            return
        link.send(answer(parts, request))


def _answer(parts: list[Path], request: InterimRequest) -> Estimated | str | None:
    """The estimate; a fault of the program is an answer, too."""
    try:
        read(parts)
        return estimated(parts, request)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _by_child(parts: list[Path], request: InterimRequest) -> Estimated | str | None:
    """The same; the rows are read here, where they stay known."""
    try:
        read(parts)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    context = multiprocessing.get_context("fork")
    near, far = context.Pipe(duplex=False)
    child = context.Process(target=_send, args=(far, parts, request))
    child.start()
    far.close()
    signal.signal(signal.SIGTERM, lambda number, frame: _end(child))
    try:
        answer: Estimated | str | None = near.recv()
    except EOFError:
        answer = "the process of the estimate was ended"
    near.close()
    child.join()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return answer


def _send(link: Connection, parts: list[Path], request: InterimRequest) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        link.send(estimated(parts, request))
    except Exception as error:
        link.send(f"{type(error).__name__}: {error}")


def _end(child: Any) -> None:
    """End with the child."""
    child.kill()
    os._exit(0)
