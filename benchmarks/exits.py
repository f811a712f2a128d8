"""How `recal check` ends on a broken run, many times: `python benchmarks/exits.py 2000`.

Each end is that of a process of its own, forked from one that has loaded the command line but no
library with threads; those load after the fork. Anything but exit code 3 is printed and counted.
"""

import contextlib
import importlib
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

EXPECTED = 3
for _name in ("pydantic", "typer"):
    importlib.import_module(_name)


def broken_run(folder: Path) -> Path:
    """A run whose imu stream is no Parquet file, made in a child process: it loads numpy."""
    child = os.fork()
    if child == 0:
        from tests.trajectories.run_cases import full_run
        from trajectories.runs.directory import write_run

        write_run(folder / "run", full_run())
        (folder / "run" / "imu.parquet").write_bytes(b"no Parquet")
        os._exit(0)
    os.waitpid(child, 0)
    return folder / "run"


def one_exit(run: Path) -> int | None:
    """The exit code of one `recal check`, minus the signal where one ended it; None in the
    child.
    """
    child = os.fork()
    if child == 0:
        return None
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def main() -> None:
    codes: Counter[int] = Counter()
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        run = broken_run(Path(folder))
        for number in range(1, int(sys.argv[1]) + 1):
            code = one_exit(run)
            if code is None:
                stack.pop_all()
                check(run)
            else:
                codes[code] += 1
                if code != EXPECTED or number % 50 == 0:
                    print(f"{number} exits: {dict(codes)}", flush=True)
    print(f"{codes.total()} exits, {codes.total() - codes[EXPECTED]} with another code than 3")


def check(run: Path) -> None:
    """`recal check` as its script starts it; ends the process."""
    from recal.__main__ import main as program

    sys.argv = ["recal", "check", "-q", str(run)]
    sys.stderr = open(os.devnull, "w")
    program()


if __name__ == "__main__":
    main()
