"""misalignment.json (`recal.misalignment/1`): the study in units of the border. Computes nothing
but units.

Every angle stands in arcsec and mrad; what was not observed is null with its sigma, and named in
`not_observable`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from infield.misalignment.closed_forms import document_angles, document_compensation
from infield.misalignment.couplings import NOT_AT_ONE_ATTITUDE, CouplingEstimate
from infield.misalignment.geometry import Geometry
from infield.misalignment.harmonic_fit import AzimuthFit, level_rate_deg_h, north_to_west_rad
from infield.misalignment.reasons import MisalignmentVerdict, Unseen
from infield.misalignment.study import ENTRIES, AzimuthStudy, LevelOffsets, corrected_twin
from infield.reports.documents.update_records import RunDocument
from ins.documents import OMIT_NONE, MadeOf, made
from ins.records import AXES, InputError
from ins.units import ARCSEC, DEG
from ins.verdicts import Observability, Reason, because, codes, sentence, sentences

SCHEMA = "recal.misalignment/1"
of = MadeOf[AzimuthStudy]()
of_fit = MadeOf[AzimuthFit]()


@dataclass(frozen=True, kw_only=True)
class AzimuthStopDocument:
    """One stop, its bias before and after compensation; the times of a run's stop alone."""

    heading_deg: float
    north_to_west_deg: float
    bias_deg_h: Sequence[float]
    sigma_deg_h: Sequence[float]
    sigma_apart_deg_h: Sequence[float]
    compensated_deg_h: Sequence[float]
    run_id: str | None = field(default=None, metadata=OMIT_NONE)
    start_s: float | None = field(default=None, metadata=OMIT_NONE)
    end_s: float | None = field(default=None, metadata=OMIT_NONE)
    used_s: float | None = field(default=None, metadata=OMIT_NONE)
    temperature_degC: Sequence[float] | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True, kw_only=True)
class GyroDocument:
    """k' and both harmonics of a gyro, and its spread over the azimuths before and after."""

    bias_deg_h: float
    sigma_bias_deg_h: float
    cos_arcsec: float
    sigma_cos_arcsec: float
    sin_arcsec: float
    sigma_sin_arcsec: float
    spread_before_deg_h: float
    spread_after_deg_h: float


@dataclass(frozen=True, kw_only=True)
class UnseenDocument:
    """What is not observable, and why."""

    what: str
    why: str
    why_code: str


@dataclass(frozen=True, kw_only=True)
class RedundancyDocument:
    """Whether the azimuths agree."""

    chi2: float = of_fit(lambda fit: fit.chi2)
    dof: int = of_fit(lambda fit: fit.dof)
    limit_999: float = of_fit(lambda fit: fit.band)


@dataclass(frozen=True, kw_only=True)
class AngleDocument:
    """One angle of the closed forms."""

    value_arcsec: float
    sigma_arcsec: float


@dataclass(frozen=True, kw_only=True)
class ClosedFormsDocument:
    """(27), (28), (29) corrected, what the print of (29) gives, the spread after (31) to (33)."""

    exy: AngleDocument
    eyx: AngleDocument
    ezy: AngleDocument
    ezy_as_printed_arcsec: float
    spread_after_deg_h: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class NoClosedFormsDocument:
    """Why there are none."""

    why_not: str


@dataclass(frozen=True, kw_only=True)
class MisalignmentDocument:
    """misalignment.json."""

    schema: str = SCHEMA
    verdict: MisalignmentVerdict = of(lambda study: study.result.verdict)
    reasons: Sequence[str] = of(lambda study: sentences(study.result.reasons))
    reason_codes: Sequence[str | None] = of(lambda study: codes(study.result.reasons))
    version: str
    imu_serial: str = of(lambda study: study.unit["imu_serial"])
    gyro_technology: str = of(lambda study: study.unit["gyro_technology"])
    source: str = of(lambda study: study.source)
    azimuths: str = of(lambda study: sentence(study.azimuths))
    azimuths_code: str = of(lambda study: study.azimuths.code.value)
    lat_deg: float = of(lambda study: study.lat_rad / DEG)
    level_earth_rate_deg_h: float = of(lambda study: level_rate_deg_h(study.lat_rad))
    noise_model: str = of(lambda study: study.twin.source)
    runs: Sequence[RunDocument] = of(lambda study: [made(RunDocument, run) for run in study.runs])
    rank: Geometry = of(lambda study: study.result.geometry)
    stops: Sequence[AzimuthStopDocument] = of(lambda study: _stops(study))
    gyros: Mapping[str, GyroDocument]
    couplings: Sequence[CouplingEstimate]
    not_observable: Sequence[UnseenDocument] = of(lambda study: _not_observable(study))
    redundancy: RedundancyDocument | None
    closed_forms: ClosedFormsDocument | NoClosedFormsDocument | None = of(
        lambda study: _closed_forms(study)
    )
    accelerometers: LevelOffsets | None = of(lambda study: study.levels)
    misalignment_mrad: Mapping[str, float]
    sigma_misalignment_mrad: Mapping[str, float | None]
    prior_mrad: float = of(lambda study: study.settings.prior_mrad)
    notes: Sequence[str] = of(lambda study: sentences(_notes(study)))
    note_codes: Sequence[str | None] = of(lambda study: codes(_notes(study)))


