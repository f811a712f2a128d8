"""What an update says of its parked vehicle, against a sway of known size and frequency."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from infield.reports.documents.update import update_document
from infield.session.pipeline import UnitHistory, update_calibration
from infield.table.file import table_sha256
from ins.documents import plain
from tests.infield.sessions import PARKED, TWIN, factory, factory_dict, ideal_of, unit
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import thermal_history

SWAY_M_S, SWAY_HZ = 0.02, 0.09


@lru_cache(maxsize=1)
def document():
    vehicle = replace(TWIN.vehicle, sway_m_s=SWAY_M_S, sway_hz=SWAY_HZ, sway_damping=0.05)
    simulated = simulate_run(
        ideal_of(PARKED),
        thermal_history("ambient"),
        unit(),
        replace(TWIN, vehicle=vehicle),
        rng=np.random.default_rng(5),
        plan=SessionPlan(run_id="sway", start_utc="2026-03-01T05:00:00Z"),
    )
    history = UnitHistory(parent_sha256=table_sha256(factory_dict()))
    result = update_calibration([simulated.run], factory(), TWIN, history=history)
    return plain(update_document(result, version="0", table_before=factory_dict()))


def test_sway_has_its_size_and_its_octave():
    found = document()["sessions"][0]["environment"]
    place_m = SWAY_M_S / (2 * np.pi * SWAY_HZ)  # RMS of a narrow line
    assert found["sway_m"] == pytest.approx(place_m, rel=0.25)
    bands = found["bands"]
    total = np.sqrt(sum(b["sway_m"] ** 2 for b in bands))
    assert total == pytest.approx(place_m, rel=0.25)
    strongest = max(bands, key=lambda b: b["sway_m"])
    assert strongest["from_hz"] <= SWAY_HZ < strongest["to_hz"]


def test_a_sway_of_place_alone_is_no_tilt_and_no_yaw():
    found = document()["sessions"][0]["environment"]
    assert found["tilt_rad"] < 5e-6
    assert found["yaw_rad"] < 5e-6


def test_points_name_their_phase():
    document_ = document()
    session = document_["sessions"][0]
    assert session["phases_used"] == ["alignment", "extended_alignment"]
    spans = {p["phase"]: (p["start_s"], p["end_s"]) for p in session["phases"]}
    for point in document_["points"]:
        start_s, end_s = spans[point["phase"]]
        assert start_s <= point["time_s"] <= end_s
