"""Sentences of `infield.aided`: what an aided solution took from a log beyond what was
declared, what of it is not to be believed, and why there is none.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum

from infield.aided.checks import Widened
from infield.aided.noise import SHOWS_LESS
from infield.aided.reasons import AidedNote, AidedReason, AidedWeakness
from infield.aided.wheels import Mounting, WheelsFound
from infield.reports.words.sentences import Template
from ins.units import DEG

PLURAL = {"position": "positions", "velocity": "velocities"}
FACTORS = {
    "white": "white noise of the gyros",
    "walk": "walks of the gyros' biases",
    "accel_white": "white noise of the accelerometers",
    "accel_walk": "walks of the accelerometers' biases",
    "position": "satellite position",
    "velocity": "satellite velocity",
}
# milliseconds by which fixes are older than their time
Late = Sequence[tuple[str, float, float]]


def _factor(value: float) -> str:
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _heading_unsure(*, best_rad: float, limit_rad: float, longest_s: float) -> str:
    return (
        f"heading from the satellite velocities is at best good to {best_rad / DEG:.2g} deg, needed"
        f" {limit_rad / DEG:g} deg within {longest_s:g} s of log: too little manoeuvring"
    )


def _many_rejected(*, kind: str, rejected: int, seen: int, most: float) -> str:
    return f"{rejected} of {seen} satellite {PLURAL[kind]} rejected, needed at most {most:.0%}"


def _unbelieved(*, factor: str, value: float, most: float, technology: str) -> str:
    return (
        f"{FACTORS[factor]} would have to be {_factor(value)} times as large, needed less than"
        f" {most:g} ({technology}): axes, signs, scale factor or units of the sensors?"
    )


def _contradicts(*, count: int, seen: int, components: str, sigmas: float) -> str:
    return (
        f"velocities of {count} of {seen} fixes are not the way of their positions ({components},"
        f" up to {sigmas:.1f} sigmas), and neither can be told right"
    )


def _fixes_say(*, declared_m: float, said_m: float, declared_m_s: float, said_m_s: float) -> str:
    told = [
        f"{what} declared {declared:.2g} {unit}, "
        + ("taken so" if said == declared else f"the innovations say {said:.2g} {unit}")
        for what, unit, declared, said in (
            ("positions", "m", declared_m, said_m),
            ("velocities", "m/s", declared_m_s, said_m_s),
        )
    ]
    return f"sigmas of the fixes (median): {'; '.join(told)}"


def _fixes_widened(
    *, count: int, first_s: float, last_s: float, components: str, sigmas: float, whose: Widened
) -> str:
    told = "positions and velocities" if whose is Widened.BOTH else PLURAL[whose]
    return (
        f"{count} fixes from {first_s:.1f} to {last_s:.1f} s have velocities that are not the way"
        f" of their positions ({components}, up to {sigmas:.1f} sigmas): their {told} are taken for"
        " as far off as that (1 sigma)"
    )


def _off_the_track(*, mean_rad: float, spread_rad: float) -> str:
    return (
        f"body x points {mean_rad / DEG:+.0f} deg off the track (median; half of the rows within"
        f" {spread_rad / DEG:.1f} deg): where that is no crab, the unit is mounted turned, and"
        " roll, pitch and heading are its own"
    )


def _lever_arm(
    *,
    lever_arm_m: Sequence[float],
    sigma_m: Sequence[float],
    declared_m: Sequence[float],
    gain_nats: float,
) -> str:
    arm = ", ".join(f"{v:.2f} +- {s:.2f}" for v, s in zip(lever_arm_m, sigma_m))
    given = ", ".join(f"{v:g}" for v in declared_m)
    return (
        f"the fixes are not of an antenna at the lever arm ({given}) m of run.json: taken"
        f" ({arm}) m, which the fixes show ({gain_nats:.0f} nats); its sigma is in the"
        " solution's"
    )


def _delay(*, late: Late, gain_nats: float) -> str:
    told = ", ".join(
        f"{what} are {1e3 * abs(t):.0f} +- {1e3 * s:.0f} ms {'older' if t > 0 else 'younger'}"
        for what, t, s in late
    )
    return f"{told} than their time: taken so ({gain_nats:.0f} nats)"


def _noise(
    *,
    factors: Mapping[str, float],
    stirred: float,
    slow: Mapping[str, float] | None,
    slow_other: Mapping[str, float] | None,
    slow_velocity: Mapping[str, float] | None,
    capped: bool,
    source: str,
) -> str:
    parts = [
        f"{FACTORS[name]} {_factor(value)} times"
        for name, value in factors.items()
        if _factor(value) != "1"
    ]
    told = "taken " + ", ".join(parts) + " as large" if parts else "noise as declared"
    if stirred:
        told += (
            ", biases of the accelerometers that move with the shaking, by"
            f" {_factor(stirred)} m/s^2 where it changes by 1 m/s^2"
        )
    if slow:
        told += (
            f", a slow error of the positions of {slow['level_m']:.2g} m level,"
            f" {slow['down_m']:.2g} m down over {slow['time_s']:.0f} s"
        )
    if slow_other:
        told += (
            f", one of {slow_other['level_m']:.2g} m level, {slow_other['down_m']:.2g} m down of"
            f" {slow_other['fixes']:.0f} of {slow_other['of']:.0f} fixes, which are of another type"
        )
    if slow_velocity:
        told += (
            f", a slow error of the velocities of {slow_velocity['sigma_m_s']:.2g} m/s over"
            f" {slow_velocity['time_s']:.2g} s"
        )
    most = " (the largest that is tried)" if capped else ""
    more = stirred or slow_other or slow_velocity or max(factors.values()) > 1.0
    short = slow is not None and slow["scatter"] <= SHOWS_LESS
    how = "fall short of" if not more and (short or not slow) else "exceed"
    if slow and short:
        told += (
            f" (positions scatter by {slow['scatter']:.2g} of what is declared; the rest is taken"
            " for a slow error)"
        )
    told = f"the innovations {how} the noise model ({source}): {told}{most}"
    return f"{told}; NIS is no test then"


WHY_NO_WHEELS: Mapping[WheelsFound, str] = {
    WheelsFound.BANKS: "the vehicle banks as it turns",
    WheelsFound.SLIPS: "its velocity is not along one axis of the unit",
    WheelsFound.TOO_SHORT: "it rolls for less than a minute with a heading that is known",
    WheelsFound.TOO_STRAIGHT: "it turns by less than 90 deg",
    WheelsFound.CONTRADICTED: "held by its wheels it contradicts the fixes",
}


def _no_wheels(*, why: WheelsFound) -> str:
    return f"not held by wheels: {WHY_NO_WHEELS[why]}"


def _wheels(
    *, side_m_s: float, up_m_s: float, scale: float, mounted: Mounting, used: int, rejected: int
) -> str:
    told = f"; its odometer's scale is {scale:.4f}" if scale == scale else ""
    yaw, pitch = (s / DEG for s in mounted.sigma_rad)
    return (
        f"held by its wheels: it goes where it points to {side_m_s:.2g} m/s sideways and"
        f" {up_m_s:.2g} m/s up (RMS), {mounted.yaw_rad / DEG:+.1f} +- {yaw:.1g} deg to the right of"
        f" body x and {mounted.pitch_rad / DEG:+.1f} +- {pitch:.1g} deg above it{told}; {used}"
        f" seconds used, {rejected} rejected"
    )


# why a stretch of a solution is degraded
WEAK_WORDS: Mapping[AidedWeakness, str] = {
    AidedWeakness.START: "the position is not yet known",
    AidedWeakness.HEADING: "the heading is known to no better than 5 deg",
    AidedWeakness.OUTAGE: "no fixes: dead reckoning",
    AidedWeakness.REJECTED: "fixes rejected one after the other",
    AidedWeakness.LEAP: "the positions leapt while the velocities fitted",
    AidedWeakness.RECEIVER: "the receiver itself gives wide sigmas to its positions",
    AidedWeakness.BEGUN_ANEW: "all fixes rejected for long, begun anew",
}

SENTENCES: Mapping[StrEnum, Template] = {
    AidedReason.NO_FIXES: "no satellite fixes in the run",
    AidedReason.FEW_FIXES: "{count} satellite fixes within the imu log, needed {needed}",
    AidedReason.NO_VELOCITY_CHANGE: (
        "the satellite velocity never changes by {needed_m_s:g} m/s within {longest_s:g} s: heading"
        " cannot be found (a constant velocity does not show it)"
    ),
    AidedReason.HEADING_UNSURE: _heading_unsure,
    AidedReason.HEADINGS_DIFFER: (
        "two headings explain the first {longest_s:g} s of fixes, or a longer stretch says another"
        " than a shorter one: the vehicle manoeuvres too little, or its fixes are not of this log"
    ),
    AidedReason.NIS_HIGH: "satellite {kind}: {excess}",
    AidedReason.MANY_REJECTED: _many_rejected,
    AidedReason.NOISE_UNBELIEVED: _unbelieved,
    AidedReason.RECEIVER_CONTRADICTS: _contradicts,
    AidedNote.FIXES_WIDENED: _fixes_widened,
    AidedNote.FIXES_SAY: _fixes_say,
    AidedNote.HEADING_OPEN: (
        "{reason}. The solution is that of flights from headings all round, weighed by what they"
        " explain: its heading is worth what its sigma says"
    ),
    AidedNote.WHEELS_TAKEN: _wheels,
    AidedNote.NO_WHEELS: _no_wheels,
    AidedNote.USUAL_MOTION: (
        "without fixes for {without_s:g} s and longer it is taken to go as with them: up to"
        " {level_m_s:.2g} m/s level and {down_m_s:.2g} m/s up or down (1 sigma), for"
        " {lasts_s:.0f} s at a time"
    ),
    AidedNote.REPEATED_FIXES: (
        "{count} fixes from {first_s:.1f} to {last_s:.1f} s are left out: their position is that of"
        " the fix before, to the last digit, at {speed_m_s:.1f} m/s (a receiver that is stuck, or a"
        " log that repeats it)"
    ),
    AidedNote.SITE_ELSEWHERE: (
        "the parked fixes lie {off_m:.0f} m from the site of run.json: the aided solution goes by"
        " the fixes"
    ),
    AidedNote.OFF_THE_TRACK: _off_the_track,
    AidedNote.LEVER_ARM_TAKEN: _lever_arm,
    AidedNote.DELAY_TAKEN: _delay,
    AidedNote.NOISE_TAKEN: _noise,
}
