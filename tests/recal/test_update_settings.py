"""Settings of `recal update` from a file: the priors of flights beside those of sessions."""

import pytest

from infield.session.settings import FlightPriors, SessionSettings
from ins.records import InputError
from recal.service.inputs.config import read_config


def settings_of(tmp_path, text):
    path = tmp_path / "settings.toml"
    path.write_text(text)
    return read_config(path)[0]


def test_priors_of_a_flight_are_read_and_what_is_not_given_keeps_its_default(tmp_path):
    text = "[flight]\ndeflection_arcsec = 12\nshift_deg_h = {rlg = 0.002}\n[session]\nbin_s = 200\n"
    found = settings_of(tmp_path, text)
    default = FlightPriors()
    assert found.bin_s == 200 and found.flight.deflection_arcsec == 12
    assert found.flight.shift_deg_h == {**default.shift_deg_h, "rlg": 0.002}
    assert found.flight.deflection_km == default.deflection_km == "fit"
    assert settings_of(tmp_path, '[flight]\ndeflection_arcsec = "fit"\n').flight == default
    assert settings_of(tmp_path, "") == SessionSettings()
    of_all = settings_of(tmp_path, "[session]\nsigma_misalignment_mrad = 0.3\n")
    assert of_all.sigma_misalignment_mrad == dict.fromkeys(("rlg", "fog", "mems"), 0.3)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[flight]\nslow_position_s = 0.5\n", r"slow_position_s = 0.5, needed at least 1"),
        ("[flight]\nantenna_cm = 3\n", r"unknown key 'antenna_cm', needed one of slow_"),
        ("[session]\nsigma_misalignment_mrad = -1\n", r"-1.*needed a number that is not negative"),
        ("[flight]\nshift_deg_h = 3\n", r"\[flight\]: shift_deg_h = 3, needed dict"),
        ("[flight]\nshift_deg_h = {lgr = 3}\n", "unknown key 'lgr'"),
        ("[flight]\nantenna_m = -1\n", r"antenna_m = -1, needed a number that is not negative"),
        ('[flight]\ndeflection_km = "far"\n', r"= \Wfar\W, needed a number .* or \"fit\""),
        ('[flight]\nantenna_m = "fit"\n', r"antenna_m = \Wfit\W, needed a number"),
        ("[flight]\ndeflection_km = 0\n", r"deflection_km = 0, needed at least 0.001"),
        ("[session]\nflight = {}\n", r"\[session\]: unknown key 'flight'"),
        ("[session]\nbin_s = 3\n", r"\[session\]: bin_s = 3, needed at least 30"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_with_its_key(tmp_path, text, told):
    with pytest.raises(InputError, match=told):
        settings_of(tmp_path, text)
