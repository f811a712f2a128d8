"""The attribution on blind trials (generator of benchmarks.gap_trials, which shares no code with
the catalogue).
"""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.gap_size import scaled
from benchmarks.gap_trials.seen import run_of, streams_of, tilted
from benchmarks.gap_trials.trial import draw_noise_trial, draw_trial
from infield.table.file import table_from_dict
from ins.errors.base import SLOW_NAME
from ins.errors.catalogue import catalogue
from ins.units import ARCSEC
from simreal.evidence.run_view import view_run
from simreal.inference.attribute import Attributor, Slot
from simreal.inference.causes import UNLISTED, _rivals, shares_of, unlisted
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from simreal.inference.tails import tail_probability, tail_quantile
from tests.simreal import diagnosed as small

HALF_AN_HOUR_S = 1800.0  # at rest: half of what trials have


def diagnosed(trial, **how) -> Diagnosis:
    settings = DiagnosisSettings(replicates=120, **how)
    return diagnose(trial.runs, trial.twin, table_from_dict(trial.table, name="trial"), settings)


@lru_cache(maxsize=8)
def planted(name: str, seed: int, size: float):
    drawn = draw_trial(seed, names=[name], plan="four_parked", parked_s=HALF_AN_HOUR_S)
    return scaled(drawn, size)[0]


def test_a_twin_that_is_right_has_no_gap():
    found = diagnosed(draw_trial(41, effects=0, plan="four_parked"))
    assert (found.verdict, found.causes) == ("no_gap", ())
    assert found.gap.score == pytest.approx(1.0, abs=0.03)


def test_a_thermal_rate_is_named_measured_and_taken_out():
    trial = planted("gyro_thermal_rate", 42, 15.0)
    found = diagnosed(trial)
    cause = found.causes[0]
    truth = trial.truth[0]
    assert found.verdict == "explained"
    assert cause.effect == "gyro_thermal_rate"
    assert cause.target == truth.target
    assert found.where[0].channel == truth.target
    assert cause.probability > 0.5
    assert cause.shrink is not None and cause.shrink.held_out
    assert cause.shrink.interval_95[0] <= 1.0 and cause.shrink.fraction > 0.5
    key = next(k for k in truth.parameters if "coefficient" in k)
    value = cause.parameters["coefficient"]
    assert abs(value.value - truth.parameters[key] * truth.size) < 4.0 * value.sigma
    assert found.gap_after.score < found.gap.score


def test_an_effect_out_of_the_catalogue_is_not_given_a_confident_name():
    trial = planted("gyro_thermal_rate", 42, 15.0)
    rest = [e for e in catalogue() if e.name not in ("gyro_thermal_rate",)]
    found = diagnosed(trial, effects=rest)
    assert found.where[0].channel == trial.truth[0].target
    assert all(c.effect != "gyro_thermal_rate" for c in found.causes)
    assert found.causes or found.unexplained.present


@pytest.mark.slow
def test_white_noise_five_percent_off_is_named_as_noise():
    trial = draw_noise_trial(3, plan="four_parked")
    found = diagnosed(trial)
    assert found.causes
    assert {c.effect for c in found.causes} <= {
        *trial.truth[0].answers,
        "gyro_noise_thermal",
        "gyro_quantization",
    }


@pytest.mark.parametrize(
    "noises,others,room",
    [(0, 0, (True, True)), (6, 0, (True, True)), (12, 5, (True, False)), (6, 6, (False, True))],
)
def test_noise_of_all_sensors_leaves_room_for_effects_and_they_for_noise(noises, others, room):
    """A unit noisier than its twin on six sensors had no room left for the drift it had as well."""
    noise, effect, table = (
        SimpleNamespace(extra=extra, of_table=of_table)
        for extra, of_table in ((1.0, False), (None, False), (None, True))
    )
    slots = [noise] * noises + [effect] * others + [table] * 3
    sources = [SimpleNamespace(key=k) for k in range(3)]
    bank = SimpleNamespace(hypotheses=sources[:2])
    searched = SimpleNamespace(slots=slots, bank=bank, hypotheses=sources, _shadowed=set())
    searched._room = lambda: Attributor._room(searched)
    searched._odds = lambda _: (np.array([1.0, 2.0, 3.0]), np.zeros(0))
    assert searched._room() == room
    odds, _ = Attributor._odds_with_room(searched, slots)
    # two effects and a noise
    assert [bool(v) for v in np.isfinite(odds)] == [room[0], room[0], room[1]]


