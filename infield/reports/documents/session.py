"""What `update.json` and the report say of one run: alignment, measurements, coverage, residuals,
the claim chain.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.motion.stillness import detect_phases
from infield.reports.documents import parked as parked_document
from infield.reports.words.sentences import codes, sentence, sentences
from infield.session.estimate import SessionEstimate
from infield.session.navigated.claim_chain import ClaimChain
from infield.session.navigated.taxi_heading import heading_source
from infield.session.points import UNSEEN_SIGMA, AxisObservability
from infield.session.results import SessionResult
from infield.thermometer.gyro_temperature import fault_reason
from ins.attitude import euler_from_dcm
from ins.records import AXES, Phase
from ins.units import DEG, DEG_PER_HOUR, MILLIRADIAN
from ins.verdicts import because

HEATING_DEG_C_MIN = 0.05


def session_document(session: SessionResult) -> dict[str, Any]:
    """Everything a report shows of one run."""
    header = session.run.header
    out: dict[str, Any] = {
        "run_id": header.run_id,
        "sha256": session.run.sha256,
        "tail": header.tail,
        "start_utc": header.start_utc,
        "site": {
            "lat_deg": header.site.lat_rad / DEG,
            "lon_deg": header.site.lon_rad / DEG,
            "height_m": header.site.height_m,
        },
        "outcome": session.verdict.outcome,
        "reasons": sentences(session.verdict.reasons),
        "reason_codes": codes(session.verdict.reasons),
        "duration_s": session.run.imu.end_s - session.run.imu.start_s,
        "streams": [
            n for n in ("temperature", "gnss", "odometer") if getattr(session.run, n) is not None
        ],
    }
    if session.temperature is not None:
        T = session.temperature
        every = max(len(T.time_s) // 400, 1)
        out["temperature"] = {
            "min_degC": T.temperature_degC.min(axis=0).tolist(),
            "max_degC": T.temperature_degC.max(axis=0).tolist(),
            "unusable": list(T.unusable),
            "faults": [sentence(fault_reason(fault)) for fault in T.faults],
            "time_s": T.time_s[::every].tolist(),
            "gyro_degC": T.temperature_degC[::every].tolist(),
        }
    if session.estimate is not None:
        out.update(_estimate(session))
    return out


def _estimate(session: SessionResult) -> dict[str, Any]:
    e = session.estimate
    assert e is not None
    return {
        "alignment": _alignment(e),
        "heading_error": heading_error(session),
        "observability": {a.axis: _seen(a) for a in session.seen},
        "phases": [vars(p) for p in session.run.phases or _detected(e)],
        "points_covariance_deg_h2": session.points.covariance.tolist() if session.points else None,
        "coverage": _coverage(session),
        "residuals": _residuals(session),
        "heating_cooling": _heating_cooling(session),
        **(_navigated(session, e) if e.parked is None else parked_document.of_session(e)),
    }


def _alignment(e: SessionEstimate) -> dict[str, Any]:
    aligned = e.alignment
    return {
        "verdict": aligned.verdict,
        "time_s": aligned.time_s,
        "roll_deg": aligned.roll_rad / DEG,
        "pitch_deg": aligned.pitch_rad / DEG,
        "sigma_roll_deg": aligned.sigma_roll_rad / DEG,
        "heading_deg": aligned.heading_rad / DEG,
        "sigma_heading_deg": aligned.sigma_heading_rad / DEG,
        "latitude_found_deg": aligned.latitude_rad / DEG,
        "sigma_latitude_deg": aligned.sigma_latitude_rad / DEG,
        "reasons": sentences(aligned.reasons),
        "reason_codes": codes(aligned.reasons),
    }


def _seen(axis: AxisObservability) -> dict[str, Any]:
    return {**vars(axis), "advice": advice_words(axis)}


def advice_words(axis: AxisObservability) -> str:
    """What would make the gyro better known; empty where nothing more is needed."""
    return "" if axis.advice is None else sentence(axis.advice)


def _detected(e: SessionEstimate) -> tuple[Phase, ...]:
    """Phases by the motion; what lies between the stretches of a parked unit is nobody's to
    name.
    """
    several = e.parked is not None and len(e.parked.stretches) > 1
    return parked_document.phases(e) if several else detect_phases(e.motion)


def _navigated(session: SessionResult, e: SessionEstimate) -> dict[str, Any]:
    """Of a session with a navigation solution."""
    tally = e.navigated.filter.tally
    return {
        "measurements": {
            kind: {"nis_mean": tally.nis[kind] / tally.dof[kind], "dof": tally.dof[kind]}
            for kind in sorted(tally.nis)
        },
        "parked_jitter_m": e.navigated.displacement_sigma_m,
        "smoothing": _smoothing(e),
        "velocity": _velocity(session),
        "claim_chain": _chain(session.chain, session),
    }


def _smoothing(e: SessionEstimate) -> dict[str, dict[str, float]]:
    """RMS over the bins of each gyro's sigma when the bin's time was over, and given the whole
    run.
    """
    filtered = e.navigated.filter.filtered[:, 1, :] / DEG_PER_HOUR**2
    smoothed = np.diag(e.covariance).reshape(-1, 3)
    return {
        axis: {
            "filtered_sigma_deg_h": float(np.sqrt(np.nanmean(filtered[:, k]))),
            "smoothed_sigma_deg_h": float(np.sqrt(np.mean(smoothed[:, k]))),
        }
        for k, axis in enumerate(AXES)
    }


def _coverage(session: SessionResult) -> list[dict[str, Any]]:
    """Seconds of the session in each 5 degC band, per axis."""
    T = session.temperature
    assert T is not None and session.estimate is not None
    bins = session.estimate.bins
    apart = np.flatnonzero(bins.start_s[1:] > bins.end_s[:-1])
    spans = zip(bins.start_s[np.append(0, apart + 1)], bins.end_s[np.append(apart, -1)])
    rows = np.concatenate([np.arange(T.time_s.size)[T.between(a, b)] for a, b in spans])
    step = float(np.median(np.diff(T.time_s)))
    found = []
    for k, axis in enumerate(AXES):
        values = T.temperature_degC[rows, k]
        edges = np.arange(5 * np.floor(values.min() / 5), values.max() + 5.0, 5.0)
        counts, _ = np.histogram(values, edges)
        for low, high, n in zip(edges[:-1], edges[1:], counts):
            found.append(
                {
                    "axis": axis,
                    "low_degC": float(low),
                    "high_degC": float(high),
                    "seconds": float(n * step),
                }
            )
    return found


def _residuals(session: SessionResult) -> list[dict[str, Any]]:
    """Points less the table before and after the merge, in deg/h, with the point's sigma."""
    p = session.points
    assert p is not None and session.estimate is not None
    before, after = session.estimate.bins.table_deg_h, _table_after(session)
    return [
        {
            "axis": AXES[a],
            "time_s": float(t),
            "temperature_degC": float(T),
            "before_deg_h": float(y - b),
            "after_deg_h": float(y - c),
            "sigma_deg_h": float(s),
        }
        for a, t, T, y, b, c, s in zip(
            p.axis_index, p.time_s, p.temperature_degC, p.bias_deg_h, before, after, p.sigma_deg_h
        )
    ]


