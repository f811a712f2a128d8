"""Table and noise model of a unit: given, from the store, or from the technology's defaults."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from alignment import coarse, gyrocompass
from alignment.motion.inertial import BRIEF_BLOCKS
from infield.reports.documents.thermal import ThermalUseDocument, use_document
from infield.session.log import find_rest
from infield.session.parked.zero_rate import unknown_sigma_deg_h
from infield.session.reasons import NewUnitReason, NoiseReason
from infield.store.errors import NoStore
from infield.store.table_store import TableStore, UnknownUnit, store_exists
from infield.table.file import table_to_dict
from infield.table.thermal_table import ThermalTable, default_table
from infield.thermal.stored_model import (
    prepared,
    read_thermal_model,
    seeded_table,
    with_model_sigma,
)
from infield.thermometer.gyro_temperature import gyro_temperature, too_short
from ins.earth import EARTH_RATE_RAD_S
from ins.errors.table import RAW_BIAS_DEG_H
from ins.records import Run, TableDocument, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG, DEG_PER_HOUR
from ins.verdicts import Reason, because
from recal.service.inputs.records import (
    AnyRun,
    AnyTable,
    AnyTwin,
    table_of,
    twin_fit_command,
    twin_of,
)
from recal.service.inputs.twin_table import twin_of_unit


class NoiseSource(StrEnum):
    """Where the noise model of a unit comes from (formats.md, section 6: `noise_source`)."""

    FITTED = "fitted"  # by recal twin fit, whichever way it came
    TWIN_FILE = "twin file"
    STORE = "store"
    DEFAULTS = "defaults"  # written with the technology that they are of


@dataclass(frozen=True)
class UnitInputs:
    """`table_dict`: the table as stored, whose hash is the stored one; `known`: the store holds the
    unit, at `revision`, or its table is `given`; `noise`: where the twin comes from.
    """

    table: ThermalTable
    table_dict: TableDocument
    twin: TwinModel
    known: bool
    revision: int = 0
    given: bool = False
    noise: NoiseSource = NoiseSource.TWIN_FILE

    @property
    def noise_source(self) -> str:
        """As documents name it."""
        if self.twin.fit is not None:
            return NoiseSource.FITTED.value
        if self.noise is NoiseSource.DEFAULTS:
            return f"{self.noise} of {self.table.gyro_technology}"
        return self.noise.value

    def new_unit_notes(self, runs: Sequence[Run]) -> tuple[Reason, ...]:
        """What an update of a unit without a table rests on; none of one that has a table, or
        without a session.
        """
        if self.known or not runs:
            return ()
        table = self.table
        sigma = float(table.sigma_deg_h(0, table.temperature_degC[0])[0])
        nothing = because(
            NewUnitReason.FROM_NOTHING, sigma_deg_h=sigma, technology=table.gyro_technology
        )
        if table.gyro_technology == "mems":
            return (nothing,)
        run = max(runs, key=lambda run: run.header.site.sigma_lat_rad)
        site = run.header.site
        level_deg_h = EARTH_RATE_RAD_S * np.cos(site.lat_rad) / DEG_PER_HOUR
        by_latitude = because(
            NewUnitReason.VERTICAL_BY_LATITUDE,
            run_id=run.header.run_id,
            latitude_deg=site.lat_rad / DEG,
            sigma_deg=site.sigma_lat_rad / DEG,
            source=site.lat_source.value,
            deg_h_a_hundredth=float(0.01 * DEG * level_deg_h),
        )
        return nothing, by_latitude

    def noise_note(self, runs: Sequence[AnyRun]) -> Reason | None:
        """That sigma rests on defaults, and what would measure the noise; None where a noise model
        of the unit was there.
        """
        if self.noise is not NoiseSource.DEFAULTS:
            return None
        return because(
            NoiseReason.DEFAULTS,
            imu_serial=self.table.imu_serial,
            technology=self.table.gyro_technology,
            command=twin_fit_command(runs),
        )


def given_unit(
    run: Run, table: AnyTable | None, twin: AnyTwin | None, store: TableStore | str | None
) -> UnitInputs:
    """What is believed of the unit that made this run: the table given, else the store's."""
    found = unit_inputs(run, opened(store), twin)
    if table is None:
        return found
    record, data = table_of(table)
    if found.known and table_to_dict(found.table) == table_to_dict(record):
        return found  # with the stored text, whose hash an update is committed to
    return replace(found, table=record, table_dict=data, known=True, given=True, revision=0)