def misalignment_document(study: AzimuthStudy, *, version: str) -> MisalignmentDocument:
    """The document of a study."""
    result, fit, gyro = study.result, study.result.fit, corrected_twin(study).gyro
    shown = result.verdict is not MisalignmentVerdict.REFUSED or fit is not None
    sigmas = zip(ENTRIES, gyro.sigma_misalignment_mrad)
    return made(
        MisalignmentDocument,
        study,
        version=version,
        gyros={} if fit is None else _gyros(fit),
        couplings=list(result.couplings) if shown else [],
        redundancy=None if fit is None else made(RedundancyDocument, fit),
        misalignment_mrad=dict(zip(ENTRIES, gyro.misalignment_mrad)),
        sigma_misalignment_mrad={entry: sigma or None for entry, sigma in sigmas},
    )


def _notes(study: AzimuthStudy) -> list[Reason]:
    """What no reason says."""
    return [note for note in study.notes if note not in study.result.reasons]


def _stops(study: AzimuthStudy) -> list[AzimuthStopDocument]:
    """One row a stop."""
    fit = study.result.fit
    sigma = np.sqrt(np.diag(study.covariance)).reshape(-1, 3)
    scatter = _sigma_apart(study, sigma)
    after = fit.compensated_deg_h() if fit else study.bias_deg_h
    rows = []
    for j, heading in enumerate(study.heading_rad):
        stop = study.stops[j] if study.stops else None
        T = None if study.temperature_degC is None else study.temperature_degC[j]
        rows.append(
            AzimuthStopDocument(
                heading_deg=float(heading / DEG),
                north_to_west_deg=float(north_to_west_rad(heading) / DEG),
                bias_deg_h=study.bias_deg_h[j].tolist(),
                sigma_deg_h=sigma[j].tolist(),
                sigma_apart_deg_h=scatter[j].tolist(),
                compensated_deg_h=after[j].tolist(),
                run_id=None if stop is None else study.runs[stop.run].header.run_id,
                start_s=None if stop is None else stop.start_s,
                end_s=None if stop is None else stop.end_s,
                used_s=None if stop is None else stop.used_s,
                temperature_degC=T,
            )
        )
    return rows


def _sigma_apart(study: AzimuthStudy, sigma: NDArray) -> NDArray:
    """Sigmas (m, 3) of each stop against the mean of all: without what they share."""
    m = len(study.heading_rad)
    if not m:
        return sigma
    apart = np.kron(np.eye(m) - 1.0 / m, np.eye(3))
    return np.asarray(np.sqrt(np.diag(apart @ study.covariance @ apart.T)).reshape(-1, 3))


def _gyros(fit: AzimuthFit) -> dict[str, GyroDocument]:
    after = fit.compensated_deg_h()
    found = {}
    for k, axis in enumerate(AXES):
        (bias, sigma), cosine, sine = (fit.entry(k, column) for column in range(3))
        found[axis] = GyroDocument(
            bias_deg_h=bias,
            sigma_bias_deg_h=sigma,
            cos_arcsec=cosine[0] / ARCSEC,
            sigma_cos_arcsec=cosine[1] / ARCSEC,
            sin_arcsec=sine[0] / ARCSEC,
            sigma_sin_arcsec=sine[1] / ARCSEC,
            spread_before_deg_h=float(np.ptp(fit.bias_deg_h[:, k])),
            spread_after_deg_h=float(np.ptp(after[:, k])),
        )
    return found


def _not_observable(study: AzimuthStudy) -> list[UnseenDocument]:
    if study.result.fit is None:
        return []
    rows = [(name, because(Unseen.VERTICAL)) for name in NOT_AT_ONE_ATTITUDE]
    rows += [
        (c.entry, because(_why_unseen(c)))
        for c in study.result.couplings
        if c.verdict is Observability.NOT_OBSERVABLE
    ]
    if study.why_no_levels is not None:
        rows.append(("accelerometer x, y offsets", study.why_no_levels))
    elif study.settings.sigma_mounting_arcsec is None:
        rows.append(("accelerometer x, y biases alone", because(Unseen.MOUNTING)))
    return [
        UnseenDocument(what=what, why=sentence(why), why_code=why.code.value) for what, why in rows
    ]


def _why_unseen(c: CouplingEstimate) -> Unseen:
    if np.isfinite(c.sigma_rad):
        return Unseen.WEAK
    return Unseen.DIAGONAL if c.entry == "xy+yx" else Unseen.NORTH


def _closed_forms(study: AzimuthStudy) -> ClosedFormsDocument | NoClosedFormsDocument | None:
    """None where nothing was fitted."""
    if study.result.fit is None:
        return None
    alpha, rate = north_to_west_rad(study.heading_rad), level_rate_deg_h(study.lat_rad)
    try:
        found = document_angles(alpha, study.bias_deg_h, study.covariance, level_rate_deg_h=rate)
    except InputError as error:
        return NoClosedFormsDocument(why_not=str(error))
    after = document_compensation(alpha, study.bias_deg_h, found, level_rate_deg_h=rate)
    exy, eyx, ezy = (
        AngleDocument(value_arcsec=value / ARCSEC, sigma_arcsec=sigma / ARCSEC)
        for value, sigma in zip((found.exy_rad, found.eyx_rad, found.ezy_rad), found.sigma_rad)
    )
    return ClosedFormsDocument(
        exy=exy,
        eyx=eyx,
        ezy=ezy,
        ezy_as_printed_arcsec=found.literal_ezy_rad / ARCSEC,
        spread_after_deg_h=dict(zip(AXES, np.ptp(after[list(found.stops)], axis=0).tolist())),
    )