@pytest.mark.parametrize(
    "own,noise,hidden",
    [
        ([20.0, 0.0], False, True),  # under 5 % of the amplitude of 10^4
        ([40.0, 0.0], False, True),
        ([60.0, 0.0], False, False),
        ([20.0, 30.0], False, False),  # most of it where the large one is not
        ([60.0, 0.0], True, True),  # of noise, squares are compared: 10 %
    ],
)
def test_a_companion_is_hidden_where_the_form_of_a_large_effect_is(own, noise, hidden):
    of = SimpleNamespace(name="n", target="gyro_x", run=None)
    small, large = (SimpleNamespace(extra=1.0 if noise else None, hypothesis=of) for _ in range(2))
    energy = {id(small): np.array(own), id(large): np.array([1e4, 0.0])}
    searched = SimpleNamespace(_effects=[small, large], _energy=lambda s: energy[id(s)])
    assert Attributor._in_shadow(searched, small) is hidden
    assert not Attributor._in_shadow(searched, large)
    of.run = 2  # the parts of one event do not hide each other
    assert not Attributor._in_shadow(searched, small)


@pytest.mark.parametrize("vehicle,beside", [(100.0, ["gyro_z"]), (500.0, [])])
def test_noises_enter_together_where_none_of_the_vehicle_leads(vehicle, beside):
    of = [SimpleNamespace(name="n", target=t) for t in ("gyro_y", "gyro_x", "gyro_z", "vehicle")]
    searched = SimpleNamespace(
        bank=SimpleNamespace(hypotheses=of[:1]),
        hypotheses=of,
        threshold=5.0,
        slots=[],
        _slot=lambda number, odds, groups: of[number].target,
    )
    odds = np.array([0.0, 900.0, 200.0, vehicle])
    first = SimpleNamespace(hypothesis=of[1])
    assert Attributor._noises_beside(searched, first, odds, None) == beside


@pytest.mark.parametrize("walk,lag,left", [(106.0, 98.0, SLOW_NAME), (98.0, 99.0, "lag")])
def test_a_walk_that_explains_all_rows_better_takes_the_place_of_a_lag_beside_it(walk, lag, left):
    """Both fits are compared by all that they explain, and share what the data leave open."""

    def made(name, extra):
        source = SimpleNamespace(name=name, target="gyro_y", key=(name, "gyro_y", None))
        return SimpleNamespace(hypothesis=source, extra=extra, of_table=False)

    first, second = [made("lag", None), made(SLOW_NAME, 1.0)], [made(SLOW_NAME, 1.0)]
    fits = [first, second]
    searched = SimpleNamespace(_stopped=False, slots=[], _effects=first)

    def settle(channels=()):
        searched.slots = fits.pop(0)

    def total():
        return lag if any(s.hypothesis.name == "lag" for s in searched.slots) else walk

    searched._settle, searched._total = settle, total
    searched._begin_anew = searched._whiten_again = lambda: None
    Attributor._search(searched)
    assert searched.slots[0].hypothesis.name == left
    hypotheses = [s.hypothesis for s in first]
    searched.hypotheses = hypotheses
    slot = searched.slots[0]
    slot.posterior = np.array([float(h.name == slot.hypothesis.name) for h in hypotheses])
    Attributor._share_with_other_fit(searched, slot)
    odds = np.exp(abs(walk - lag))
    assert slot.posterior.max() == pytest.approx(odds / (1.0 + odds))
    assert slot.posterior.sum() == pytest.approx(1.0)


