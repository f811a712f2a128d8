"""The words on the errors: one entry for each name of the list, whole sentences."""

from dataclasses import astuple

import pytest

from ins.errors.catalogue import OWN, words_of
from ins.errors.unnamed import FREE_FUNCTIONS

NAMES = dict.fromkeys([*(source.name for source in OWN), *FREE_FUNCTIONS])


def test_a_users_own_error_needs_no_words():
    assert words_of("gyro_fan") is None


@pytest.mark.parametrize("name", NAMES)
def test_words_are_whole_sentences(name):
    for sentence in astuple(words_of(name)):
        assert sentence[0].isupper() or sentence[0].isdigit(), sentence
        assert sentence.endswith("."), sentence
