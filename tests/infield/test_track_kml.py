"""track.kml: order of elements as KML 2.2 has it, times, colours, points within the limit, free
text escaped.
"""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import lru_cache

import numpy as np

from infield.replay.free_inertial import replay
from infield.reports.track_kml import MOST_POINTS, NAMES, track_kml
from tests.infield.aided_cases import flown, ideal, twin_of
from tests.infield.test_replay import choices, flat

NS = "{http://www.opengis.net/kml/2.2}"
# OGC 07-147r2, the order of the elements used here within a feature and within a geometry
ORDER = {
    "Document": ["name", "description", "Style", "Placemark"],
    "Placemark": [
        "name",
        "description",
        "TimeStamp",
        "TimeSpan",
        "styleUrl",
        "Point",
        "LineString",
    ],
    "LineString": ["tessellate", "altitudeMode", "coordinates"],
    "Point": ["altitudeMode", "coordinates"],
    "TimeSpan": ["begin", "end"],
    "TimeStamp": ["when"],
    "Style": ["LineStyle"],
    "LineStyle": ["color", "width"],
}

NUMBER = r"-?\d+\.\d+"
VALUES = {
    "color": r"[0-9a-f]{8}",
    "width": r"\d+(\.\d+)?",
    "tessellate": "0|1",
    "altitudeMode": "clampToGround|absolute",
    **dict.fromkeys(("begin", "end", "when"), r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z"),
    "coordinates": rf"{NUMBER},{NUMBER},{NUMBER}( {NUMBER},{NUMBER},{NUMBER})*",
}


@lru_cache(maxsize=1)
def result():
    run = flown(ideal(700.0), twin_of("rlg"), 1).run
    header = replace(run.header, run_id='a <b> & "c"', imu_serial="]]> & 1")
    return replay(replace(run, header=header), choices(flat(), flat(x=0.05)), twin_of("rlg"))


def test_document_is_kml_2_2():
    root = ET.fromstring(track_kml(result()))
    assert root.tag == NS + "kml" and [e.tag for e in root] == [NS + "Document"]
    for element in root.iter():
        names = [child.tag.removeprefix(NS) for child in element]
        if names and element is not root:
            allowed = ORDER[element.tag.removeprefix(NS)]
            assert [allowed.index(n) for n in names] == sorted(allowed.index(n) for n in names)
    assert root[0].find(NS + "name").text == 'a <b> & "c"'
    assert "]]> & 1" in root[0].find(NS + "description").text


def faults(text: str) -> list[str]:
    """What a validator with the OGC schema (ogckml22.xsd, in fastkml) finds in values, and two
    things that it lets pass: a styleUrl without its style, a coordinate that is no number.
    """
    root = ET.fromstring(text)
    ids = [e.attrib["id"] for e in root.iter() if "id" in e.attrib]
    found = [
        f"id {name}"
        for name in ids
        if not re.fullmatch(r"[A-Za-z_][\w.-]*", name) or ids.count(name) > 1
    ]
    found += [
        f"{e.tag} {e.text}"
        for tag, shape in VALUES.items()
        for e in root.iter(NS + tag)
        if not re.fullmatch(shape, e.text)
    ]
    found += [
        e.text for e in root.iter(NS + "styleUrl") if e.text[0] != "#" or e.text[1:] not in ids
    ]
    begun = [
        (s.find(NS + "begin").text, s.find(NS + "end").text) for s in root.iter(NS + "TimeSpan")
    ]
    return found + [f"TimeSpan {a} {b}" for a, b in begun if a > b]


def test_values_are_those_of_the_schema():
    assert faults(track_kml(result())) == []
    lost = replace(
        result().run.gnss,
        lat_rad=np.where(np.arange(result().run.gnss.time_s.size) % 9 == 0, np.nan, 0.7),
    )
    assert faults(track_kml(replace(result(), run=replace(result().run, gnss=lost)))) == []


def test_tracks_points_and_times():
    root = ET.fromstring(track_kml(result()))
    lines = [p for p in root.iter(NS + "Placemark") if p.find(NS + "LineString") is not None]
    assert [p.find(NS + "name").text for p in lines] == [
        NAMES[k] for k in ("gnss", "active", "previous", "aided")
    ]
    assert len({p.find(NS + "styleUrl").text for p in lines}) == 4
    points = [
        p.find(NS + "name").text
        for p in root.iter(NS + "Placemark")
        if p.find(NS + "Point") is not None
    ]
    assert points[:2] == ["start", "end"]
    gnss, run = lines[0], result().run
    assert gnss.find(f"{NS}TimeSpan/{NS}begin").text == "2026-03-01T05:00:01.000000Z"
    assert gnss.find(f"{NS}LineString/{NS}altitudeMode").text == "absolute"  # it climbs by 300 m
    rows = [
        tuple(map(float, row.split(",")))
        for row in gnss.find(f"{NS}LineString/{NS}coordinates").text.split()
    ]
    assert len(rows) == run.gnss.time_s.size
    np.testing.assert_allclose(
        rows[5][:2], np.degrees([run.gnss.lon_rad[5], run.gnss.lat_rad[5]]), atol=1e-7
    )


def test_long_tracks_are_thinned_and_longitude_stays_within_180():
    many = 60_000
    gnss = result().run.gnss
    long = replace(
        gnss,
        time_s=np.arange(many) / 10.0,
        lat_rad=np.linspace(0, 0.1, many),
        lon_rad=np.linspace(3.1, 3.2, many),
        height_m=np.zeros(many),
        v_n_m_s=np.zeros((many, 3)),
        sigma_horizontal_m=None,
        sigma_vertical_m=None,
        sigma_velocity_m_s=None,
    )
    text = track_kml(replace(result(), run=replace(result().run, gnss=long)))
    lines = ET.fromstring(text).iter(NS + "coordinates")
    rows = [row.split(",") for line in lines for row in line.text.split()]
    assert len(rows) <= MOST_POINTS + 10
    assert max(abs(float(row[0])) for row in rows) <= 180.0
