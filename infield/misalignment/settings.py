"""What a study of azimuths is done with."""

from dataclasses import dataclass

from ins.errors.catalogue import prior

MAX_OFF_DEG = 2.0  # of an azimuth from its nominal place (requirements R21)
# a stop below this says less than the flicker of the gyro: ARW / sqrt(t) alone is 0.007 deg/h
SHORTEST_STOP_S = 300.0
# of the error that all given headings share, 1 sigma: docs/reference/formats.md section 6
SIGMA_HEADING_DEG = 0.1


@dataclass(frozen=True, kw_only=True)
class AzimuthSettings:
    """max_off_deg: how far an azimuth may be off its place; prior_mrad: what a coupling may be
    before the measurement; sigma_mounting_arcsec: of the unit's base against the axis that it is
    turned about, None: not known; sigma_heading_deg: of the error that all given headings share.
    """

    shortest_s: float = SHORTEST_STOP_S
    max_off_deg: float = MAX_OFF_DEG
    prior_mrad: float = prior("gyro_misalignment_x", "azimuths").size
    sigma_mounting_arcsec: float | None = None
    sigma_heading_deg: float = SIGMA_HEADING_DEG
