"""What is wrong with thermometers, as codes; sentences: `infield.reports.words.thermometer`."""

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import ClassVar

from ins.records import InputError
from ins.verdicts import Reason


class ThermometerReason(StrEnum):
    """What follows from a fault, or why no gyro has a temperature."""

    NONE_LOGGED = "none_logged"
    TOO_FEW_ROWS = "too_few_rows"
    ALL_STUCK = "all_stuck"
    NONE_USABLE = "none_usable"
    OF_ANOTHER = "of_another"
    COARSE = "coarse"
    CONSTANT = "constant"
    HOLE = "hole"
    AXIS_LEFT_OUT = "axis_left_out"
    READINGS_LEFT_OUT = "readings_left_out"


def _too_few_rows(*, rows: int, span_s: float, needed_rows: int, needed_s: float) -> str:
    return (
        f"gyro temperature: {rows} row{'s' if rows > 1 else ''} over {span_s:g} s, needed at least"
        f" {needed_rows} rows over {needed_s:.0f} s"
    )


class NoTemperature(InputError):
    """A run without the gyro temperature that a fit needs.

    Parameters
    ----------
    run_id : str
        The run.
    reason : Reason
        One of those with a template here.
    """

    TEMPLATES: ClassVar[Mapping[StrEnum, str | Callable[..., str]]] = {
        ThermometerReason.NONE_LOGGED: (
            "no gyro temperature in the run: a bias without its temperature has no place in the"
            " table"
        ),
        ThermometerReason.TOO_FEW_ROWS: _too_few_rows,
        ThermometerReason.ALL_STUCK: (
            "all gyro thermometers are stuck (a constant temperature is accepted by"
            ' "accepted_constant_temperature": true in run.json)'
        ),
        ThermometerReason.NONE_USABLE: "no gyro thermometer can be used",
    }

    def __init__(self, run_id: str, reason: Reason) -> None:
        template = self.TEMPLATES[reason.code]
        told = template if isinstance(template, str) else template(**reason.values)
        super().__init__(f"{run_id}: {told}")
        self.reason = reason
