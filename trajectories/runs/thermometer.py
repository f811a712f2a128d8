"""What `recal check` says of a temperature stream: the faults that the recalibration would find in
it.
"""

import numpy as np
from numpy.typing import NDArray

from ins.thermometer_faults import FaultKind, check_thermometers
from trajectories.runs.checks import Findings


def check_thermometer(columns: dict[str, NDArray], label: str, findings: Findings) -> None:
    """Warnings on thermometers and holes; kelvin, which no reader should pass on, is a suspect."""
    time_s = columns["time_s"]
    thermometers = {
        name: values
        for name, values in columns.items()
        if name != "time_s" and not name.startswith("gradient") and np.isfinite(values).any()
    }
    for fault in check_thermometers(time_s, thermometers).faults:
        name = "" if fault.column == "temperature" else f"{fault.column} "
        say = findings.suspect if fault.kind is FaultKind.IMPLAUSIBLE else findings.warn
        say(f"{label}: {name}{fault.text}")
