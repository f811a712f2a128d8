"""The twin fitted to parked logs: what is told is right to its sigma, the rest is said."""

import json
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt
from typer.testing import CliRunner

import recal
import recal.service.twin.fit as service
from alignment.motion.kinds import DISTURBED, Disturbance
from ins.attitude import dcm_from_euler
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.noise import markov_covariance
from ins.records import InputError
from ins.twin_file import default_twin, read_twin
from ins.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, HOUR, MICRO_G
from recal.cli.app import app
from recal.service.twin.fit import check_twin
from simreal.evidence.noise_model import ChannelNoise
from simreal.twin.fit.agreement import RunBandPower, swings
from simreal.twin.fit.constants import accel_constants, gyro_constants, spread_between
from simreal.twin.fit.evidence import needed_s, plateau
from simreal.twin.fit.fit import believed_value, lines_of_unit
from simreal.twin.fit.gear import GEAR_BELOW_HZ, flat_above, rocked, without_gear
from simreal.twin.fit.model import PRIOR_SIGMA, NoiseEstimate, TriadEvidence, TriadModel, climb
from simreal.twin.fit.other_sensors import resolution
from simreal.twin.fit.shared_motion import own_power
from simreal.twin.fit.spectra import Bands
from simreal.twin.fit.streams import DitherLine, stream_at_rest, stream_of
from simreal.twin.fit.terms import NoiseTerm, Shape, bin_covariance, sampled_psd, sway_folded
from simreal.twin.reasons import Why
from tests.drawn import unscripted


@lru_cache
def fitted():
    simulated = recal.simulate("parked_only", seed=5, rate_hz=20)
    return simulated, recal.fit_twin(simulated.run)


