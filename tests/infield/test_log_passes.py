"""How often a session's log is gone over, and that it is asked once where it rests."""

from collections import Counter
from dataclasses import replace

import pytest

from alignment.motion import seconds
from infield.session.pipeline import update_calibration
from recal.service.inputs import unit_inputs
from tests.infield.sessions import TAXI, TWIN, factory, simulated

MOST = 8.0  # times the rows of the log: one reading by seconds, solve's passes, the claim chain


class CountedImu:
    """A log left in its file, as far as anyone can tell, that counts the rows it hands out."""

    def __init__(self, imu):
        self.imu = imu
        self.handed_out = 0

    def __getattr__(self, name):
        return getattr(self.imu, name)

    def pieces(self, *span):
        for piece in self.imu.pieces(*span):
            self.handed_out += piece.rows
            yield piece

    def between(self, start_s, end_s):
        part = self.imu.between(start_s, end_s)
        self.handed_out += part.rows
        return part

    def whole(self):
        self.handed_out += self.imu.rows
        return self.imu.whole()


@pytest.fixture
def counted():
    run = simulated(1, TAXI).run
    return replace(run, imu=CountedImu(run.imu))


def test_an_update_goes_over_the_log_at_most_eight_times(counted):
    found = update_calibration([counted], factory(), TWIN)
    assert found.sessions[0].estimate is not None
    assert counted.imu.handed_out <= MOST * counted.imu.rows


def test_a_unit_without_a_table_is_read_by_seconds_once(counted, monkeypatch):
    read = Counter()
    real = seconds.read_seconds

    def counting(imu):
        read[id(imu)] += 1
        return real(imu)

    monkeypatch.setattr(seconds, "read_seconds", counting)
    table = unit_inputs.table_of_unknown_unit(counted, TWIN)
    update_calibration([counted], table, TWIN)
    assert read[id(counted.imu)] == 1
