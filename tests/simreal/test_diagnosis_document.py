"""diagnosis.json, twin.json and the curves: the contract's fields, and numbers that agree with what
was planted.
"""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from infield.table.file import table_from_dict
from ins.documents import from_json, plain, to_json
from ins.errors.gyro.noise import NOISE_OF_TIME
from ins.errors.unnamed import OF_RUN, OF_TEMPERATURE, OF_TIME, WHILE_MOVING
from ins.records import InputError
from ins.twin_file import read_twin, twin_from_dict
from ins.units import DEG_PER_HOUR
from simreal.declared.twin_effects import parse_effects, twin_traces
from simreal.evidence.overlap import overlapping
from simreal.inference.addback import Shrink
from simreal.inference.causes import Cause, Rival, judged, parameter_of
from simreal.inference.diagnosis import DiagnosisSettings, NotLookedAt, diagnose
from simreal.inference.verdict import Judging, KeptOut
from simreal.plan.record_next import record_next, settling
from simreal.predict.sessions import sessions_of
from simreal.predict.traces import fitted_trace
from simreal.report.diagnosis_curves import overlays
from simreal.report.diagnosis_document import (
    DiagnosisRequest,
    GapReport,
    diagnosis_document,
    refused_document,
    summary,
)
from simreal.report.diagnosis_page import diagnosis_html, value_text
from simreal.report.diagnosis_words import band_words, expected, gathered, percent
from simreal.twin.write_back import effect_items, twin_with_causes
from tests.drawn import specifications
from tests.simreal.diagnosed import diagnosed, trial

# one-minute mean under the twin's angle random walk
MINUTE_SIGMA_deg_h = 0.002 * 60.0 / np.sqrt(60.0)


@pytest.fixture(scope="module")
def found():
    return diagnosed()


def document_of(found):
    asked = DiagnosisRequest(version="1", seed=0, table_sha256="f" * 64)
    return diagnosis_document(found, trial().runs, asked)


def cause(effect="gyro_bias_step", **changes):
    """A step of gyro x in one run; another effect has no run and repeats, where not said."""
    base = Cause(
        effect=effect,
        target="gyro_x",
        id=effect,
        probability=0.8,
        rivals=(),
        parameters={
            "coefficient": parameter_of(0.02, 0.001, "deg/h"),
            "onset_s": parameter_of(900.0, 20.0, "s"),
        },
        run_id="r2" if effect == "gyro_bias_step" else None,
        size=12.0,
        repeats="E" if effect == "gyro_bias_step" else "R",
    )
    return judged(replace(base, **changes))


def finite(value):
    if isinstance(value, dict):
        return all(finite(v) for v in value.values())
    if isinstance(value, list):
        return all(finite(v) for v in value)
    return not isinstance(value, float) or math.isfinite(value)


def test_the_document_has_every_field_of_the_contract(found):
    d = json.loads(to_json(document_of(found)))
    assert d["schema"] == "recal.diagnosis/1" and d["verdict"] == "explained"
    assert set(d["gap"]) == {"score", "floor", "p_value", "excess_sigma"}
    assert set(d["gap_after"]) == {"score", "p_value", "excess_sigma"}
    assert finite(d) and all(isinstance(v, float) for v in d["gap"].values())
    where = d["where"][0]
    assert {"channel", "phase", "temperature_degC", "frequency_hz", "time_s", "share"} <= set(where)
    assert sum(w["share"] for w in d["where"]) <= 1.0 + 1e-9
    assert [w["share"] for w in d["where"]] == sorted(
        (w["share"] for w in d["where"]), reverse=True
    )
    c = d["causes"][0]
    assert {"effect", "target", "probability", "confounded_with", "parameters", "shrink"} <= set(c)
    assert {"value", "sigma", "unit"} <= set(c["parameters"]["coefficient"])
    assert {"fraction", "interval_95", "held_out"} <= set(c["shrink"])
    assert c["shrink"]["held_out"] is True
    assert {"present", "p_value", "share", "looks_like"} == set(d["unexplained"])
    assert all(set(n) == {"effect", "needs"} for n in d["not_testable"])


