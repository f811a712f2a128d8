"""The ceiling of the gap study: how often can anyone name the planted effect?

The linear-Gaussian cell: whitened rows are a planted effect of 3, 5, 8 or 12 sigma plus unit white
noise. The effect is drawn by the priors of the catalogue: of an effect and its target, of a
grid point of its shape, and of its size (`simreal.inference.bank.size_weights`); the direction of
its coefficients is even in whitened rows.

- The oracle knows all of that, and the size in sigmas: it scores each hypothesis by its exact
  likelihood. No answer can be right more often.
- The diagnosis is given the same rows: its own Bayes factors over the same catalogue, its free
  functions and its mixture of sizes; the first scan alone, without refinement and sweeps.

Both must also raise an alarm: the threshold of each is its own 99.5 % point over draws of noise
alone, as a diagnosis at the default level has it. Noise effects are no part of this cell.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ive

from benchmarks.gap_size import NOISY
from benchmarks.gap_trials.trial import Trial, draw_trial
from benchmarks.study import Record, Work, table
from infield.table.file import table_from_dict
from simreal.effects.catalogue import catalogue
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import Evidence
from simreal.inference.attribute import Attribution
from simreal.inference.bank import REACH, Bank, Group, Hypothesis
from simreal.inference.scoring import Scorer, usual_range
from simreal.inference.tails import tail_quantile

SIZES = (3.0, 5.0, 8.0, 12.0)
LEVEL = 0.005  # half of the default level of 1 %, as in simreal.inference.attribute
NULLS = 4000
LEAST_SHARE = 1e-8  # of a group's largest eigenvalue: a direction below is none
NO_COLUMNS = np.zeros(0, dtype=int)
SHARES = {
    "oracle_right": "oracle right",
    "oracle_right_and_alarm": "and with an alarm",
    "ours_right": "diagnosis right",
    "ours_right_and_alarm": "and with an alarm",
}
Key = tuple[str, str]


@dataclass(frozen=True)
class Candidate:
    """A grid point of a named hypothesis: roots (p, k) make whitened coordinates of its columns'
    products, back (k, p) coefficients of them.
    """

    key: Key
    columns: NDArray
    roots: NDArray
    back: NDArray
    log_prior: NDArray  # by size

    @property
    def freedom(self) -> int:
        return int(self.roots.shape[0])


def unit(seed: int, draws: int) -> list[dict]:
    """Answers on one set of four runs, a row a size."""
    bank = bank_of(seed)
    rng = np.random.default_rng([seed, 18])
    found = candidates(bank, SIZES)
    names = sorted({c.key for c in found})
    scorer = Scorer(bank)
    root = half(bank.gram)
    null = root @ rng.standard_normal((root.shape[1], NULLS))
    ours = Ours(scorer, names, null)
    out = []
    for number, size in enumerate(SIZES):
        prior = np.array([c.log_prior[number] for c in found])
        oracle = Oracle(found, names, prior, size)
        threshold = float(np.quantile(oracle.evidence(oracle.by_name(null)), 1.0 - LEVEL))
        truth, score = drawn(found, prior, size, draws, rng, bank.gram)
        score = score + root @ rng.standard_normal((root.shape[1], draws))
        right = np.array([names.index(found[t].key) for t in truth])
        by_name = oracle.by_name(score)
        said = by_name.argmax(axis=0) == right
        heard = oracle.evidence(by_name) > threshold
        mine, alarm = ours.answers(score)
        out.append(
            {
                "seed": seed,
                "sigma": size,
                "draws": draws,
                "oracle_right": int(said.sum()),
                "oracle_right_and_alarm": int((said & heard).sum()),
                "ours_right": int((mine == right).sum()),
                "ours_right_and_alarm": int(((mine == right) & alarm).sum()),
                "ours_alarm": int(alarm.sum()),
                "oracle_alarm": int(heard.sum()),
                "ours_nameless": int((mine >= len(names)).sum()),
                "oracle_wrong_ours_right": int(((mine == right) & ~said).sum()),
                "hypotheses": len(names),
            }
        )
    return out


def bank_of(seed: int) -> Bank:
    """The signatures of the whole catalogue on four runs without any effect."""
    trial = draw_trial(12000 + seed, effects=0, plan="four")
    table = table_from_dict(trial.table, name="trial")
    views: list[RunView] = []
    for k, run in enumerate(trial.runs):
        view = view_run(run, k, table, trial.twin)
        assert not isinstance(view, str), view
        views.append(view)
    return Bank(Evidence(views, trial.twin), catalogue())


def candidates(bank: Bank, sizes: Sequence[float]) -> list[Candidate]:
    """All grid points of named effects that leave a trace in these runs; points between them, which
    a diagnosis may have entered, are none.
    """
    found = []
    for h in bank.hypotheses:
        for group in h.groups[: h.coarse] if h.effect is not None else ():
            made = candidate(bank, h, group, sizes)
            if made is not None:
                found.append(made)
    return found


def candidate(bank: Bank, h: Hypothesis, group: Group, sizes: Sequence[float]) -> Candidate | None:
    c = group.columns
    scaled = bank.gram[np.ix_(c, c)] * np.outer(group.scale, group.scale)
    values, vectors = np.linalg.eigh(scaled)
    top = float(values[-1])
    if top < 1e-6:
        return None
    live = values > LEAST_SHARE * top
    root = np.sqrt(values[live])
    roots = (vectors[:, live] / root).T * group.scale
    back = group.scale[:, None] * vectors[:, live] / root
    low, high = usual_range(h)
    size = np.array(sizes) / np.sqrt(top)
    beyond = np.maximum(size / high, 1.0)
    weight = -0.5 * np.log(beyond) - 3.0 * (beyond > REACH) - 1.0 * (size < low / 30.0)
    return Candidate((h.name, h.target), c, roots, back, weight + h.log_prior + group.log_weight)


def half(gram: NDArray) -> NDArray:
    """A root of the Gram matrix: noise as the columns see it."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    live = values > 1e-9 * values[-1]
    return np.asarray(scale[:, None] * vectors[:, live] * np.sqrt(values[live]))


