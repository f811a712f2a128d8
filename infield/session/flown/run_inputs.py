"""Inputs of the update of a run that flies."""

from dataclasses import dataclass, replace

from numpy.typing import NDArray

from alignment.motion.inertial import Where
from infield.session.bins import SessionBins
from infield.session.flown.priors import Layout, laid_out
from infield.session.navigated.own_errors import LoggedRun, OwnErrors, own_errors
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.estimation import error_model as em
from ins.records import Run, TwinModel


@dataclass(frozen=True)
class RunInputs:
    """A run with its temperatures, table, twin and settings."""

    run: Run
    table: ThermalTable
    temperature: GyroTemperature
    twin: TwinModel
    settings: SessionSettings

    def with_shift(self, size_deg_h: float) -> "RunInputs":
        """The same with gyros that may read so much more in flight than at rest (1 sigma)."""
        return replace(
            self, settings=self.settings.with_shift(self.run.header.gyro_technology, size_deg_h)
        )

    def own_errors(self, layout: Layout, flight: Where, rest: Where, C_nb: NDArray) -> OwnErrors:
        """What users' errors add, their states after the further ones; rest: a first stretch of the
        session, at the attitude C_nb (3, 3).
        """
        errors = own_errors(
            LoggedRun(self.run, self.table, self.temperature),
            self.twin,
            rest=rest,
            attitude=lambda: C_nb,
            first=layout.first + layout.sigma.size,
        )
        return replace(errors, airborne=flight)

    def layout(self, bins: SessionBins) -> Layout:
        """Where the further states stand, after the bins."""
        technology = self.run.header.gyro_technology
        return laid_out(
            self.settings.flight,
            technology,
            first=em.BASE + bins.table_deg_h.size,
            scale_ppm=self.settings.sigma_scale_factor_ppm[technology],
            accel_z_ug=max(self.twin.accel.turn_on_ug, 1.0),
        )
