"""How well one effect is told from another in a set of runs: from Gram matrices of whitened
signatures (effects.md, section 3.9).

An effect of size Delta (norm of its whitened signature) is told from a rival, which adapts its
shape and coefficients as well as it can, by what is left of it::

    Delta^2 (1 - cos^2) / 2 >= ln 19 nats   (95 % odds),

cos: between the signature and its projection on the rival's columns. Runs are independent, so their
Gram matrices add.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ins.documents import written
from ins.errors.base import Effect
from ins.errors.telemetry import Telemetry
from ins.records import InputError, TwinModel
from simreal.evidence.run_view import RunView
from simreal.evidence.whitened import Evidence
from simreal.inference.bank import Bank, Group, shapes_of

ODDS_NATS = float(np.log(19.0))  # 95 % against 5 %
# size that the diagnosis calls found in the mean: log odds of 5 nats (see `plan.seen_sizes`)
SEEN_DELTA = 4.0
LEAST_LEFT = 1e-6  # of a squared signature; nearer than that is the same
GRAM_ROUNDING = 1e-6  # of the bank's Gram matrix, which is summed in single precision
# a signature that the rival's columns hold whole; 0.3 % of its length is beside them
SAME_COS2 = 1.0 - 1e-5
# squared size of an effect that leaves no trace: a millionth of a sigma, 1e-6^2
NO_SIGNATURE_SQUARE = 1e-12


@written("effect=effect.name target")
@dataclass(frozen=True)
class Contender:
    """An effect on a target; `shapes`: grid points to look at, None: all of its grid."""

    effect: Effect
    target: str
    shapes: tuple[tuple[tuple[str, float], ...], ...] | None = None

    @property
    def key(self) -> tuple[str, str]:
        return self.effect.id, self.target

    @property
    def label(self) -> str:
        return f"{self.effect.name} on {self.target}"

    @property
    def reach(self) -> NDArray:
        """Upper end of the usual size over its geometric mean, one a coefficient."""
        return np.array([np.sqrt(c.high / c.low) for c in self.effect.coefficients])

    def grid(self, run: Telemetry) -> list[dict[str, float]]:
        if self.shapes is not None:
            return [dict(shape) for shape in self.shapes]
        return shapes_of(self.effect, run if self.effect.repeats == "E" else None)


class _OpenBank(Bank):
    """The columns of all contenders in one run, whatever that run alone lacks; what it has no
    temperature for is left out.
    """

    def __init__(self, evidence: Evidence, contenders: Sequence[Contender]) -> None:
        self._wanted = {e.key: e for e in contenders}
        self.found: dict[tuple[str, str], list[Group]] = {}
        super().__init__(
            evidence, list({e.effect.id: e.effect for e in contenders}.values()), with_generic=False
        )

    def _add_effect(self, effect: Effect, target: str) -> None:
        contender = self._wanted.get((effect.id, target))
        if contender is not None:
            try:
                self.found[contender.key] = [
                    self.new_group(effect, target, shape, None)
                    for shape in contender.grid(self.telemetry[0])
                ]
            except InputError:
                return


class RunGrams:
    """Gram matrix of all contenders in one run, in units of the geometric mean of their usual
    sizes.
    """

    def __init__(self, view: RunView, twin: TwinModel, contenders: Sequence[Contender]) -> None:
        self._of(Evidence([view], twin), contenders)

    @classmethod
    def of_evidence(cls, evidence: Evidence, contenders: Sequence[Contender]) -> "RunGrams":
        """Of a run that is whitened already."""
        made = cls.__new__(cls)
        made._of(evidence, contenders)
        return made

    def _of(self, evidence: Evidence, contenders: Sequence[Contender]) -> None:
        (self.view,) = evidence.views
        self.telemetry = self.view.telemetry
        bank = _OpenBank(evidence, contenders)
        # (shapes, p)
        self.columns = {
            key: np.stack([g.columns for g in groups]) for key, groups in bank.found.items()
        }
        self.usual = {key: groups[0].scale for key, groups in bank.found.items()}
        scale = np.concatenate(
            [np.zeros(0), *(g.scale for groups in bank.found.values() for g in groups)]
        )
        self.gram = bank.gram * np.outer(scale, scale)
        # asked for again and again while sets of recordings are compared
        self._products: dict[tuple[tuple[str, str], ...], NDArray] = {}

    def block(self, h: Contender, k: Contender) -> NDArray:
        """Products (shapes of h, shapes of k, p, q) of two contenders' columns."""
        if (h.key, k.key) not in self._products:
            a, b = self.columns[h.key], self.columns[k.key]
            self._products[h.key, k.key] = self.gram[a[:, None, :, None], b[None, :, None, :]]
        return self._products[h.key, k.key]

    def own(self, h: Contender) -> NDArray:
        """Products (shapes, p, p) of each shape's columns with each other."""
        if (h.key,) not in self._products:
            a = self.columns[h.key]
            self._products[h.key,] = self.gram[a[:, :, None], a[:, None, :]]
        return self._products[h.key,]