def test_the_document_names_what_was_planted(found):
    planted = trial().truth[0]
    c = document_of(found).causes[0]
    assert (c.effect, c.target) == (planted.effect, planted.target)
    assert c.shrink.fraction > 0.8 and c.size > 12.0
    assert document_of(found).where[0].channel == planted.target
    assert c.rms[planted.target].unit == "deg/h"


def test_cells_are_all_there_before_and_after(found):
    cells = document_of(found).cells
    assert len(cells) == len(found.cells)
    assert {"gyro_x", "accel_z"} <= {c.channel for c in cells}
    loud = max(cells, key=lambda c: c.nats)
    assert loud.channel == trial().truth[0].target and loud.rho_after < 0.2 * loud.rho


def test_the_twin_reads_back_and_makes_the_fitted_trace_again(found, tmp_path):
    names = [v.name for v in found.views]
    data = twin_with_causes(found.twin, found.causes, names, with_table=True)
    (tmp_path / "twin.json").write_text(json.dumps(data))
    twin = read_twin(tmp_path / "twin.json")
    assert twin.table == "table.json" and len(twin.effects) == len(found.twin.effects) + 1
    effects = parse_effects(twin)
    for k, view in enumerate(found.views):
        again, fitted = twin_traces(effects, view.telemetry, view.name), fitted_trace(found, k)
        assert np.allclose(again.gyro_rad_s, fitted.gyro_rad_s, rtol=1e-9, atol=1e-18)


def test_a_twin_without_table_names_none(found):
    assert twin_with_causes(found.twin, (), [], with_table=False)["table"] is None


def test_an_event_carries_its_run():
    (item,) = effect_items(cause(), ["r1", "r2"])
    assert item == {
        "effect": "gyro_bias_step",
        "target": "gyro_x",
        "parameters": {"coefficient": 0.02, "onset_s": 900.0, "run_id": "r2"},
        "sigma": {"coefficient": 0.001, "onset_s": 20.0},
    }


def test_a_coefficient_a_run_is_an_item_a_run():
    parameters = {
        f"coefficient[{r}]": parameter_of(v, 0.001, "deg/h")
        for r, v in (("a[1]", 0.01), ("b", -0.02))
    }
    items = effect_items(cause(effect="gyro_turn_on_bias", repeats="P", parameters=parameters), [])
    assert [i["parameters"] for i in items] == [
        {"coefficient": 0.01, "run_id": "a[1]"},
        {"coefficient": -0.02, "run_id": "b"},
    ]


@pytest.mark.parametrize("process", ["gyro_bias_instability", "gyro_rate_random_walk"])
def test_a_slow_variation_names_its_process(process):
    slow = cause(
        effect="slow_variation",
        id=process,
        repeats="S",
        parameters={"coefficient": parameter_of(0.005, 1e-3, "deg/h")},
    )
    (item,) = effect_items(slow, [])
    assert item["parameters"] == {"coefficient": 0.005, "process": process}
    assert slow.confounded_with[0] == process and "gyro_gauss_markov" in slow.confounded_with


@pytest.mark.parametrize(
    "name,nodes,expected", [(OF_TEMPERATURE, (0.0, 10.0), [0.0, 10.0]), (OF_RUN, (), ["r1", "r2"])]
)
def test_a_free_function_carries_nodes_and_values(name, nodes, expected):
    free = cause(effect=name, named=False, nodes=nodes, values=(0.1, 0.2), shrink=shrink(0.4, 0.9))
    (item,) = effect_items(free, ["r1", "r2"])
    assert item["parameters"] == {"nodes": expected, "values": [0.1, 0.2], "unit": "deg/h"}


def shrink(low, high, *, held_out=True):
    middle = 0.5 * (low + high)
    return Shrink(middle, (low, high), held_out, Judging.HALVES, 10.0, False)


