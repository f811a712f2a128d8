"""`recal fleet forecast` on units at the level of session points, and on a small store."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.fleet_made import made_fleet
from infield.learning.forecast import HORIZON_YEARS, Paths, state_of, works_at
from infield.learning.learn import Learnt
from infield.learning.likelihood import FleetLikelihood
from infield.learning.parameters import OF_POINTS, PriorName, defaults_of, logs_of
from infield.learning.stored_sessions import covering
from infield.store.table_store import TableStore
from infield.table.file import table_to_dict
from recal.cli.app import app
from recal.service.priors.forecast import ForecastRequest, forecast
from tests.infield.stores import table

URL = "sqlite:///recal.db"


@pytest.fixture(scope="module")
def unit():
    """A unit of default parameters with its state after four sessions, and these parameters."""
    made, _ = made_fleet(11, units=1, sessions=4, width=0.0)
    kept, value = made[0].kept, defaults_of("rlg")
    evidence = FleetLikelihood([kept])(logs_of(value))
    n = sum(t.size for t in covering(kept).temperature_degC)
    first = covering(kept)
    active = first.replaced(parameters=first.parameters + evidence.mean[0, :n])
    state = state_of(kept, evidence.mean[0], evidence.covariance[0], active)
    known = {name: Learnt.normal(value[name], 0.1, shown=True, n=4) for name in OF_POINTS}
    return kept, state, known


def ahead(unit, **changes):
    kept, state, value = unit
    after = changes.pop("state", state)
    return Paths(value, works_at(kept)).ahead(after, year=state.year, **changes)


def test_the_drift_grows_and_passes_the_limit_later_where_it_is_higher(unit):
    seen = ahead(unit)
    assert seen.median[-1] > 2.0 * seen.median[0] and np.all(seen.high >= seen.median)
    assert 0.0 < seen.year_95 < seen.year_50 < HORIZON_YEARS
    assert ahead(unit, limit_nm_h=1.6).year_50 > seen.year_50
    assert ahead(unit, limit_nm_h=0.01).year_95 == 0.0
    assert ahead(unit, limit_nm_h=50.0).year_50 == np.inf


def test_the_drift_now_is_that_of_what_the_table_leaves(unit):
    """RMS over paths against the covariance: 60 NM/h for each deg/h (physics.md 6.3)."""
    kept, state, value = unit
    _, P = state.level_error(works_at(kept))
    start = value[PriorName.TURN_ON].value ** 2 + (0.664 * value[PriorName.FLICKER].value) ** 2
    expected = 60.0 * np.sqrt(np.trace(P) / len(works_at(kept)[0]) + 2.0 * start)
    assert ahead(unit).median[0] == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("years", (0.02, 2.0))
def test_walks_leave_a_disc_when_theory_says(unit, years):
    """Level errors that walk without a start from zero, alike at all temperatures, leave the disc
    of radius r after r^2 / (2 q) on average, q their growth: a planar Brownian motion. A week ahead
    as well as in years.
    """
    kept, state, value = unit
    radius = 0.8 / 60.0
    sizes = dict.fromkeys(value, 1e-9) | {
        PriorName.AGEING_COMMON: radius / np.sqrt(2.0 * years),
        PriorName.LENGTH: 30.0,
    }
    known = {name: Learnt.normal(sizes[name], 1e-9, shown=True, n=4) for name in OF_POINTS}
    still = replace(state, covariance=0.0 * state.covariance)
    seen = Paths(known, works_at(kept)).ahead(still, year=state.year)
    expected = pytest.approx(years, abs=3.0 * np.std(seen.passes) / np.sqrt(seen.passes.size))
    assert np.mean(seen.passes) == expected


def test_a_session_puts_the_dates_off(unit):
    kept, state, value = unit
    later = state.aged(value, state.year + 1.0)
    after = later.with_session(kept.sessions[-1], value, later.year)
    before, then = (ahead(unit, state=s) for s in (later, after))
    assert then.year_95 > before.year_95 and then.median[0] < before.median[0]


def test_a_store_is_forecast_by_urgency(tmp_path, monkeypatch):
    """Tables without a session: the older one first; MEMS units are named; empty is refused."""
    monkeypatch.chdir(tmp_path)
    with TableStore.open(URL, create=True):
        pass
    assert CliRunner().invoke(app, ["fleet", "forecast", "--store", URL]).exit_code == 4
    with TableStore.open(URL, create=True) as store:
        for serial, technology, since in (
            ("SN-OLD", "rlg", "2024-01-01T00:00:00Z"),
            ("SN-NEW", "rlg", "2026-11-01T00:00:00Z"),
            ("DRONE", "mems", "2026-11-01T00:00:00Z"),
        ):
            data = {**table_to_dict(table(serial, technology)), "created_utc": since}
            if technology == "rlg":
                P = np.array(data["covariance"]) * 0.01
                data["covariance"] = P.tolist()
                for axis in data["axes"].values():
                    axis["sigma_deg_h"] = [0.1 * sigma for sigma in axis["sigma_deg_h"]]
            store.import_table(data)
    now = datetime(2026, 11, 22, tzinfo=UTC)
    told = []
    found = forecast(ForecastRequest(store_url=URL, now=now, limit_nm_h=1.5), told.append)
    assert told[1:-1] == ["SN-OLD, unit 1 of 2 rlg", "SN-NEW, unit 2 of 2 rlg"]
    assert [u.imu_serial for u in found.record.units] == ["SN-OLD", "SN-NEW"]
    old, new = found.record.units
    assert old.drift_now_nm_h > new.drift_now_nm_h and "defaults of rlg" in old.rests_on
    assert old.date_95_utc <= new.date_95_utc and new.date_95_utc < new.date_50_utc
    assert [item.imu_serial for item in found.record.without] == ["DRONE"]
    document = json.loads(Path("recal-fleet-forecast/forecast.json").read_text())
    assert document["schema"] == "recal.forecast/1" and document["limit_nm_h"] == 1.5
    page = Path("recal-fleet-forecast/forecast.html").read_text()
    assert page.index("SN-OLD") < page.index("SN-NEW")
    done = CliRunner().invoke(app, ["fleet", "forecast", "--store", URL, "--json", "-o", "f"])
    assert done.exit_code == 0 and json.loads(done.stdout)["verdict"] == "ok"
    wrong = CliRunner().invoke(app, ["fleet", "forecast", "--store", "sqlite:///no.db"])
    assert "///no.db" in str(wrong.exception)
