"""`recal table diff A B`: revisions and files, what the difference is worth, its page."""

import json

import numpy as np
import pytest

from infield.store.table_store import MergedRun, TableStore
from infield.table.file import csv_text, json_text, table_to_dict
from infield.table.thermal_table import EvenNodes, default_table
from ins.records import InputError
from recal.service.table_diff import table_diff
from tests.drawn import specifications
from tests.recal import command

STORE = "sqlite:///recal.db"
NODES = 0.01  # of sigma: between two nodes it is smaller, for their errors are not all common
SHIFT_deg_h = 0.003  # of gyro x at all temperatures


def table(shift_deg_h=0.0, sigma_deg_h=0.01, serial="SN-1"):
    made = default_table(
        imu_serial=serial,
        gyro_technology="rlg",
        created_utc="2026-03-01T05:00:00Z",
        span=EvenNodes(low_degC=0, high_degC=20),
        sigma_deg_h=sigma_deg_h,
    )
    parameters = made.parameters.copy()
    parameters[made.values_of("x")] = shift_deg_h
    return made.replaced(parameters=parameters)


@pytest.fixture
def stored(folder):
    """Revision 1 of the factory, 2 an update of it with a third of its sigma."""
    old, new = table(), table(SHIFT_deg_h, 0.001)
    with TableStore.open(STORE, create=True) as store:
        first = store.import_table(table_to_dict(old))
        new = new.replaced(provenance={"parent_sha256": first.sha256})
        store.commit_update(first.sha256, new, [MergedRun(run_id="r", sha256="1" * 64)], "{}")
    (folder / "old.json").write_text(json_text(table_to_dict(old)))
    (folder / "other.json").write_text(json_text(table_to_dict(table(serial="SN-2"))))
    (folder / "new.csv").write_text(csv_text(new))
    return folder


@pytest.mark.parametrize("a, b", [("previous", "active"), ("1", "2"), ("old.json", "active")])
def test_the_drift_of_an_update_is_known_as_its_table_is(stored, a, b):
    """60 NM/h for each deg/h of the level gyros, and the sigma of x and y together."""
    worth = table_diff(a, b, STORE).record.worth
    assert worth.sigma_of == "after" and worth.significant
    assert worth.drift_nm_h == pytest.approx(60 * SHIFT_deg_h)
    assert worth.sigma_drift_nm_h == pytest.approx(60 * 0.001 * np.sqrt(2), rel=NODES)
    back = table_diff(b, a, STORE).record.worth
    assert back.sigma_of == "before"
    assert back.sigma_drift_nm_h == pytest.approx(worth.sigma_drift_nm_h)


def test_tables_of_separate_origin_are_taken_as_independent(stored):
    worth = table_diff("1", "new.csv", STORE).record.worth
    assert worth.sigma_of == "both" and not worth.significant
    assert worth.sigma_level_deg_h == pytest.approx(np.sqrt(2) * np.hypot(0.01, 0.001), rel=NODES)


def test_two_files_need_no_store(stored):
    found = table_diff("new.csv", "old.json", "sqlite:///nowhere.db")
    assert found.record.axes["x"].change_deg_h == pytest.approx([-SHIFT_deg_h] * 3)
    with pytest.raises(InputError, match="SN-2"):
        table_diff("old.json", "other.json", STORE)
    with pytest.raises(InputError, match="serial"):
        table_diff("new.csv", "new.csv", STORE)


def test_the_command_writes_page_and_document(stored):
    said = command.run("table", "diff", "factory", "new.csv", "-o", "out", "--json")
    assert said.exit_code == 0, said.output
    assert json.loads(said.stdout) == json.loads((stored / "out/diff.json").read_text())
    assert len(specifications((stored / "out/diff.html").read_text())) == 6
    (stored / "out/diff.json").write_text("{}")
    assert "--force" in command.refused("table", "diff", "-o", "out")
