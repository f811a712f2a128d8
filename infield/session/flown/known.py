"""What the update of a run that flies takes for known."""

from dataclasses import dataclass, replace

from alignment.navigation_filter import ParkedConstraint
from infield.session.bins import SessionBins
from infield.session.flown.priors import Layout, laid_out
from infield.session.settings import SessionSettings
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.estimation import error_model as em
from ins.records import Run, TwinModel


@dataclass(frozen=True)
class KnownRun:
    """A run, its temperatures, and what its update takes for known."""

    run: Run
    table: ThermalTable
    temperature: GyroTemperature
    twin: TwinModel
    settings: SessionSettings

    def with_shift(self, size_deg_h: float) -> "KnownRun":
        """The same with gyros that may read so much more in flight than at rest (1 sigma)."""
        return replace(
            self, settings=self.settings.with_shift(self.run.header.gyro_technology, size_deg_h)
        )

    def layout(self, bins: SessionBins, parked: ParkedConstraint) -> Layout:
        """Where the further states stand, after the bins and the states of a place that swings."""
        technology = self.run.header.gyro_technology
        return laid_out(
            self.settings.flight,
            technology,
            first=em.BASE + bins.table_deg_h.size + parked.swing_states,
            scale_ppm=self.settings.sigma_scale_factor_ppm[technology],
            accel_z_ug=max(self.twin.accel.turn_on_ug, 1.0),
        )