@pytest.mark.parametrize(
    "effect,measured,expected",
    [
        (OF_TEMPERATURE, shrink(0.1, 0.9), None),
        (OF_TEMPERATURE, shrink(-0.1, 0.9), KeptOut.NOT_SHOWN),
        (OF_TEMPERATURE, shrink(0.1, 0.9, held_out=False), KeptOut.NOT_SHOWN),
        (OF_TEMPERATURE, None, KeptOut.NOT_SHOWN),
        (OF_TEMPERATURE, shrink(-1.0, -0.2), KeptOut.MADE_WORSE),
        ("gyro_thermal_rate", shrink(-0.1, 0.9), None),
        ("gyro_thermal_rate", shrink(-1.0, -0.2), KeptOut.MADE_WORSE),
        (NOISE_OF_TIME, shrink(-0.1, 0.9), KeptOut.NOT_SHOWN),
        (OF_RUN, shrink(-0.1, 0.9), None),
        (WHILE_MOVING, shrink(0.1, 0.9), KeptOut.OF_MOTION),
    ],
)
def test_the_twin_takes_only_what_other_data_bear(found, effect, measured, expected):
    one = cause(
        effect=effect,
        named=effect.startswith("gyro"),
        nodes=(0.0, 10.0) if effect != OF_RUN else (),
        values=(0.1, 0.2),
        shrink=measured,
    )
    assert one.kept_out is expected
    assert bool(effect_items(one, ["r1", "r2"])) == (expected is None)
    document = document_of(replace(found, causes=(one,)))
    assert ("not in twin.json" in "\n".join(summary(document))) == (expected is not None)
    assert plain(document)["causes"][0].get("kept_out") == expected


def test_a_curve_of_time_of_one_rest_stays_out_of_the_twin():
    """A triangle wave over one half-hour: right between the half-minutes that it is drawn through,
    and nothing that another start would show.
    """
    made = trial(None, 0.0, 4, "one_cold", 0)
    (run,) = made.runs
    imu = run.imu.whole()
    x = (imu.time_s - imu.time_s[0]) / 400.0
    wave = np.abs(2.0 * (x % 1.0) - 1.0) - 0.5
    dtheta = imu.dtheta_rad.copy()
    dtheta[:, 1] += 0.2 * DEG_PER_HOUR * wave * imu.dt_s
    waved = replace(run, imu=replace(imu, dtheta_rad=dtheta))
    settings = DiagnosisSettings(effects=(), replicates=100)
    said = diagnose([waved], made.twin, table_from_dict(made.table, name="table"), settings)
    (cause,) = said.causes
    assert (cause.effect, cause.target) == (OF_TIME, "gyro_y")
    assert cause.kept_out is KeptOut.NOT_SHOWN
    assert twin_with_causes(said.twin, said.causes, ["r"], with_table=False)["effects"] == []


def test_items_of_all_kinds_parse():
    slow = cause(
        effect="slow_variation",
        id="gyro_bias_instability",
        repeats="S",
        parameters={"coefficient": parameter_of(0.005, 1e-3, "deg/h")},
    )
    free = cause(effect=OF_RUN, named=False, values=(0.1, 0.2))
    items = [i for c in (cause(), slow, free) for i in effect_items(c, ["r1", "r2"])]
    twin = twin_from_dict(
        {"schema": "recal.twin/1", "gyro_technology": "rlg", "effects": items},
        source="twin.json",
        name="twin.json",
    )
    assert [e.run_id for e in parse_effects(twin)] == ["r2", "", "r1", "r2"]


def test_rivals_of_one_name_are_no_confusion_of_names(found):
    rivals = (
        Rival("gyro_bias_step", "gyro_y", 0.05, 0.1),
        Rival("platform_step", "vehicle", 0.05, None),
    )
    shown = document_of(replace(found, causes=(cause(rivals=rivals),))).causes[0]
    assert shown.confounded_with == ("platform_step",) and shown.rivals[1].cosine is None
    assert not shown.resolved


def test_a_shape_that_the_fit_leaves_open_has_the_sigma_of_its_bounds(found):
    parameters = {
        "coefficient": parameter_of(0.02, 0.001, "deg/h"),
        "tau_s": parameter_of(700.0, float("nan"), "s", bounds=(300.0, 1500.0)),
    }
    loose = cause(effect="gyro_warmup_transient", parameters=parameters)
    document = document_of(replace(found, causes=(loose,)))
    shown = document.causes[0].parameters["tau_s"]
    assert shown.sigma_from == "bounds" and shown.sigma > 100.0


