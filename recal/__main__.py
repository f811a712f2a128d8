"""`recal` and `python -m recal`: runs the command line, turns bad input into one line and exit code
3.

Decision: docs/decisions/0083-compiled-kernels.md.
"""

import gc
import os
import sys

for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    # the matrices are small: waiting threads cost a diagnosis 10 times its own time
    os.environ.setdefault(_threads, "1")

# A command makes many objects and ends: looking for cycles less often saves 5 % of its time.
GARBAGE_AFTER = 50_000
gc.set_threshold(GARBAGE_AFTER)


def main() -> None:
    code = _run()
    try:
        if sys.stdout is not None:  # None where the shell closed it (>&-)
            sys.stdout.flush()
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"recal: standard output: {error.strerror}", file=sys.stderr)
        code = 3
    sys.exit(code)


def _run() -> int:
    """The exit code of the command that the arguments ask for."""
    try:
        from recal.cli.app import app

        app(prog_name="recal")
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # the reader of the help has seen enough
            return 0
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        return 0
    except Exception as error:
        from ins.records import InputError
        from ins.user_input import one_line

        line = str(error)
        if isinstance(error, OSError) and error.strerror is not None:
            line = f"{error.filename or 'standard output'}: {error.strerror}"
        elif not isinstance(error, InputError):
            raise
        for said in (f"recal: {line}", *getattr(error, "more", ())):
            print(one_line(said), file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    main()
