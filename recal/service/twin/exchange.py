"""`twin import` and `twin export`: noise models from and to other programs."""

import json
from dataclasses import replace
from pathlib import Path

from ins.json_file import read_small_text
from ins.records import InputError, TwinModel
from ins.twin_file import TwinDocument, default_twin, twin_to_dict
from recal.service.inputs.records import AnyTwin, twin_of
from simreal.twin.exchange import Dialect, kalibr_text, pyins_parameters, twin_from_text

TARGETS = ("kalibr", "pyins")


def import_twin(
    path: str | Path, dialect: str, *, technology: str = "mems", serial: str = ""
) -> TwinModel:
    """A twin from a noise file of Kalibr, imu_utils or a data sheet; what that lacks is the default
    of the technology.

    Parameters
    ----------
    path : path
        Noise file: key: number, one a line.
    dialect : str
        Whose file it is.
    technology : {'rlg', 'fog', 'mems'}
        Its defaults fill what the file lacks.
    serial : str
        imu_serial of the unit.
    """

    believed = replace(default_twin(technology), imu_serial=serial)
    return twin_from_text(read_small_text(Path(path)), Dialect(dialect), believed, name=str(path))


def export_twin(twin: AnyTwin, target: str, *, rate_hz: float = 100.0) -> str:
    """A twin as the text of Kalibr's imu.yaml, or as JSON of pyins' arguments.

    Parameters
    ----------
    twin : TwinModel or path
        Twin file.
    target : str
        In whose form.
    rate_hz : float in [10, 2000]
        update_rate that Kalibr is told [Hz].
    """
    record = twin_of(twin)
    if target == "kalibr":
        return kalibr_text(record, rate_hz)
    if target == "pyins":
        return json.dumps(pyins_parameters(record), indent=1) + "\n"
    raise InputError(f"--to {target}: needed one of {', '.join(TARGETS)}")


def twin_document(twin: TwinModel) -> TwinDocument:
    """A twin as its file holds it."""
    return twin_to_dict(twin)
