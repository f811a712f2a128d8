"""When a difference counts: what is said of a value beside its sigma."""

from ins.verdicts import Observability

SIGMAS_APART = 2.0  # 95 % of normal errors lie within; U(k=2) of the reports is the same band
MEASURED, NOT_FROM_ZERO = "measured", "measured, not different from zero"


def differs(value: float, sigma: float) -> bool:
    """Whether a value is further from zero than chance takes it in 19 of 20 cases."""
    return abs(value) >= SIGMAS_APART * sigma


def measured_words(verdict: str, value: float, sigma: float) -> str:
    """What is said of a measured value: `observed` alone would say that it is not zero."""
    if verdict == Observability.NOT_OBSERVABLE:
        return "not observable"
    said = MEASURED if differs(value, sigma) else NOT_FROM_ZERO
    return f"weakly {said}" if verdict == Observability.WEAK else said
