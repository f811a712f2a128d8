"""Recordings that a plan may ask for: what they are called, and a simulated run of each as the
diagnosis would see it.

A recording is made with the twin's noise along a motion of `trajectories.simulator.motions` and a
temperature history of `trajectories.simulator.thermal`. Only its motion and temperatures matter
here: the whitening does not depend on the noise drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from infield.table.file import table_to_dict
from infield.table.thermal_table import ThermalTable
from ins.attitude import dcm_from_euler
from ins.documents import written
from ins.records import InputError, Run, Site, TwinModel
from ins.units import DEG, HOUR
from simreal.evidence.run_view import RunView, view_run
from trajectories.simulator.motions import lay
from trajectories.simulator.segments import Park, Segment, Stop, Straight, Turn
from trajectories.simulator.sensors import ideal_sensors
from trajectories.simulator.session import SessionPlan, simulate_run
from trajectories.simulator.thermal import STARTS, ThermalHistory, thermal_history
from trajectories.simulator.truth import build_truth
from trajectories.simulator.unit_truth import aged_unit

RATE_HZ = 10.0
# switched off for a moment
HOT_RESTART = ThermalHistory(ambient_degC=20.0, start_degC=42.0, settled_degC=42.0)
START_WORDS = {
    "cold": "a cold start",
    "ambient": "a start at ambient temperature",
    "hot": "a hot start in the sun",
    "cooling": "a cooling start (warm unit in cold air)",
    "hot_restart": "a restart while warm",
}
AIDS = ("gnss", "odometer")
TAXI_COST_HOURS, AID_COST_HOURS = 0.5, 0.1  # trouble of a recording, to choose among equals
_LEG = Straight(duration_s=60.0)
_TAXI: tuple[Segment, ...] = (
    Turn(angle_deg=90.0),
    _LEG,
    Stop(duration_s=40.0),
    Turn(angle_deg=-90.0, speed_m_s=6.0),
    _LEG,
    Turn(angle_deg=-90.0),
    Stop(duration_s=40.0),
    Turn(angle_deg=90.0, speed_m_s=6.0),
    _LEG,
    Stop(duration_s=60.0),
)


@written("recording=name words start heading_deg hours taxi gnss odometer")
@dataclass(frozen=True, kw_only=True)
class Recording:
    """One power-on: where its temperature starts, parked heading, length, whether it ends in a taxi
    with turns, and aids.

    variant: 0 as the name says; else another day, its temperatures a few degC off
    (`trajectories.simulator.thermal`).
    """

    start: str = "cold"
    heading_deg: float = 0.0
    hours: float = 1.0
    taxi: bool = False
    aids: tuple[str, ...] = ()
    variant: int = 0

    @property
    def name(self) -> str:
        day = f" (day {self.variant + 1})" if self.variant else ""
        motion = f"taxi{''.join('+' + aid for aid in self.aids)}" if self.taxi else "parked"
        return f"{self.start} {self.hours:g} h {self.heading_deg:g} deg {motion}{day}"

    @property
    def words(self) -> str:
        """What to do, in plain words."""
        aids = " and ".join({"gnss": "GNSS", "odometer": "odometer"}[aid] for aid in self.aids)
        end = (
            ", then a taxi with left and right turns and"
            f" stops{f', with {aids} logged' if aids else ''}"
            if self.taxi
            else ""
        )
        return (
            f"{START_WORDS[self.start]}, {self.hours:g} h parked on heading {self.heading_deg:g}"
            f" deg{end}"
        )

    @property
    def gnss(self) -> bool:
        return "gnss" in self.aids

    @property
    def odometer(self) -> bool:
        return "odometer" in self.aids

    @property
    def cost_hours(self) -> float:
        return self.hours + TAXI_COST_HOURS * self.taxi + AID_COST_HOURS * len(self.aids)


def candidates(without: Sequence[str] = ()) -> tuple[Recording, ...]:
    """The recordings a plan chooses from: starts by length, by heading, and ending in a taxi with
    and without aids.
    """
    out = [Recording(start=s) for s in START_WORDS]
    out += [
        Recording(start=s, hours=h) for h in (2.0, 3.0) for s in ("cold", "ambient", "hot_restart")
    ]
    out += [Recording(start=s, heading_deg=h) for h in (90.0, 180.0, 270.0) for s in START_WORDS]
    if "taxi" not in without:
        live = tuple(aid for aid in AIDS if aid not in without)
        choices = dict.fromkeys([(), *((aid,) for aid in live), live])
        out += [Recording(start=s, taxi=True, aids=aids) for aids in choices for s in STARTS]
    return tuple(out)


def short_list(heading_deg: float, without: Sequence[str] = ()) -> tuple[Recording, ...]:
    """A few recordings that settle most questions, for an answer in seconds: on the heading known
    already and beside it.
    """
    beside = (heading_deg + 90.0) % 360.0
    out = [
        Recording(start=s, heading_deg=heading_deg) for s in ("ambient", "cooling", "hot_restart")
    ]
    out.append(Recording(start="hot_restart", heading_deg=heading_deg, hours=3.0))
    out.append(Recording(start="cooling", heading_deg=beside))
    if "taxi" not in without:
        out.append(
            Recording(
                start="ambient",
                heading_deg=beside,
                taxi=True,
                aids=tuple(a for a in AIDS if a not in without),
            )
        )
    return tuple(out)


def _quiet(twin: TwinModel) -> TwinModel:
    """The twin without effects, and without the slow noise and the sway of what it simulates: of a
    recording only its motion and temperatures count, and half of the time to make one went into
    noise that no signature looks at.
    """
    return replace(
        twin,
        effects=(),
        gyro=replace(twin.gyro, bias_instability_deg_h=0.0, rate_random_walk_deg_h_sqrt_h=0.0),
        accel=replace(twin.accel, bias_instability_ug=0.0, rate_random_walk_ug_sqrt_h=0.0),
        vehicle=replace(twin.vehicle, sway_m_s=0.0),
    )


@dataclass
class RecordingMaker:
    """Simulates recordings of one twin at one site and views them; each is made once."""

    twin: TwinModel
    table: ThermalTable | None
    site: Site
    seed: int = 0
    without: tuple[str, ...] = ()
    _made: dict[Recording, Run] = field(default_factory=dict)

    def view(self, recording: Recording, index: int = 0) -> RunView:
        """The recording as the diagnosis would see it. InputError where the simulated unit cannot
        be used at all.
        """
        full = replace(recording, aids=AIDS)
        if full not in self._made:
            self._made[full] = self._simulate(full)
        run = self._made[full]
        run = replace(
            run,
            gnss=run.gnss if recording.gnss else None,
            odometer=run.odometer if recording.odometer else None,
        )
        if "gradient" in self.without and run.temperature is not None:
            run = replace(run, temperature=replace(run.temperature, gradient_degC=None))
        view = view_run(run, index, self.table, self.twin)
        if isinstance(view, str):
            raise InputError(
                f"twin {self.twin.source}: a simulated recording ({recording.name}) cannot be used:"
                f" {view}"
            )
        level = np.round(dcm_from_euler(0.0, 0.0, recording.heading_deg * DEG), 12)
        # as simulated: one noise covariance serves all recordings of a length
        return replace(view, C_nb=level)

    def _simulate(self, recording: Recording) -> Run:
        twin = _quiet(self.twin)
        rng = np.random.default_rng([self.seed, recording.variant])
        thermal = (
            HOT_RESTART
            if recording.start == "hot_restart"
            else thermal_history(recording.start, rng=rng if recording.variant else None)
        )
        parked_s = recording.hours * HOUR
        motion = lay((Park(duration_s=parked_s), *(_TAXI if recording.taxi else ())))
        truth = build_truth(motion, self.site, heading_rad=recording.heading_deg * DEG)
        unit = aged_unit(
            np.random.default_rng(self.seed),
            gyro_technology=twin.gyro_technology,
            ageing_offset_deg_h=0.0,
            ageing_shape_deg_h=0.0,
            table=None if self.table is None else table_to_dict(self.table),
        )
        return simulate_run(
            ideal_sensors(truth, RATE_HZ),
            thermal,
            unit,
            twin,
            rng=rng,
            plan=SessionPlan(
                with_gnss=recording.taxi, with_odometer=recording.taxi, run_id=recording.name
            ),
        ).run
