"""misalignment.json (`recal.misalignment/1`): the study as plain values. Computes nothing but
units.

Every angle stands in arcsec and mrad; what was not observed is null with its sigma, and named in
`not_observable`.
"""

from typing import Any

import numpy as np

from infield.misalignment.closed_forms import DocumentAngles, document_angles, document_compensation
from infield.misalignment.harmonic_fit import (
    NOT_AT_ONE_ATTITUDE,
    Coupling,
    level_rate_deg_h,
    north_to_west_rad,
)
from infield.misalignment.study import ENTRIES, AzimuthStudy, corrected_twin
from ins.records import AXES, InputError
from ins.units import ARCSEC, DEG, MICRO_G, MILLIRADIAN, STANDARD_GRAVITY

SCHEMA = "recal.misalignment/1"
WHY_VERTICAL = (
    "what the vertical couples in is a bias at one attitude and latitude: it stays in the table;"
    " tilt the unit to see it"
)
WHY_NORTH = (
    "turning both level gyros about down looks like another north: give headings (--heading-deg)"
    " from a line outside"
)
WHY_DIAGONAL = (
    "xy + yx shows off the cardinal headings only where nobody gives the azimuths: stand on 45,"
    " 135, 225, 315 deg"
)
WHY_WEAK = (
    "noise: its sigma is too near to the prior; stay longer at each stop, or make the stops in one"
    " power-on"
)
WHY_MOUNTING = (
    "the unit's base against the turning axis looks the same; give --sigma-mounting-arcsec to state"
    " a bias"
)


def misalignment_document(study: AzimuthStudy, *, version: str) -> dict[str, Any]:
    """The document of a study."""
    result, fit = study.result, study.result.fit
    geometry = result.geometry
    shown = result.verdict != "refused" or fit is not None
    twin = corrected_twin(study)
    return {
        "schema": SCHEMA,
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "version": version,
        **study.unit,
        "source": study.source,
        "azimuths": study.azimuths,
        "lat_deg": study.lat_rad / DEG,
        "level_earth_rate_deg_h": level_rate_deg_h(study.lat_rad),
        "noise_model": study.twin.source,
        "runs": [{"run_id": run.header.run_id, "sha256": run.sha256} for run in study.runs],
        "rank": {
            "rank": geometry.rank,
            "needed": 3,
            "condition": geometry.condition,
            "origin_deg": geometry.origin_deg,
            "missing_deg": list(geometry.missing_deg),
            "largest_off_deg": geometry.off_deg,
            "limit_off_deg": study.settings.max_off_deg,
        },
        "stops": _stops(study),
        "gyros": _gyros(study) if fit else {},
        "couplings": [_coupling(c) for c in result.couplings] if shown else [],
        "not_observable": _not_observable(study),
        "redundancy": {"chi2": fit.chi2, "dof": fit.dof, "limit_999": fit.band} if fit else None,
        "closed_forms": _closed_forms(study),
        "accelerometers": _accelerometers(study),
        "misalignment_mrad": dict(zip(ENTRIES, twin.gyro.misalignment_mrad)),
        "sigma_misalignment_mrad": {
            e: s or None for e, s in zip(ENTRIES, twin.gyro.sigma_misalignment_mrad)
        },
        "prior_mrad": study.settings.prior_mrad,
        "notes": list(study.notes),
    }


def _coupling(c: Coupling) -> dict[str, Any]:
    value = c.value_rad if np.isfinite(c.sigma_rad) else float("nan")
    return {
        "entry": c.name,
        "value_arcsec": value / ARCSEC,
        "sigma_arcsec": c.sigma_rad / ARCSEC,
        "value_mrad": value / MILLIRADIAN,
        "sigma_mrad": c.sigma_rad / MILLIRADIAN,
        "verdict": c.verdict,
    }


def _stops(study: AzimuthStudy) -> list[dict[str, Any]]:
    """One row a stop, the bias before and after compensation."""
    fit, rows = study.result.fit, []
    sigma = np.sqrt(np.diag(study.covariance)).reshape(-1, 3)
    m = len(study.heading_rad)
    # of a stop against the mean of all: without what they share
    apart = np.kron(np.eye(m) - 1.0 / max(m, 1), np.eye(3))
    scatter = np.sqrt(np.diag(apart @ study.covariance @ apart.T)).reshape(-1, 3) if m else sigma
    after = fit.compensated_deg_h() if fit else study.bias_deg_h
    for j, heading in enumerate(study.heading_rad):
        row: dict[str, Any] = {
            "heading_deg": float(heading / DEG),
            "north_to_west_deg": float(north_to_west_rad(heading) / DEG),
            "bias_deg_h": study.bias_deg_h[j].tolist(),
            "sigma_deg_h": sigma[j].tolist(),
            "sigma_apart_deg_h": scatter[j].tolist(),
            "compensated_deg_h": after[j].tolist(),
        }
        if study.stops:
            stop = study.stops[j]
            row |= {
                "run_id": study.runs[stop.run].header.run_id,
                "start_s": stop.start_s,
                "end_s": stop.end_s,
            }
            row["used_s"] = stop.used_s
        if study.temperature_degC is not None:
            row["temperature_degC"] = study.temperature_degC[j].tolist()
        rows.append(row)
    return rows


