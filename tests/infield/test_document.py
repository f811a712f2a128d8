"""update.json against its keys in formats.md section 5, copied into tests/vectors, and against the
result it stands for.
"""

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from infield.reports.documents.update import update_document
from infield.reports.documents.update_records import update_of
from infield.session.pipeline import UnitHistory, update_calibration
from infield.table.file import table_from_dict, table_sha256
from ins.documents import Null, plain, to_json
from ins.records import InputError
from ins.units import MILLIRADIAN
from tests.infield.sessions import PARKED, TWIN, factory, factory_dict, simulated

CONTRACT = Path(__file__).parents[1] / "vectors" / "update_contract.json"


@lru_cache(maxsize=4)
def result_of(segments=None, temperature=True):
    run = simulated(1).run if segments is None else simulated(1, segments).run
    if not temperature:
        from dataclasses import replace

        run = replace(run, temperature=None)
    return update_calibration(
        [run], factory(), TWIN, history=UnitHistory(parent_sha256=table_sha256(factory_dict()))
    )


def document_of(result):
    return plain(update_document(result, version="0", table_before=factory_dict()))


@lru_cache(maxsize=1)
def document():
    return document_of(result_of())


def contract():
    return json.loads(CONTRACT.read_text(encoding="utf-8"))


def missing(wanted, got, where=""):
    """Keys of the contract that the document lacks."""
    if isinstance(wanted, dict):
        if not isinstance(got, dict):
            return [f"{where} is {type(got).__name__}"]
        lacking = [f"{where}.{k}" for k in wanted if k not in got]
        return lacking + [
            p for k, v in wanted.items() if k in got for p in missing(v, got[k], f"{where}.{k}")
        ]
    if isinstance(wanted, list) and wanted and isinstance(wanted[0], dict):
        return [p for k, item in enumerate(got) for p in missing(wanted[0], item, f"{where}[{k}]")]
    return []


def test_every_key_of_the_contract_is_there():
    assert missing(contract(), document()) == []


def test_points_are_the_sessions_own():
    p, points = result_of().sessions[0].points, document()["points"]
    assert len(points) == len(p.bias_deg_h)
    for k in (0, 1, 2, 7):
        assert points[k]["axis"] == "xyz"[p.axis_index[k]]
        assert points[k]["bias_deg_h"] == p.bias_deg_h[k]
        assert points[k]["sigma_deg_h"] == pytest.approx(p.sigma_deg_h[k])


def test_tables_and_hashes():
    d = document()
    assert d["table_before"] == factory_dict()
    assert d["table_before_sha256"] == table_sha256(factory_dict())
    assert d["table_after_sha256"] == table_sha256(d["table_after"]) != d["table_before_sha256"]
    after = table_from_dict(d["table_after"], name="after")
    assert np.array_equal(after.parameters, result_of().after.parameters)
    assert d["table_after"]["provenance"]["parent_sha256"] == d["table_before_sha256"]


def test_heading_error_is_computed_minus_true():
    e, truth = result_of().sessions[0].estimate, simulated(1).reference
    k = int(np.argmin(np.abs(truth.time_s - e.alignment.time_s)))
    true_mrad = (
        np.angle(np.exp(1j * (e.alignment.heading_rad - truth.heading_rad[k]))) / MILLIRADIAN
    )
    found = document()["heading_error"]
    assert abs(found["value_mrad"] - true_mrad) < 4 * found["sigma_mrad"]


def test_an_unobservable_heading_error_is_null_and_its_axis_not_observable():
    d = document_of(result_of(PARKED))
    assert d["heading_error"]["value_mrad"] is None
    assert d["heading_error"]["sigma_mrad"] > 0.5
    assert d["observability"]["y"]["verdict"] == "not_observable"
    assert d["observability"]["y"]["advice"]


def test_a_refused_update_has_every_key_too():
    d = document_of(result_of(None, temperature=False))
    assert d["verdict"] == "refused"
    assert "no gyro temperature" in d["reasons"][0]
    assert d["table_after"] == d["table_before"]
    assert d["table_after_sha256"] == d["table_before_sha256"]
    assert d["points"] == []
    assert set(contract()) <= set(d)
    assert d["heading_error"] == {"value_mrad": None, "sigma_mrad": None, "source": None}


def test_uncertainty_budget_names_terms_of_the_right_size():
    budget = {
        (row["axis"], row["term"]): row["sigma_deg_h"] for row in document()["uncertainty_budget"]
    }
    hours = (simulated(1).run.imu.time_s[-1]) / 3600
    assert budget["x", "angle random walk"] == pytest.approx(0.002 / np.sqrt(hours), rel=0.05)
    assert budget["x", "turn-on, this session against the mean"] == 0.003
    assert budget.get(("x", "heading (east part)"), 0.0) < 1e-3  # heading 0: x is north
    assert budget["y", "heading (east part)"] > 1e-3
    assert budget["z", "yaw creep of the airframe"] > 0
    assert all(value > 0 for value in budget.values())


def test_changes_hold_both_tables_at_every_node():
    rows = document()["changes"]
    assert len(rows) == 27
    for row in rows:
        assert row["after_deg_h"] - row["before_deg_h"] == pytest.approx(
            row["change_deg_h"], abs=1e-15
        )
        assert row["U_after_k2_deg_h"] <= row["U_before_k2_deg_h"] * (1 + 1e-9)


def test_shares_of_variance_add_up_and_points_split_into_common_and_own():
    shares = document()["variance_shares"]
    assert len(shares) == 27 + 3  # nodes, and the mean over the temperatures visited of each gyro
    for row in shares:
        assert sum(row["shares"].values()) == pytest.approx(1.0, abs=1e-9)
    of_x = next(r for r in shares if r["axis"] == "x" and r["temperature_degC"] is None)
    assert of_x["shares"]["turn_on"] > 0.2  # 0.003 deg/h of a turn-on, below 0.005 in all
    for p in document()["points"]:
        parts = p["sigma_common_deg_h"] ** 2 + p["sigma_own_deg_h"] ** 2
        assert parts == pytest.approx(p["sigma_deg_h"] ** 2, rel=1e-9)
    # the heading error is one for all points of the east gyro
    assert max(p["sigma_common_deg_h"] for p in document()["points"] if p["axis"] == "y") > 0


def test_a_stored_update_is_the_record_that_was_written():
    written = update_document(result_of(), version="0", table_before=factory_dict())
    stored = json.loads(to_json(written))
    assert to_json(update_of(stored)) == to_json(written)
    assert update_of(stored).zero_rate_effect is None
    assert update_of(stored | {"zero_rate_effect": None}).zero_rate_effect is Null.NULL


def test_a_stored_update_that_is_none_is_refused_in_one_line():
    with pytest.raises(InputError, match="points: got 3"):
        update_of(document() | {"points": 3})
