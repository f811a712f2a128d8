"""Every code of a room has its sentence, and every sentence names only what its reason brings."""

from importlib import import_module

import pytest

from infield.reports.words import sentences
from ins.verdicts import because

REASONS = {
    "aided": ("infield.aided.reasons", ("AidedReason", "AidedNote")),
    "misalignment": (
        "infield.misalignment.reasons",
        ("MisalignmentReason", "StopReason", "MisalignmentNote", "Azimuths", "Unseen"),
    ),
    "thermal": ("infield.thermal.reasons", ("ThermalReason", "ThermalNote")),
    "replay": (
        "infield.replay.reasons",
        ("ReplayReason", "ReplayNote", "SchulerReason", "Damping"),
    ),
}


@pytest.mark.parametrize("room", REASONS)
def test_every_code_has_a_sentence(room):
    module, enums = REASONS[room]
    codes = [code for name in enums for code in getattr(import_module(module), name)]
    found = sentences.templates()
    assert codes and all((type(code), code.name) in found for code in codes)


def test_a_reason_among_the_values_is_said_and_coded():
    from infield.aided.reasons import AidedReason
    from infield.replay.reasons import ReplayReason

    inner = because(AidedReason.FEW_FIXES, count=5, needed=10)
    reason = because(ReplayReason.BY_AIDED, reason=inner)
    told = "aided by GNSS: 5 satellite fixes within the imu log, needed 10"
    assert sentences.sentences([reason, "as it is"]) == [told, "as it is"]
    assert sentences.codes([reason, "as it is"]) == ["aided_by_gnss.few_fixes", None]
