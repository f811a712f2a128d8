"""`recal plan` as a user runs it: documents, pages, runs at hand, exit codes."""

import json

import pytest

from ins.records import InputError, Site
from ins.twin_file import default_twin, twin_to_dict
from ins.units import DEG
from simreal.plan import flights
from simreal.plan.recordings import Recording, RecordingMaker
from tests.drawn import specifications, unscripted
from tests.recal import command
from trajectories.runs.directory import write_run

TWO = ("--separate", "gyro_thermal_linear,gyro_warmup_transient", "--without", "taxi")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A few recordings to choose from and one plan to compare: the whole lists take ten seconds."""
    few = [Recording(start=start) for start in ("cold", "ambient", "cooling", "hot_restart")]
    monkeypatch.setattr("simreal.plan.study.candidates", lambda without: tuple(few))
    monkeypatch.setattr("simreal.plan.study.COMPARED", {"1 cold": tuple(few[:1])})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    return command.run("plan", *arguments)


def result_of(*arguments, exit_code=0):
    return command.answered("plan", *arguments, "-q", exit_code=exit_code)


def test_a_plan_from_nothing(folder):
    (folder / "unit.json").write_text(json.dumps(twin_to_dict(default_twin("fog"))))
    document = result_of(
        "--twin", "unit.json", *TWO, "--separate", "gyro_g_sensitivity,gyro_turn_on_bias"
    )
    assert document["schema"] == "recal.plan/1" and document["gyro_technology"] == "fog"
    first, second = document["recommended"]["pairs"]
    assert first["verdict"].startswith("separated") and first["cos"] < 0.9
    for member in (first["a"], first["b"]):
        (size,) = member["coefficients"]
        assert 0 < size["seen_from"] <= size["told_from"]
    assert second["verdict"] == "not_testable" and "flight" in second["lacks"]
    assert [n["label"] for n in document["never"]] == [second["label"]]
    assert "heading error" in [n["b"] for n in document["inseparable"]]
    cold = next(p for p in document["compared"] if p["name"] == "1 cold")
    assert cold["pairs"][0]["cos"] > 0.95 > document["recommended"]["pairs"][0]["cos"]
    assert json.loads((folder / "recal-plan/plan.json").read_text()) == document
    page = (folder / "recal-plan/plan.html").read_text()
    assert len(specifications(page)) == 1 and "http" not in unscripted(page)
    assert "heading error" in page and "flight" in page


def test_runs_at_hand_and_the_one_more_that_helps(folder):
    maker = RecordingMaker(
        default_twin("rlg"), None, Site(lat_rad=50 * DEG, lon_rad=7 * DEG, height_m=100.0)
    )
    write_run(folder / "cold", maker.view(Recording()).run)
    document = result_of("cold", *TWO, "-o", "out")
    assert document["lat_deg"] == pytest.approx(50.0)
    assert document["given"]["run_ids"] == [Recording().name]
    assert document["given"]["pairs"][0]["cos"] > 0.95 and document["compared"] == []
    assert document["steps"][0]["start"] != "cold"
    assert document["next"][0]["recording"] == document["steps"][0]["recording"]
    assert "helps most" in (folder / "out/plan.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--separate", "gyro_thermal_linaer,clock_rate"), "nearest: gyro_thermal_linear"),
        (("--separate", "a"), "two effects"),
        (("--twin", "none.json"), "none.json"),
        (("no-run",), "no-run"),
    ],
)
def test_bad_input_is_one_line(folder, arguments, said):
    outcome = run(*arguments)
    assert isinstance(outcome.exception, InputError) and said in str(outcome.exception)
    assert "\n" not in str(outcome.exception) and not (folder / "recal-plan").exists()


def test_flights_are_planned_where_they_are_asked_for(folder, monkeypatch):
    """One flight of the list, to save time."""
    few = tuple(flight for flight in flights.FLIGHTS if flight.name == "short")
    monkeypatch.setattr(flights, "FLIGHTS", few)
    document = result_of(*TWO, "--flights")
    (flight,) = document["flights"]
    assert flight["flight"] == "short" and flight["best_for"] == ["x", "y", "z"]
    for gyro in flight["gyros"]:
        assert 0.0 < gyro["sigma_after_deg_h"] < gyro["sigma_before_deg_h"]
    cold = [n for n in flight["nodes"] if n["temperature_degC"] == -10.0]
    assert len(cold) == 3 and all(n["after_deg_h"] < n["before_deg_h"] for n in cold)
    assert "What flights would show" in (folder / "recal-plan/plan.html").read_text()


def test_flights_of_units_without_a_heading_are_bad_input(folder):
    outcome = run(*TWO, "--flights", "--technology", "mems")
    assert isinstance(outcome.exception, InputError)
    assert "gyro_technology" in str(outcome.exception)
    assert not (folder / "recal-plan").exists()
