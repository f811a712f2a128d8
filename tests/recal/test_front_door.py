"""`import recal`: what a notebook user finds, and that it does what its pages say."""

import doctest
import importlib
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import recal
from infield.store.errors import StoreRefused
from infield.store.table_store import TableStore
from ins.records import InputError
from tests.infield.sessions import factory_dict, simulated
from trajectories.runs.directory import write_run

ROOT = Path(recal.__file__).parent.parent
HEAVY = ("numpy", "scipy", "pandas", "pyarrow", "numba", "plotly", "sqlalchemy", "pydantic")
VERBS = sorted(name for name in recal.__all__ if name[0].islower())
URL = "sqlite:///recal.db"
NUMBER = re.compile(r"[-+]?\d+\.\d+")
SAVED = '.write_html("tables.html")'  # a notebook shows what the tutorial writes
LAST_DIGITS = 0.05  # mrad, deg, NM/h: a sixth of the sigmas that are printed


def block(page: str, *, after: str = "```python\n") -> str:
    """The block of a page that begins with these words."""
    return (ROOT / page).read_text().partition(after)[2].partition("```")[0]


def printed(page: str) -> str:
    """What the first block of Python of a page is said to print."""
    return block(page, after="It prints:\n\n```\n")


def test_import_recal_loads_no_heavy_library_and_little_else():
    code = (
        "import sys, recal; dir(recal); "
        f"print([name for name in {HEAVY} if name in sys.modules], len(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("[] ") and int(done.stdout.split()[-1]) < 150


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_says_shapes_units_errors_and_an_example(name):
    said = inspect.getdoc(getattr(recal, name))
    for heading in ("Parameters", "Returns", "Raises", "Examples"):
        assert f"{heading}\n{'-' * len(heading)}\n" in said
    assert ">>> import recal" in said
    for argument in inspect.signature(getattr(recal, name)).parameters:
        assert re.search(rf"^(\w+, )*{argument}(, \w+)* : ", said, re.MULTILINE), argument


@pytest.mark.parametrize("module", sorted(set(recal._HOMES.values())))
def test_the_examples_do_what_they_say(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = importlib.import_module(f"recal.service.{module}")
    flags = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
    failed, tried = doctest.testmod(found, optionflags=flags)
    assert tried and not failed


def test_the_session_of_the_tutorial_runs_as_it_stands(tmp_path):
    code, said = block("docs/python.md"), printed("docs/python.md")
    assert len(code.splitlines()) <= 15
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
    )
    assert NUMBER.sub("#", done.stdout) == NUMBER.sub("#", said)
    shown, wanted = (list(map(float, NUMBER.findall(text))) for text in (done.stdout, said))
    assert shown == pytest.approx(wanted, abs=LAST_DIGITS)
    assert {p.name for p in tmp_path.iterdir()} == {"recal.db", "update.html", "tables.html"}


def test_the_notebook_is_the_session_of_the_tutorial():
    """Every code cell, one after the other, is the block that the test above runs."""
    cells = json.loads((ROOT / "docs/tutorial.ipynb").read_text("utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    lines = block("docs/python.md").replace(SAVED, "").splitlines()
    assert "\n".join(code).splitlines() == [line for line in lines if line]
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    printed = "".join("".join(o["text"]) for o in outputs if o["output_type"] == "stream")
    said = (ROOT / "docs/python.md").read_text("utf-8").split("It prints:\n\n```\n")[1]
    assert [*map(float, NUMBER.findall(printed))] == pytest.approx(
        [*map(float, NUMBER.findall(said.split("```")[0]))], abs=LAST_DIGITS
    )
    (drawn,) = [o["data"] for o in outputs if o["output_type"] == "display_data"]
    titles = drawn["application/vnd.plotly.v1+json"]["layout"]["annotations"]
    assert [title["text"] for title in titles] == ["Gyro x", "Gyro y", "Gyro z"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("front-door")
    write_run(folder / "run", simulated(1).run)
    (folder / "table.json").write_text(json.dumps(factory_dict()))
    return folder


@pytest.fixture(scope="module")
def result(folder):
    return recal.update([str(folder / "run")], folder / "table.json")


def test_paths_records_one_or_several_give_the_same(folder, result, monkeypatch):
    monkeypatch.chdir(folder)
    run, table = recal.read_run("run"), recal.read_table(Path("table.json"))
    again = recal.update(run, table)
    for one, other in zip(result.points, again.points, strict=True):
        assert one == other
    assert again.table_before.gyro_technology == result.table_before.gyro_technology


def test_a_record_of_the_stored_table_is_the_stored_table(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with recal.open_store(URL) as store:
        store.import_table(factory_dict())
        table = recal.read_table(folder / "table.json")
        found = recal.update(folder / "run", table, store=store)
        assert store.commit(found, by="A. Engineer").number == 2


def test_a_result_is_frozen_short_and_shows_itself(result, tmp_path):
    with pytest.raises(AttributeError):
        result.document = {}
    lines = repr(result).splitlines()
    assert lines[0].endswith(result.verdict) and 4 <= len(lines) <= 9
    gyros = [line for line in lines if "; mean bias of the run, 1 sigma" in line]
    assert [line.split()[:2] for line in gyros] == [["gyro", f"{axis}:"] for axis in "xyz"]
    assert result._repr_html_().startswith("<pre>")
    assert json.loads(result.to_json()) == result.to_dict()
    assert "<html" in result.to_html(tmp_path / "update.html").read_text()
    with pytest.raises(NotImplementedError, match="no report"):
        recal.check("nowhere").to_html(tmp_path / "check.html")


def test_points_become_a_frame_and_a_figure(result):
    frame = result.points.to_frame()
    assert len(frame) == len(result.points) and set(frame.axis) == set("xyz")
    found = list(frame.columns[:5])
    assert found == ["axis", "time_s", "temperature_degC", "bias_deg_h", "sigma_deg_h"]
    figure = result.plot()
    assert {trace.xaxis or "x" for trace in figure.data} == {"x", "x2", "x3"}
    assert figure.to_json() == result.plot().to_json()
    found = [trace.name for trace in figure.data if trace.showlegend]
    assert found == ["before", "after", "points, U(k=2)"]


def test_without_plotly_a_plot_says_what_to_install(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(InputError, match=r"pip install 'strapdown-recal\[plot\]'"):
        result.plot()


def test_a_commit_is_the_table_and_is_signed(result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with recal.open_store(URL) as store:
        with pytest.raises(InputError, match="by"):
            store.commit(result, by="", new_unit=True)
        with pytest.raises(StoreRefused, match=r"holds no table of SN-0042 .*it holds no unit"):
            store.commit(result, by="A. Engineer")
        assert store.units() == []
        done = store.commit(
            result, by="A. Engineer", note="first flight of the year", new_unit=True
        )
    assert (done.number, done.kind) == (2, "update") and "A. Engineer" in done.note
    with TableStore.open(URL) as store:
        held = store.active()
        T = held.table.temperature_degC[0]
        assert np.array_equal(held.table.bias_deg_h("x", T), result.table.bias_deg_h("x", T))
        assert json.loads(held.report_json)["verdict"] == "committed"


def test_a_refusal_is_a_result_that_no_store_takes(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with recal.open_store(URL) as store:
        store.import_table(factory_dict())
        store.commit(recal.update(folder / "run", store=store), by="A. Engineer")
        again = recal.update(folder / "run", store=URL)
        assert again.verdict == "refused" and again.reasons
        with pytest.raises(InputError, match="needed proposed"):
            store.commit(again, by="A. Engineer")
