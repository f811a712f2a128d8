"""Commands on a log that stays in its file: the same documents as with the log in memory, in
bounded memory.
"""

import json
from functools import partial

import pytest

from benchmarks.long_flight import make_run
from benchmarks.speed import LIMIT_MB, measure
from infield.store.table_store import TableStore
from ins.documents import to_json
from tests.infield.sessions import TAXI, factory_dict, simulated
from tests.recal import verbs
from trajectories.runs import directory as run_module
from trajectories.runs import stream_files
from trajectories.runs.directory import read_run, write_run
from trajectories.runs.imu_stream import ImuFile, load_imu
from trajectories.simulator.segments import Climb, Cruise, TakeOff

FLIGHT = (*TAXI, TakeOff(lift_off_speed_m_s=70.0), Climb(height_m=200.0), Cruise(duration_s=60.0))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = simulated(1, FLIGHT)
    write_run(tmp_path / "run", made.run, reference=made.reference)
    with TableStore.open("sqlite:///recal.db", create=True) as store:
        store.import_table(factory_dict())
    return tmp_path


def documents(folder) -> list[str]:
    path, store = folder / "run", "sqlite:///recal.db"
    made = [
        verbs.check(path),
        verbs.align(path, store_url=store),
        verbs.replay(path, store_url=store),
        verbs.update([path], store_url=store, commit=False),
    ]
    assert made[3].pop("issued_utc")
    return [to_json(document) for document in made] + [
        (folder / "recal-replay/navigation.parquet").read_bytes()
    ]


@pytest.mark.parametrize("phases", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_log_left_in_its_file_gives_the_same_documents(folder, monkeypatch, phases):
    if not phases:
        (folder / "run" / "phases.parquet").unlink()
    held = documents(folder)
    monkeypatch.setattr(run_module, "load_imu", partial(load_imu, piece_rows=997))
    monkeypatch.setattr(run_module, "read_run", partial(read_run, held_rows=0))
    monkeypatch.setattr(run_module, "inspect_run", partial(run_module.inspect_run, held_rows=0))
    monkeypatch.setattr(stream_files, "HELD_ROWS", 0)
    assert isinstance(run_module.read_run(folder / "run").imu, ImuFile)
    for in_memory, left in zip(held, documents(folder)):
        assert left == in_memory
    assert json.loads(held[3])["verdict"] == "proposed"


@pytest.mark.slow
@pytest.mark.parametrize("fmt", ["parquet", "csv"])
def test_ten_hours_at_200_hz_stay_below_a_gigabyte(tmp_path, fmt):
    """The largest resident memory of each command, measured on its own process; about 0.5 GB."""
    make_run(tmp_path, 10.0, fmt=fmt)
    for command, use in measure(tmp_path).items():
        assert use.peak_mb < LIMIT_MB, f"{command}: {use.peak_mb:.0f} MB"