def _table_after(session: SessionResult) -> NDArray:
    """The merged table at the points; as it was where nothing was merged or a stuck thermometer
    ties no table to them.
    """
    assert session.estimate is not None and session.points is not None
    before, H = session.estimate.bins.table_deg_h, session.points.H
    return (
        np.where(H.any(axis=1), H @ session.merged.candidate.parameters, before)
        if session.merged
        else before
    )


def _heating_cooling(session: SessionResult) -> list[dict[str, Any]]:
    """Mean residual to the merged table over rising and over falling temperature, per axis, with
    the sigma of their difference from the points' joint covariance; null where one side was not
    visited.
    """
    p = session.points
    assert p is not None
    residual = p.bias_deg_h - _table_after(session)
    found = []
    for k, axis in enumerate(AXES):
        up = (p.axis_index == k) & (p.temperature_rate_degC_min > HEATING_DEG_C_MIN)
        down = (p.axis_index == k) & (p.temperature_rate_degC_min < -HEATING_DEG_C_MIN)
        row: dict[str, Any] = {
            "axis": axis,
            "heating_points": int(up.sum()),
            "cooling_points": int(down.sum()),
            "difference_deg_h": None,
            "sigma_deg_h": None,
        }
        if up.any() and down.any():
            w = up / up.sum() - down / down.sum()
            row["difference_deg_h"], row["sigma_deg_h"] = (
                float(w @ residual),
                float(np.sqrt(w @ p.covariance @ w)),
            )
        found.append(row)
    return found


