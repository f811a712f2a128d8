"""The page of a fleet of hundreds: self-contained, readable, from the document alone; verdicts and
groups of reasons.
"""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from infield.session.disagreement import BiasStep
from infield.store.rows import UnitKey
from recal.fleet.document import Timing, fleet_document, plain_reason
from recal.fleet.document_records import FleetTiming, TableDrift, TemperatureBand, UnitReport
from recal.fleet.records import FleetRequest, RunOutcome
from recal.fleet.report import SHOWN_UNITS, fleet_html
from tests.drawn import unscripted

UNITS = 240
STEP = BiasStep(
    axis="x",
    shift_deg_h=0.05,
    sigma_deg_h=0.003,
    since_utc="2026-03-01T05:00:00Z",
    run_ids=("r1", "r2"),
    run_sha256=("0", "1"),
)
STEPS = [STEP, replace(STEP, axis="z", shift_deg_h=0.5)]  # z: no level gyro, so no drift


def summary(k):
    low_degC = 5.0 * (k % 7)
    return UnitReport(
        of="x",
        steps=STEPS if k == 7 else (),
        step_words=["table disagrees with unit <since>"] if k == 7 else (),
        pages=[f"/out/units/U{k}/last"],
        coverage=[TemperatureBand(low_degC=low_degC, high_degC=low_degC + 5.0, seconds=600.0)],
        drift=drift(k) if k else None,
    )


def drift(k):
    return TableDrift(
        level_change_deg_h=0.001 * k,
        nm_h=0.06 * (k % 50),
        sigma_nm_h=0.2,
        surprise_sigmas=4.0 if k == 9 else 1.0,
        sigma_before_deg_h=0.0072,
        sigma_after_deg_h=0.0024,
        largest_deg_h=0.01,
        temperature_degC=(1.0, 50.0),
        table_before_sha256="0",
        table_after_sha256="1",
        since_utc="2026-03-01T05:00:00Z",
        until_utc="2026-04-01T05:00:00Z",
    )


@pytest.fixture(scope="module")
def document():
    units = [UnitKey(imu_serial=f"<U{k}>", gyro_technology="rlg") for k in range(UNITS)]
    outcomes = [
        RunOutcome(
            path=f"/r/{k}",
            outcome="committed" if k else "refused",
            reasons=() if k else ("too short: 240 s",),
            folder=f"/out/units/U{k}/last",
            notes=("a note",) if k == 3 else (),
            **vars(key),
        )
        for k, key in enumerate(units)
    ]
    timing = Timing()
    for outcome in outcomes:
        timing.tell(outcome)
    request = FleetRequest(
        source=Path("/r"), store_url="sqlite:////nowhere/a.db", output=Path("/out"), mode="commit"
    )
    return fleet_document(
        request,
        outcomes,
        {key: summary(k) for k, key in enumerate(units)},
        FleetTiming(**vars(timing.document(60.0)), earlier_calls=()),
    )


def test_units_are_ranked_by_predicted_drift_a_step_counted(document):
    first, *units = document.units
    assert first.imu_serial == "<U7>" and first.rank == 1
    # 60 NM/h a deg/h
    assert first.step_drift.nm_h == pytest.approx(3.0)
    assert first.step_drift.sigma_nm_h == pytest.approx(0.18)
    drifts = [u.drift.nm_h for u in units if u.drift]
    assert drifts == sorted(drifts, reverse=True) and len(drifts) == UNITS - 2
    assert [u.rank for u in document.units] == [*range(1, UNITS), None]
    assert first.page.startswith("units/U7/last") and first.page.endswith("/last/update.html")


def test_the_page_is_whole_and_fetches_nothing(document):
    page = unscripted(fleet_html(document))
    assert not re.search(r"https?://|<script|<link|@import|src=", page)
    assert "<U1>" not in page and "&lt;U1&gt;" in page
    assert page.count("update.html") == UNITS + 1 and page.count('class="strip"') == UNITS - 1
    assert f"The other {UNITS - 1 - SHOWN_UNITS} units" in page
    assert "1 of 240 units moved by more than 3 times" in page
    assert "table disagrees with unit &lt;since&gt;" in page and "too short: # s" in page
    assert len(page) < 600_000


def test_reasons_are_grouped_without_names_and_numbers():
    run = RunOutcome(
        path="/a/b",
        run_id="r7",
        imu_serial="SN-7",
        outcome="refused",
        reasons=("/a/b: r7 of SN-7 rests 4.5 s, x2 axis y",),
    )
    assert plain_reason(run) == "RUN: RUN of UNIT rests # s, x2 axis y"
