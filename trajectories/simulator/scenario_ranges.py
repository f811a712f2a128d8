"""What the numbers of a scenario may be, by the unit in their key's name, and how many rows it may
ask for; both are checked before anything is made.

The ranges are those of vehicles and units on Earth with room to spare. They keep powers of a number
that occur here (a fifth of a time, a square of a speed) and the products with the rows of a run
within what a float64 holds.
"""

from collections.abc import Mapping

from ins.records import InputError

Range = tuple[float, float]
# By the whole key, else by the longest ending; gravity holds for -500 to 20,000 m (ins.earth).
RANGE_OF_KEY: Mapping[str, Range] = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-360.0, 360.0),
    "pitch_deg": (-90.0, 90.0),
    "bank_deg": (0.1, 80.0),  # 5.8 g; the tangent goes to infinity at 90
    "height_m": (-500.0, 20_000.0),
    "radius_m": (0.1, 100_000.0),
    "rate_hz": (0.1, 10_000.0),  # five times the fastest unit of formats.md
    "time_s": (-100_000.0, 1_000_000.0),
    "settle_s": (0.01, 100_000.0),
    "duration_s": (0.001, 1_000_000.0),
    "rate_degC_min": (0.001, 1_000.0),
    "ramp_s": (0.01, 100_000.0),
    "soak_s": (0.0, 1_000_000.0),
    "cycles": (1.0, 1_000.0),
    "strength": (0.0, 1_000.0),
    "seed": (0.0, 2.0**63),
    "ageing_seed": (0.0, 2.0**63),
}
RANGE_OF_ENDING: Mapping[str, Range] = {
    "_degC_min": (-1_000.0, 1_000.0),
    "_m_s2": (0.001, 1_000.0),
    "_m_s": (-10_000.0, 10_000.0),
    "_tau_s": (0.001, 10_000_000.0),
    "_degC": (-273.15, 1_000.0),
    "_deg": (-36_000.0, 36_000.0),  # 100 turns
    "_s": (0.0, 1_000_000.0),  # 11.6 days
    "_m": (-100_000.0, 100_000.0),
}
RANGE_OF_OTHERS: Range = (-1e6, 1e6)
# 5.6 h at 200 Hz; the simulator takes 970 bytes a row (an hour parked at 100 Hz), so 3.9 GB
MAX_SIMULATED_ROWS = 4_000_000
LEAST_HZ = 10.0  # of what is made at a rate of its own: knots, slow errors, odometer, reference
# Of motion, disturbances and environments: each is laid over all rows; chosen: the packaged
# scenarios have at most some 30, and 1,000 over 4 million rows end in minutes.
MAX_PARTS = 1_000


def refuse_out_of_range(key: str, value: object, *, name: str) -> None:
    """InputError for the first number, alone or in a list, that is not in the range of its key."""
    low, high = range_of(key)
    for number in _numbers(value):
        if not low <= number <= high:
            got = f"{number:g}" if abs(number) < 1e300 else str(number)[:20]
            raise InputError(f"{name}: {key}: got {got}, needed {low:g} to {high:g}")


def _numbers(value: object) -> list[int | float]:
    """The numbers of a value: itself, or those of a list."""
    parts = value if isinstance(value, list | tuple) else [value]
    return [n for n in parts if isinstance(n, int | float) and not isinstance(n, bool)]


def range_of(key: str) -> Range:
    """The range of a key."""
    if key in RANGE_OF_KEY:
        return RANGE_OF_KEY[key]
    return next(
        (limits for end, limits in RANGE_OF_ENDING.items() if key.endswith(end)), RANGE_OF_OTHERS
    )


def refuse_many_parts(key: str, count: int, *, name: str) -> None:
    """InputError where a list has more parts than MAX_PARTS."""
    if count > MAX_PARTS:
        raise InputError(f"{name}: {key}: got {count} parts, needed at most {MAX_PARTS}")


def refuse_many_rows(end_s: float, rate_hz: float, *, name: str) -> None:
    """InputError where a run would have more rows than MAX_SIMULATED_ROWS, be it of the knots of
    its truth.
    """
    rows = end_s * max(rate_hz, LEAST_HZ)
    if not rows <= MAX_SIMULATED_ROWS:
        raise InputError(
            f"{name}: {end_s:g} s at {rate_hz:g} Hz are {rows:.3g} rows, needed at most"
            f" {MAX_SIMULATED_ROWS}"
        )
