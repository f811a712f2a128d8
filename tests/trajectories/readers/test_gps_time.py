"""GPS time to UTC, at epochs that are published."""

import pytest

from trajectories.readers.rows.clocks import gps_seconds, unix_seconds, utc_text


@pytest.mark.parametrize(
    ("week", "tow_s", "utc"),
    # IS-GPS-200: the first week rollover, 13 leap seconds
    [
        (1024, 0.0, "1999-08-21T23:59:47.000Z"),
        (2048, 0.0, "2019-04-06T23:59:42.000Z"),  # the second one, 18 leap seconds
        # IERS Bulletin C 52
        (1930, 18.0, "2017-01-01T00:00:00.000Z"),
        (1930, 16.5, "2016-12-31T23:59:59.500Z"),
        # within the leap second, which ISO text here does not have
        (1930, 17.5, "2017-01-01T00:00:00.500Z"),
        # Bulletin C 49
        (1851, 259217.5, "2015-07-01T00:00:00.500Z"),
        (1851, 259215.5, "2015-06-30T23:59:59.500Z"),
    ],
)
def test_published_epochs(week, tow_s, utc):
    assert utc_text(float(unix_seconds(gps_seconds(week, tow_s)))) == utc
