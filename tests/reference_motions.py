"""The motions of physics.md 6.7, by name: what studies and tests of accuracy drive."""

from ins.units import DEG
from trajectories.simulator.motions import SimulatedMotion, lay
from trajectories.simulator.segments import Park, Pivot, Segment, Stop, Straight, Turn

PARKED_S = 4200.0  # 10 min of alignment and 60 min extended, physics.md 6.7
_LEG_300 = Straight(duration_s=300.0, speed_m_s=10.0, acceleration_m_s2=1.0)
_LEG_200 = Straight(duration_s=200.0, speed_m_s=10.0, acceleration_m_s2=1.0)
# heading at alignment [deg], what follows the parking
_REFERENCE: dict[str, tuple[float, tuple[Segment, ...]]] = {
    "parked_only": (0.0, ()),
    "straight_taxi": (0.0, (_LEG_300,)),
    "taxi_0_180": (0.0, (Turn(angle_deg=180.0), _LEG_300)),
    "taxi_0_90": (0.0, (Turn(angle_deg=90.0), _LEG_300)),
    "taxi_m90_p90_300": (-90.0, (Turn(angle_deg=180.0), _LEG_300)),
    "taxi_m90_p90_600": (-90.0, (Turn(angle_deg=180.0), _LEG_300, _LEG_300)),
    "taxi_m90_p90_300_stop_120": (-90.0, (Turn(angle_deg=180.0), _LEG_300, Stop(duration_s=120.0))),
    "legs_90_180_90": (
        0.0,
        (
            Turn(angle_deg=90.0),
            _LEG_200,
            Stop(duration_s=60.0),
            Turn(angle_deg=90.0),
            _LEG_200,
            Stop(duration_s=60.0),
            Turn(angle_deg=-90.0),
            _LEG_200,
            Stop(duration_s=60.0),
        ),
    ),
    "turn_90_park_20min": (0.0, (Pivot(angle_deg=90.0), Park(duration_s=1200.0))),
    "turn_180_park_20min": (0.0, (Pivot(angle_deg=180.0), Park(duration_s=1200.0))),
    "turn_180_park_60min": (0.0, (Pivot(angle_deg=180.0), Park(duration_s=3600.0))),
    "realistic_taxi": (
        0.0,
        (
            Turn(angle_deg=90.0),
            Straight(duration_s=120.0, speed_m_s=9.5),
            Stop(duration_s=60.0),
            Turn(angle_deg=90.0),
            Straight(duration_s=120.0, speed_m_s=9.5),
            Stop(duration_s=120.0),
            Turn(angle_deg=-90.0),
            Straight(duration_s=120.0, speed_m_s=9.5),
            Stop(duration_s=60.0),
        ),
    ),
}
REFERENCE_MOTIONS = tuple(_REFERENCE)


def reference_motion(
    name: str, *, parked_s: float = PARKED_S, alignment_s: float = 600.0
) -> tuple[float, SimulatedMotion]:
    """Heading at alignment [rad] and motion of a row of physics.md 6.7, or the realistic taxi."""
    heading_deg, then = _REFERENCE[name]
    return heading_deg * DEG, lay([Park(duration_s=parked_s), *then], alignment_s=alignment_s)