def drawn(
    found: list[Candidate],
    prior: NDArray,
    size: float,
    draws: int,
    rng: np.random.Generator,
    gram: NDArray,
) -> tuple[NDArray, NDArray]:
    """Numbers of the planted candidates, and what they make of all products (m, draws)."""
    weights = np.exp(prior - prior.max())
    truth = rng.choice(len(found), size=draws, p=weights / weights.sum())
    out = np.zeros((gram.shape[0], draws))
    for k, number in enumerate(truth):
        c = found[number]
        way = rng.standard_normal(c.freedom)
        coefficients = c.back @ (size * way / np.linalg.norm(way))
        out[:, k] = gram[:, c.columns] @ coefficients
    return truth, out


@dataclass(frozen=True)
class Oracle:
    """Exact likelihoods under the prior that the draws were made with."""

    found: list[Candidate]
    names: list[Key]
    prior: NDArray
    size: float

    def by_name(self, score: NDArray) -> NDArray:
        """Log posterior over that of no effect, of each name on its target (names, draws)."""
        place = {key: k for k, key in enumerate(self.names)}
        out = np.full((len(self.names), score.shape[1]), -np.inf)
        for c, prior in zip(self.found, self.prior):
            length = np.linalg.norm(c.roots @ score[c.columns], axis=0)
            value = prior + over_sphere(self.size * length, c.freedom) - 0.5 * self.size**2
            k = place[c.key]
            out[k] = np.logaddexp(out[k], value)
        return out

    @staticmethod
    def evidence(by_name: NDArray) -> NDArray:
        return np.asarray(np.logaddexp.reduce(by_name, axis=0))


