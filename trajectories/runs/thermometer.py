"""What `recal check` says of a temperature stream: the faults that the recalibration would find in
it.
"""

import numpy as np
from numpy.typing import NDArray

from ins.thermometer_faults import FaultKind, check_thermometers
from trajectories.runs.checks import Findings

# what a log is told whose thermometers never change
HOW_TO_ACCEPT = "where it is a constant temperature, accepted_constant_temperature accepts it"


def check_thermometer(
    columns: dict[str, NDArray], label: str, findings: Findings, *, constant: bool = False
) -> None:
    """Warnings on thermometers and holes; kelvin, which no reader should pass on, is a suspect.
    constant: readings that never change are accepted.
    """
    time_s = columns["time_s"]
    thermometers = {
        name: values
        for name, values in columns.items()
        if name != "time_s" and not name.startswith("gradient") and np.isfinite(values).any()
    }
    never_change = all(np.ptp(v[np.isfinite(v)]) == 0.0 for v in thermometers.values())
    for fault in check_thermometers(time_s, thermometers, constant=constant).faults:
        name = "" if fault.column == "temperature" else f"{fault.column} "
        say = findings.suspect if fault.kind is FaultKind.IMPLAUSIBLE else findings.warn
        hint = f" ({HOW_TO_ACCEPT})" if fault.kind is FaultKind.STUCK and never_change else ""
        say(f"{label}: {name}{fault.text}{hint}")
