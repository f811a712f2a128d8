"""Records as JSON holds them, and back."""

import doctest
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TypedDict

import numpy as np
import pytest

from ins import documents
from ins.documents import (
    INLINE,
    OMIT_NONE,
    UNWRITTEN,
    MadeOf,
    Null,
    from_json,
    made,
    plain,
    to_json,
    written,
    written_as,
)
from ins.records import InputError
from ins.verdicts import Outcome


@dataclass(frozen=True)
class Inner:
    sigma_deg_h: np.ndarray
    outcome: Outcome


@dataclass(frozen=True)
class Outer:
    inner: tuple[Inner, ...]
    by_axis: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Site:
    lat_deg: float


@dataclass(frozen=True, kw_only=True)
class Long(Site):
    lon_deg: float


class Table(TypedDict):
    """A part with a reader of its own: it stays what JSON makes of it."""

    any: list[int]


@dataclass(frozen=True, kw_only=True)
class Result:
    verdict: Outcome | str
    sites: Sequence[Long | Site]
    spans_s: tuple[tuple[float, float], ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    as_it_is: float | None = field(default=None, metadata=written_as("with"))
    table: Table | None = None
    note: str | None = field(default=None, metadata=OMIT_NONE)
    drawn: object = field(default=None, metadata=UNWRITTEN)


RESULT = Result(
    verdict=Outcome.REFUSED,
    sites=(Long(lat_deg=1.0, lon_deg=2.0), Site(lat_deg=3.0)),
    spans_s=((0.0, 1.5),),
    counts={"x": 3},
    as_it_is=1e-05,
    table={"any": [1, {"more": None}]},
)


def test_examples_of_the_docstrings():
    assert doctest.testmod(documents).failed == 0


def test_nested_records_become_json():
    record = Outer((Inner(np.array([1.0, 2.0]), Outcome.REFUSED),), {"x": np.float64(0.5)})
    assert json.loads(to_json(record)) == {
        "inner": [{"sigma_deg_h": [1.0, 2.0], "outcome": "refused"}],
        "by_axis": {"x": 0.5},
    }
    assert type(plain(record)["by_axis"]["x"]) is float


def test_the_text_of_a_record():
    assert to_json(Site(lat_deg=1e-05)) == '{\n "lat_deg": 1e-05\n}\n'
    text = to_json(RESULT)
    assert '"with": 1e-05' in text and "note" not in text and "drawn" not in text


def test_numbers_that_are_not_finite_are_null_and_read_back_as_none():
    text = to_json({"a": [np.nan, np.float64("inf")], "b": np.array([-np.inf, 1.0])})
    assert json.loads(text) == {"a": [None, None], "b": [None, 1.0]}
    assert np.isnan(plain([np.nan])[0])
    assert from_json(Site, to_json(Site(lat_deg=np.nan)), name="x") == Site(lat_deg=None)


def test_keys_of_an_inner_record_in_its_place_and_a_null_that_stands():
    @dataclass(frozen=True)
    class Held:
        rows: int
        site: Site | None = field(metadata=INLINE)
        zero_rate: Site | Null | None = field(default=None, metadata=OMIT_NONE)

    assert plain(Held(3, Site(lat_deg=1.0))) == {"rows": 3, "lat_deg": 1.0}
    assert plain(Held(3, None, Null.NULL)) == {"rows": 3, "zero_rate": None}


@dataclass(frozen=True)
class Kept:
    first: Site | Null | None = field(default=None, metadata=OMIT_NONE)
    second: Site | Null | None = field(default=None, metadata=OMIT_NONE)


@pytest.mark.parametrize(
    "kept", [Kept(), Kept(Null.NULL), Kept(Null.NULL, Site(lat_deg=1.0)), Kept(None, Null.NULL)]
)
def test_a_null_that_stands_reads_back(kept):
    assert from_json(Kept, to_json(kept), name="kept.json") == kept


def test_a_record_reads_back():
    again = from_json(Result, to_json(RESULT), name="result.json")
    assert again == RESULT
    assert again.verdict is Outcome.REFUSED  # the first kind of several that holds the value
    assert [type(site) for site in again.sites] == [Long, Site]
    newer = json.loads(to_json(RESULT)) | {"key_of_a_later_version": 1, "verdict": "later"}
    assert from_json(Result, newer, name="result.json").verdict == "later"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            {"sites": [{"lat_deg": "north", "lon_deg": 0.0}]},
            'sites[0].lat_deg: got "north", needed a number',
        ),
        ({"sites": [3]}, "sites[0]: got 3, needed keys with values"),
        ({"counts": 3}, "counts: got 3, needed keys with values"),
        ({"spans_s": 3}, "spans_s: got 3, needed a list"),
        ({"verdict": 3}, "verdict: got 3, needed"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_key(change, line):
    wrong = json.loads(to_json(RESULT)) | change
    with pytest.raises(InputError) as error:
        from_json(Result, wrong, name="result.json")
    assert str(error.value).startswith("result.json: ") and "\n" not in str(error.value)
    assert line in str(error.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}"])
def test_what_is_no_document_is_one_line(text):
    with pytest.raises(InputError, match=r"result\.json: ") as error:
        from_json(Result, text, name="result.json")
    assert "\n" not in str(error.value)


def test_help_loads_no_pydantic():
    code = "import sys, recal.cli.app; assert 'pydantic' not in sys.modules, 'loaded'"
    subprocess.run([sys.executable, "-c", code], check=True)


@written("bias=bias.name half")
@dataclass(frozen=True)
class Shown:
    bias: Site
    size: float

    @property
    def half(self) -> float:
        return 0.5 * self.size


@dataclass(frozen=True)
class ShownTwice(Shown):
    size: float = 4.0


def test_named_keys_take_properties_and_attributes_of_fields():
    """A path wins over the field of the same name; a derived class has its own fields as keys."""
    place = SimpleNamespace(name="Bern")
    assert plain(Shown(place, 3.0)) == {"bias": "Bern", "half": 1.5}
    assert list(plain(ShownTwice(None))) == ["bias", "size"]


of_place = MadeOf[SimpleNamespace]()


@dataclass(frozen=True, kw_only=True)
class Place:
    lat_deg: float = of_place(lambda place: place.lat_rad * 2.0)
    run_id: str
    note: str | None = of_place(lambda place: place.note, OMIT_NONE, default=None)


def test_a_document_is_made_where_its_fields_are_declared():
    found = SimpleNamespace(lat_rad=0.5, note=None)
    assert plain(made(Place, found, run_id="a")) == {"lat_deg": 1.0, "run_id": "a"}
    assert made(Place, found, run_id="a", lat_deg=3.0).lat_deg == 3.0
    with pytest.raises(TypeError, match="run_id"):
        made(Place, found)
    with pytest.raises(AttributeError, match="lat_rad"):
        made(Place, SimpleNamespace(note=None), run_id="a")


def test_a_field_that_is_made_needs_its_key_in_a_file_unless_it_has_a_default():
    read = from_json(Place, {"lat_deg": 1.0, "run_id": "a"}, name="x")
    assert read == Place(lat_deg=1.0, run_id="a")
    with pytest.raises(InputError, match="lat_deg"):
        from_json(Place, {"run_id": "a"}, name="x")
