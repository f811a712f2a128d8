"""What libraries do to a child, asked for by name in `wanted` (test_contained.py)."""

import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np

from ins.records import InputError
from trajectories.runs.notes import About, Note


def contents(path, wanted):
    (deed,) = wanted
    DEEDS[deed](path)
    arrays = {"imu.w/x": np.arange(6.0).reshape(2, 3), "names": np.array(["GyrX", ""])}
    return arrays, ["a note", Note("a damaged one", About.DAMAGE)]


def _crash(path):
    os.kill(os.getpid(), signal.SIGSEGV)


def _print(path):
    print("Warning: most likely corrupt")
    sys.stdout.flush()
    os.write(1, b"junk of a library")


def _refuse(path):
    raise InputError(f"{path.name}: got 1, needed 2")


def _fail(path):
    raise RuntimeError("odd\x1b[2J file")


def _write(path):
    path.with_name("written").write_bytes(b"1")


DEEDS = {
    "read": lambda path: path.read_bytes(),
    "print": _print,
    "grow": lambda path: np.empty(200_000_000),
    "hang": lambda path: time.sleep(100),
    "crash": _crash,
    "leave": lambda path: os._exit(0),
    "refuse": _refuse,
    "fail": _fail,
    "connect": lambda path: socket.create_connection(("127.0.0.1", 9)),
    "start": lambda path: subprocess.run(["true"], check=True),
    "write": _write,
}
