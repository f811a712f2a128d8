"""Bayes factors of single effects, in closed form, given what has been selected already
(effects.md, section 3.4)::

    log BF = log mean_v sum_i [ y_i^2 w_i / (2 (1 + w_i)) - ln(1 + w_i) / 2 ]
    w_i = v lambda_i / lambda_max

y_i: products of the data with the effect's principal signatures, orthogonal to the selected
effects, unit length; lambda_i: their squared lengths in units of the catalogue's typical
coefficients; v: squared size, mixed over `bank.SIZES`. A hypothesis averages over its grid of
shapes, so that freedom costs what it should. Coefficients of a declared size, a table's error, have
w_i = lambda_i in place of the mixture.

Source: single-effect regression of Wang, Sarkar, Carbonetto and Stephens (2020), J. R. Stat. Soc. B
82, 1273; the mixture over sizes as in Wakefield (2009), Genet. Epidemiol. 33, 79.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simreal.inference.bank import SIZES, Bank, Group, Hypothesis, size_weights

# squared length left after projection, of the whole: below, an effect is one of the selected ones;
# 1 % of its length
ALIKE = 1e-4
# squared length in usual sizes below which an effect leaves no trace at all in these runs: a
# thousandth of a sigma, 1e-3^2
NO_TRACE_SQUARE = 1e-6
GENERIC_RANGE = (0.03, 30.0)  # of a free function's coefficients, in turn-on sigmas


class Scorer:
    """Log Bayes factors of a bank's groups and hypotheses, for the data or for many replicates at
    once.
    """

    def __init__(self, bank: Bank, hypotheses: Sequence[Hypothesis] | None = None) -> None:
        self.bank = bank
        self.hypotheses = list(bank.hypotheses if hypotheses is None else hypotheses)
        self.groups: list[Group] = []
        self.owner: list[int] = []
        alike: dict[tuple[int, bool], list[int]] = {}
        for number, hypothesis in enumerate(self.hypotheses):
            for group in hypothesis.groups:
                alike.setdefault((group.columns.size, group.precision > 0.0), []).append(
                    len(self.groups)
                )
                self.groups.append(group)
                self.owner.append(number)
        self._batches = [_Batch.of(self, np.array(numbers)) for numbers in alike.values()]
        self._owner = np.array(self.owner, dtype=int)
        self._log_prior = np.array([h.log_prior for h in self.hypotheses])
        self._weight = np.array([g.log_weight for g in self.groups])

    def groups_log_bf(self, selected: NDArray, score: NDArray) -> NDArray:
        """Log Bayes factor of each group (groups, reps) given selected columns; score (m, reps)."""
        left = Conditioned(self.bank.gram, score, selected)
        out = np.zeros((len(self.groups), score.shape[1]))
        for batch in self._batches:
            out[batch.numbers] = batch.log_bf(self.bank.gram, left)
        return out

    def log_posterior(self, selected: NDArray, score: NDArray) -> tuple[NDArray, NDArray]:
        """Unnormalised log posterior of each hypothesis (h, reps) and the groups' log Bayes
        factors.
        """
        groups = self.groups_log_bf(selected, score)
        out = np.full((len(self.hypotheses), score.shape[1]), -np.inf)
        have, first = np.unique(self._owner, return_index=True)
        if have.size:
            weighted = groups + self._weight[:, None]
            out[have] = np.logaddexp.reduceat(weighted, first, axis=0)
        return out + self._log_prior[:, None], groups

    def groups_of(self, hypothesis: int) -> NDArray:
        """Numbers of a hypothesis's groups."""
        return np.flatnonzero(self._owner == hypothesis)


