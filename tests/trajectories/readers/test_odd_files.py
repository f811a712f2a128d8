"""Files that are no log, and texts as spreadsheets of other countries and systems write them: read,
or one line that helps.
"""

import bz2
import gzip
import lzma
import zipfile

import numpy as np
import pytest

from ins import user_input
from ins.records import InputError
from tests.trajectories.readers.hostile_rows import convert, noisy
from tests.trajectories.readers.known_motion import GIVEN
from tests.trajectories.readers.test_maps import MAP, N, csv_text
from trajectories.readers.conversion import convert_log
from trajectories.readers.registry import readers

TEXT = csv_text({k: v[:3000] for k, v in noisy().items()})
NAMES, ROWS = TEXT.split("\n", 1)
FILES = {
    "log.zip": (b"PK\x03\x04 and more", "a zip file: unpack it first"),
    "log.csv.bz2": (bz2.compress(TEXT.encode()), "a bzip2 file"),
    "log.csv.xz": (lzma.compress(TEXT.encode()), "a xz file"),
    "log.ulg.zst": (b"\x28\xb5\x2f\xfd....", "a zstd file"),
    "log.bin": (gzip.compress(TEXT.encode()), r"a gzip file without \.gz"),
    "log.mcap": (b"", r"the file is empty \(0 bytes\)"),
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("options", [{}, MAP, {"format": "ros"}], ids=["", "map", "format"])
def test_no_log(tmp_path, name, options):
    data, line = FILES[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=rf"{name}: {line}"):
        convert_log(tmp_path / name, options, GIVEN)


def test_a_whole_zip(tmp_path):
    with zipfile.ZipFile(tmp_path / "logs.zip", "w") as archive:
        archive.writestr("log.csv", TEXT)
    with pytest.raises(InputError, match="a zip file"):
        convert_log(tmp_path / "logs.zip", MAP, GIVEN)


def test_links_and_folders(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match=r"a: a link that leads nowhere"):
        convert_log(tmp_path / "a", MAP, GIVEN)
    (tmp_path / "c.csv").symlink_to(tmp_path / "log.csv")
    (tmp_path / "log.csv").write_text(TEXT)
    assert convert_log(tmp_path / "c.csv", MAP, GIVEN).run.imu.rows == 3000
    with pytest.raises(InputError, match="a folder without a bag"):
        convert_log(tmp_path, {}, GIVEN)
    for reader in readers():
        if not reader.folder:
            with pytest.raises(
                InputError, match=rf"a folder, needed a file: a {reader.name} log is one"
            ):
                convert_log(tmp_path, {"format": reader.name}, GIVEN)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "part_0.mcap").write_bytes(b"")
    with pytest.raises(InputError, match=r"bag: a folder without a bag"):
        convert_log(tmp_path / "bag", {}, GIVEN)


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text(TEXT)

    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(user_input.os, "open", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        convert_log(path, MAP, GIVEN)


GERMAN = TEXT.replace(",", ";").replace(".", ",")
LAYOUTS = {
    "Windows line ends": (TEXT.replace("\n", "\r\n"), {}),
    "old Mac line ends": (TEXT.replace("\n", "\r"), {}),
    "byte order mark": ("\ufeff" + TEXT, {}),
    "spaces": (TEXT.replace("t,wx", " t , wx ", 1).replace(",", ", "), {}),
    "all quoted": (
        "\n".join(",".join(f'"{v}"' for v in row.split(",")) for row in TEXT.splitlines()) + "\n",
        {},
    ),
    "comma at the end": (TEXT.replace("\n", ",\n"), {}),
    "decimal commas": (GERMAN, {"delimiter": ";", "decimal": ","}),
    "decimal commas and tabs": (GERMAN.replace(";", "\t"), {"delimiter": "\t", "decimal": ","}),
    "decimal commas and spaces": (
        GERMAN.replace(";", "  "),
        {"format": "text", "decimal": ",", "header_lines": 1},
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_texts_of_other_programs(tmp_path, name):
    text, keys = LAYOUTS[name]
    (tmp_path / "log.csv").write_bytes(text.encode())
    run = convert_log(tmp_path / "log.csv", MAP | keys, GIVEN).run
    (tmp_path / "plain.csv").write_text(TEXT)
    np.testing.assert_array_equal(
        run.imu.dtheta_rad, convert_log(tmp_path / "plain.csv", MAP, GIVEN).run.imu.dtheta_rad
    )


REFUSED = {
    "UTF-16": (TEXT.encode("utf-16"), {}, "text in UTF-16, needed UTF-8"),
    "decimal commas": (
        GERMAN.encode(),
        {"delimiter": ";"},
        r'column t: got \'5000,01\', needed a number: decimal = "," in the map',
    ),
    "semicolons": (GERMAN.encode(), {}, 'needed delimiter = ";" in the map'),
    "decimal commas between commas": (
        TEXT.encode(),
        {"decimal": ","},
        'decimal = "," needs another delimiter',
    ),
    "thousands and semicolons": (
        TEXT.replace(",", ";").replace("\n5000.", "\n5,000.").encode(),
        {"delimiter": ";"},
        r"got '5,000\.01'",
    ),
    "thousands of Switzerland": (
        TEXT.replace("\n5000.", "\n5'000.").encode(),
        {},
        "thousands separators",
    ),
    "other case": (TEXT.replace("wx", "Wx", 1).encode(), {}, "no column wx, has t Wx wy"),
    "one value too many": (
        (NAMES + "\n" + ROWS.replace("\n", ",\n")).encode(),
        {},
        r"\(line 2\): 8 values, needed 7",
    ),
    "no rows": (f"{NAMES}\n".encode(), {}, "no rows"),
    "one row": (TEXT[: TEXT.index("\n5000.02") + 1].encode(), {}, "1 usable rows"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_texts_that_are_refused(tmp_path, name):
    data, keys, line = REFUSED[name]
    (tmp_path / "log.csv").write_bytes(data)
    with pytest.raises(InputError, match=line) as refusal:
        convert_log(tmp_path / "log.csv", MAP | keys, GIVEN)
    assert "\n" not in str(refusal.value)


def test_rows_of_other_streams_between_those_of_the_imu(tmp_path):
    """A log with a row for each message, empty where the other sensor speaks: nothing is missing,
    nothing counts as lost.
    """
    columns = {k: np.insert(v, np.arange(10, N, 10), np.nan) for k, v in noisy().items()}
    late = np.isnan(columns["t"])
    columns["t"][late] = noisy()["t"][10::10] - 0.004
    columns["T"] = np.where(late, 20.0 + np.arange(late.size) / 1000, np.nan)
    made = convert(tmp_path, columns, {"temperature": {"columns": ["T"]}})
    assert made.run.imu.rows == N
    assert made.run.faults == ()
    assert made.run.temperature.time_s.size == 60
    assert made.record.notes[0].endswith(
        "more stretches dropped: no value of the imu (rows of other streams)"
    )


def degC(made) -> np.ndarray:
    return made.run.temperature.gyro_degC[:, 0]


WARM = 20.0 + np.arange(N) / 1e4
WRONG = [
    (WARM + 273.15, {}, 'kelvin\\? unit = "K"'),
    (WARM * 100, {}, "hundredths\\? scale = 0.01"),
    (WARM * 1000, {}, "thousandths\\? scale = 0.001"),
    (WARM, {"unit": "K"}, "degC taken for kelvin"),
    (WARM * 1.8 + 52.0, {"unit": "K"}, 'degF taken for kelvin\\? unit = "degF"'),
    (0 * WARM + 3e9, {}, "counts\\? unit and scale"),
]


@pytest.mark.parametrize(
    ("values", "keys", "line"), WRONG, ids=["K", "centi", "milli", "not K", "degF not K", "counts"]
)
@pytest.mark.parametrize("apart", [False, True], ids=["rows", "file"])
def test_temperatures_in_another_unit_are_refused(tmp_path, values, keys, line, apart):
    columns = noisy()
    part = {"columns": ["T"], **keys}
    if apart:
        (tmp_path / "oven.csv").write_text(
            csv_text({"stamp": columns["t"][::100], "T": values[::100]})
        )
        part |= {"file": "oven.csv", "time": {"column": "stamp"}}
    with pytest.raises(InputError, match=rf"temperatures are .* degC, needed -60 to 125: {line}"):
        convert(tmp_path, columns if apart else columns | {"T": values}, {"temperature": part})


def test_single_wild_temperatures_are_left_out_and_stuck_ones_said(tmp_path):
    keys = {"temperature": {"columns": ["T"]}}
    wild = np.where(np.isin(np.arange(N), [300, 301]), -273.15, WARM)
    made = convert(tmp_path, noisy() | {"T": wild}, keys)
    assert degC(made).min() >= 20.0
    assert "2 of 6000 temperatures" in str(made.record.notes)
    made = convert(tmp_path, noisy() | {"T": 0 * WARM}, keys)
    assert "all 6000 temperatures are 0 degC" in str(made.record.notes)
    with pytest.raises(InputError, match=r"temperature column T has no value, needed one$"):
        convert(tmp_path, noisy() | {"T": WARM * np.nan}, keys)
    three = {"temperature": {"columns": ["T", "U", "V"]}}
    empty = {"T": WARM, "U": WARM, "V": WARM * np.nan}
    with pytest.raises(InputError, match=r"column V has no value, needed one beside T U$"):
        convert(tmp_path, noisy() | empty, three)
    turns = {"T": WARM, "U": np.where(np.arange(N) % 2, WARM, np.nan)}
    turns["V"] = np.where(np.arange(N) % 2, np.nan, WARM)
    with pytest.raises(InputError, match=r"columns T U V hold no complete row, needed one$"):
        convert(tmp_path, noisy() | turns, three)