def test_the_overlay_of_a_run_follows_the_effect_fitted_on_the_others(found):
    (overlay,) = overlays(found)
    assert (overlay.channel, overlay.unit) == (trial().truth[0].target, "deg/h")
    assert len(overlay.curves) == 4
    for curve in overlay.curves:
        assert curve.held_out and curve.time_min.size == 29
        left = curve.measured - curve.effect
        assert np.std(left) < 1.5 * MINUTE_SIGMA_deg_h
    swing = max(np.ptp(c.effect) for c in overlay.curves)
    assert swing > 3.0 * MINUTE_SIGMA_deg_h


def test_a_run_held_out_is_drawn_first_and_fitted_without(found):
    name = found.views[2].name
    apart = diagnosed(hold_out=(name,))
    (overlay,) = overlays(apart)
    assert [c.held_out for c in overlay.curves] == [True, False, False, False]
    assert overlay.curves[0].run_id == name
    before = next(c for c in overlays(found)[0].curves if c.run_id == name)
    # leave one out is the same fit
    assert np.allclose(overlay.curves[0].effect, before.effect, rtol=0.02)
    asked = DiagnosisRequest(version="1", seed=0, hold_out=(name,))
    d = diagnosis_document(apart, trial().runs, asked)
    assert [r.run_id for r in d.runs if r.held_out] == [name]
    assert d.causes[0].shrink.how == "runs held out"
    parked = [np.mean(v.telemetry.parked) > 0.9 for v in apart.views]
    assert all(parked)
    assert fitted_trace(apart, 3).gyro_rad_s.shape == (apart.views[3].telemetry.n, 3)


def test_a_stream_of_another_time_is_left_out():
    run = trial().runs[0]
    late = replace(run, temperature=replace(run.temperature, time_s=run.temperature.time_s + 1e5))
    kept, notes = overlapping(late)
    assert kept.temperature is None and kept.imu is run.imu
    assert notes == (
        "run trial-00004-1: temperature covers 100000 to 101800 s, the IMU 0 to 1800 s: left out",
    )
    assert overlapping(run) == (run, ())


def advice_on(found):
    return record_next(found, settling(found, None))


def test_advice_only_for_what_is_open(found):
    alone = replace(found, causes=(cause(),))
    assert advice_on(alone) == []
    slow = cause(effect="slow_variation", id="gyro_bias_instability", repeats="S")
    left = advice_on(
        replace(found, causes=(slow,), unexplained=replace(found.unexplained, present=True))
    )
    assert "three hours" in left[0] and "comes again" in left[1]
    free = replace(found, causes=(cause(effect=OF_TEMPERATURE, named=False),))
    assert "other starts" in advice_on(free)[0]
    rivals = (Rival("gyro_thermal_quadratic", "gyro_x", 0.3, 0.99),)
    mixed = cause(effect="gyro_thermal_linear", rivals=rivals)
    (told,) = advice_on(replace(found, causes=(mixed,)))
    assert "gyro_thermal_linear from gyro_thermal_quadratic" in told


def test_the_page_draws_each_cause_in_every_run(found):
    document = document_of(found)
    page = diagnosis_html(document, overlays(found))
    assert len(specifications(page)) == 8  # first screen: map, bars, shrink; map after; four runs
    assert all(v.name in page for v in found.views)
    titles = [spec["layout"].get("title", {}).get("text", "") for spec in specifications(page)]
    assert sum("fitted on the other runs" in title for title in titles) == 4