def unit_inputs(run: Run, store: TableStore | None, given_twin: AnyTwin | None) -> UnitInputs:
    """What is believed of the unit that made this run, by the store."""
    header = run.header
    key = (header.imu_serial, header.gyro_technology, header.gyro_mode)
    twin = None if given_twin is None else twin_of(given_twin)
    noise = NoiseSource.DEFAULTS if twin is None else NoiseSource.TWIN_FILE
    if store is not None:
        try:
            revision = store.active(*key)
            stored = store.twin(*key) if twin is None else None
            return UnitInputs(
                revision.table,
                revision.table_dict,
                twin_of_unit(twin or stored or default_twin(header.gyro_technology), run),
                True,
                revision.number,
                noise=noise if stored is None else NoiseSource.STORE,
            )
        except UnknownUnit:
            pass
    twin = twin_of_unit(twin or default_twin(header.gyro_technology), run)
    table = table_of_unknown_unit(run, twin)
    return UnitInputs(table, table_to_dict(table), twin, False, noise=noise)


def table_of_unknown_unit(run: Run, twin: TwinModel) -> ThermalTable:
    """No table for a unit: bias 0 and the raw bias of its technology as sigma, widened by what
    |omega| of the parked log shows.
    """
    header = run.header
    sigma = raw_bias_sigma_deg_h(run, twin)
    # its warm-up shows too, and it may rest where a gyrocompass sees none
    if header.gyro_technology == "mems":
        temperature = (
            None
            if too_short(run.temperature) or run.temperature is None
            else gyro_temperature(run.temperature)
        )
        sigma = unknown_sigma_deg_h(run, twin, temperature, sigma)
    return default_table(
        imu_serial=header.imu_serial,
        gyro_technology=header.gyro_technology,
        gyro_mode=header.gyro_mode,
        created_utc=header.start_utc,
        sigma_deg_h=sigma,
    )


def raw_bias_sigma_deg_h(run: Run, twin: TwinModel) -> float:
    """Sigma of the biases of gyros that nobody knows [deg/h]: the raw bias of their technology,
    widened by what |omega| of the parked log shows.
    """
    rest = find_rest(run) or find_rest(run, BRIEF_BLOCKS)
    if rest is None:
        return RAW_BIAS_DEG_H[run.header.gyro_technology]
    means = coarse.earth_rate_means(run.imu.between(*rest))
    return gyrocompass.unknown_bias_sigma_deg_h(twin, means)


def with_thermal_model(
    unit: UnitInputs, runs: list[Run], path: Path | None
) -> tuple[UnitInputs, list[Run], Callable[[ThermalTable], ThermalUseDocument | None]]:
    """Unit and runs as a thermal model leaves them (without one: as they are), and what to say of
    it beside a table.
    """
    stored = None if path is None else read_thermal_model(path)
    runs, removed = prepared(runs, stored)
    if stored is None:
        return unit, runs, lambda table: None
    # goes into the table that is merged
    learnt_with = {**unit.table.provenance, "thermal_model_sha256": stored.sha256}
    unit = replace(
        unit,
        twin=with_model_sigma(unit.twin, removed),
        table=unit.table.replaced(provenance=learnt_with),
    )
    if not unit.known:
        table = seeded_table(unit.table, stored)
        unit = replace(unit, table=table, table_dict=table_to_dict(table))
    return unit, runs, lambda table: use_document(stored, removed, table)


def opened(store: TableStore | str | None) -> TableStore | None:
    """The store that was given, or opened to read; None where there is none."""
    return open_store(store) if isinstance(store, str) else store


def open_store(url: str, *, create: bool = False, any_clock: bool = False) -> TableStore | None:
    """The store, None where a command that only reads finds none."""
    if not create and not store_exists(url):
        return None
    try:
        return TableStore.open(url, create=create, any_clock=any_clock)
    except NoStore:  # a server's database that holds no recal tables
        return None
