"""`recal table` as a user runs it: files in, files out, one line and exit code 3 where something is
wrong.
"""

import json

import pytest

from infield.store.table_store import MergedRun, TableStore
from infield.table.file import json_text, table_sha256, table_to_dict
from infield.table.thermal_table import EvenNodes, default_table
from ins.records import TwinModel
from ins.twin_file import twin_to_dict
from tests.recal import command

UTC = "2026-03-01T05:00:00Z"


SIGNED = ("--by", "B", "--reason", "why")  # of a rollback


def table_file(folder, serial="SN-1", technology="rlg", name="table.json"):
    data = table_to_dict(
        default_table(
            imu_serial=serial,
            gyro_technology=technology,
            created_utc=UTC,
            span=EvenNodes(low_degC=0, high_degC=20),
        )
    )
    data["axes"]["y"]["bias_deg_h"] = [0.1 + 0.2, 1e-17, -3]
    (folder / name).write_text(json_text(data))
    return data


def run(*arguments):
    return command.run("table", *arguments)


def ok(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, (result.output, result.exception)
    return result.stdout


def refused(*arguments):
    return command.refused("table", *arguments)


def test_export_import_export_is_bit_identical(folder):
    data = table_file(folder)
    about = json.loads(ok("import", "table.json", "--json"))
    assert about["sha256"] == table_sha256(data) and about["kind"] == "factory"
    ok("export", "-o", "sub/one.json", "-q")
    assert json.loads((folder / "sub/one.json").read_text()) == data
    ok("import", "sub/one.json", "--store", "sqlite:///other.db")
    ok("export", "-o", "two.json", "--store", "sqlite:///other.db", "--serial", "SN-1")
    assert (folder / "sub/one.json").read_bytes() == (folder / "two.json").read_bytes()


def test_csv_needs_serial_and_technology(folder):
    table_file(folder)
    ok("import", "table.json")
    ok("export", "-o", "t.csv")
    assert run("import", "t.csv").exit_code == 2
    ok("import", "t.csv", "--serial", "SN-2", "--technology", "fog")
    ok("export", "-o", "again.csv", "--serial", "SN-2")
    assert (folder / "again.csv").read_text() == (folder / "t.csv").read_text()


def test_export_wants_a_file_of_a_known_kind(folder):
    table_file(folder)
    ok("import", "table.json")
    assert run("export").exit_code == 2 and run("export", "-o", "t.xlsx").exit_code == 2


@pytest.mark.parametrize(
    "damage, clue",
    [
        ({"schema": "recal.table/2"}, "schema"),
        ({"covariance": [[1.0]]}, "covariance"),
        ({"extra": 1}, "unknown key"),
    ],
)
def test_bad_table_is_refused_and_no_store_made(folder, damage, clue):
    data = table_file(folder)
    (folder / "table.json").write_text(json.dumps({**data, **damage}))
    line = refused("import", "table.json")
    assert line.startswith("table.json: ") and clue in line
    assert not (folder / "recal.db").exists()


def test_serial_rules(folder):
    table_file(folder)
    assert "SN-7" in refused("import", "table.json", "--serial", "SN-7")
    ok("import", "table.json")
    assert "SN-1" in ok("show")
    assert "no table for serial SN-9" in refused("show", "--serial", "SN-9")
    assert "no table for serial SN-9" in refused("list", "--serial", "SN-9")
    table_file(folder, serial="SN-2")
    ok("import", "table.json")
    assert "several units" in refused("show")
    assert "several units" in refused("export", "-o", "t.json")
    assert "SN-2" in ok("show", "--serial", "SN-2")


def test_show_json_is_the_table_itself(folder):
    data = table_file(folder)
    ok("import", "table.json")
    refused("diff")
    assert table_sha256(json.loads(ok("show", "--json"))) == table_sha256(data)


def updated_store(folder):
    """A store whose unit SN-1 has one update of +0.001 deg/h on all nodes."""
    table_file(folder)
    ok("import", "table.json")
    with TableStore.open("sqlite:///recal.db") as store:
        first = store.active()
        table = first.table.replaced(
            parameters=first.table.parameters + 0.001,
            covariance=first.table.covariance / 4,
            provenance={"parent_sha256": first.sha256, "runs": ["abc"]},
        )
        store.commit_update(first.sha256, table, [MergedRun(run_id="run-1", sha256="abc")], "{}")


def test_diff_list_and_rollback(folder):
    updated_store(folder)
    change = json.loads(ok("diff", "--json"))
    assert change["from"]["revision"] == 1
    assert change["to"]["runs"] == [{"run_id": "run-1", "sha256": "abc"}]
    assert change["axes"]["x"]["change_deg_h"] == pytest.approx([0.001] * 3)
    assert change["axes"]["x"]["sigma_after_deg_h"] == pytest.approx([0.005] * 3)
    assert "+0.00100" in ok("diff") and "+0.00000" in ok("diff", "--from", "2", "--to", "active")
    ok("rollback", "--to", "factory", "--serial", "SN-1", "--by", "B", "--reason", "lab says so")
    text = ok("list", "-v")
    assert "rollback" in text
    assert "[active]" in text
    assert "[factory]" in text
    assert "lab says so" in text
    unit = json.loads(ok("list", "--json"))["units"][0]
    assert [r["kind"] for r in unit["revisions"]] == ["factory", "update", "rollback"]
    assert unit["revisions"][2]["sha256"] == unit["revisions"][0]["sha256"]
    for wrong in ("3", "17", "last"):
        refused("rollback", "--to", wrong, *SIGNED)
    for wrong in ("17", "last"):
        refused("show", "--revision", wrong)


def test_import_sets_the_twin_without_opening_its_table(folder):
    table_file(folder)
    twin = TwinModel(imu_serial="SN-1", table="nowhere/table.json")
    (folder / "twin.json").write_text(json.dumps(twin_to_dict(twin)))
    ok("import", "table.json", "--twin", "twin.json")
    with TableStore.open("sqlite:///recal.db") as store:
        assert store.twin("SN-1").gyro == twin.gyro
    table_file(folder, serial="SN-2")
    assert "SN-2" in refused(
        "import", "table.json", "--twin", "twin.json", "--store", "sqlite:///new.db"
    )
    assert not (folder / "new.db").exists()


def test_a_serial_has_one_technology_unless_that_is_overridden_and_noted(folder):
    """R24: a table of another unit under the serial is a swapped unit until overridden."""
    table_file(folder)
    table_file(folder, technology="fog", name="fog.json")
    ok("import", "table.json")
    assert refused("import", "fog.json").startswith(
        "fog.json: gyro_technology fog, the store holds SN-1 (rlg): another unit?"
    )
    assert len(json.loads(ok("list", "--json"))["units"]) == 1
    about = json.loads(
        ok("import", "fog.json", "--override-technology", "--note", "rebuilt", "--json")
    )
    assert (
        about["note"]
        == "rebuilt; technology overridden: gyro_technology fog, the store holds SN-1 (rlg):"
        " another unit?"
    )
    assert about["note"] in ok("list")
    assert json.loads(ok("import", "fog.json", "--json"))["revision"] == 1  # known by now


@pytest.mark.parametrize(("technology", "limit"), [("rlg", 10.0), ("fog", 100.0), ("mems", 2e4)])
def test_a_table_in_another_unit_is_refused_unless_that_is_overridden_and_noted(
    folder, technology, limit
):
    """A table 3,600 times too large became a factory table."""
    table_file(folder, technology=technology)
    table = json.loads((folder / "table.json").read_text())
    for key in ("bias_deg_h", "sigma_deg_h"):
        nodes = table["axes"]["y"][key]
        for size, is_sound in ((0.99 * limit, True), (1.01 * limit, False)):
            wild = {**table["axes"]["y"], key: [size, *nodes[1:]]}
            text = json.dumps({**table, "axes": {**table["axes"], "y": wild}, "covariance": None})
            (folder / "wild.json").write_text(text)
            if is_sound:
                ok("import", "wild.json", "--store", f"sqlite:///sound-{key}.db")
                continue
            said = refused("import", "wild.json", "--store", "sqlite:///wild.db")
            assert said.startswith(f"wild.json: axes.y.{key}: got {size:g}")
            assert not (folder / "wild.db").exists()
    ok("import", "wild.json", "--any-size", "--store", "sqlite:///wild.db")
    assert f"got {size:g}" in ok("list", "--store", "sqlite:///wild.db")
