"""Notes of readers: what they are about outlives labels, joining and a trip to a worker."""

import pickle

from trajectories.runs.notes import About, Note, about, joined, labelled

CUT = Note("last row cut off, dropped", About.DAMAGE)


def test_a_label_keeps_what_a_note_is_about():
    told = labelled("flight.bin", CUT)
    assert told == "flight.bin: last row cut off, dropped"
    assert about(told) is About.DAMAGE
    assert about(labelled("flight.bin", "50 Hz")) is None


def test_joined_notes_keep_the_first_code():
    told = joined(("", "50 Hz", CUT, Note("no date", About.DATE)))
    assert told == "50 Hz; last row cut off, dropped; no date"
    assert about(told) is About.DAMAGE
    assert about(joined(("", "50 Hz"))) is None


def test_a_copy_keeps_the_code():
    assert about(pickle.loads(pickle.dumps(CUT))) is About.DAMAGE