@dataclass(frozen=True)
class _Batch:
    """Groups of as many columns (n, p), with their typical coefficients, the precision before any
    data (n,), and the usual sizes in typical coefficients (n, 1).
    """

    numbers: NDArray
    columns: NDArray
    scale: NDArray
    precision: NDArray
    low: NDArray
    high: NDArray

    @classmethod
    def of(cls, scorer: Scorer, numbers: NDArray) -> "_Batch":
        groups = [scorer.groups[k] for k in numbers]
        usual = np.array([usual_range(scorer.hypotheses[scorer.owner[k]]) for k in numbers])
        return cls(
            numbers,
            np.stack([g.columns for g in groups]),
            np.stack([g.scale for g in groups]),
            np.array([g.precision for g in groups]),
            usual[:, :1],
            usual[:, 1:],
        )

    def log_bf(self, gram: NDArray, left: "Conditioned") -> NDArray:
        """Log Bayes factors (n, reps)."""
        c, scale = self.columns, self.scale
        before = ((gram[c, c] - self.precision[:, None]) * scale**2).max(axis=1)
        data = left.gram_of_each(c) - self.precision[:, None, None] * np.eye(c.shape[1])
        values, vectors = np.linalg.eigh(data * scale[:, :, None] * scale[:, None, :])
        values = np.maximum(values, 0.0)
        projected = np.swapaxes(vectors, 1, 2) @ (left.score[c] * scale[:, :, None])
        top = values.max(axis=1, keepdims=True)
        share = values / np.maximum(top, 1e-300)
        live = share > 1e-8
        y2 = np.where(live[:, :, None], projected**2 / np.maximum(values, 1e-300)[:, :, None], 0.0)
        sizes, weights = self._sizes(top)
        w = sizes[:, :, None] * np.where(live, share, 0.0)[:, None, :]  # (n, V, p)
        fit = 0.5 * (w / (1.0 + w)) @ y2 - 0.5 * np.log1p(w).sum(axis=2, keepdims=True)
        out = np.logaddexp.reduce(fit + weights[:, :, None], axis=1)
        seen = (top[:, 0] >= ALIKE * before) & (np.minimum(top[:, 0], before) >= NO_TRACE_SQUARE)
        return np.where(seen[:, None], out, 0.0)

    def _sizes(self, top: NDArray) -> tuple[NDArray, NDArray]:
        """Squared sizes of the largest principal signatures (n, V) and their log weights; top (n,
        1): its squared length in typical coefficients.
        """
        if self.precision[0]:
            return top / self.precision[:, None], np.zeros_like(top)
        sizes = np.broadcast_to(SIZES, (len(top), SIZES.size))
        return sizes, size_weights(np.sqrt(top), self.low, self.high)


def usual_range(hypothesis: Hypothesis) -> tuple[float, float]:
    """Usual sizes in units of the typical coefficient."""
    if hypothesis.effect is None:
        return GENERIC_RANGE
    ratio = max(np.sqrt(c.high / c.low) for c in hypothesis.effect.coefficients)
    return float(1.0 / ratio), float(ratio)


class Conditioned:
    """Gram matrix and products with the selected columns projected out (their coefficients are
    free, or as free as the precision in their Gram matrix lets them).
    """

    def __init__(self, gram: NDArray, score: NDArray, selected: NDArray) -> None:
        self._gram, self._selected = gram, selected
        self.score = score
        if selected.size:
            self._gain = gram[:, selected] @ _inverse(gram[np.ix_(selected, selected)])
            self.score = score - self._gain @ score[selected]

    def gram_of(self, rows: NDArray, columns: NDArray | None = None) -> NDArray:
        """The block of these rows and columns, of the same number for both where one is given."""
        columns = rows if columns is None else columns
        block = self._gram[np.ix_(rows, columns)]
        if not self._selected.size:
            return block
        return block - self._gain[rows] @ self._gram[np.ix_(self._selected, columns)]

    def gram_of_each(self, rows: NDArray) -> NDArray:
        """The blocks (n, p, p) of several sets of rows (n, p)."""
        blocks = self._gram[rows[:, :, None], rows[:, None, :]]
        if not self._selected.size:
            return blocks
        across = self._gram[self._selected[:, None], rows[:, None, :]]
        return blocks - self._gain[rows] @ across


def _inverse(S: NDArray) -> NDArray:
    """Pseudo-inverse of a Gram matrix, scaled first; a signature without any trace keeps the
    coefficient 0.
    """
    diagonal = np.diag(S)
    seen = diagonal > 1e-24 * diagonal.max(initial=1e-300)
    scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, diagonal, 1.0)), 0.0)
    return np.asarray(
        np.linalg.pinv(S * np.outer(scale, scale), rcond=1e-10, hermitian=True)
        * np.outer(scale, scale)
    )


def fit(bank: Bank, selected: NDArray) -> tuple[NDArray, NDArray]:
    """Least-squares coefficients of selected columns and their covariance."""
    inverse = _inverse(bank.gram[np.ix_(selected, selected)])
    return inverse @ bank.score[selected], inverse
