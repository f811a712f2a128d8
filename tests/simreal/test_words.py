"""The words on the effects: one entry for each name of the catalogue, whole sentences."""

from dataclasses import astuple

import pytest

from simreal.declared.generic import FREE_FUNCTIONS, TABLE_AGED
from simreal.effects.catalogue import catalogue
from simreal.effects.words import FREE_WORDS, TABLE_WORDS, WORDS, words_of


def test_every_effect_and_free_function_has_its_words():
    assert WORDS.keys() == {e.name for e in catalogue()}
    assert FREE_WORDS.keys() == FREE_FUNCTIONS
    assert TABLE_WORDS.keys() == {TABLE_AGED}
    assert words_of("gyro_fan") is None


@pytest.mark.parametrize("name", [*WORDS, *FREE_WORDS, *TABLE_WORDS])
def test_words_are_whole_sentences(name):
    for sentence in astuple(words_of(name)):
        assert sentence[0].isupper() or sentence[0].isdigit(), sentence
        assert sentence.endswith("."), sentence
