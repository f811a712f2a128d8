"""The best possible answer on a trial's own rows: the oracle of `gap_oracle`, given the very data
that the diagnosis was given.

It knows the twin's noise, the catalogue with its priors, that there is one effect and how many
sigmas it has. Its alarm level is that of the diagnosis, on the same replicates of the noise. Noise
effects are no part of it, and of two effects at once it does not judge.
"""

from typing import Any

import numpy as np

from benchmarks.gap_oracle import Oracle, candidates
from benchmarks.gap_size import NOISY
from benchmarks.gap_trials.trial import Trial
from simreal.effects.catalogue import catalogue
from simreal.inference.attribute import Attribution
from simreal.inference.bank import Bank
from simreal.inference.tails import tail_quantile


def oracle_of(
    trial: Trial, reached: float, found: Attribution, *, alpha: float
) -> dict[str, Any] | None:
    """Its most probable name and target, with its probability, and whether it raises an alarm;
    None where the trial has no effect, two of them or one of noise.
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
