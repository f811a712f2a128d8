"""Gusts on fuselage, wing and fin of a parked airliner: `calm` and `gusty`."""

from functools import partial

import numpy as np

from trajectories.simulator.environments.gear import (
    DOWN,
    FORE,
    PITCH,
    ROLL,
    YAW,
    Forcing,
    push,
    still,
)
from trajectories.simulator.environments.scene import Scene
from trajectories.simulator.environments.spectra import (
    gaussian,
    gust_scales,
    gust_share,
    von_karman_across,
    von_karman_along,
)

CALM_M_S, GUSTY_M_S = 1.5, 12.0  # wind at 20 ft: Beaufort 1 and 6 (light air, strong breeze)
AIR_KG_M3 = 1.225
HEIGHT_M = 4.6  # of the fuselage's axis above the ground, 15 ft
# Areas of an A320 (from the drawings of Airbus, "Aircraft characteristics for airport planning"),
# and the arm of the fin about the main gear.
SIDE_M2, FRONT_M2, WING_M2, FIN_M2, FIN_ARM_M = 120.0, 30.0, 122.0, 22.0, 15.0
SIDE_COEFFICIENT, FRONT_COEFFICIENT = 0.8, 0.5  # of force; Hoerner (1965)
LIFT_SLOPE = 4.0  # of the wing, per radian, flaps in, near the ground
WING_AHEAD_M = 2.0  # centre of the wing's lift, ahead of the main gear
HALF_WING_ARM_M, UNEVEN = 7.0, 0.4  # gusts that lift one half of the wing alone: arm, and share


def calm(scene: Scene, rng: np.random.Generator) -> Forcing:
    """Light air: what is always there."""
    return Forcing(loads=wind_loads(scene, CALM_M_S, rng), motions=still(scene))


def gusty(scene: Scene, rng: np.random.Generator) -> Forcing:
    """A strong breeze from anywhere."""
    return Forcing(loads=wind_loads(scene, GUSTY_M_S, rng), motions=still(scene))


def wind_loads(scene: Scene, speed_m_s: float, rng: np.random.Generator) -> np.ndarray:
    """Loads (J, 6) of turbulence that a mean wind from a random side carries past the vehicle."""
    sigma_u, length_u, sigma_w, length_w = gust_scales(speed_m_s, HEIGHT_M)
    along = partial(von_karman_along, sigma=sigma_u, length_m=length_u, speed_m_s=speed_m_s)
    across = partial(von_karman_across, sigma=sigma_u, length_m=length_u / 2, speed_m_s=speed_m_s)
    up = partial(von_karman_across, sigma=sigma_w, length_m=length_w, speed_m_s=speed_m_s)

    def gust(spectrum, area_m2: float) -> np.ndarray:
        felt = partial(gust_share, area_m2=area_m2, speed_m_s=speed_m_s)
        return gaussian(scene, lambda f: spectrum(f) * felt(f), rng)

    bearing = rng.uniform(0.0, 2 * np.pi)
    sine, cosine = np.sin(bearing), np.cos(bearing)
    pressure = AIR_KG_M3 * speed_m_s * scene.parked  # of one m/s more, on one m^2
    hull = gust(along, SIDE_M2) * sine + 0.5 * gust(across, SIDE_M2) * cosine
    fin = gust(along, FIN_M2) * sine + 0.5 * gust(across, FIN_M2) * cosine
    head = gust(along, FRONT_M2) * cosine - 0.5 * gust(across, FRONT_M2) * sine
    lift = 0.5 * LIFT_SLOPE * WING_M2 * pressure
    loads = still(scene)
    push(loads, pressure * SIDE_M2 * SIDE_COEFFICIENT * hull, HEIGHT_M, 0.0)
    loads[:, YAW] -= pressure * FIN_M2 * SIDE_COEFFICIENT * fin * FIN_ARM_M
    loads[:, FORE] += pressure * FRONT_M2 * FRONT_COEFFICIENT * head
    lifted = lift * gust(up, WING_M2)
    loads[:, DOWN] -= lifted
    loads[:, PITCH] += lifted * WING_AHEAD_M
    loads[:, ROLL] += lift * UNEVEN * HALF_WING_ARM_M * gust(up, WING_M2 / 2)
    return loads
