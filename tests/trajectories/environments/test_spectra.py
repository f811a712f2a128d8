"""Published spectra hold their variance, series have them, and each mode peaks where it is declared
to."""

from functools import partial

import numpy as np
import pytest
from scipy.signal import welch

from trajectories.simulator.environments import spectra
from trajectories.simulator.environments.gear import AIRLINER, PITCH, ROLL, YAW
from trajectories.simulator.environments.scene import Scene

RUN_S, DT_S = 20_000.0, 0.05
F_HZ = np.geomspace(1e-6, 1e3, 400_000)  # wide enough for the tails of the gusts, f^(-5/3)


def scene() -> Scene:
    """Parked all the time."""
    time_s = np.arange(int(RUN_S / DT_S)) * DT_S
    return Scene(
        rows=time_s.size // 4,
        steps=2,
        dt_s=DT_S,
        time_s=time_s,
        parked=np.ones(time_s.size),
        stand_s=(0.0, RUN_S / 2),
    )


@pytest.mark.parametrize(
    ("spectrum", "rms"),
    [
        (partial(spectra.von_karman_along, sigma=2.0, length_m=30.0, speed_m_s=8.0), 2.0),
        (partial(spectra.von_karman_across, sigma=2.0, length_m=15.0, speed_m_s=8.0), 2.0),
        (partial(spectra.resonance, rms=3.0, peak_hz=0.1, damping=0.08), 3.0),
    ],
    ids=["gusts along", "gusts across", "resonance"],
)
def test_a_spectrum_holds_the_variance_that_it_is_given(spectrum, rms):
    assert np.sqrt(np.trapezoid(spectrum(F_HZ), F_HZ)) == pytest.approx(rms, rel=0.01)


def test_gust_scales_are_those_of_the_standard():
    """MIL-F-8785C at 20 ft: sigma_w a tenth of the wind, sigma_u = sigma_w / 0.1934^0.4."""
    sigma_u, length_u, sigma_w, length_w = spectra.gust_scales(10.0, 20 * 0.3048)
    assert sigma_w == pytest.approx(1.0) and length_w == pytest.approx(6.096)
    assert sigma_u == pytest.approx(1.929, rel=1e-3)
    assert length_u / 0.3048 == pytest.approx(143.6, rel=2e-3)


@pytest.mark.parametrize(
    ("spectrum", "rms", "peak_hz"),
    [
        (partial(spectra.resonance, rms=0.4, peak_hz=1 / 12, damping=0.08), 0.4, 1 / 12),
        (partial(spectra.jonswap, height_m=0.4, peak_s=8.0), 0.1, 1 / 8),
        (partial(spectra.band, rms=2.0, low_hz=0.5, high_hz=2.0), 2.0, None),
    ],
    ids=["roll", "waves", "band"],
)
def test_a_series_has_the_rms_and_the_peak_that_are_declared(spectrum, rms, peak_hz):
    """20,000 s: at a bandwidth of 0.01 Hz some 200 independent values, 5 % of RMS."""
    series = spectra.gaussian(scene(), spectrum, np.random.default_rng(3))
    assert series.std() == pytest.approx(rms, rel=0.15)
    f, power = welch(series, 1 / DT_S, nperseg=8192)
    if peak_hz is not None:
        assert f[np.argmax(power)] == pytest.approx(peak_hz, rel=0.1)
    expected = spectrum(f[1:])
    strong = expected > 0.2 * expected.max()
    assert np.mean(power[1:][strong] / expected[strong]) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("column", [ROLL, PITCH, YAW])
def test_a_mode_stands_at_its_stiffness_and_rings_at_its_frequency(column):
    f = np.linspace(0.0, 5.0, 50_001)
    size = np.abs(AIRLINER.response(f))[:, column]
    assert size[0] * AIRLINER.stiffness[column] == pytest.approx(1.0)
    damping = AIRLINER.damping[column]
    peak_hz = AIRLINER.frequency_hz[column] * np.sqrt(1 - 2 * damping**2)
    assert f[np.argmax(size)] == pytest.approx(peak_hz, abs=2e-4)
    assert size.max() / size[0] == pytest.approx(
        1 / (2 * damping * np.sqrt(1 - damping**2)), rel=1e-4
    )