def test_the_page_answers_three_questions_first(found):
    """Each with its number, before anything else; a cause's words are linked."""
    document = replace(document_of(found), expected_drift=sessions_of(found)[0])
    page = diagnosis_html(document, overlays(found))
    first = page[: page.index('id="now"')]
    place, cause_, drift = document.where[0], document.causes[0], document.expected_drift
    for said in (
        f"{percent(place.share)} of the gap",
        percent(cause_.probability),
        percent(cause_.shrink.fraction),
        expected(drift.as_it_is),
        expected(drift.without),
    ):
        assert said in first, said
    assert len(specifications(first)) == 3
    assert "recal update RUN --twin twin.json" in page
    assert page.count(f'id="word-{cause_.effect}"') == 1 and f'"#word-{cause_.effect}"' in page


def test_an_event_of_several_runs_is_said_once():
    events = [
        cause(effect="engine_start", target="vehicle", run_id=name, repeats="E") for name in "abc"
    ]
    (found_,) = gathered(events)
    assert found_.causes == tuple(events) and "3 runs" in found_.words


def test_no_band_is_longer_than_the_runs():
    """Rests of 83 min: cells from the mean to quicker than two seconds."""
    edges = [0.0, 1 / 9960, 1.5 / 4980, 3 / 4980, 0.05, 0.5]
    names = [band_words(low, high, 4980.0) for low, high in zip(edges, [*edges[1:], None])]
    hours = [float(n.split()[-2]) for n in names if n.endswith(" h")]
    assert len(set(names)) == len(names) and all(h * 3600.0 <= 4980.0 for h in hours)


def test_a_noise_below_the_declared_is_said_to_be(found):
    quiet = cause(
        effect="gyro_angle_random_walk",
        repeats="S",
        parameters={"coefficient": parameter_of(-0.001, 1e-5, "deg/sqrt(h)", below_declared=True)},
    )
    document = document_of(replace(found, causes=(quiet,)))
    page = diagnosis_html(document, (None,))
    # map and bars; map after, bands
    assert "that much less than the twin declares" in page and len(specifications(page)) == 4
    assert any("less than declared" in line for line in summary(document))


@pytest.mark.parametrize(
    "value,sigma,text",
    [
        (1000.0, None, "1000"),
        (-0.0123456, None, "−0.0123"),
        (2e-7, None, "2e−07"),
        (0.07585, 0.0038, "0.0759 ± 0.0038"),
        (0.0, None, "0"),
    ],
)
def test_values_have_the_digits_that_count(value, sigma, text):
    assert value_text(value, sigma) == text


def test_a_refused_document_says_why_and_claims_nothing(found):
    d = refused_document(
        [NotLookedAt("r1", "never rests")],
        trial().runs[:1],
        found.twin,
        version="1",
        alpha=0.01,
        seed=0,
    )
    assert d.verdict == "refused" and "never rests" in d.sentence and d.gap.score is None
    assert d.causes == () and summary(d) == [f"SN-0042: {d.sentence}"]


def test_a_shrink_of_nearly_all_reads_as_one(found):
    """Score, excess and shrink are one measure, over all rows and by channel."""
    d = plain(document_of(found))
    gap, after = d["gap"], d["gap_after"]
    assert (gap["score"] - 1.0) / gap["excess_sigma"] == pytest.approx(
        (after["score"] - 1.0) / after["excess_sigma"]
    )
    assert gap["excess_sigma"] > 3.0 > abs(after["excess_sigma"])
    low, high = d["shrink"]["interval_95"]
    assert low <= d["shrink"]["fraction"] <= high <= 1.0 and d["shrink"]["fraction"] > 0.8
    worst = max(d["channels"], key=lambda c: c["excess_sigma"])
    assert worst["channel"] == d["where"][0]["channel"]
    assert worst["shrink"]["fraction"] > 0.8
    assert any(line.startswith("  excess over the floor") for line in summary(document_of(found)))


def test_a_document_reads_back_from_its_json(found):
    """What `recal serve` does with a stored document: the same record, the same lines."""
    document = replace(document_of(found), record_next=("one more",))
    stored = json.loads(json.dumps(plain(document)))
    again = from_json(GapReport, stored, name="d.json")
    assert again == document and summary(again) == summary(document)
    assert plain(again) == stored
    del stored["gap"]
    with pytest.raises(InputError, match=r"d\.json: key gap is missing"):
        from_json(GapReport, stored, name="d.json")
