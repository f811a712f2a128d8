"""`simreal.plan.study`: sums of Gram matrices against whole banks, the table of effects.md, and the
search for recordings.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ins.errors.catalogue import catalogue, effects_named
from ins.records import InputError, Site
from ins.twin_file import default_twin
from ins.units import DEG
from simreal.evidence.whitened import Evidence
from simreal.inference.attribute import Attributor
from simreal.inference.bank import Bank
from simreal.plan.advice import advice
from simreal.plan.gram import ODDS_NATS, Contender, RunGrams, separation
from simreal.plan.pairs import CLASSICAL, Pair, assess, contender, read_pair
from simreal.plan.recordings import Recording, RecordingMaker, candidates
from simreal.plan.study import NULL_NATS, Planner, seen_sizes

TWIN = default_twin("rlg")
SITE = Site(lat_rad=45 * DEG, lon_rad=7 * DEG, height_m=250.0)
COLD, AMBIENT, COOLING = (Recording(start=s) for s in ("cold", "ambient", "cooling"))
RESTART = Recording(start="hot_restart")
PLANS = {
    "1 cold": (COLD,),
    "1 cooling": (COOLING,),
    "3 cold": (COLD, Recording(variant=1), Recording(variant=2)),
    "diverse": (COLD, AMBIENT, COOLING),
    "restart": (COLD, AMBIENT, COOLING, RESTART),
    "3 h": (Recording(hours=3.0),),
}


@pytest.fixture(scope="module")
def maker():
    return RecordingMaker(TWIN, None, SITE)


def of(name, target="gyro_x", **shape):
    effect = next(e for e in effects_named(name) if target in e.targets)
    return Contender(effect, target, (tuple(shape.items()),) if shape else None)


def grams(maker, recordings, *contenders, twin=TWIN):
    return [RunGrams(maker.view(r), twin, contenders) for r in recordings]


def whole_bank_cos2(views, h, k, *, run_h=None, run_k=None):
    """Largest squared cosine of single shapes of h with the span of k, from one bank over all."""
    bank = Bank(Evidence(views, TWIN), (h.effect, k.effect), with_generic=False)

    def groups(e, run):
        found = next(
            x
            for x in bank.hypotheses
            if x.effect.id == e.effect.id and x.target == e.target and x.run == run
        )
        return found.groups

    out = []
    for a in groups(h, run_h):
        A = np.column_stack(
            [bank.signature(a.columns[[c]], a.scale[[c]]) for c in range(a.columns.size)]
        )
        best = 0.0
        for b in groups(k, run_k):
            B = np.column_stack(
                [bank.signature(b.columns[[c]], b.scale[[c]]) for c in range(b.columns.size)]
            )
            left = A - B @ np.linalg.lstsq(B, A, rcond=1e-10)[0]
            best = max(best, 1.0 - np.sum(left**2) / np.sum(A**2))
        out.append((best, np.sqrt(np.sum(A**2))))
    return np.array(out)


@pytest.mark.parametrize(
    ("h", "k"),
    [
        (of("gyro_thermal_linear"), of("gyro_warmup_transient")),
        (of("gyro_warmup_transient"), of("gyro_mode_hop")),
        (of("gyro_turn_on_bias"), of("gyro_magnetic_sensitivity")),
        (of("gyro_magnetic_sensitivity"), of("gyro_turn_on_bias")),
    ],
)
def test_sums_over_runs_are_the_whole_bank(maker, h, k):
    recordings = (COLD, replace(AMBIENT, heading_deg=90.0))
    found = separation(grams(maker, recordings, h, k), h, k)
    wanted = whole_bank_cos2([maker.view(r, n) for n, r in enumerate(recordings)], h, k)
    np.testing.assert_allclose(found.cos**2, wanted[:, 0], atol=1e-5)
    np.testing.assert_allclose(found.delta, wanted[:, 1], rtol=1e-5)


def test_an_event_is_one_run_and_its_rival_all(maker):
    settling, drift = of("platform_settling", "vehicle"), of("accel_warmup_transient", "accel_x")
    runs = grams(maker, (COLD, AMBIENT), settling, drift)
    views = [maker.view(r, n) for n, r in enumerate((COLD, AMBIENT))]
    ahead, back = separation(runs, settling, drift), separation(runs, drift, settling)
    each = [whole_bank_cos2(views, settling, drift, run_h=r) for r in range(2)]
    np.testing.assert_allclose(ahead.cos**2, np.concatenate(each)[:, 0], atol=1e-5)
    both = np.max(
        [whole_bank_cos2(views, drift, settling, run_k=r)[:, 0] for r in range(2)], axis=0
    )
    np.testing.assert_allclose(back.cos**2, both, atol=1e-5)
    step = of("platform_step", "vehicle")
    runs = grams(maker, (COLD, AMBIENT), settling, step)
    own = [whole_bank_cos2(views, settling, step, run_h=r, run_k=r) for r in range(2)]
    np.testing.assert_allclose(
        separation(runs, settling, step).cos ** 2, np.concatenate(own)[:, 0], atol=1e-5
    )


def test_needed_size_gives_odds_of_nineteen_to_one(maker):
    """Mean log likelihood ratio against the fitted rival, at the size needed: ln 19."""
    h, k = of("gyro_thermal_linear"), of("gyro_thermal_rate")
    view = maker.view(COLD)
    found = separation([RunGrams(view, TWIN, (h, k))], h, k)
    evidence = Evidence([view], TWIN)
    a, b = (evidence.whiten([e.effect.traces(view.telemetry, "gyro_x", {})])[:, 0] for e in (h, k))
    true = found.delta_needed[0] * a / np.linalg.norm(a)
    left = true - b * (b @ true) / (b @ b)
    assert 0.5 * left @ left == pytest.approx(ODDS_NATS, rel=1e-4)
    assert ODDS_NATS == pytest.approx(np.log(0.95 / 0.05))


def table(maker, twin):
    """effects.md's pairs in its plans, each true effect of one shape."""
    exp1000 = of("gyro_warmup_transient", tau_s=1000.0)
    exp350 = of("gyro_warmup_transient", tau_s=350.0)
    linear = of("gyro_thermal_linear")
    ramp = of("gyro_rate_ramp")
    quadratic = of("gyro_thermal_quadratic")
    pairs = {
        "Tlin/exp1000": (linear, exp1000),
        "Tlin/Tquad": (linear, quadratic),
        "exp1000/ramp": (exp1000, ramp),
        "Tquad/exp350": (quadratic, exp350),
    }
    recordings = {r for plan in PLANS.values() for r in plan}
    cached = {
        e: {r: RunGrams(maker.view(r), twin, (linear, quadratic, ramp, e)) for r in recordings}
        for e in (exp1000, exp350)
    }
    return {
        (name, plan): separation(
            [cached[exp350 if exp350 in pair else exp1000][r] for r in PLANS[plan]], *pair
        )
        for name, pair in pairs.items()
        for plan in PLANS
    }