def test_an_implausible_size_is_more_likely_of_a_cause_that_is_not_listed():
    assert unlisted(10.0, 6.0) == unlisted(10.0) > unlisted(100.0)  # a form of its own says more
    usual = unlisted(100.0)
    assert unlisted(100.0, 1.0, any_form=True) == pytest.approx(usual)
    absurd = unlisted(100.0, 6.0, any_form=True)
    # six times beyond: 35 times the odds of 0.15 more
    more = absurd / (1.0 - absurd) - usual / (1.0 - usual)
    assert more == pytest.approx(35.0 * 0.15 / 0.85)
    assert usual < 0.5 < absurd


@pytest.mark.parametrize("outside,rivals", [(0.85, [UNLISTED]), (0.15, [])])
def test_a_cause_less_likely_than_one_outside_the_catalogue_has_that_for_a_rival(outside, rivals):
    own = ("slow_variation", "gyro_x")
    slot = SimpleNamespace(group=None, hypothesis=SimpleNamespace(name=own[0], target=own[1]))
    found = _rivals(None, slot, {own: 1.0 - outside, UNLISTED: outside})
    assert [(r.effect, r.target) for r in found] == rivals


def test_runs_of_another_unit_are_refused():

    from ins.records import InputError

    trial = draw_trial(41, effects=0, plan="one_cold", parked_s=600.0)
    with pytest.raises(InputError, match="SN-9999"):
        diagnosed(replace(trial, twin=replace(trial.twin, imu_serial="SN-9999")))


def test_tail_of_exponential_maxima():
    rng = np.random.default_rng(0)
    values = rng.exponential(size=2000)
    assert tail_quantile(values, 0.005) == pytest.approx(-np.log(0.005), rel=0.15)
    assert tail_probability(values, 6.9) == pytest.approx(0.001, rel=0.6)
    assert tail_probability(values, 0.0) == pytest.approx(1.0, abs=0.01)
    assert tail_probability(values, tail_quantile(values, 0.005)) == pytest.approx(0.005)


def test_a_threshold_from_few_replicates_is_passed_as_often_as_asked():
    """In the mean over the replicates; the plain exponential is passed in 0.70 % for 0.5."""
    rng = np.random.default_rng(2)
    thresholds = [tail_quantile(rng.exponential(size=150), 0.005) for _ in range(4000)]
    # the mean over 4,000 thresholds has a sigma of 0.00005
    assert np.mean(np.exp(-np.array(thresholds))) == pytest.approx(0.005, abs=0.0004)


def test_one_start_does_not_tell_a_cause_of_temperature_from_a_drift():
    """Within one warm-up the temperature's rate is a smooth curve of time: both keep a half."""
    found = small.diagnosed("gyro_thermal_rate", plan="one_cold")
    cause = next(c for c in found.causes if c.named)
    # whose signatures are one where there is one ramp
    assert cause.effect in ("gyro_thermal_rate", "gyro_thermal_lag")
    assert cause.probability <= 0.5
    rivals = {(r.effect, r.target) for r in cause.rivals}
    assert ("unknown_function_of_time", cause.target) in rivals


NOISES = ("gyro_noise_thermal", "gyro_noise_of_time", "gyro_angle_random_walk")


def noise_shares(plan):
    """Probabilities of the noises of a gyro that is noisier while it warms up."""
    drawn = draw_trial(7, names=["gyro_noise_thermal"], plan=plan, parked_s=HALF_AN_HOUR_S)
    trial = scaled(drawn, 20.0)[0]
    effects = [e for e in catalogue() if e.name in NOISES]
    found = diagnosed(trial, effects=effects)
    assert found.causes
    slot = found.attribution.slots[0]
    shares = shares_of(found.attribution, slot)
    return {name: p for (name, target), p in shares.items() if target == trial.truth[0].target}


def test_one_start_does_not_tell_noise_of_a_temperature_from_noise_of_time():
    """Noise that falls through one rest, beside a ramp that falls as well: the temperature keeps no
    more than a half; four starts tell.
    """
    one, four = noise_shares("one_cold"), noise_shares("four_parked")
    assert one["gyro_noise_of_time"] >= one["gyro_noise_thermal"]
    assert one["gyro_noise_thermal"] <= 0.5
    assert four["gyro_noise_thermal"] > 0.7


