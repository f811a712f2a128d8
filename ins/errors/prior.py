"""What estimators assume of an error before they see data: a zero mean, a sigma, a process."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Prior:
    """One sigma of each component of an error, in some recipes of the estimators.

    Parameters
    ----------
    recipes : str
        Where it holds, words apart: "session" (parked, taxi and flight), "taxi", "flight",
        "replay", "azimuths", "learning", "raw" (a unit without a table), "attitude" (a unit that
        stands otherwise than its table was taken).
    unit : str
        Of the sigma.
    sigma : float or mapping
        A number, or one for each gyro technology; 0 where its level is fitted.
    part : str
        Which coefficients of the error, where they differ.
    scale, scale_unit : float, str
        Of a Gauss-Markov process: the time "s", the way "m" or the turn "rad" after which 1/e of it
        is left; 0 of other processes.
    source : str
        Where the number comes from.
    walks : bool
        A random walk; a constant where it has no scale either.
    """

    recipes: str
    unit: str
    sigma: float | Mapping[str, float]
    part: str = ""
    scale: float = 0.0
    scale_unit: str = ""
    source: str = ""
    walks: bool = False

    @property
    def process(self) -> str:
        """In words."""
        if self.walks:
            return "random walk"
        if not self.scale:
            return "constant"
        return f"Gauss-Markov, {self.scale:g} {self.scale_unit}"

    @property
    def size(self) -> float:
        """The number of all technologies; TypeError where each has its own."""
        if isinstance(self.sigma, Mapping):
            raise TypeError(f"{self.recipes} {self.part}: a sigma for each technology")
        return self.sigma

    def of(self, technology: str) -> float:
        """The number of a gyro technology.

        Parameters
        ----------
        technology : str

        Returns
        -------
        sigma : float
        """
        return self.sigma[technology] if isinstance(self.sigma, Mapping) else self.sigma

    def each(self) -> dict[str, float]:
        """The numbers by technology.

        Returns
        -------
        numbers : dict

        Raises
        ------
        TypeError
            Where all share one.
        """
        if not isinstance(self.sigma, Mapping):
            raise TypeError(f"{self.recipes} {self.part}: one sigma for all technologies")
        return dict(self.sigma)