def test_the_table_of_gap_md_comes_out_alike(maker):
    """With the turn-on bias free, as in the prototype: its order and values."""
    free = table(maker, replace(TWIN, gyro=replace(TWIN.gyro, turn_on_deg_h=1.0)))
    cos = {key: float(t.cos[0]) for key, t in free.items()}
    for pair in ("Tlin/exp1000", "Tquad/exp350", "Tlin/Tquad"):
        assert cos[pair, "1 cold"] > 0.9 and cos[pair, "diverse"] < 0.6, "diversity, not number"
        assert cos[pair, "3 cold"] > cos[pair, "diverse"] + 0.3
    # the same profile in both: exact
    assert cos["exp1000/ramp", "1 cold"] == pytest.approx(0.902, abs=0.01)
    assert cos["exp1000/ramp", "diverse"] == pytest.approx(0.902, abs=0.01), (
        "only a longer run helps"
    )
    assert cos["exp1000/ramp", "3 h"] < 0.7
    assert cos["Tlin/Tquad", "1 cold"] == pytest.approx(0.948, abs=0.03)
    assert cos["Tlin/Tquad", "1 cooling"] == pytest.approx(0.998, abs=0.02)
    needed = {plan: float(free["Tlin/exp1000", plan].delta_needed[0]) for plan in PLANS}
    assert needed["1 cold"] > 2.5 * needed["diverse"] and needed["diverse"] < 4.0