@dataclass(frozen=True)
class PairSeparation:
    """A true effect against a rival, for each shape v the true one may have (an event: in each run
    that may hold it).

    cos (v,): with the rival's best match. delta, delta_low, delta_high (v,): size at the geometric
    mean and at both ends of the usual range.
    """

    cos: NDArray
    delta: NDArray
    delta_low: NDArray
    delta_high: NDArray

    @cached_property
    def delta_needed(self) -> NDArray:
        """Size (v,) from which it is told apart at 95 % odds."""
        return np.sqrt(2.0 * ODDS_NATS / np.maximum(1.0 - self.cos**2, LEAST_LEFT))

    @cached_property
    def margin(self) -> float:
        """Size at the geometric mean of the usual range over the size needed to be seen and told:
        median over the shapes.
        """
        return float(np.median(self.delta / np.maximum(self.delta_needed, SEEN_DELTA)))

    @cached_property
    def margin_high(self) -> float:
        """The same at the upper end of the usual range."""
        return float(np.median(self.delta_high / np.maximum(self.delta_needed, SEEN_DELTA)))


def separation(runs: Sequence[RunGrams], h: Contender, k: Contender) -> PairSeparation:
    """How well the true effect h is told from k in a set of runs; both must leave traces in all of
    them.
    """
    events = [e.effect.repeats == "E" for e in (h, k)]
    if not any(events):
        blocks = [[_together(runs, h, k)]]
    elif all(events):  # an event stands against events of its own run
        blocks = [[_together([run], h, k)] for run in runs]
    elif events[0]:
        blocks = [[_with_event(runs, r, h, k, of=0)] for r in range(len(runs))]
    else:
        blocks = [[_with_event(runs, r, h, k, of=1) for r in range(len(runs))]]
    out = [_against(h, row) for row in blocks]
    return PairSeparation(*(np.concatenate([part[i] for part in out]) for i in range(4)))


Matrices = tuple[NDArray, NDArray, NDArray]  # H (s, p, p), K (t, q, q), X (s, t, p, q)


def _together(runs: Sequence[RunGrams], h: Contender, k: Contender) -> Matrices:
    """Over all runs: products add where a coefficient is common to the runs, and stand apart where
    each has its own.
    """
    H, K = (_joined([run.own(e) for run in runs], e) for e in (h, k))
    apart_h, apart_k = (e.effect.repeats == "P" for e in (h, k))
    X = np.stack([run.block(h, k) for run in runs])  # (runs, s, t, p, q)
    n, s, t, p, q = X.shape
    if apart_h and apart_k:
        out = np.zeros((s, t, n, p, n, q))
        for r in range(n):
            out[:, :, r, :, r, :] = X[r]
        return H, K, out.reshape(s, t, n * p, n * q)
    if apart_h:
        return H, K, np.moveaxis(X, 0, 2).reshape(s, t, n * p, q)
    if apart_k:
        return H, K, np.moveaxis(X, 0, 3).reshape(s, t, p, n * q)
    return H, K, X.sum(axis=0)


def _joined(own: list[NDArray], e: Contender) -> NDArray:
    if e.effect.repeats != "P":
        return np.sum(own, axis=0)
    n, (s, p, _) = len(own), own[0].shape
    out = np.zeros((s, n, p, n, p))
    for r, block in enumerate(own):
        out[:, r, :, r, :] = block
    return out.reshape(s, n * p, n * p)


def _with_event(
    runs: Sequence[RunGrams], r: int, h: Contender, k: Contender, *, of: int
) -> Matrices:
    """One of the two (0: h, 1: k) happens in run r only, the other in all."""
    mine = runs[r]
    other = k if of == 0 else h
    rest = _joined([run.own(other) for run in runs], other)
    X = mine.block(h, k)
    if other.effect.repeats == "P":  # its coefficient of run r alone meets the event
        s, t, p, q = X.shape
        wide = np.zeros((s, t, p, len(runs), q) if of == 0 else (s, t, len(runs), p, q))
        if of == 0:
            wide[:, :, :, r, :] = X
        else:
            wide[:, :, r, :, :] = X
        X = wide.reshape(s, t, p if of == 0 else -1, -1 if of == 0 else q)
    return (mine.own(h), rest, X) if of == 0 else (rest, mine.own(k), X)


def _against(h: Contender, rivals: list[Matrices]) -> tuple[NDArray, ...]:
    """cos, delta, delta_low, delta_high (s,) of h against its best rival; mean over the directions
    of its coefficients.
    """
    H = rivals[0][0]
    whole = np.einsum("spp->s", H)
    share = np.zeros(whole.size)
    for _, K, X in rivals:
        inverse = _inverse(K)
        explained = np.einsum("stpq,tqr,stpr->st", X, inverse, X)
        share = np.maximum(
            share, (explained / np.maximum(whole, NO_SIGNATURE_SQUARE)[:, None]).max(axis=1)
        )
    share = np.where(whole > NO_SIGNATURE_SQUARE, np.clip(share, 0.0, 1.0), 1.0)
    reach = np.resize(h.reach, H.shape[1]) ** 2
    squares = [whole, *(np.einsum("spp,p->s", H, factor) for factor in (1.0 / reach, reach))]
    return np.sqrt(share), *(np.sqrt(np.maximum(square, 0.0)) for square in squares)


def _inverse(K: NDArray) -> NDArray:
    """Inverses (t, q, q) where there is one, of what is there elsewhere."""
    size = np.sqrt(np.maximum(np.einsum("tqq->tq", K), 1e-300))
    unit = K / (size[:, :, None] * size[:, None, :])
    return np.linalg.pinv(unit, rcond=GRAM_ROUNDING, hermitian=True) / (
        size[:, :, None] * size[:, None, :]
    )
