"""Which unit next? The order, the words and the filters of the list of units."""

from datetime import UTC, datetime, timedelta

import pytest

pytest.importorskip("fastapi")

from recal.service.priors.records import DriftTrend, ForecastReport, UnitForecast
from recal.service.store import UnitKey, UnitSummary
from recal.web.health import Show, chosen, unit_health, urgency

NOW = datetime(2026, 11, 22, tzinfo=UTC)


def unit(serial, *, days=10.0, **more):
    known = {
        "active_number": 2,
        "kind": "update",
        "sha256": "a" * 64,
        "has_twin": True,
        "undecided": 0,
        "contradictions": 0,
        **more,
    }
    created = (NOW - timedelta(days=days)).strftime("%Y-%m-%dT%H:%M:%SZ")
    key = UnitKey(imu_serial=serial, gyro_technology="rlg")
    return UnitSummary(unit=key, created_utc=created, **known)


def forecast(**drifts):
    """Drift now [NM/h] and days until the 95 % date, by serial."""
    rows = [
        UnitForecast(
            imu_serial=serial,
            gyro_technology="rlg",
            gyro_mode="",
            revision=2,
            sessions=3,
            last_session_utc=None,
            drift_now_nm_h=drift,
            drift_now_95_nm_h=2 * drift,
            expected_bias_deg_h=0.01,
            date_50_utc=None,
            date_95_utc=(NOW + timedelta(days=days)).strftime("%Y-%m-%dT%H:%M:%SZ"),
            temperature_degC=(0.0, 40.0),
            rests_on="defaults of rlg",
            trend=DriftTrend(date_utc=(), median_nm_h=(), high_nm_h=()),
        )
        for serial, (drift, days) in drifts.items()
    ]
    return ForecastReport(
        verdict="forecast",
        reasons=(),
        store="s",
        issued_utc="",
        version="",
        limit_nm_h=0.8,
        units=rows,
    )


UNITS = [
    unit("GOOD"),
    unit("OLD", days=400),
    unit("WAITS", undecided=1),
    unit("SOON"),
    unit("BEYOND"),
    unit("AGAINST", contradictions=2),
    unit("NEW", active_number=0, has_twin=False, days=0),
]
DRIFTS = forecast(BEYOND=(0.9, -5), SOON=(0.5, 30), GOOD=(0.2, 900))


def test_the_unit_that_needs_most_comes_first():
    rows = sorted(unit_health(UNITS, DRIFTS, NOW), key=urgency)
    found = [row.unit.unit.imu_serial for row in rows]
    assert found == ["AGAINST", "WAITS", "BEYOND", "SOON", "NEW", "OLD", "GOOD"]
    assert [row.age_days for row in rows if row.unit.unit.imu_serial == "OLD"] == [400.0]


def test_what_waits_for_a_decision_comes_before_what_only_drifts():
    rows = unit_health([unit("BEYOND"), unit("BOTH", undecided=1)], forecast(BOTH=(0.9, -5)), NOW)
    assert [row.unit.unit.imu_serial for row in sorted(rows, key=urgency)] == ["BOTH", "BEYOND"]


@pytest.mark.parametrize(
    ("show", "serials"),
    [
        (Show.ALL, {"GOOD", "OLD", "WAITS", "SOON", "BEYOND", "AGAINST", "NEW"}),
        (Show.NEXT, {"OLD", "WAITS", "SOON", "BEYOND", "AGAINST", "NEW"}),
        (Show.WAITING, {"WAITS"}),
        (Show.NO_TWIN, {"NEW"}),
    ],
)
def test_filters(show, serials):
    rows = chosen(unit_health(UNITS, DRIFTS, NOW), show)
    assert {row.unit.unit.imu_serial for row in rows} == serials