def _velocity(session: SessionResult) -> dict[str, Any]:
    """Computed velocity of the last pass, decimated, for the plot."""
    assert session.estimate is not None
    history = session.estimate.navigated.history
    every = max(len(history.time_s) // 800, 1)
    return {
        "time_s": history.time_s[::every].tolist(),
        "north_m_s": history.v_n_m_s[::every, 0].tolist(),
        "east_m_s": history.v_n_m_s[::every, 1].tolist(),
        "heading_deg": (euler_from_dcm(history.C_nb[::every])[2] / DEG).tolist(),
    }


def _chain(chain: ClaimChain | None, session: SessionResult) -> dict[str, Any] | None:
    """The patent's own path beside the filter: points along north and east of the parked
    heading.
    """
    p, e = session.points, session.estimate
    if chain is None or p is None or e is None:
        return None
    c, s = np.cos(chain.heading_rad), np.sin(chain.heading_rad)
    level = e.mean_deg_h.reshape(-1, 3)[:, :2] @ np.array([[c, s], [-s, c]])  # columns north, east
    centre = e.bins.centre_s
    rows = []
    for point in chain.points:
        north, east = (float(np.interp(point.time_s, centre, level[:, k])) for k in (0, 1))
        rows.append({**vars(point), "filter_north_deg_h": north, "filter_east_deg_h": east})
    nan = bool(np.isnan(chain.psi_rad))
    difference = np.array(
        [
            [r["north_deg_h"] - r["filter_north_deg_h"], r["east_deg_h"] - r["filter_east_deg_h"]]
            for r in rows
        ]
    )
    return {
        "points": rows,
        "heading_error_mrad": None if nan else chain.psi_rad / MILLIRADIAN,
        "sigma_heading_error_mrad": None if nan else chain.sigma_psi_rad / MILLIRADIAN,
        "note": sentence(because(chain.note)),
        "sigma_deg_h": _mean(rows, "sigma_deg_h"),
        "sigma_filtered_deg_h": _mean(rows, "sigma_filtered_deg_h"),
        "bracket_sigma_deg_h": _mean(rows, "bracket_sigma_deg_h"),
        "difference_rms_deg_h": _rms(difference[:, 0]) if rows else None,
        "difference_rms_east_deg_h": _rms(difference[:, 1]) if rows and not nan else None,
    }


def _mean(rows: list[dict[str, Any]], key: str) -> float | None:
    values = np.array([row[key] for row in rows], dtype=float)
    return float(np.nanmean(values)) if np.isfinite(values).any() else None


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def heading_error(session: SessionResult | None) -> dict[str, Any]:
    """Computed minus true at the end of the alignment; null where the session did not add to the
    alignment.
    """
    nothing = {"value_mrad": None, "sigma_mrad": None, "source": None}
    if session is None or session.estimate is None:
        return nothing
    e = session.estimate
    sigma = e.sigma_heading_rad / MILLIRADIAN
    if not np.isfinite(sigma):
        return nothing
    source = heading_source(e.navigated.filter.tally.heading_gain)
    if source is None or e.sigma_heading_rad > UNSEEN_SIGMA * e.sigma_heading_before_rad:
        return {"value_mrad": None, "sigma_mrad": sigma, "source": None}
    return {"value_mrad": e.heading_error_rad / MILLIRADIAN, "sigma_mrad": sigma, "source": source}
