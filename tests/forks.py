"""Real processes without their start-up time: a server that has imported everything and forks one
for each job::

    with ForkServer() as forks:
        jobs = [forks.start("tests.infield.store_writer:work", url, name) for name in "ab"]
        outcomes = [forks.wait(job) for job in jobs]
        update = ["update", "run", "--commit"]
        outcome = forks.run_and_kill("tests.forks:recal", update, since=1, after_s=0.01)

A job is a function of a module with JSON arguments. Its standard output is part of the outcome;
SIGKILL may come a time after its start, or after its n-th write transaction began, on the clock of
its own computing where that can be read: a busy machine then shifts nothing. SIGKILL leaves no time
for clean-up.
"""

import importlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
LONGEST_S = 300.0  # a job that takes longer is killed and reported


@dataclass(frozen=True)
class Outcome:
    """A job's exit code, negative for the signal that ended it, and what it had printed."""

    code: int
    out: str


class ForkServer:
    """Starts jobs in processes of their own."""

    def __init__(self, folder: Path | None = None) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        self._server = subprocess.Popen(
            [sys.executable, "-m", "tests.forks"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=folder,
        )

    def __enter__(self) -> "ForkServer":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._server.stdin.close()
        self._server.wait()
        self._server.stdout.close()

    def here(self, function: str, *arguments: object) -> None:
        """Run a job in the server itself, so that what it loads is there in every later one."""
        self._ask(do="here", function=function, arguments=arguments)

    def start(self, function: str, *arguments: object) -> int:
        """Start a job; its process id."""
        return self._ask(do="start", function=function, arguments=arguments)["pid"]

    def wait(self, pid: int) -> Outcome:
        return Outcome(**self._ask(do="wait", pid=pid))

    def run_and_kill(
        self, function: str, *arguments: object, since: int, after_s: float
    ) -> Outcome:
        """Kill a job `after_s` after its start (since 0) or n-th write began; one that is done by
        then ends by itself.
        """
        pid = self.start(function, *arguments)
        return Outcome(**self._ask(do="kill", pid=pid, since=since, after_s=after_s))

    def _ask(self, **request: object) -> dict:
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        answer = json.loads(self._server.stdout.readline() or '{"error": "the fork server died"}')
        assert "error" not in answer, answer["error"]
        return answer


def recal(arguments: list[str]) -> None:
    """The command line, as `python -m recal` runs it."""
    from recal.__main__ import main

    sys.argv = ["recal", *arguments]
    main()


def plain_page(document) -> str:
    """A page in the place of `infield.reports.update_page.update_html`, of its size without its
    figures: they take 0.85 of an update.
    """
    return f"<html>{document.verdict}{' ' * 300_000}</html>"


def recal_plain(arguments: list[str]) -> None:
    """The command line, its page without figures."""
    import infield.reports.update_page

    infield.reports.update_page.update_html = plain_page
    recal(arguments)


@dataclass
class _Job:
    out: Path
    marks: int  # the end of a pipe that gets a letter where a write begins


def _serve() -> None:
    jobs: dict[int, _Job] = {}
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    with tempfile.TemporaryDirectory() as folder:
        for line in sys.stdin:
            try:
                answer = _answer(json.loads(line), jobs, Path(folder))
            except Exception:
                answer = {"error": traceback.format_exc()}
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


def _answer(request: dict, jobs: dict[int, _Job], folder: Path) -> dict:
    if request["do"] == "here":
        try:
            _function(request["function"])(*request["arguments"])
        except SystemExit as end:
            if end.code:
                return {"error": f"{request['arguments']}: exit code {end.code}"}
        return {}
    if request["do"] == "start":
        return {"pid": _fork(request, jobs, folder)}
    pid = request["pid"]
    job = jobs.pop(pid)
    if request["do"] == "kill":
        for _ in range(request["since"]):
            select.select([job.marks], [], [], LONGEST_S)  # readable when it writes, or has ended
            os.read(job.marks, 1)
        _let_compute(pid, request["after_s"])
        os.kill(pid, signal.SIGKILL)
    elif not _let_run(pid, LONGEST_S):
        os.kill(pid, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    os.close(job.marks)
    return {"code": code, "out": job.out.read_text()}


def _let_run(pid: int, longest_s: float) -> bool:
    """Whether the process ended within a time; it stays to be waited for."""
    until = time.monotonic() + longest_s
    while (left := until - time.monotonic()) > 0:
        if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
            return True
        time.sleep(min(left, 0.002))
    return False


def _let_compute(pid: int, seconds: float) -> None:
    """Returns when the process has computed for so long, has ended, or hangs."""
    start, until = _computed_s(pid), time.monotonic() + 20.0 * seconds
    while _computed_s(pid) < start + seconds and time.monotonic() < until:
        if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
            return
        time.sleep(0.0002)


def _computed_s(pid: int) -> float:
    """Time that a process had a processor, where Linux says so, else the time of day."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) * 1e-9
    except (OSError, IndexError):
        return time.monotonic()


def _fork(request: dict, jobs: dict[int, _Job], folder: Path) -> int:
    out, (marks, mark) = folder / f"{len(os.listdir(folder))}.out", os.pipe()
    out.touch()
    function = _function(request["function"])
    pid = os.fork()
    if pid == 0:
        os.dup2(os.open(out, os.O_WRONLY), 1)
        os.close(marks)
        _child(function, request["arguments"], mark)
    os.close(mark)
    jobs[pid] = _Job(out, marks)
    return pid


def _child(function, arguments: list, mark: int) -> None:
    """Runs the job and ends the process; says when its first write transaction begins."""
    from infield.store.database import Database

    begin, code = Database.write, 1

    def write(self, work):
        os.write(mark, b"w")
        return begin(self, work)

    Database.write = write
    try:
        function(*arguments)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _function(name: str):
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


if __name__ == "__main__":
    _serve()