def _gyros(study: AzimuthStudy) -> dict[str, Any]:
    """k' and both harmonics of each gyro, and the spread over the azimuths before and after."""
    fit = study.result.fit
    assert fit is not None
    after = fit.compensated_deg_h()
    out = {}
    for k, axis in enumerate(AXES):
        (bias, sigma), cosine, sine = (fit.entry(k, column) for column in range(3))
        out[axis] = {
            "bias_deg_h": bias,
            "sigma_bias_deg_h": sigma,
            "cos_arcsec": cosine[0] / ARCSEC,
            "sigma_cos_arcsec": cosine[1] / ARCSEC,
            "sin_arcsec": sine[0] / ARCSEC,
            "sigma_sin_arcsec": sine[1] / ARCSEC,
            "spread_before_deg_h": float(np.ptp(fit.bias_deg_h[:, k])),
            "spread_after_deg_h": float(np.ptp(after[:, k])),
        }
    return out


def _not_observable(study: AzimuthStudy) -> list[dict[str, str]]:
    if study.result.fit is None:
        return []
    rows = [{"what": name, "why": WHY_VERTICAL} for name in NOT_AT_ONE_ATTITUDE]
    for c in study.result.couplings:
        if c.verdict == "not_observable":
            why = (
                WHY_WEAK
                if np.isfinite(c.sigma_rad)
                else WHY_DIAGONAL
                if c.name == "xy+yx"
                else WHY_NORTH
            )
            rows.append({"what": c.name, "why": why})
    if study.levels is None:
        rows.append({"what": "accelerometer x, y offsets", "why": study.why_no_levels})
    elif study.settings.sigma_mounting_arcsec is None:
        rows.append({"what": "accelerometer x, y biases alone", "why": WHY_MOUNTING})
    return rows


def _closed_forms(study: AzimuthStudy) -> dict[str, Any] | None:
    """(27), (28), (29) corrected, what the print of (29) gives, and the spread after (31) to (33);
    None where not to be had.
    """
    if study.result.fit is None:
        return None
    alpha, rate = north_to_west_rad(study.heading_rad), level_rate_deg_h(study.lat_rad)
    try:
        found = document_angles(alpha, study.bias_deg_h, study.covariance, level_rate_deg_h=rate)
    except InputError as error:
        return {"why_not": str(error)}
    after = document_compensation(alpha, study.bias_deg_h, found, level_rate_deg_h=rate)
    return {
        **{name: _angle(found, k) for k, name in enumerate(("exy", "eyx", "ezy"))},
        "ezy_as_printed_arcsec": found.literal_ezy_rad / ARCSEC,
        "spread_after_deg_h": dict(zip(AXES, np.ptp(after[list(found.stops)], axis=0).tolist())),
    }


def _angle(found: DocumentAngles, k: int) -> dict[str, float]:
    value = (found.exy_rad, found.eyx_rad, found.ezy_rad)[k]
    return {"value_arcsec": value / ARCSEC, "sigma_arcsec": found.sigma_rad[k] / ARCSEC}


def _accelerometers(study: AzimuthStudy) -> dict[str, Any] | None:
    """Offsets, and biases where the mounting is known."""
    levels, mounting = study.levels, study.settings.sigma_mounting_arcsec
    if levels is None:
        return None
    out: dict[str, Any] = {
        "offset_ug": levels.offset_ug.tolist(),
        "sigma_offset_ug": levels.sigma_ug.tolist(),
        "ground_tilt_arcsec": (levels.tilt_rad / ARCSEC).tolist(),
        "chi2": levels.chi2,
        "dof": levels.dof,
        "bias_ug": None,
        "sigma_bias_ug": None,
        "sigma_mounting_arcsec": mounting,
    }
    if mounting is not None:
        of_mounting = mounting * ARCSEC * STANDARD_GRAVITY / MICRO_G
        out |= {
            "bias_ug": out["offset_ug"],
            "sigma_bias_ug": np.hypot(levels.sigma_ug, of_mounting).tolist(),
        }
    return out
