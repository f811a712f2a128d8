"""The merge by measured points, beside which `infield.table.merge.merge_posterior` is held.

Source: physics.md 6.8; Joseph form: Bar-Shalom (2001), eq. (5.2.3-18).
"""

import numpy as np

from infield.table.merge import _judged, _whitener


def gain_of(table, points, extra_covariance):
    """Parameters per innovation, shape (n, m)."""
    H, P = points.H, table.covariance
    W = _whitener(H @ P @ H.T + points.covariance + np.asarray(extra_covariance, dtype=float))
    return P @ H.T @ W.T @ W


def merge_points(table, points, extra_covariance):
    """Merge measured points; `extra_covariance` (m, m) is `session_covariance` (and whatever else
    they share).
    """
    H, P = points.H, table.covariance
    R = points.covariance + np.asarray(extra_covariance, dtype=float)
    innovation = points.bias_deg_h - H @ table.parameters
    S = H @ P @ H.T + R
    W = _whitener(S)
    gain = P @ H.T @ W.T @ W
    left = np.eye(table.n_parameters) - gain @ H
    P_plus = left @ P @ left.T + gain @ R @ gain.T
    z = W @ innovation
    nis, dof = float(z @ z), z.size
    return _judged(table, (innovation, S), gain @ innovation, P_plus, nis=nis, dof=dof)