@pytest.mark.parametrize(
    "planted,name", [("white_vibration", "platform_vibration"), ("engine_start", "engine_start")]
)
def test_a_start_is_what_begins_within_the_run(planted, name):
    """Both make the accelerometers noisier in one run: a machine through the whole of it, an engine
    from its start on.
    """
    trial = draw_trial(75, names=[planted], plan="four_parked", parked_s=900.0)
    names = ("engine_start", "platform_vibration", "accel_noise", "platform_sway")
    found = diagnosed(trial, effects=[e for e in catalogue() if e.name in names])
    first = found.causes[0]
    number = trial.truth[0].parameters["run"]
    assert (first.effect, first.run_id) == (name, trial.runs[number].header.run_id)
    assert first.probability > 0.9
    if name == "engine_start":
        onset_s = trial.truth[0].parameters["onset_s"]
        assert first.parameters["onset_s"].value == pytest.approx(onset_s, abs=30.0)


SETTLED_WITHIN_S = 700.0


def settled(trial, arcsec: np.ndarray):
    """The trial's runs on a vehicle that gives way by so much (runs, 2), roll and pitch."""
    runs = []
    for run, seen, level in zip(trial.runs, trial.seen, arcsec, strict=True):
        angle = np.outer(1.0 - np.exp(-seen.time_s / SETTLED_WITHIN_S), [*(level * ARCSEC), 0.0])
        runs.append(run_of(run, tilted(streams_of(run), seen, angle - angle[0])))
    return replace(trial, runs=tuple(runs))


# slow: the same search twice; runs that settle alike are the harder case
ALIKE, UNLIKE = (1.0, 1.0, 1.0, 1.0), (1.0, 1.6, 0.6, 1.1)


@pytest.mark.parametrize("shares", [ALIKE, pytest.param(UNLIKE, marks=pytest.mark.slow)])
def test_a_vehicle_that_settles_in_every_run_is_not_taken_for_warm_ups(shares):
    """25 arcsec of pitch are 120 ug and, at first, 0.03 deg/h: one rotation, which no single run
    holds and a warm-up of an accelerometer and one of a gyro describe apart. Runs that
    settle by unlike amounts have one of their own each, at the same pace.
    """
    level = np.outer(shares, (-6.0, 25.0))
    found = diagnosed(settled(draw_trial(46, effects=0, plan="four_parked"), level))
    first = found.causes[0]
    assert {cause.effect for cause in found.causes} == {"platform_settling"}
    assert (first.target, first.run_id) == ("vehicle", None) and first.probability > 0.95
    true = {"roll": -6.0, "pitch": 25.0, "tau_s": SETTLED_WITHIN_S}
    if len(set(shares)) > 1:
        names = [view.name for view in found.attribution.evidence.views]
        true = {f"pitch[{name}]": 25.0 * share for name, share in zip(names, shares)}
    for name, size in true.items():
        value = first.parameters[name]
        assert abs(value.value - size) < 4.0 * value.sigma, name


def test_only_what_shakes_accelerometers_shakes_gyros():
    """Noise of three gyros in one run is theirs, unless accelerometers feel a machine."""
    made = small.trial(None, 0.0, 4, "one_cold", 0)
    views = [view_run(run, k, None, made.twin) for k, run in enumerate(made.runs)]
    names = ("platform_vibration", "gyro_angle_random_walk")
    effects = [e for e in catalogue() if e.name in names]
    rng = np.random.default_rng(0)
    looked = Attributor(views, made.twin, effects, alpha=0.01, rng=rng, replicates=20)
    ids = [h.effect.id if h.effect else h.name for h in looked.hypotheses]
    of_gyros = ids.index("platform_vibration_gyro_noise")
    alone, _ = looked._odds(looked.slots)
    felt = Slot(looked.hypotheses[ids.index("platform_vibration")])
    beside, _ = looked._odds([*looked.slots, felt])
    assert np.isneginf(alone[of_gyros]) and np.isfinite(beside[of_gyros])