def test_a_declared_turn_on_makes_the_constant_part_tell(maker):
    """The prototype left the bias free; the twin's 0.003 deg/h does not."""
    exp1000 = of("gyro_warmup_transient", tau_s=1000.0)
    linear, ramp = of("gyro_thermal_linear"), of("gyro_rate_ramp")
    recordings = {*PLANS["3 cold"], *PLANS["diverse"]}
    found = {r: RunGrams(maker.view(r), TWIN, (linear, ramp, exp1000)) for r in recordings}

    def cosine(a, b, plan):
        return float(separation([found[r] for r in PLANS[plan]], a, b).cos[0])

    assert cosine(exp1000, ramp, "1 cold") < 0.3
    assert cosine(linear, exp1000, "1 cold") > 0.95
    assert cosine(linear, exp1000, "diverse") < 0.4
    assert cosine(linear, exp1000, "3 cold") > 0.9


def test_more_recordings_never_tell_less(maker):
    pair = read_pair("gyro_thermal_quadratic,gyro_warmup_transient")
    planner = Planner([pair], maker)
    for last, plan in zip(
        (PLANS["1 cold"], PLANS["diverse"]), (PLANS["diverse"], PLANS["restart"])
    ):
        before, after = planner.plan(last).judged[0], planner.plan(plan).judged[0]
        for a, b in ((before.a, after.a), (before.b, after.b)):
            left = [t.delta**2 * (1.0 - t.cos**2) for t in (a, b)]
            assert np.all(left[1] >= left[0] - 1e-9)


def test_the_search_asks_for_other_starts(maker):
    planner = Planner([read_pair("gyro_thermal_linear,gyro_warmup_transient")], maker)
    given = Planner(planner.pairs, maker, [maker.view(COLD)])
    among = (COLD, replace(COLD, variant=1), AMBIENT, COOLING, RESTART)
    ranked = given.best_next(given.plan(()), among)
    assert ranked[0].recordings[0].start != "cold" and ranked[-1].recordings[0].start == "cold"
    steps, _ = planner.choose(among, 4)
    assert steps[-1].judged[0].verdict.separates and len(steps) < 4, "no more than it takes"
    assert steps[0].recordings[0].start != "cold", (
        "the start at which the two look alike comes last"
    )
    scores = [p.score for p in steps]
    assert scores == sorted(scores)
    alike = planner.choose((COLD, replace(COLD, variant=1)), 4)[0]
    assert alike[-1].score < steps[-1].score and alike[-1].judged[0].cos > 0.95


def test_a_special_case_is_no_reason_to_record(maker):
    """The line is a parabola with no bend: only the bend has to be told."""
    pair = read_pair("gyro_thermal_linear,gyro_thermal_parabola")
    planner = Planner([pair], maker)
    assert planner.plan(PLANS["diverse"]).judged[0].cos == pytest.approx(1.0, abs=1e-5)
    planner.learn_special_cases(PLANS["restart"])
    judged = planner.plan(PLANS["diverse"]).judged[0]
    assert judged.special == "a" and judged.cos < 0.95 and judged.verdict.separates
    turn_on = read_pair("gyro_g_sensitivity,gyro_turn_on_bias")
    other = Planner([turn_on], maker)
    other.learn_special_cases(PLANS["restart"])
    assert other.special == {turn_on.label: ""}


def test_advice_is_a_sentence_for_each_rival(maker):
    evidence = Evidence([maker.view(COLD)], TWIN)
    credible = [
        ("gyro_warmup_transient", "gyro_x"),
        ("gyro_thermal_linear", "gyro_x"),
        ("unknown_function_of_time", "gyro_x"),
        ("gyro_g_sensitivity", "gyro_x"),
        ("gyro_warmup_transient", "gyro_x"),
    ]
    linear, force = advice(credible, evidence)
    assert "gyro_thermal_linear" in linear
    assert "cold start" not in linear
    before, after = (
        float(part.split(" times")[0].split()[-1])
        for part in (linear.split("instead of")[1], linear)
    )
    assert after < 0.7 * before
    assert "gyro_g_sensitivity" in force
    assert advice(credible[2:3], evidence) == [] == advice(credible[:1], evidence)


def test_where_every_recording_tells_less_that_is_said(maker, monkeypatch):
    """A plan may score below the runs alone by a rounding: 0.033937 after 0.033950 ended `diagnose`
    in a ValueError.
    """
    monkeypatch.setattr(Planner, "best_next", lambda planner, now, listed: [less_told(now)])
    evidence = Evidence([maker.view(COLD)], TWIN)
    (said,) = advice(
        [("gyro_warmup_transient", "gyro_x"), ("gyro_thermal_linear", "gyro_x")], evidence
    )
    assert "gyro_thermal_linear" in said


