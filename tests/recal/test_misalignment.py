"""`recal misalignment` as a user runs it: tables, runs, exit codes, the twin it writes, bad input
in one line.
"""

import json

import numpy as np
import pytest

from infield.store.table_store import TableStore
from ins.records import InputError
from ins.twin_file import read_twin, twin_to_dict
from tests.drawn import specifications, unscripted
from tests.infield.azimuth_cases import TWIN, one_power_on, unit
from tests.recal import command
from trajectories.runs.directory import write_run

HEADER = "north_to_west_deg,bias_x_deg_h,bias_y_deg_h,bias_z_deg_h"
ROWS = (
    "0,0.01,-0.02,0.03577",
    "90,0.00654,-0.02,0.03",
    "180,0.01,-0.02,0.02423",
    "270,0.01346,-0.02,0.03",
)
HEADINGS_UNKNOWN = ("k.csv", "--lat-deg", "39.9", "--sigma-deg-h", "0.001")
TABLE = (*HEADINGS_UNKNOWN, "--sigma-heading-deg", "0")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    put()
    return tmp_path


def put(header=HEADER, rows=ROWS):
    with open("k.csv", "w", encoding="utf-8") as stream:
        stream.write("\n".join((header, *rows)) + "\n")


def run(*arguments):
    return command.run("misalignment", *arguments)


def result_of(*arguments, exit_code=0):
    return command.answered("misalignment", *arguments, "-q", exit_code=exit_code)


def by_entry(document):
    return {c["entry"]: c for c in document["couplings"]}


def test_a_table_of_the_document_gives_both_couplings_and_its_closed_forms(folder):
    document = result_of(*TABLE)
    assert document["schema"] == "recal.misalignment/1" and document["verdict"] == "measured"
    found = by_entry(document)
    assert found["zx"]["value_arcsec"] == pytest.approx(103.1, abs=0.2)  # 0.5 mrad
    # north to west: exy = -xy = 0.3 mrad
    assert found["xy"]["value_arcsec"] == pytest.approx(-61.9, abs=0.2)
    assert all(
        found[e]["sigma_arcsec"] == pytest.approx(12.6, abs=0.05) for e in ("xy", "yx", "zx", "zy")
    )
    forms = document["closed_forms"]
    assert forms["exy"]["value_arcsec"] == pytest.approx(61.9, abs=0.2)
    assert forms["ezy"]["value_arcsec"] == pytest.approx(103.1, abs=0.2)
    assert forms["ezy_as_printed_arcsec"] == pytest.approx(66.6 * 206.265, rel=2e-3)
    assert {row["what"] for row in document["not_observable"]} >= {"xz", "yz", "z own axis"}
    out = folder / "recal-misalignment"
    assert json.loads((out / "misalignment.json").read_text()) == document
    page = (out / "misalignment.html").read_text()
    assert specifications(page) and "http" not in unscripted(page) and "Measured" in page


def test_the_error_that_headings_share_is_in_the_sigmas_by_default(folder):
    exact, found = (by_entry(result_of(*given)) for given in (TABLE, HEADINGS_UNKNOWN))
    for entry in ("xy", "yx"):
        assert found[entry]["value_arcsec"] == pytest.approx(exact[entry]["value_arcsec"], abs=1e-9)
        common = np.sqrt(found[entry]["sigma_arcsec"] ** 2 - exact[entry]["sigma_arcsec"] ** 2)
        assert common == pytest.approx(360.0, rel=1e-3)  # 0.1 deg
    for entry in ("zx", "zy", "xy+yx"):
        assert found[entry]["sigma_arcsec"] == pytest.approx(exact[entry]["sigma_arcsec"])
    assert "within 0.1 deg" in result_of(*HEADINGS_UNKNOWN)["azimuths"]
    seconds = by_entry(result_of(*TABLE[:-2], "--sigma-north-arcsec", "360"))
    assert seconds["xy"]["sigma_arcsec"] == pytest.approx(found["xy"]["sigma_arcsec"])


def test_the_twin_takes_the_sum_where_north_is_poor(folder):
    result_of(*HEADINGS_UNKNOWN, "--twin-out", "twin.json")
    misalignment = read_twin(folder / "twin.json").gyro.misalignment_mrad
    xy, yx = misalignment[0], misalignment[2]
    assert xy == pytest.approx(yx)


