"""What is wrong with thermometers: codes with the templates of their sentences."""

from ins.records import InputError
from ins.verdicts import Reason, ReasonCode, sentence


class ThermometerReason(ReasonCode):
    """What follows from a fault, or why no gyro has a temperature."""

    NONE_LOGGED = (
        "none_logged",
        "no gyro temperature in the run: a bias without its temperature has no place in the table",
    )
    TOO_FEW_ROWS = (
        "too_few_rows",
        "gyro temperature: {rows} {rows:row|rows} over {span_s:g} s, needed at least {needed_rows}"
        " rows over {needed_s:.0f} s",
    )
    ALL_STUCK = (
        "all_stuck",
        "all gyro thermometers are stuck (a constant temperature is accepted by"
        ' "accepted_constant_temperature": true in run.json)',
    )
    NONE_USABLE = "none_usable", "no gyro thermometer can be used"
    OF_ANOTHER = "of_another", "{column}: {fault}"
    COARSE = "coarse", "thermometer {column}: {fault}; its sigma is wider"
    CONSTANT = (
        "constant",
        "thermometer {column}: {fault}; a step of 1 degC could hide in it, and is in its sigma",
    )
    HOLE = "hole", "thermometer {column}: {fault}; nothing is learnt there beyond two minutes"
    AXIS_LEFT_OUT = "axis_left_out", "thermometer {column}: {fault}; the axis is left out"
    READINGS_LEFT_OUT = (
        "readings_left_out",
        "thermometer {column}: {fault}; these readings are left out",
    )


class NoTemperature(InputError):
    """A run without the gyro temperature that a fit needs.

    Parameters
    ----------
    run_id : str
        The run.
    reason : Reason
        Why it has none.
    """

    def __init__(self, run_id: str, reason: Reason) -> None:
        super().__init__(f"{run_id}: {sentence(reason)}")
        self.reason = reason
