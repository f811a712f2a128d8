"""A Dask cluster by the address of its scheduler (extra `cluster`); the workers may be on other
machines.

Tasks name files: run directories, the store and the output folder must be there under the same
paths, which is asked before anything else. Dask restarts a killed worker and hands its task out
again; after its `allowed-failures` the task is given up.
"""

import os
import queue
import socket
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ins.records import InputError
from recal.fleet.pools.local_pool import Done, Lost
from recal.fleet.pools.work import perform
from recal.fleet.records import Task
from recal.service.results.files import program_version

CONNECT_S, WORKERS_S, LOOK_S = 10.0, 30.0, 5.0


class DaskPool:
    """Tasks as futures of a cluster; `paths` must exist on every worker."""

    def __init__(self, address: str, paths: Sequence[str], sqlite: bool) -> None:
        self.address, self._ended = address, queue.Queue[tuple[Task, Any]]()
        self._client = _connect(address)
        try:
            self._client.wait_for_workers(1, timeout=WORKERS_S)
            found = self._client.run(probe, list(paths))
        except TimeoutError:
            self.close()
            raise InputError(f"--cluster {address}: the scheduler has no workers") from None
        except (ImportError, OSError) as error:
            self.close()
            raise InputError(f"--cluster {address}: a worker cannot take part: {error}") from None
        wrong = [
            words
            for worker, facts in sorted(found.items())
            if (words := _wrong(worker, facts, sqlite))
        ]
        if wrong:
            self.close()
            raise InputError(
                f"--cluster {address}: {wrong[0]}"
                + (f" (and {len(wrong) - 1} more)" if wrong[1:] else "")
            )

    @property
    def size(self) -> int:
        return max(len(self._client.scheduler_info(n_workers=-1)["workers"]), 1)

    def submit(self, task: Task) -> None:
        future = self._client.submit(perform, task, key=f"recal-{uuid.uuid4()}", pure=False)
        future.add_done_callback(lambda ended: self._ended.put((task, ended)))

    def wait(self) -> list[Done | Lost]:
        from distributed import KilledWorker

        while True:
            try:
                task, future = self._ended.get(timeout=LOOK_S)
                break
            except queue.Empty:
                if self._client.status not in ("running", "connecting"):
                    raise InputError(
                        f"--cluster {self.address}: the scheduler is gone; the same command goes on"
                    ) from None
        if future.status == "finished":
            return [Done(task, future.result())]
        if future.status == "cancelled":
            raise InputError(
                f"--cluster {self.address}: the scheduler is gone; the same command goes on"
            )
        error = future.exception()
        return [
            Lost(
                task,
                (
                    f"{error.last_worker.address} died at it"
                    if isinstance(error, KilledWorker)
                    else repr(error)[:300]
                ),
            )
        ]

    def close(self) -> None:
        self._client.close(timeout=2)


@dataclass(frozen=True, kw_only=True)
class Sight:
    """What a worker sees: its host and version, which paths are missing there, and whether it may
    write to the first.
    """

    host: str
    missing: Sequence[str]
    writable: bool
    version: str


def probe(paths: Sequence[str]) -> Sight:
    """What a worker sees, told by itself."""
    missing = [path for path in paths if not os.path.exists(path)]
    writable = all(os.access(path, os.W_OK) for path in paths[:1] if path not in missing)
    return Sight(
        host=socket.gethostname(), missing=missing, writable=writable, version=program_version()
    )


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--cluster needs Dask: pip install 'strapdown-recal[cluster]'") from None
    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"--cluster {address}: no Dask scheduler answers there ({why[:200]})"
        ) from None


def _wrong(worker: str, facts: Sight, sqlite: bool) -> str:
    """Why a worker cannot take part, empty if it can."""
    where = f"worker {worker} on {facts.host}"
    if facts.missing:
        return (
            f"{where} does not see {facts.missing[0]}: runs, store and output must be reachable"
            " by the same paths there"
        )
    if not facts.writable:
        return f"{where} cannot write to the output folder"
    if facts.version != program_version():
        return f"{where} has recal {facts.version}, here is {program_version()}"
    if sqlite and facts.host != socket.gethostname():
        return (
            f"{where}: a SQLite store takes no writers from other machines; use PostgreSQL (--store"
            " postgresql://...)"
        )
    return ""


def sample_paths(output: Path, run_paths: Sequence[str], store_file: str | None) -> list[str]:
    """What to ask for: the output folder, the store, and the folders that the runs lie in."""
    parents = sorted({str(Path(path).parent) for path in run_paths})
    return [str(output), *([store_file] if store_file else []), *parents[:1000]]
