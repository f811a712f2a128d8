"""Whether the parked stretches and what follows them tell one story of the found effects.

Where what follows is beyond every hypothesis, effects of the parked stretch can be bent to explain
some of it: two that cancel while parked, at a thousand times their usual size. Their coefficients,
fitted to the parked rows alone, then come out otherwise (effects.md, section 3.6).
"""

import numpy as np
from scipy.special import chdtri

from simreal.evidence.whitened import Evidence
from simreal.inference.bank import Bank
from simreal.inference.scoring import fit

CONTRADICTION = 1e-6  # of one story, such a difference; chosen: 1e-4 of --alpha (0.01)
# of the effects' own size in the parked rows; chosen: what the form of a warped effect is off by
# was up to 0.05, twice that
LEAST_DIFFERENCE = 0.1


def phases_contradict(bank: Bank, evidence: Evidence, columns: np.ndarray) -> bool:
    """Whether the parked rows want other coefficients of these columns than all rows do."""
    if not columns.size or not evidence.followed.any():
        return False
    beta, _ = fit(bank, columns)
    parked = ~evidence.followed
    A = np.stack([bank.signature(columns[k : k + 1], beta[k : k + 1]) for k in range(beta.size)])
    A = A[:, parked].T
    length = np.linalg.norm(A, axis=0)
    A = A[:, length > 0.0] / length[length > 0.0]
    if not A.size:
        return False
    made, left = A @ length[length > 0.0], evidence.z[parked] - A @ length[length > 0.0]
    change, _, rank, _ = np.linalg.lstsq(A, left, rcond=1e-8)
    moved = float(np.sum((A @ change) ** 2))
    beyond = moved > float(chdtri(max(int(rank), 1), CONTRADICTION))
    return bool(beyond and moved > LEAST_DIFFERENCE**2 * float(made @ made))
