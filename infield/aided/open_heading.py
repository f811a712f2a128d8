"""The solution of a log that shows no heading: flights from headings all round through all of it,
made one.

A heading that nothing shows is a state of knowledge and no reason to refuse: positions and
velocities are as good as the fixes, and the heading's sigma says what it is worth, until
manoeuvres come. Each flight is linear about its own heading; at each time they are weighed by the
likelihood of the innovations up to then (a Gaussian sum filter, Sorenson and Alspach, Automatica 7,
1971), with logarithms divided by how far the innovations are from white, as in
`infield.aided.headings`. Mean and second moments of the mixture are put out: a heading of
which nothing is known has a sigma of 104 deg (pi / sqrt(3)).

Decision: docs/decisions/0060-unknown-heading.md.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from infield.aided.headings import colour_of, fix_logliks
from ins.attitude import rotation_vector_from_dcm
from ins.earth import dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.filters.aided_records import AidedHistory
from ins.filters.states import AIDED_ACCEL, AIDED_GYRO, AIDED_POS, AIDED_THETA, AIDED_VEL

# second singular value of the weighed mean of C_nb, above which there is a mean attitude: headings
# that spread by more than 60 deg have less (cos 60 deg), and the likeliest flight's is put out
MEAN_EXISTS = 0.5
# cosine of a turn below which the axis is taken from C + 1, 8 deg from half a turn: there the
# other formula still has 12 digits, here C + 1 is along the axis to 0.5 % (1 - cos 8 deg / 2)
NEARLY_OPPOSITE = -0.99


def causal_weights(histories: list[AidedHistory]) -> NDArray:
    """Weight (k, flights) of each flight at each row, by the fixes up to then."""
    logliks = np.stack([np.cumsum(fix_logliks(h)) for h in histories], axis=1)
    best = histories[int(np.argmax(logliks[-1]))]
    logliks = np.vstack([np.zeros(len(histories)), logliks / colour_of(best)])
    rows = np.searchsorted(best.fix_time_s, best.time_s + 1e-6, side="right")
    at = logliks[rows]
    weights = np.exp(at - at.max(axis=1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def mixed(histories: list[AidedHistory], weights: NDArray) -> AidedHistory:
    """Mean and second moments of the flights by weight (k, flights); what became of the fixes is
    the likeliest flight's.
    """
    best = histories[int(np.argmax(weights[-1]))]
    r_e = np.stack(
        [ecef_from_geodetic(h.lat_rad, h.lon_rad, h.height_m) for h in histories], axis=1
    )
    C_en = dcm_en(best.lat_rad, best.lon_rad)
    mean_r = _mean(r_e, weights)
    lat, lon, height = geodetic_from_ecef(mean_r)
    v_n = np.stack([h.v_n_m_s for h in histories], axis=1)
    gyro = np.stack([h.gyro_bias_rad_s for h in histories], axis=1)
    accel = np.stack([h.accel_bias_m_s2 for h in histories], axis=1)
    C_nb = np.stack([h.C_nb for h in histories], axis=1)
    mean_C = _mean_attitude(C_nb, weights)
    means = {name: _mean(x, weights) for name, x in (("v", v_n), ("g", gyro), ("a", accel))}
    off = np.zeros((*weights.shape, 15))
    off[..., AIDED_POS] = np.einsum("kji,kfj->kfi", C_en, r_e - mean_r[:, None])
    off[..., AIDED_VEL] = v_n - means["v"][:, None]
    turned = C_nb @ np.swapaxes(mean_C, 1, 2)[:, None]
    turn = _turns(turned)
    off[..., AIDED_THETA] = turn
    off[..., AIDED_GYRO] = gyro - means["g"][:, None]
    off[..., AIDED_ACCEL] = accel - means["a"][:, None]
    within = np.stack([h.variance for h in histories], axis=1)
    phi = np.stack([h.phi_covariance for h in histories], axis=1)
    spread = phi + turn[..., :, None] * turn[..., None, :]
    return replace(
        best,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        v_n_m_s=means["v"],
        C_nb=mean_C,
        gyro_bias_rad_s=means["g"],
        accel_bias_m_s2=means["a"],
        variance=_mean(within + off**2, weights),
        phi_covariance=np.einsum("kf,kfij->kij", weights, spread),
    )


def _turns(C: NDArray) -> NDArray:
    """Rotation vectors (k, flights, 3) of up to half a turn, which opposite headings are apart.

    Close to it the axis is that of C + 1, whose columns are all along it; its sign is of no
    matter to second moments.
    """
    flat = C.reshape(-1, 3, 3)
    found = rotation_vector_from_dcm(flat)
    cosine = 0.5 * (np.trace(flat, axis1=1, axis2=2) - 1.0)
    for k in np.flatnonzero(cosine < NEARLY_OPPOSITE):
        along = flat[k] + np.eye(3)
        axis = along[:, int(np.argmax(np.linalg.norm(along, axis=0)))]
        found[k] = np.arccos(max(cosine[k], -1.0)) * axis / np.linalg.norm(axis)
    return np.asarray(found.reshape(C.shape[:-1]))


def _mean(values: NDArray, weights: NDArray) -> NDArray:
    """Mean (k, n) of values (k, flights, n)."""
    return np.asarray(np.einsum("kf,kfi->ki", weights, values))


def _mean_attitude(C_nb: NDArray, weights: NDArray) -> NDArray:
    """The mean attitude (k, 3, 3), the likeliest flight's where there is none."""
    U, size, Vt = np.linalg.svd(np.einsum("kf,kfij->kij", weights, C_nb))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    likeliest = C_nb[np.arange(len(weights)), np.argmax(weights, axis=1)]
    return np.asarray(np.where((size[:, 1] > MEAN_EXISTS)[:, None, None], U @ Vt, likeliest))
