"""Worker processes on this machine, each with a pipe to the parent: one may die without taking the
others along.

A worker that finds its pipe closed ends: a killed parent leaves none behind for longer than the run
it is at.
"""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from ins.records import InputError
from recal.fleet.records import Task

READY = "ready"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Done:
    """A task and what came back."""

    task: Task
    result: Any


@dataclass(frozen=True)
class Lost:
    """A task whose worker is gone, and how."""

    task: Task
    why: str


class Pool(Protocol):
    """Where tasks are worked on."""

    @property
    def size(self) -> int:
        """How many tasks are worked on at once."""

    def submit(self, task: Task) -> None: ...

    def wait(self) -> list[Done | Lost]:
        """What ended, at least one; waits for it."""

    def close(self) -> None: ...


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    task: Task | None = None
    ready: bool = False


class LocalPool:
    """`workers` spawned processes, each with one thread of linear algebra; a dead one is
    replaced.
    """

    def __init__(self, workers: int) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._workers = [self._start() for _ in range(workers)]

    @property
    def size(self) -> int:
        return len(self._workers)

    def submit(self, task: Task) -> None:
        idle = next(w for w in self._workers if w.task is None)
        idle.task = task
        try:
            idle.pipe.send(task)
        except OSError:  # it is dead: `wait` finds that out
            pass

    def wait(self) -> list[Done | Lost]:
        ended: list[Done | Lost] = []
        while not ended:
            ready = wait([item for w in self._workers for item in (w.pipe, w.process.sentinel)])
            for k, worker in enumerate(self._workers):
                if worker.pipe in ready or worker.process.sentinel in ready:
                    ended += self._hear(k, worker)
        return ended

    def close(self) -> None:
        for worker in self._workers:
            worker.process.kill()
            worker.process.join()
            worker.pipe.close()

    def _hear(self, k: int, worker: _Worker) -> list[Done | Lost]:
        """What a worker sent before anything else; without a word it is dead and a new one takes
        its place.
        """
        try:
            while worker.pipe.poll():
                message = worker.pipe.recv()
                if message == READY:
                    worker.ready = True
                    continue
                task, worker.task = worker.task, None
                assert task is not None
                return [Done(task, message)]
        except (EOFError, OSError):
            pass
        else:
            if worker.process.exitcode is None:
                return []
        worker.process.join()
        why = _death(worker.process.exitcode)
        if not worker.ready and worker.process.exitcode != -signal.SIGKILL:
            raise InputError(f"a worker process cannot start ({why}); its words are above")
        worker.pipe.close()
        self._workers[k] = self._start()
        return [] if worker.task is None else [Lost(worker.task, why)]

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=serve, args=(theirs,), daemon=True)
        with _one_thread():
            process.start()
        theirs.close()
        return _Worker(process=process, pipe=ours)


def serve(pipe: Connection) -> None:
    """The life of a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    from recal.fleet.pools.work import perform

    try:
        pipe.send(READY)
        while True:
            pipe.send(perform(pipe.recv()))
    except (EOFError, OSError):  # the parent is gone
        return


@contextmanager
def _one_thread() -> Iterator[None]:
    """What a process started in here reads before it loads numpy; two threads for small matrices
    only wait for each other.
    """
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        try:
            return f"killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"killed by signal {-code}"
    return f"ended with exit code {code}"
