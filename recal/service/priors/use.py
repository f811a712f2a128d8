"""The priors that an update goes by: those approved in the store, those of a file, or none."""

import json
from dataclasses import replace
from pathlib import Path

from infield.learning.parameters import PriorName
from infield.reports.documents.update_records import PriorsUse
from infield.session.settings import SessionSettings
from infield.store.priors import PriorsRecord
from infield.store.table_store import TableStore
from ins.json_file import read_json_object
from ins.records import InputError, TwinModel
from recal.service.inputs.unit_inputs import NoiseSource, UnitInputs
from recal.service.priors.document import TechnologyPriors, priors_of

APPROVED, DEFAULT = "approved", "default"


def priors_in_use(choice: str, store: TableStore | None, unit: UnitInputs) -> PriorsUse | None:
    """The priors of a unit by `choice`: approved, default (none), or a file; None: the defaults
    stand.

    Raises
    ------
    InputError
        Where the file is none, or says nothing of the technology.
    """
    technology = unit.table.gyro_technology
    name, found, record = chosen_priors(choice, store, technology)
    if not name:
        return None
    if found is None:
        raise InputError(f"{name}: says nothing of {technology}")
    return _use(found, choice, record, unit)


def chosen_priors(
    choice: str, store: TableStore | None, technology: str
) -> tuple[str, TechnologyPriors | None, PriorsRecord | None]:
    """Name of what was chosen ("": the defaults stand), what it says of the technology, and where
    the store has it.
    """
    record = None
    if choice in (APPROVED, DEFAULT):
        if choice == APPROVED and store is not None:
            record = store.priors_in_use(technology)
        if record is None:
            return "", None, None
        name, data = f"priors {record.number} of {technology}", json.loads(record.priors_json)
    else:
        name, data = choice, read_json_object(Path(choice))
    of = priors_of(data, name=name).technologies
    return name, next((t for t in of if t.gyro_technology == technology), None), record


def _use(
    found: TechnologyPriors, source: str, record: PriorsRecord | None, unit: UnitInputs
) -> PriorsUse:
    """Of the unit where it was learnt from, else of its technology."""
    name = " ".join(filter(None, (unit.table.imu_serial, unit.table.gyro_mode)))
    scope = next((u for u in found.units if u.name == name), found.technology)
    known = {**found.technology.parameters, **scope.parameters}
    values = {key: value.value for key, value in known.items()}
    which = source if record is None else f"revision {record.number}"
    common, shape = values[PriorName.AGEING_COMMON], values[PriorName.AGEING_SHAPE]
    return PriorsUse(
        source=source,
        gyro_technology=found.gyro_technology,
        scope=scope.name,
        revision=None if record is None else record.number,
        sha256=None if record is None else record.sha256,
        parameters=values,
        text=(
            f"priors of {found.gyro_technology}, {which}, for {scope.name}: ageing {common:.2g}"
            f" deg/h common and {shape:.2g} deg/h shape per square root of a year"
        ),
    )


def with_priors(unit: UnitInputs, use: PriorsUse) -> UnitInputs:
    """The unit with what was learnt of its noise, where its noise model rests on defaults: a twin
    of its own stands.
    """
    if unit.noise is not NoiseSource.DEFAULTS:
        return unit
    value, twin = use.parameters, unit.twin
    gyro = replace(
        twin.gyro,
        turn_on_deg_h=value[PriorName.TURN_ON],
        bias_instability_deg_h=value[PriorName.FLICKER],
        rate_random_walk_deg_h_sqrt_h=value[PriorName.RANDOM_WALK],
    )
    vehicle = replace(twin.vehicle, yaw_creep_arcsec_sqrt_h=value[PriorName.YAW_CREEP])
    return replace(unit, twin=_named(replace(twin, gyro=gyro, vehicle=vehicle), use))


def _named(twin: TwinModel, use: PriorsUse) -> TwinModel:
    which = f"revision {use.revision}" if use.source == APPROVED else use.source
    return replace(twin, source=f"{twin.source}, priors {which}")


def settings_of(use: PriorsUse, settings: SessionSettings) -> SessionSettings:
    """Settings with the crab that taxis of the technology showed, where nobody set another."""
    crab = use.parameters.get(PriorName.CRAB)
    if crab is None or settings.sigma_crab_mrad != SessionSettings().sigma_crab_mrad:
        return settings
    return replace(settings, sigma_crab_mrad=crab)
