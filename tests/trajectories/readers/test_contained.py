"""A library in a child: its answer, and every way in which it can end is one line."""

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers import child_readers
from tests.trajectories.readers.conftest import fork
from tests.trajectories.readers.damage import SAMPLES
from trajectories.readers import contained
from trajectories.readers.contained import read_contained
from trajectories.readers.registry import read_log
from trajectories.readers.rows.column_map import LogOptions
from trajectories.runs.limits import unpack_limit
from trajectories.runs.notes import About, about


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.mat"
    path.write_bytes(b"log")
    return path


def read(path, deed):
    return read_contained(child_readers.__name__, path, [deed])


def check(contents):
    arrays, notes = contents
    assert list(arrays) == ["imu.w/x", "names"] and arrays["names"].tolist() == ["GyrX", ""]
    np.testing.assert_array_equal(arrays["imu.w/x"], np.arange(6.0).reshape(2, 3))
    assert notes == ["a note", "a damaged one"]
    assert [about(note) for note in notes] == [None, About.DAMAGE]


def test_an_answer_whatever_is_printed(log, monkeypatch, capfd):
    check(read(log, "print"))
    monkeypatch.chdir(log.parent)
    check(read(log.relative_to(log.parent), "read"))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("deed", "line"),
    [
        ("grow", "recal --max-unpacked-mb"),
        ("crash", "ended by SIGSEGV"),
        ("leave", r"its reader's answer is garbled \(EOFError\)"),
        ("refuse", "got 1, needed 2"),
        ("fail", "RuntimeError: odd"),
        ("connect", "PermissionError: socket.getaddrinfo"),
        ("start", "PermissionError: subprocess.Popen"),
        ("write", "PermissionError: open while a file is read"),
    ],
)
def test_every_end_is_one_line(log, deed, line):
    with pytest.raises(InputError, match=rf"^log\.mat: .*{line}") as error:
        read(log, deed)
    assert str(error.value).isprintable() and not log.with_name("written").exists()


@pytest.fixture
def children(monkeypatch):
    """The files that children are asked for."""
    asked = []

    def counted(request, arrays, errors):
        asked.append(request.file)
        return fork(request, arrays, errors)

    monkeypatch.setattr(contained, "_run", counted)
    return asked


@pytest.mark.parametrize("sample", SAMPLES, ids=[s.name for s in SAMPLES])
def test_no_child_but_one_of_a_matlab_file(tmp_path, sample, children):
    """Which format it is, is asked without one; what NaveGo's and PSINS's is known by, once."""
    path = tmp_path / f"log{sample.suffix}"
    sample.write(path)
    given = {"format": sample.reader} if sample.reader in ("text", "binary") else {}
    read_log(path, LogOptions({**given, **sample.options}))
    assert children == ([str(path)] if ".mat" in sample.suffix else [])


def test_one_that_does_not_come_back(log, monkeypatch):
    monkeypatch.setattr(contained, "CHILD_LIFE_S", 2)
    with pytest.raises(InputError, match=r"^log\.mat: not read after 2 s, needed one"):
        read(log, "hang")


def test_the_option_raises_what_it_may_take(log):
    with unpack_limit(1000):
        check(read(log, "grow"))


def test_the_environment_stays_behind(log, monkeypatch):
    """Whatever a library reads of it, passwords are not there."""
    seen = {}

    def run(command, **settings):
        seen.update(settings["env"])
        raise InputError("seen")

    monkeypatch.setattr(contained.subprocess, "run", run)
    monkeypatch.setenv("RECAL_PASSWORD", "secret")
    with pytest.raises(InputError, match="seen"):
        read(log, "read")
    assert set(seen) <= {*contained.ENVIRONMENT, *contained.ONE_THREAD, contained.VARIABLE}
    assert "secret" not in seen.values() and seen["PATH"] == os.environ["PATH"]


def test_from_threads_and_from_workers_that_may_have_no_children(log):
    with ThreadPoolExecutor(3) as threads:
        for contents in threads.map(read, [log] * 3, ["read"] * 3):
            check(contents)
    with multiprocessing.get_context("spawn").Pool(1) as workers:  # daemonic
        check(workers.apply(read, (log, "read")))


def test_an_answer_that_would_be_code_is_refused(log, monkeypatch):
    def pickled(request, arrays, errors):
        np.savez(arrays, told=np.array([{}], dtype=object), allow_pickle=True)
        return 0

    monkeypatch.setattr(contained, "_run", pickled)
    with pytest.raises(InputError, match="answer is garbled"):
        read(log, "read")
