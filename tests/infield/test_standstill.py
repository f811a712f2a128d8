"""Speed logged by others against the motion found in the inertial solution."""

from dataclasses import replace

import numpy as np

from alignment.motion.speeds import speed_disagreement
from infield.reports.documents.update import update_document
from infield.reports.update_page import update_html
from infield.session.pipeline import UnitHistory, update_calibration
from infield.table.file import table_sha256, table_to_dict
from ins.records import OdometerLog, TemperatureLog
from ins.verdicts import codes, sentences
from tests.scenarios.study import REFERENCE_TWIN, prior_table, session


def test_agreeing_odometer_and_gnss_say_nothing():
    o = session("realistic_taxi", 0, with_odometer=True, with_gnss=True)
    assert speed_disagreement(o.simulated.run, o.estimate.solution.motion) == ()


def test_dead_encoder_and_rolling_rest_are_named():
    o = session("realistic_taxi", 0, with_odometer=True)
    run, motion = o.simulated.run, o.estimate.solution.motion
    t = run.odometer.time_s
    dead = replace(run, odometer=OdometerLog(time_s=t, speed_m_s=np.zeros(t.size)))
    assert any("dead_odometer" in code for code in codes(speed_disagreement(dead, motion)))
    rolling = replace(run, odometer=OdometerLog(time_s=t, speed_m_s=np.full(t.size, 9.0)))
    assert any(
        "while the inertial solution rests" in reason
        for reason in sentences(speed_disagreement(rolling, motion))
    )


def test_a_dead_encoder_refuses_the_update_with_a_full_report():
    o = session("realistic_taxi", 0, with_odometer=True)
    run = o.simulated.run
    dead = replace(
        run,
        odometer=OdometerLog(
            time_s=run.odometer.time_s, speed_m_s=np.zeros(run.odometer.time_s.size)
        ),
    )
    table, data = prior_table(), table_to_dict(prior_table())
    result = update_calibration(
        [dead], table, REFERENCE_TWIN, history=UnitHistory(parent_sha256=table_sha256(data))
    )
    assert result.outcome == "refused" and "dead_odometer" in codes(result.reasons)[0]
    document = update_document(result, version="test", table_before=data)
    assert document.reasons[0] in update_html(document)


def test_a_stuck_thermometer_teaches_its_axis_nothing():
    o = session("realistic_taxi", 0)
    run = o.simulated.run
    gyro = np.array(run.temperature.gyro_degC)
    gyro[:, 0] = 0.0
    stuck = replace(run, temperature=TemperatureLog(time_s=run.temperature.time_s, gyro_degC=gyro))
    table, data = prior_table(), table_to_dict(prior_table())
    result = update_calibration(
        [stuck], table, REFERENCE_TWIN, history=UnitHistory(parent_sha256=table_sha256(data))
    )
    assert result.outcome == "accepted"
    x, y = table.values_of("x"), table.values_of("y")
    assert np.array_equal(result.after.parameters[x], table.parameters[x])
    assert np.max(np.abs(result.after.parameters[y] - table.parameters[y])) > 1e-5
    document = update_document(result, version="test", table_before=data)
    assert document.observability["x"].verdict == "not_observable"
    assert "thermometer of gyro x is exactly 0" in document.observability["x"].advice
