"""Strapdown inertial navigation that recalibrates its gyros in the field.

A session: `run = recal.read_run("run-1")`, `result = recal.update(run, table, twin)`,
`result.to_html("update.html")`, `with recal.open_store(url) as store: store.commit(result,
by="...")`. Every verb takes paths or records, one run or several, and gives a frozen result with
`verdict`, `reasons`, `to_json()`, `to_dict()` and `to_html(path)`.

What a name needs is imported when the name is first used.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from recal.service.align import align
    from recal.service.check import check
    from recal.service.convert import convert
    from recal.service.diagnose import diagnose
    from recal.service.inputs.records import read_table, read_twin
    from recal.service.look.look import look
    from recal.service.look.own_runs import Run, read_run
    from recal.service.misalignment import misalignment
    from recal.service.plan import PlanRequest, plan
    from recal.service.replay import replay
    from recal.service.simulate import simulate
    from recal.service.store import open_store
    from recal.service.thermal import fit_fog, fit_rlg
    from recal.service.twin.fit import fit_twin
    from recal.service.update import update

    __version__: str

_HOMES = {
    "PlanRequest": "plan",
    "Run": "look.own_runs",
    "align": "align",
    "check": "check",
    "convert": "convert",
    "diagnose": "diagnose",
    "fit_fog": "thermal",
    "fit_rlg": "thermal",
    "fit_twin": "twin.fit",
    "look": "look.look",
    "misalignment": "misalignment",
    "open_store": "store",
    "plan": "plan",
    "read_run": "look.own_runs",
    "read_table": "inputs.records",
    "read_twin": "inputs.records",
    "replay": "replay",
    "simulate": "simulate",
    "update": "update",
}

__all__ = [
    "PlanRequest",
    "Run",
    "__version__",
    "align",
    "check",
    "convert",
    "diagnose",
    "fit_fog",
    "fit_rlg",
    "fit_twin",
    "look",
    "misalignment",
    "open_store",
    "plan",
    "read_run",
    "read_table",
    "read_twin",
    "replay",
    "simulate",
    "update",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from recal.service.results.files import program_version

        return program_version()
    if name not in _HOMES:
        raise AttributeError(f"module 'recal' has no attribute {name!r}")
    found: object = getattr(importlib.import_module(f"recal.service.{_HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
