"""Whether the noise model fits the runs that it was used on, as every document says it."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class NoiseFit:
    """p_value: of the worst band of any sensor, times their number; text: in one line, with the
    command that would measure a model that does not fit.
    """

    fits: bool
    p_value: float
    text: str
