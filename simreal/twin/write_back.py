"""twin.json with the found effects in its `effects` (formats.md, section 3), ready to be simulated
and diagnosed again.

Each item has the parameters that `simreal.declared.twin_effects` reads: coefficients and shape
parameters as plain numbers in the effect's units; `run_id` for what belongs to one run, `process`
for a slow variation, nodes, values and unit for a free function; and `sigma`, one standard
deviation of what was found. A cause that data do not bear which it was not fitted to stays out, and
so does one that an update would take out of its log although it is not unique or implausibly large
(`Cause.kept_out`). The table is copied beside the twin, so the file needs nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ins.errors.base import SLOW_NAME
from ins.errors.table import TABLE_AGED
from ins.errors.unnamed import OF_RUN
from ins.records import EffectDocument, ParameterValue, TwinModel
from ins.twin_file import TwinDocument, twin_to_dict
from simreal.declared.generic import OF_UNNAMED_MOTION
from simreal.declared.node_function import unit_of
from simreal.declared.twin_effects import PER_RUN, PROCESS, RUN_ID
from simreal.inference.causes import Cause

TABLE_NAME = "table.json"


def twin_with_causes(
    twin: TwinModel, causes: Sequence[Cause], run_ids: Sequence[str], *, with_table: bool
) -> TwinDocument:
    """The twin as a plain dict, the causes after the effects that it has already.

    run_ids : of the runs, in the order of the diagnosis. with_table : a table is written beside it,
    as TABLE_NAME.
    """
    added = tuple(item for cause in causes for item in effect_items(cause, run_ids))
    return twin_to_dict(
        replace(twin, table=TABLE_NAME if with_table else None, effects=(*twin.effects, *added))
    )


def effect_items(cause: Cause, run_ids: Sequence[str]) -> list[EffectDocument]:
    """A cause as items of a twin's `effects`: one, or one a run where each run has a coefficient of
    its own; none of a cause that is kept out.
    """
    return [] if cause.kept_out is not None else fitted_items(cause, run_ids)


def fitted_items(cause: Cause, run_ids: Sequence[str]) -> list[EffectDocument]:
    """A cause as items that say what was fitted to these runs, whether other data bear it or
    not.
    """
    if cause.effect in (TABLE_AGED, *OF_UNNAMED_MOTION):
        return []
    if not cause.named:
        return [_item(cause, _function(cause, run_ids))]
    if cause.repeats == "P":
        return [_item(cause, {**own, RUN_ID: run_id}) for run_id, own in _by_run(cause).items()]
    parameters: dict[str, ParameterValue] = {
        name: float(p.value) for name, p in cause.parameters.items()
    }
    if cause.effect == SLOW_NAME:
        parameters[PROCESS] = cause.id
    if cause.run_id is not None:
        parameters[RUN_ID] = cause.run_id
    sigma = {
        name: float(p.sigma)
        for name, p in cause.parameters.items()
        if p.sigma is not None and p.sigma_from == "fit"
    }
    item = _item(cause, parameters)
    return [{**item, "sigma": sigma} if sigma else item]


def _item(cause: Cause, parameters: Mapping[str, ParameterValue]) -> EffectDocument:
    return {"effect": cause.effect, "target": cause.target, "parameters": dict(parameters)}


def _function(cause: Cause, run_ids: Sequence[str]) -> dict[str, ParameterValue]:
    of_run = cause.effect == OF_RUN
    nodes: ParameterValue = list(run_ids) if of_run else [float(n) for n in cause.nodes]
    return {
        "nodes": nodes,
        "values": [float(v) for v in cause.values],
        "unit": unit_of(cause.target),
    }


def _by_run(cause: Cause) -> dict[str, dict[str, float]]:
    """Coefficients of each run, from names like `coefficient[run-1]`, with what all have in
    common.
    """
    own: dict[str, dict[str, float]] = {}
    common: dict[str, float] = {}
    for key, parameter in cause.parameters.items():
        of_one = PER_RUN.fullmatch(key)
        of = common if of_one is None else own.setdefault(of_one[2], {})
        of[key if of_one is None else of_one[1]] = float(parameter.value)
    return {run_id: {**values, **common} for run_id, values in own.items()}