def less_told(now):
    """A plan with one recording whose pairs are told a little worse."""
    worse = [
        SimpleNamespace(**{**vars(j), "score": 0.99 * j.score, "cos": j.cos}) for j in now.judged
    ]
    return SimpleNamespace(judged=worse, recordings=(COLD,))


def test_rivals_are_named_each_with_the_sensor_it_can_be_on(maker):
    """A bias of a gyro and one of an accelerometer: neither is on the other's sensor."""
    evidence = Evidence([maker.view(COLD)], TWIN)
    credible = [("gyro_rate_ramp", "gyro_y"), ("accel_misalignment", "accel_x")]
    (said,) = advice(credible, evidence)
    assert "accel_misalignment" in said
    assert "(on gyro_y)" not in said


def test_what_recordings_lack_is_said_in_words(maker):
    pair = read_pair("gyro_misalignment,gyro_magnetic_sensitivity")
    one = assess(grams(maker, (COLD,), pair.a, pair.b), pair)
    assert one.verdict == "not_testable" and "headings" in one.lacks and one.score == 0.0
    four = assess(
        grams(
            maker, [replace(COLD, heading_deg=h) for h in (0.0, 90.0, 180.0, 270.0)], pair.a, pair.b
        ),
        pair,
    )
    assert not four.lacks and four.cos < 0.99
    assert assess([], pair).lacks == "a recording"


def test_without_a_second_sensor_a_gradient_is_not_testable():
    bare = RecordingMaker(TWIN, None, SITE, without=("gradient",))
    pair = read_pair("gyro_thermal_rate,gyro_thermal_gradient")
    assert "gradient_x_degC" in assess(grams(bare, (COLD,), pair.a, pair.b), pair).lacks
    assert not any(r.taxi for r in candidates(("taxi",)))
    assert not any("gnss" in r.aids for r in candidates(("gnss",)))


def test_the_size_that_is_seen_is_about_four(maker):
    """Log odds of 5 nats, search over shapes and prior of sizes included; a known shape alone would
    need sqrt(10).
    """
    linear, warm = contender("gyro_thermal_linear"), contender("gyro_warmup_transient")
    seen = seen_sizes([maker.view(COLD)], TWIN, [linear, warm, contender("gyro_turn_on_bias")])
    assert np.sqrt(10.0) < seen[linear.key] <= seen[warm.key] < 5.0
    assert seen["gyro_turn_on_bias", "gyro_x"] == np.inf, "one power-on does not show what is usual"


@pytest.mark.slow
def test_the_threshold_is_that_of_the_attribution(maker):
    """Odds that noise alone passes in 1 % of diagnoses: within a nat of the constant, on one run
    and on three.
    """
    for recordings in (PLANS["1 cold"], PLANS["diverse"]):
        views = [maker.view(r, k) for k, r in enumerate(recordings)]
        found = Attributor(
            views, TWIN, catalogue(), alpha=0.01, rng=np.random.default_rng(1)
        ).threshold
        assert found == pytest.approx(NULL_NATS, abs=1.0)


def test_pairs_are_read_with_their_channels():
    pair = read_pair("gyro_thermal_linear@gyro_y, gyro_warmup_transient")
    assert (pair.a.target, pair.b.target) == ("gyro_y", "gyro_y")
    found = read_pair("gyro_misalignment@gyro_z,site_latitude_error").a.effect.id
    assert found == "gyro_misalignment_z"
    assert read_pair("gyro_scale_factor,clock_rate").a.target == "gyro_z", "a taxi turns about z"
    assert len({read_pair(text).label for text in CLASSICAL}) == len(CLASSICAL)
    assert isinstance(pair, Pair)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gyro_thermal_linaer,gyro_rate_ramp", "nearest: gyro_thermal_linear"),
        ("gyro_rate_ramp", "two effects"),
        ("gyro_rate_ramp,gyro_rate_ramp", "two different"),
        ("gyro_rate_ramp@accel_x,clock_rate", "needed one of gyro_x"),
        ("gyro_angle_random_walk,gyro_rate_ramp", "is noise"),
        ("platform_vibration,gyro_rate_ramp", "is noise"),
        ("zzz,gyro_rate_ramp", "needed one of"),
    ],
)
def test_bad_pairs_are_one_line(text, said):
    with pytest.raises(InputError, match=said) as caught:
        read_pair(text)
    assert "\n" not in str(caught.value)