def over_sphere(x: NDArray, k: int) -> NDArray:
    """log of the mean of exp(x cos) over directions in k dimensions."""
    if k == 1:
        return np.asarray(np.logaddexp(x, -x) - np.log(2.0))
    order = 0.5 * k - 1.0
    x = np.maximum(x, 1e-9)
    bessel = np.log(np.maximum(ive(order, x), 1e-300)) + x
    return np.asarray(gammaln(0.5 * k) + order * np.log(2.0 / x) + bessel)


class Ours:
    """The first scan of the diagnosis."""

    def __init__(self, scorer: Scorer, names: list[Key], null: NDArray) -> None:
        self.scorer = scorer
        every = [(h.name, h.target) for h in scorer.hypotheses]
        self.keys = [*names, *sorted(set(every) - set(names))]
        self.place = np.array([self.keys.index(key) for key in every])
        posterior, _ = scorer.log_posterior(NO_COLUMNS, null)
        self.threshold = float(np.quantile(posterior.max(axis=0), 1.0 - LEVEL))

    def answers(self, score: NDArray) -> tuple[NDArray, NDArray]:
        """Place of the most probable name among `keys`, and whether there is an alarm."""
        posterior, _ = self.scorer.log_posterior(NO_COLUMNS, score)
        out = np.full((len(self.keys), score.shape[1]), -np.inf)
        for row, place in zip(posterior, self.place):
            out[place] = np.logaddexp(out[place], row)
        return out.argmax(axis=0), posterior.max(axis=0) > self.threshold


def oracle_of(trial: Trial, reached: float, found: Attribution, *, alpha: float) -> Record | None:
    """The best possible answer on a trial's own rows, given the very data of the diagnosis: its
    most probable name and target, with its probability, and whether it raises an alarm (at the
    level of the diagnosis, on the same replicates of the noise).

    It knows the twin's noise, the catalogue with its priors, that there is one effect and how many
    sigmas it has. None where the trial has no effect, two of them or one of noise.
    """
    if len(trial.truth) != 1 or trial.truth[0].effect in NOISY:
        return None
    plain = found.evidence is found.plain_evidence
    bank = found.bank if plain else Bank(found.plain_evidence, catalogue())
    points = candidates(bank, (reached,))
    names = sorted({c.key for c in points})
    prior = np.array([c.log_prior[0] for c in points])
    oracle = Oracle(points, names, prior - np.logaddexp.reduce(prior), reached)
    null = oracle.evidence(oracle.by_name(bank.replicate_scores(found.replicate_z)))
    by_name = oracle.by_name(bank.score[:, None])
    evidence = float(oracle.evidence(by_name)[0])
    best = int(by_name[:, 0].argmax())
    effect, target = names[best]
    return {
        "effect": effect,
        "target": target,
        "probability": round(float(np.exp(by_name[best, 0] - evidence)), 5),
        "alarm": evidence > tail_quantile(null, 0.5 * alpha),
    }


def row(size: float, own: list[Record]) -> list[str]:
    """Shares of all draws of a size."""
    n = sum(r["draws"] for r in own)
    total = {key: sum(r[key] for r in own) for key in SHARES}
    of_oracle = total["ours_right_and_alarm"] / max(total["oracle_right_and_alarm"], 1)
    shares = [f"{100 * total[key] / n:.1f} %" for key in SHARES]
    return [f"{size:g} sigma", f"{n}", *shares, f"{100 * of_oracle:.1f} %"]


def run(work: Work, *, draws: int = 400, units: int = 3, first: int = 0) -> str:
    found = work.each(unit, [(seed, draws) for seed in range(first, first + units)])
    rows = list(chain(*found))
    head = ("size", "draws", *SHARES.values(), "share of the oracle's, with an alarm")
    return table(head, [row(size, [r for r in rows if r["sigma"] == size]) for size in SIZES])
