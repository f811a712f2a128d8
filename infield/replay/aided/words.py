"""What aided replay took from a log beyond what was declared, and what of it is not to be believed,
in words.
"""

import numpy as np

from infield.replay.aided.antenna import SeenAntenna, antenna_sigmas
from infield.replay.aided.noise import BELIEVED, NoiseScales
from ins.filters.aided_filter import Antenna
from ins.records import TwinModel

LEAST_APART_S = 0.02  # between the delays of positions and velocities, to be told apart


def antenna_words(seen: SeenAntenna, declared: Antenna) -> tuple[str, ...]:
    """What was taken of the antenna, against what was declared."""
    now, sigma, words = seen.antenna, antenna_sigmas(seen.antenna), []
    if seen.freed.arm:
        arm = ", ".join(f"{v:.2f} +- {s:.2f}" for v, s in zip(now.lever_arm_m, sigma))
        given = ", ".join(f"{v:g}" for v in declared.lever_arm_m)
        words.append(
            f"the fixes are not of an antenna at the lever arm ({given}) m of run.json: taken"
            f" ({arm}) m, which the fixes show ({seen.gain_nats:.0f} nats); its sigma is in the"
            " solution's"
        )
    if seen.freed.delay:
        apart = abs(now.delay_s - now.velocity_delay_s) > max(
            4.0 * float(np.hypot(*sigma[3:])), LEAST_APART_S
        )
        late = (
            ("positions", now.delay_s, sigma[3]),
            ("velocities", now.velocity_delay_s, sigma[4]),
        )
        told = [
            f"{what} are {1e3 * abs(t):.0f} +- {1e3 * s:.0f} ms {'older' if t > 0 else 'younger'}"
            for what, t, s in (late if apart else (("fixes", *late[1][1:]),))
        ]
        words.append(f"{', '.join(told)} than their time: taken so ({seen.gain_nats:.0f} nats)")
    return tuple(words)


def scaled_words(scales: NoiseScales, twin: TwinModel) -> str:
    parts = [
        f"{what} {_factor(value)} times"
        for what, value in (
            ("white noise of the sensors", scales.white),
            ("walks of their biases", scales.walk),
            ("satellite position", scales.position),
            ("satellite velocity", scales.velocity),
        )
        if _factor(value) != "1"
    ]
    told = "taken " + ", ".join(parts) + " as large" if parts else "noise as declared"
    if scales.slow:
        level, down = (
            scales.slow * twin.gnss.sigma_horizontal_m,
            scales.slow * twin.gnss.sigma_vertical_m,
        )
        told += (
            f", a slow error of the positions of {level:.2g} m level, {down:.2g} m down over"
            f" {scales.slow_s:.0f} s"
        )
    if scales.slow_velocity:
        sigma = scales.slow_velocity * twin.gnss.sigma_velocity_m_s
        told += (
            f", a slow error of the velocities of {sigma:.2g} m/s over"
            f" {scales.slow_velocity_s:.2g} s"
        )
    most = " (the largest that is tried)" if scales.capped else ""
    return (
        f"the innovations exceed the noise model ({twin.source}): {told}{most}; NIS is no test then"
    )


def unbelieved(scales: NoiseScales, technology: str) -> tuple[str, ...]:
    """Factors on the sensors that no noise explains."""
    most = BELIEVED[technology]
    what = {"white": "white noise of the sensors", "walk": "walks of their biases"}
    return tuple(
        f"{told} would have to be {_factor(value)} times as large, needed less than {most:g}"
        f" ({technology}): axes, signs, scale factor or units of the sensors?"
        for name, told in what.items()
        if (value := getattr(scales, name)) >= most
    )


def _factor(value: float) -> str:
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