def test_one_run_with_four_stops_and_the_twin_that_it_writes(folder):
    write_run(folder / "run", one_power_on(45.0).run)
    (folder / "unit.json").write_text(json.dumps(twin_to_dict(TWIN)))
    with TableStore.open("sqlite:///recal.db", create=True) as store:
        store.import_table(unit().factory_table(np.arange(-20.0, 61.0, 10.0)))
    document = result_of("run", "--twin", "unit.json", "--twin-out", "twin.json", "-o", "out")
    assert document["verdict"] == "measured" and len(document["stops"]) == 4
    assert document["stops"][0]["run_id"] == "run-45-1" and document["runs"][0]["sha256"]
    twin = read_twin(folder / "twin.json")
    assert twin.gyro.misalignment_mrad[4] == pytest.approx(document["misalignment_mrad"]["zx"])
    assert twin.gyro.sigma_misalignment_mrad[4] > 0 == twin.gyro.sigma_misalignment_mrad[1]
    outcome = run("run", "--twin", "unit.json", "--north-to-west-deg", "45,135,225,315")
    assert outcome.exit_code == 4 and "counted from north to west?" in outcome.stdout
    assert run("run", "--twin", "unit.json", "--heading-deg", "45,135,225,315").exit_code == 0


@pytest.mark.parametrize(
    ("rows", "exit_code", "told"),
    [
        (ROWS[:3], 4, "none near"),
        ((*ROWS[:3], "273" + ROWS[3][3:]), 4, "3.00 deg off"),
        ((*ROWS[:3], "270,0.5,-0.02,0.03"), 5, "contradict"),
    ],
)
def test_verdicts_and_exit_codes(folder, rows, exit_code, told):
    put(rows=rows)
    document = result_of(*TABLE, "--twin-out", "twin.json", exit_code=exit_code)
    assert told in document["reasons"][0] and not (folder / "twin.json").exists()
    if exit_code == 4:
        assert document["couplings"] == []
        assert document["gyros"] == {}
        assert document["rank"]["needed"] == 3
    assert (folder / "recal-misalignment/misalignment.html").exists()


@pytest.mark.parametrize(
    ("header", "rows", "told"),
    [
        ("azimuth_deg" + HEADER[17:], ROWS, "which way it counts"),
        (HEADER, (), "0 rows"),
        (HEADER.replace("bias_y", "bias_w"), ROWS, "bias_y_deg_h is missing"),
        (HEADER + ",note", ROWS, "'note' is unknown"),
        (HEADER, (*ROWS[:2], "180,x,0,0"), "row 3: bias_x_deg_h = 'x'"),
        (HEADER, ("0,1,2",), "row 1: 3 values, needed 4"),
        (HEADER, ("400,0,0,0",), "within +-360"),
        ("heading_deg," + HEADER, ROWS, "exactly one of"),
        (
            HEADER + ",sigma_x_deg_h,sigma_y_deg_h,sigma_z_deg_h",
            [r + ",1,0,1" for r in ROWS],
            "row 1: sigma_y_deg_h = 0",
        ),
        (HEADER + ",sigma_x_deg_h", ROWS, "sigma_y_deg_h is missing"),
    ],
)
def test_bad_tables_are_one_line(folder, header, rows, told):
    put(header, rows)
    outcome = run(*TABLE)
    assert isinstance(outcome.exception, InputError) and told in str(outcome.exception)
    assert "k.csv" in str(outcome.exception) and "\n" not in str(outcome.exception)
    assert not (folder / "recal-misalignment").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("k.csv", "--sigma-deg-h", "0.001"),
        (*TABLE, "--heading-deg", "0,90,180,270"),
        (*TABLE, "--sigma-north-arcsec", "30"),
        ("run", "--heading-deg", "0,ninety"),
        ("run", "--heading-deg", "0", "--north-to-west-deg", "0"),
    ],
)
def test_wrong_usage_is_exit_code_2(folder, arguments):
    assert run(*arguments).exit_code == 2


def test_compensated_biases_are_level(folder):
    document = result_of(*TABLE)
    rows = np.array([stop["compensated_deg_h"] for stop in document["stops"]])
    assert np.ptp(rows, axis=0).max() < 1e-5
    assert document["gyros"]["z"]["spread_before_deg_h"] == pytest.approx(0.01154)
