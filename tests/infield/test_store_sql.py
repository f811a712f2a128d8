"""No SQL is put together from strings: what is executed is a constant or an expression, values are
parameters.
"""

import ast
from pathlib import Path

import pytest

import infield

ROOT = Path(infield.__file__).parent.parent
RUNS_SQL = {
    "execute",
    "exec_driver_sql",
    "text",
    "executemany",
    "executescript",
    "scalar",
    "scalars",
    "DDL",
}
SOURCES = sorted(
    path for package in ("infield", "recal", "simreal") for path in (ROOT / package).rglob("*.py")
)


def built_sql(source):
    """Where a call that runs SQL gets a string that was built: f"", +, %, .format or .join."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        called = (
            node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        )
        if called in RUNS_SQL and any(map(_built, ast.walk(node.args[0]))):
            yield node.lineno


def _built(node):
    if isinstance(node, ast.Call):
        return (
            isinstance(node.func, ast.Attribute)
            and node.func.attr in ("format", "join", "replace")
            and isinstance(node.func.value, ast.Constant)
        )
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.Mod | ast.Add) and any(
            isinstance(side, ast.Constant | ast.JoinedStr)
            and isinstance(getattr(side, "value", ""), str)
            for side in (node.left, node.right)
        )
    return isinstance(node, ast.JoinedStr | ast.FormattedValue)


def test_no_sql_is_built_from_strings():
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in SOURCES
        for line in built_sql(path.read_text())
        if "sqlalchemy" in path.read_text() or "sqlite3" in path.read_text()
    ]
    assert len(SOURCES) > 50 and found == []


@pytest.mark.parametrize(
    "source",
    [
        'c.execute(text(f"SELECT * FROM t WHERE a = {a}"))',
        'c.execute("SELECT " + name)',
        'c.exec_driver_sql("PRAGMA %s" % p)',
        'c.execute(text("SELECT {}".format(a)))',
        'op.execute(f"DROP TABLE {name}")',
        'text(" AND ".join(parts))',
    ],
)
def test_the_check_sees_what_it_should(source):
    assert set(built_sql(source)) == {1}


@pytest.mark.parametrize(
    "source",
    [
        'c.execute(text("SELECT 1 WHERE a = :a"), {"a": a})',
        "c.execute(select(unit).where(unit.c.a == a + 1))",
    ],
)
def test_the_check_lets_parameters_pass(source):
    assert list(built_sql(source)) == []