@pytest.mark.parametrize("term", list(NoiseTerm))
def test_a_terms_spectrum_is_the_transform_of_its_covariance(term):
    """Over 4096 means of a second: what a term's own covariance gives a Hann window, bin by bin."""
    n, shape = 1024, Shape(tau_s=20.0)
    end = np.arange(1.0, n + 1.0)
    V = bin_covariance(term, end - 1.0, end, shape, run_s=1e6)
    taper = np.hanning(n + 1)[:n]
    k = np.arange(20, n // 2, 60)
    waves = np.exp(-2j * np.pi * np.outer(k, np.arange(n)) / n) * taper / np.sqrt(np.sum(taper**2))
    power = np.real(np.einsum("kn,nm,km->k", waves, V, waves.conj()))
    assert power == pytest.approx(sampled_psd(term, k / n, 1.0, shape), rel=0.02)


def test_a_resonance_is_expected_as_a_short_window_shows_it():
    """Windows of 20 s of a sway of 0.45 Hz, by its covariance: a taper flattens the resonance, by a
    tenth at its top.
    """
    n, dt, shape = 400, 0.05, Shape(sway_w=2.0 * np.pi * 0.45, sway_zeta=0.2)
    end = dt * np.arange(1.0, n + 1.0)
    V = bin_covariance(NoiseTerm.SWAY, end - dt, end, shape, run_s=1e6)
    taper = np.hanning(n + 1)[:n]
    k = np.arange(8, 40)
    waves = np.exp(-2j * np.pi * np.outer(k, np.arange(n)) / n) * taper
    power = np.real(np.einsum("kn,nm,km->k", waves, V, waves.conj())) * dt / np.sum(taper**2)
    nothing = np.zeros(k.size, bool)
    each = np.arange(k.size)
    bands = Bands(3, dt, 1.0 / (n * dt), k / (n * dt), each, power, np.ones(k.size), nothing)
    assert bands.expected(NoiseTerm.SWAY, shape) == pytest.approx(power, rel=0.01)
    flat = sampled_psd(NoiseTerm.SWAY, bands.hz, dt, shape)
    assert np.max(flat / power) > 1.06


def test_means_show_a_quick_sway_that_rows_have_shown():
    slow, quick = (Shape(sway_w=2.0 * np.pi * hz) for hz in (0.1, 0.8))
    assert sway_folded(np.array([0.1]), 1.0, slow)[0] < 0.05
    assert sway_folded(np.array([0.2]), 1.0, quick)[0] > 0.95


def test_a_clip_may_hide_who_stepped_aboard():
    """Still seconds on either side of a clip may be on another level; of a gust they are not."""
    simulated, _ = fitted()
    stream = stream_of(simulated.run, simulated.twin)
    kind, cause = np.zeros_like(stream.motion.kind), np.full(stream.motion.kind.size, "", object)
    kind[600:640] = DISTURBED
    for why, places in ((Disturbance.CLIPPING, 2), (Disturbance.GUST, 1)):
        cause[600:640] = why
        motion = replace(stream.motion, kind=kind, cause=cause)
        found = stream_at_rest(simulated.run, simulated.twin, None, motion=motion)
        assert len(np.unique(found.place)) == places


def test_a_longer_recording_is_asked_for_than_the_one_that_did_not_tell():
    model = TriadModel(
        (NoiseTerm.WHITE, NoiseTerm.FLICKER),
        np.log([1e-12, 1e-30]),
        Shape(),
        np.full(2, PRIOR_SIGMA),
    )
    for size, needed in ((1e-30, np.inf), (1e-13, 2.0 * HOUR)):
        x = np.log([1e-12, size])
        fit = NoiseEstimate(model, x, 0.0, np.eye(2))
        assert needed_s(fit, NoiseTerm.FLICKER, 0.01, longer_s=HOUR) == needed


def test_markov_means_are_those_of_the_noise_model():
    end = 10.0 * np.arange(1.0, 7.0)
    known = ChannelNoise(markov=1.0, markov_tau_s=25.0).covariance(6, 10.0)
    assert markov_covariance(end - 10.0, end, tau_s=25.0) == pytest.approx(known, rel=1e-9)


def test_what_an_hour_tells_is_right_to_its_sigma():
    simulated, result = fitted()
    truth = simulated.twin
    told = {p.name: p for p in result.parameters if p.identified}
    for name in ("gyro.arw_deg_sqrt_h", "accel.vrw_ug_sqrt_hz", "vehicle.sway_m_s"):
        section, key = name.split(".")
        true = getattr(getattr(truth, section), key)
        assert abs(told[name].value - true) < 4.0 * told[name].sigma, name
        assert told[name].value == pytest.approx(true, rel=0.05)
    assert told["vehicle.sway_hz"].value == pytest.approx(truth.vehicle.sway_hz, rel=0.05)
    assert told["temperature.resolution_degC"].value == pytest.approx(0.01)


def test_what_an_hour_cannot_tell_is_named_with_the_recording_that_would():
    _, result = fitted()
    rest = {p.name: p for p in result.parameters if not p.identified}
    walk = rest["gyro.rate_random_walk_deg_h_sqrt_h"]
    assert walk.needed > 4200.0 and walk.value < walk.high
    assert rest["gyro.turn_on_deg_h"].needed == 9.0
    assert walk.name in result.twin.fit["not_identified"]
    assert result.twin.gyro.turn_on_deg_h == 0.003


def test_the_files_of_a_fit(tmp_path):
    _, result = fitted()
    assert result.write(tmp_path / "unit.json") == tmp_path / "unit.json"
    assert {path.name for path in tmp_path.iterdir()} == {"unit.json", "unit_fit.json", "unit.html"}
    twin = read_twin(tmp_path / "unit.json")
    assert twin.gyro == result.twin.gyro and twin.fit == result.twin.fit
    covariance = np.array(twin.fit["covariance"])
    assert np.linalg.eigvalsh(covariance).min() > -1e-12 * covariance.max()
    document = json.loads((tmp_path / "unit_fit.json").read_text())
    assert document["schema"] == "recal.twin_fit/1" and len(document["channels"]) == 6
    page = (tmp_path / "unit.html").read_text()
    assert "http" not in unscripted(page) and "Allan deviation" in page
    assert list(result.to_frame()["name"]) == [p.name for p in result.parameters]


def test_two_units_in_one_fit_are_bad_input():
    simulated, _ = fitted()
    other = replace(simulated.run, header=replace(simulated.run.header, imu_serial="SN-2"))
    with pytest.raises(InputError, match=r"imu_serial 'SN-2'.*needed runs of one unit"):
        recal.fit_twin([simulated.run, other])
    with pytest.raises(InputError, match="imu_serial SN-3"):
        recal.fit_twin(simulated.run, replace(default_twin("rlg"), imu_serial="SN-3"))


def test_a_run_that_never_rests_is_refused(tmp_path):
    simulated, _ = fitted()
    imu = simulated.run.imu.whole()
    shaken = imu.dv_m_s + 0.5 * np.sin(np.arange(imu.rows))[:, None]
    turned = imu.dtheta_rad + 0.02 * np.sin(0.01 * np.arange(imu.rows))[:, None]
    run = replace(simulated.run, imu=replace(imu, dv_m_s=shaken, dtheta_rad=turned), phases=())
    result = recal.fit_twin(run)
    assert result.verdict == "refused" and "never at rest" in result.reasons[0]
    assert result.twin is None


def test_a_vehicle_that_is_never_still_shows_the_noise_of_its_rows(tmp_path):
    """Ten minutes of a storm, and none is still; navigated from its first rest the vehicle seems to
    roll. The rows above the gear tell the white noise.
    """
    scenario = tmp_path / "short.toml"
    packaged = resources.files("trajectories.simulator") / "scenarios" / "parked_only.toml"
    text = packaged.read_text("utf-8")
    scenario.write_text(text.replace("duration_s = 4200", "duration_s = 600"), "utf-8")
    simulated = recal.simulate(scenario, seed=5, rate_hz=100, environments=["gusty:5"])
    found = recal.fit_twin(simulated.run).record
    assert found is not None and found.parked_s > 500.0
    told = found.of("gyro.arw_deg_sqrt_h")
    assert told.identified
    assert abs(told.value - simulated.twin.gyro.arw_deg_sqrt_h) < 4.0 * told.sigma


def test_runs_that_tell_nothing_of_the_sensors_make_no_twin(tmp_path, monkeypatch):
    """A thermometer's resolution alone is no twin: refused, and none is written."""
    simulated, told = fitted()
    found = told.record
    nothing = tuple(
        p if p.name.startswith("temperature.") else replace(p, why=Why.TOO_LOOSE)
        for p in found.parameters
    )
    assert any(p.identified for p in nothing)
    monkeypatch.setattr(service, "fit_runs", lambda *_: replace(found, parameters=nothing))
    result = recal.fit_twin(simulated.run)
    assert result.verdict == "refused" and result.twin is None
    result.write(tmp_path / "twin.json")
    assert not (tmp_path / "twin.json").exists() and (tmp_path / "twin_fit.json").exists()


def test_a_twin_is_held_against_a_run():
    simulated, result = fitted()
    right = check_twin(simulated.run, result.twin)
    assert right.verdict == "ok" and "fits these runs" in right.lines()[0]
    declared = replace(result.twin.gyro, arw_deg_sqrt_h=0.5 * result.twin.gyro.arw_deg_sqrt_h)
    wrong = check_twin(simulated.run, replace(result.twin, gyro=declared))
    assert wrong.verdict == "inconsistent" and "recal twin fit" in wrong.lines()[0]
    assert {c.channel[:4] for c in wrong.record.cells if not c.fits} == {"gyro"}
    within = replace(result.twin.gyro, arw_deg_sqrt_h=1.07 * result.twin.gyro.arw_deg_sqrt_h)
    assert check_twin(simulated.run, replace(result.twin, gyro=within)).verdict == "ok"


def test_an_axis_that_differs_is_held_against_its_own_noise():
    """A unit whose gyro x is twice as noisy as y: told apart, and its own twin fits."""
    simulated, _ = fitted()
    imu = simulated.run.imu.whole()
    noisy = imu.dtheta_rad.copy()
    row_rad = simulated.twin.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR * np.sqrt(0.05)
    noisy[:, 0] += np.sqrt(3.0) * row_rad * np.random.default_rng(4).standard_normal(imu.rows)
    run = replace(simulated.run, imu=replace(imu, dtheta_rad=noisy))
    twin = recal.fit_twin(run).twin
    axes = {entry["channel"]: entry["white"] for entry in twin.fit["axes"]}
    assert axes["gyro_x"] / axes["gyro_y"] == pytest.approx(4.0, rel=0.15)
    assert check_twin(run, twin).verdict == "ok"


def test_wind_is_not_charged_to_the_unit():
    """A ring laser in a strong breeze, 15,000 times its noise at 1 Hz: its own twin fits, one whose
    white noise is half or twice as large does not.
    """
    simulated = recal.simulate("parked_only", seed=8, rate_hz=50, environments=["gusty"])
    right = check_twin(simulated.run, simulated.twin)
    assert right.verdict == "ok"
    assert max(c.ratio for c in right.record.cells if c.of == "vehicle") > 100.0
    for factor in (0.5, 2.0):
        size = factor * simulated.twin.gyro.arw_deg_sqrt_h
        declared = replace(simulated.twin.gyro, arw_deg_sqrt_h=size)
        wrong = check_twin(simulated.run, replace(simulated.twin, gyro=declared))
        assert wrong.verdict == "inconsistent"
        bad = [c for c in wrong.record.cells if c.of == "sensor" and not c.fits]
        assert {c.channel[:4] for c in bad} == {"gyro"}


def test_no_number_is_told_of_a_model_that_the_data_contradict():
    """People who board shake a ring laser of 0.002 deg/h: 1.19 +- 0.006 deg/h of flicker were told
    once, 25 times what the data beside it show.
    """
    shaken = recal.simulate("cold_parked_taxi", seed=42, rate_hz=50, environments=["boarding:0.5"])
    found = recal.fit_twin(shaken.run)
    told = {p.name: p for p in found.parameters}
    flicker = told["gyro.bias_instability_deg_h"]
    assert not flicker.identified or abs(flicker.value - 0.002) < 4.0 * flicker.sigma
    assert found.record.read_above_hz == {"gyro_x": GEAR_BELOW_HZ, "gyro_y": GEAR_BELOW_HZ}
    for name, true in (("gyro.arw_deg_sqrt_h", 0.002), ("vehicle.yaw_creep_arcsec_sqrt_h", 3.0)):
        assert told[name].identified
        assert abs(told[name].value - true) < 4.0 * told[name].sigma


def bands_at(hz, power, channel=0):
    """Bands of rows of 50 Hz, known to 1 %."""
    dof = np.full(hz.size, 1e4)
    nothing = np.zeros(hz.size, bool)
    return Bands(channel, 0.02, 0.05, hz, np.arange(hz.size), power, dof, nothing)


def evidence_of(*bands):
    return TriadEvidence(tuple((0, b) for b in bands), (), (np.ones(6),))


WHITE_ALONE = TriadModel((NoiseTerm.WHITE,), np.zeros(1), Shape(), np.full(1, PRIOR_SIGMA))


def test_a_channel_that_a_vehicle_rocks_is_read_above_the_gear_alone():
    hz = np.geomspace(0.5, 24.0, 60)
    hump = 3.0 * np.exp(-(np.log(hz / 1.2) ** 2))
    evidence = evidence_of(bands_at(hz, 1.0 + hump, 0), bands_at(hz, np.ones(60), 1))
    gear = rocked(evidence, climb(evidence, WHITE_ALONE))
    assert gear == {(0, 0)}
    kept = without_gear(evidence, gear)
    assert climb(kept, WHITE_ALONE).log_variance(NoiseTerm.WHITE) == pytest.approx(0.0, abs=0.01)
    assert not (kept.bands[0][1].dof > 0)[hz < GEAR_BELOW_HZ].any()
    assert (kept.bands[1][1].dof > 0).all()


def test_what_a_filter_leaves_above_the_gear_is_no_white_noise():
    hz = np.geomspace(0.5, 24.0, 60)
    flat, filtered = np.ones(60), 1.0 / (1.0 + (hz / 20.0) ** 2)
    for power, is_flat in ((flat, True), (filtered, False)):
        evidence = evidence_of(bands_at(hz, power))
        assert flat_above(without_gear(evidence, frozenset({(0, 0)}))) == is_flat
    assert not flat_above(without_gear(evidence_of(bands_at(hz[hz < 10], flat[hz < 10])), {(0, 0)}))


@pytest.mark.slow
@pytest.mark.parametrize("environment", ["boarding", "boarding:0.5", "gusty:2"])
@pytest.mark.parametrize("scenario", ["mems_warm_up", "parked_only"])
def test_numbers_of_a_rocked_unit_are_right_to_their_sigmas(scenario, environment):
    """A MEMS unit in gusts was told 262 +- 6 ug/sqrt(Hz) where 100 are true."""
    simulated = recal.simulate(scenario, seed=31, rate_hz=50, environments=[environment])
    found = recal.fit_twin(simulated.run).record
    for name in ("gyro.arw_deg_sqrt_h", "accel.vrw_ug_sqrt_hz"):
        told = found.of(name)
        if told.identified:
            assert abs(told.value - believed_value(simulated.twin, name)) < 4.0 * told.sigma


def filtered(simulated, filter_of):
    """The run with each channel of its rows through a filter."""
    imu = simulated.run.imu.whole()
    angle, velocity = (
        filter_of(rows - rows[:50].mean(axis=0)) + rows[:50].mean(axis=0)
        for rows in (imu.dtheta_rad, imu.dv_m_s)
    )
    return replace(simulated.run, imu=replace(imu, dtheta_rad=angle, dv_m_s=velocity))


def one_pole(tau_s):
    kept = np.exp(-0.05 / tau_s)
    return lambda rows: lfilter([1.0 - kept], [1.0, -kept], rows, axis=0)


@pytest.mark.parametrize(
    "filter_of",
    [
        pytest.param(one_pole(0.03), id="one pole, 5 Hz"),
        pytest.param(
            lambda rows: sosfilt(butter(4, 4.0, fs=20.0, output="sos"), rows, axis=0),
            id="four poles, 4 Hz",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_white_noise_is_read_below_the_band_of_a_filter(filter_of):
    """Units and loggers smooth their rows: what such a log shows of the noise below the filter's
    band is told, and the twin fits the log.
    """
    simulated, _ = fitted()
    run = filtered(simulated, filter_of)
    found = recal.fit_twin(run)
    assert found.record.read_below_hz.keys() == {"gyro", "accel"}
    assert all(hz < 4.0 for hz in found.record.read_below_hz.values())
    told = {p.name: p for p in found.parameters}
    for name, truth in (
        ("gyro.arw_deg_sqrt_h", simulated.twin.gyro.arw_deg_sqrt_h),
        ("accel.vrw_ug_sqrt_hz", simulated.twin.accel.vrw_ug_sqrt_hz),
    ):
        assert told[name].identified and told[name].sigma < 0.03 * truth
        assert abs(told[name].value - truth) < 2.5 * told[name].sigma
    assert any("a filter takes noise out of the gyro rows" in note for note in found.record.notes)
    assert check_twin(run, found.twin).verdict == "ok"


@pytest.mark.slow  # that no number is told of a model that is wrong: the boarded ring laser above
def test_no_number_is_told_of_rows_filtered_below_the_seconds():
    """Smoothed over half a second: 1.6e-5 deg/sqrt(h) +- 0.3 % were told once, 125 times too
    little, with a Markov process that stood for the noise.
    """
    simulated, _ = fitted()
    found = recal.fit_twin(filtered(simulated, one_pole(0.5)))
    assert not any(p.identified for p in found.parameters if p.name.startswith("gyro."))
    assert any("model of the gyro noise" in note for note in found.record.notes)


@pytest.mark.slow
def test_flicker_covers_a_markov_process_that_a_twin_has_no_key_for():
    simulated, _ = fitted()
    imu = simulated.run.imu.whole()
    kept, sigma = np.exp(-0.05 / 60.0), 0.1 * DEG_PER_HOUR
    drive = sigma * np.sqrt(1.0 - kept**2) * np.random.default_rng(3).standard_normal((imu.rows, 3))
    slow = 0.05 * lfilter([1.0], [1.0, -kept], drive, axis=0)
    found = recal.fit_twin(
        replace(simulated.run, imu=replace(imu, dtheta_rad=imu.dtheta_rad + slow))
    )
    process = next(p for p in found.parameters if p.name == "gyro.gauss_markov_deg_h")
    assert process.identified and abs(process.value - 0.1) < 4.0 * process.sigma
    assert 0.07 < found.twin.gyro.bias_instability_deg_h < 0.12
    assert any("Gauss-Markov" in note for note in found.record.notes)


def test_a_spectrum_that_falls_gently_is_no_swinging_vehicle():
    """Power over the declared one by bands, as an integrated gyro's has it: the last band holds few
    rows, and is low by chance.
    """
    edges = (0.4, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 34.0)
    dof = (180.0, 320.0, 580.0, 1300.0, 2300.0, 5200.0, 60.0)

    def parts(ratios):
        return [
            RunBandPower(0, low, high, ratio, n, 1.0, 0.0)
            for low, high, ratio, n in zip(edges, edges[1:], ratios, dof)
        ]

    assert not swings(parts((1.2, 1.1, 1.12, 1.1, 1.06, 1.0, 0.8)))
    assert swings(parts((1.2, 1.6, 1.12, 1.1, 1.06, 1.0, 0.8)))


def test_a_twin_is_not_written_over_unasked(tmp_path):
    (tmp_path / "twin.json").write_text("{}")
    outcome = CliRunner().invoke(app, ["twin", "fit", "nowhere", "-o", str(tmp_path / "twin.json")])
    assert isinstance(outcome.exception, InputError) and "--force" in str(outcome.exception)
    noise = tmp_path / "imu.yaml"
    noise.write_text("gyroscope_noise_density: 1e-4\n")
    given = ["twin", "import", str(noise), "--from", "kalibr", "-o", str(tmp_path / "twin.json")]
    assert "--force" in str(CliRunner().invoke(app, given).exception)
    assert CliRunner().invoke(app, [*given, "--force"]).exit_code == 0
    assert read_twin(tmp_path / "twin.json").gyro_technology == "mems"


def test_the_command_names_a_missing_run():
    outcome = CliRunner().invoke(app, ["twin", "fit", "nowhere"])
    assert outcome.exit_code != 0 and isinstance(outcome.exception, InputError)


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 180.0])
def test_constants_of_a_run_are_those_of_each_place_that_it_stood_on(turn_deg):
    """Of the 900 s that are read the vehicle stands turned and leaning for the last 100 s."""
    lat, up = 0.8, np.array([0.0, 0.0, -1.0])
    bias = np.array([0.3, 0.0, -0.2]) * DEG_PER_HOUR
    rows = []
    for heading, roll, count in ((0.0, 0.0, 800), (turn_deg * DEG, 2e-3, 400)):
        C_nb = dcm_from_euler(roll, 0.0, heading)
        earth = EARTH_RATE_RAD_S * np.array([np.cos(lat), 0.0, -np.sin(lat)])
        mean = np.concatenate([C_nb.T @ earth + bias, C_nb.T @ (gravity_magnitude(lat, 0.0) * up)])
        rows += [mean] * count
    stream = SimpleNamespace(
        run=SimpleNamespace(
            header=SimpleNamespace(site=SimpleNamespace(lat_rad=lat, height_m=0.0))
        ),
        still=np.ones(1200, dtype=bool),
        place=np.repeat([0, 1], [800, 400]),
        seconds=SimpleNamespace(mean=np.array(rows)),
    )
    vertical, north = gyro_constants(stream, finds_north=True) / DEG_PER_HOUR
    assert vertical == pytest.approx(-0.2, abs=2e-3)
    of_second = 0.3 * np.cos(turn_deg * DEG)
    assert north == pytest.approx((8 * 0.3 + of_second) / 9, abs=6e-3)
    assert accel_constants(stream)[0] == pytest.approx(0.0, abs=1e-9)


def test_lines_of_one_run_are_none_of_the_unit():
    dither = DitherLine(channel=0, frequency_hz=400.0, amplitude=1e-5, sigma=1e-7, swing=1e-8)
    again = replace(dither, frequency_hz=400.9, amplitude=2e-5)
    rocking = replace(dither, channel=1, frequency_hz=1.3)
    assert lines_of_unit([[dither, rocking], [again], [dither]]) == (again,)
    assert lines_of_unit([[dither, rocking]]) == (dither, rocking)
    on_its_gear = frozenset({(0, rocking.channel), (0, dither.channel)})
    assert lines_of_unit([[dither, rocking]], on_its_gear) == (dither,)
    assert lines_of_unit([[dither], []]) == ()


def test_three_power_ons_hardly_tell_a_turn_on():
    rng = np.random.default_rng(3)
    few = spread_between([rng.standard_normal(1) for _ in range(3)], np.zeros(1))
    many = spread_between([rng.standard_normal(2) for _ in range(60)], np.zeros(2))
    assert few.freedom == 2 and few.high > 25.0 * few.low
    assert many.low < 1.0 < many.high and many.high / many.low < 3.0


def test_constants_that_agree_by_chance_leave_a_turn_on_as_it_was_believed():
    """Two power-ons below their own noise bound the spread from above and say no more; over sizes
    drawn from the belief the mean logarithm is right (it was a thousandth in half of them).
    """
    rng, log_sigma = np.random.default_rng(8), 2.0 * np.log(3.0)
    alike = spread_between([np.zeros(2), np.full(2, 1e-3)], np.ones(2))
    assert 0.1 < np.sqrt(alike.weighed(1.0, log_sigma)) < 1.0
    off = []
    for _ in range(150):
        log = log_sigma * rng.standard_normal()
        size = np.sqrt(np.exp(log) + 0.5)
        found = spread_between([size * rng.standard_normal(2) for _ in range(2)], np.full(2, 0.5))
        off.append((np.log(found.weighed(1.0, log_sigma)) - log) / log_sigma)
    assert abs(np.mean(off)) < 3.0 / np.sqrt(150) and 0.4 < np.std(off) < 1.0


def test_a_tilting_vehicle_is_not_charged_to_the_gyro():
    """A hundred windows of a gyro with unit noise on a base that accelerometers see too."""
    rng = np.random.default_rng(7)

    def white(*shape):
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)

    tilt = white(100, 20)
    gyro = white(100, 20) + 0.7j * tilt
    accel = np.stack([3.0 * tilt + 0.1 * white(100, 20), *white(2, 100, 20)], axis=2)
    power, dof, shared = own_power(gyro, accel, np.zeros(20, int), np.array([2000.0]))
    assert power[0] == pytest.approx(1.0, abs=0.08) and dof[0] == 1997.0
    assert shared[0] == pytest.approx(0.33, abs=0.05)
    apart = own_power(gyro, white(100, 20, 3), np.zeros(20, int), np.array([2000.0]))
    assert apart[0][0] == pytest.approx(1.49, abs=0.12)
    level = 100.0 * white(100, 20, 2)
    upright = white(100, 20) + 0.02 * level[:, :, 0]  # four fifths of its power is sway
    own = own_power(upright, level, np.zeros(20, int), np.array([2000.0]), 0.9)
    assert own[0][0] == pytest.approx(1.0, abs=0.08) and own[1][0] == 1998.0


def test_a_resolution_is_a_grid_and_noise_has_none():
    rng = np.random.default_rng(1)
    readings = 20.0 + np.cumsum(rng.standard_normal(4000)) * 0.03
    assert resolution([0.0625 * np.round(readings / 0.0625)]) == pytest.approx(0.0625)
    assert resolution([readings]) == 0.0


def test_a_plateau_shows_white_noise_between_a_drift_and_a_filter():
    """Flicker below 1 Hz, a line at 10 Hz, a filter at 30 Hz: 400 ug/sqrt(Hz) between them. A
    vehicle's motion has no plateau.
    """
    hz = np.geomspace(0.4, 25.0, 80)
    white = (400.0 * MICRO_G) ** 2
    seen = white * (0.1 / hz + 1.0 / (1.0 + (hz / 30.0) ** 4) + 3.0 * (np.abs(hz - 10.0) < 0.5))
    told, top_hz = plateau(evidence_of(*(bands_at(hz, seen, c) for c in (3, 4, 5))))
    assert abs(told.value - np.log(white)) < 2.0 * told.sigma and told.identified
    assert top_hz < 10.0
    moved = white * (1.0 + 30.0 / hz**2)
    channels = [bands_at(hz, seen, 3), bands_at(hz, moved, 4), bands_at(hz, seen, 5)]
    assert plateau(evidence_of(*channels)) is None
