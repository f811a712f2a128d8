"""The `aided` part of replay.json, and the columns of navigation_aided.parquet, from an
`infield.replay.aided.flight.AidedResult`.

verdict, reasons, notes   "aided", "inconsistent" or "refused"
table                     role of the table that the log was compensated with
start                     time_s, method ("gyrocompass", "velocity matching"), the stretch it was
found on, heading and its
                          first sigma
end                       attitude, velocity, biases at the end, each with its sigma
fixes                     count, and of each kind: used, rejected
rejected[]                time_s, kind, nis, and the residual over its sigma, NED; at most MOST of
them, in order of time outages[]                 start_s, end_s without a used position, sigma_m
(level) at the end, off_m: what the next fix was off resets_s                  when the solution was
begun anew standing[]                start_s, end_s: taken as measurements of no velocity
consistency               overall, position, velocity: nis_mean, dof, band_95; standing; is_test:
false where noise was fitted noise                     factors on the declared sigmas, those at the
largest that is tried, declared_nis (before any factor) antenna                   lever_arm_m (with
sigma) and delay_s of the solution, what of them was taken from the fixes, and
                          `seen`: what the fixes say with both free; null where that could not be
                          flown
scoring_only              against the run's reference: RMS errors, and squared error over variance
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.replay.aided.antenna import SeenAntenna, antenna_sigmas
from infield.replay.aided.flight import AidedResult, nis_of, rejected_rows, reset_times
from ins.attitude import euler_from_dcm, wrap_pi
from ins.earth import displacement_ned
from ins.filters.aided_filter import KINDS, AidedHistory, Antenna, level_sigmas
from ins.filters.states import AIDED_ACCEL as ACCEL
from ins.filters.states import AIDED_GYRO as GYRO
from ins.filters.states import AIDED_POS as POS
from ins.filters.states import AIDED_VEL as VEL
from ins.kalman import nis_band
from ins.records import ReferenceLog
from ins.units import DEG, DEG_PER_HOUR, MICRO_G

MOST = 500  # rejects that are listed
ANGLES = ("roll", "pitch", "heading")


def aided_document(
    result: AidedResult | None, reference: ReferenceLog | None
) -> dict[str, Any] | None:
    """The plain document; null without GNSS or where it was not asked for."""
    if result is None:
        return None
    head: dict[str, Any] = {
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "notes": list(result.notes),
        "table": result.role,
        "standing": [{"start_s": a, "end_s": b} for a, b in result.stands],
    }
    history, found = result.history, result.found
    if history is None or found is None:
        return head
    rejected = _rejected(history)
    return head | {
        "start": {
            "time_s": found.start.state.time_s,
            "method": found.method,
            "span": {"start_s": found.span[0], "end_s": found.span[1]},
            "heading_deg": float(euler_from_dcm(found.start.state.C_nb)[2]) / DEG,
            "sigma_heading_deg": found.sigma_heading_rad / DEG,
        },
        "end": _end(result),
        "fixes": {
            "count": int((history.used > 0).any(axis=1).sum()),
            **{f"used_{kind}": nis_of(history, k)[1] // 3 for k, kind in enumerate(KINDS)},
            **{
                f"rejected_{kind}": int(rejected_rows(history, k).size)
                for k, kind in enumerate(KINDS)
            },
        },
        "rejected": rejected[:MOST],
        "outages": [
            {"start_s": o.start_s, "end_s": o.end_s, "sigma_m": o.sigma_m, "off_m": o.off_m}
            for o in result.outages
        ],
        "resets_s": [float(t) for t in reset_times(history)],
        "consistency": _consistency(result, history),
        "noise": _noise(result),
        "antenna": _antenna(result.antenna),
        "scoring_only": None if reference is None else _scores(result, reference),
    }


def _rejected(history: AidedHistory) -> list[dict[str, Any]]:
    found = []
    for k, kind in enumerate(KINDS):
        part = slice(3 * k, 3 * k + 3)
        for row in rejected_rows(history, k):
            over = history.residual[row, part] / history.sigma[row, part]
            found.append(
                {
                    "time_s": float(history.fix_time_s[row]),
                    "kind": kind,
                    "nis": float(history.nis[row, k]),
                    "north_sigmas": float(over[0]),
                    "east_sigmas": float(over[1]),
                    "down_sigmas": float(over[2]),
                }
            )
    return sorted(found, key=lambda r: r["time_s"])


def _consistency(result: AidedResult, history: AidedHistory) -> dict[str, Any]:
    parts = {kind: nis_of(history, k) for k, kind in enumerate(KINDS)}
    dof = sum(n for _, n in parts.values())
    total = sum(mean * n for mean, n in parts.values() if n)
    everything = {"overall": (total / dof if dof else float("nan"), dof), **parts}
    out: dict[str, Any] = {
        name: {"nis_mean": mean, "dof": n, "band_95": list(nis_band(n, 0.95))}
        for name, (mean, n) in everything.items()
    }
    taken = result.antenna is not None and any(result.antenna.freed)
    standing = history.stand_nis / history.stand_dof if history.stand_dof else float("nan")
    return out | {
        "standing": {"nis_mean": standing, "dof": history.stand_dof},
        "is_test": not (result.scales.fitted or taken),
    }


def _noise(result: AidedResult) -> dict[str, Any]:
    s = result.scales
    return {
        "fitted": s.fitted,
        "white_factor": s.white,
        "walk_factor": s.walk,
        "position_factor": s.position,
        "velocity_factor": s.velocity,
        "slow_factor": s.slow,
        "slow_s": s.slow_s if s.slow else None,
        "slow_velocity_factor": s.slow_velocity,
        "slow_velocity_s": s.slow_velocity_s if s.slow_velocity else None,
        "at_largest": list(s.capped),
        "declared_nis": {"position": result.declared_nis[0], "velocity": result.declared_nis[1]},
    }


def _antenna(seen: SeenAntenna | None) -> dict[str, Any] | None:
    if seen is None:
        return None
    return _arm(seen.antenna) | {
        "taken": [name for name, freed in zip(("lever_arm", "delay"), seen.freed) if freed],
        "gain_nats": seen.gain_nats,
        "seen": None if seen.seen is None else _arm(seen.seen),
    }


def _arm(antenna: Antenna) -> dict[str, Any]:
    sigma = [float(v) for v in antenna_sigmas(antenna)]
    return {
        "lever_arm_m": [float(v) for v in antenna.lever_arm_m],
        "sigma_lever_arm_m": sigma[:3],
        "delay_s": antenna.delay_s,
        "sigma_delay_s": sigma[3],
        "velocity_delay_s": antenna.velocity_delay_s,
        "sigma_velocity_delay_s": sigma[4],
    }


def _end(result: AidedResult) -> dict[str, float]:
    return {name: float(column[-1]) for name, column in aided_columns(result).items()}


def aided_columns(result: AidedResult) -> dict[str, NDArray]:
    """The solution at 1 Hz by column, units in the names, each with its sigma (NED; roll, pitch,
    heading).
    """
    history = result.history
    assert history is not None
    sigma, attitude = (
        np.sqrt(history.variance),
        level_sigmas(history.phi_covariance, history.C_nb) / DEG,
    )
    columns = {
        "time_s": history.time_s,
        "lat_deg": history.lat_rad / DEG,
        "lon_deg": history.lon_rad / DEG,
        "height_m": history.height_m,
        **dict(zip(("vn_m_s", "ve_m_s", "vd_m_s"), history.v_n_m_s.T)),
        **{f"{name}_deg": a / DEG for name, a in zip(ANGLES, euler_from_dcm(history.C_nb))},
        **dict(zip(("sigma_north_m", "sigma_east_m", "sigma_down_m"), sigma[:, POS].T)),
        **dict(zip(("sigma_vn_m_s", "sigma_ve_m_s", "sigma_vd_m_s"), sigma[:, VEL].T)),
        **{f"sigma_{name}_deg": a for name, a in zip(ANGLES, attitude.T)},
    }
    gyro_sigma, accel_sigma = bias_sigmas(result)
    for sensor, bias, spread, unit, factor in (
        ("gyro", history.gyro_bias_rad_s, gyro_sigma, "deg_h", DEG_PER_HOUR),
        ("accel", history.accel_bias_m_s2, accel_sigma, "ug", MICRO_G),
    ):
        for k, axis in enumerate("xyz"):
            columns[f"{sensor}_bias_{axis}_{unit}"] = bias[:, k] / factor
            columns[f"sigma_{sensor}_bias_{axis}_{unit}"] = spread[:, k] / factor
    return columns


def bias_sigmas(result: AidedResult) -> tuple[NDArray, NDArray]:
    """Sigmas (k, 3) of gyro and accelerometer bias: the filter's, and the flicker that its random
    walk is too slow for.
    """
    history = result.history
    assert history is not None
    gyro, accel = result.flicker
    return np.sqrt(history.variance[:, GYRO] + gyro**2), np.sqrt(
        history.variance[:, ACCEL] + accel**2
    )


def _scores(result: AidedResult, reference: ReferenceLog) -> dict[str, Any] | None:
    """RMS errors against truth, and squared errors over variances (1 where the sigmas are
    honest).
    """
    history = result.history
    assert history is not None
    inside = (history.time_s >= reference.time_s[0]) & (history.time_s <= reference.time_s[-1])
    if not inside.any():
        return None
    t = history.time_s[inside]

    def true(values: NDArray) -> NDArray:
        return np.interp(t, reference.time_s, values)

    level = displacement_ned(
        history.lat_rad[inside],
        history.lon_rad[inside],
        lat0_rad=true(reference.lat_rad),
        lon0_rad=true(np.unwrap(reference.lon_rad)),
        height0_m=true(reference.height_m),
    )
    position = np.column_stack([level, true(reference.height_m) - history.height_m[inside]])
    velocity = history.v_n_m_s[inside] - np.stack([true(v) for v in reference.v_n_m_s.T], axis=1)
    angles = np.stack(euler_from_dcm(history.C_nb[inside]), axis=1) / DEG
    turn = np.stack(
        [
            true(np.unwrap(a))
            for a in (reference.roll_rad, reference.pitch_rad, reference.heading_rad)
        ],
        axis=1,
    )
    attitude = wrap_pi(angles * DEG - turn) / DEG
    sigma = level_sigmas(history.phi_covariance, history.C_nb)[inside] / DEG
    out: dict[str, Any] = {"source": "reference"}
    for name, error, spread, unit in (
        ("position", position, np.sqrt(history.variance[inside, POS]), "m"),
        ("velocity", velocity, np.sqrt(history.variance[inside, VEL]), "m_s"),
        ("attitude", attitude, sigma, "deg"),
    ):
        out[f"rms_{name}_{unit}"] = [float(x) for x in np.sqrt(np.mean(error**2, axis=0))]
        out[f"normalised_{name}"] = float(np.mean((error / spread) ** 2))
    return out
