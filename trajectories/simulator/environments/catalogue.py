"""Which function makes which environment."""

from collections.abc import Callable

import numpy as np

from trajectories.simulator.environments.cargo import loading, refuelling
from trajectories.simulator.environments.gear import Forcing
from trajectories.simulator.environments.kinds import EnvironmentKind
from trajectories.simulator.environments.machines import engines, gpu
from trajectories.simulator.environments.people import boarding, maintenance
from trajectories.simulator.environments.scene import Scene
from trajectories.simulator.environments.ship import ship
from trajectories.simulator.environments.wind import calm, gusty

CATALOGUE: dict[EnvironmentKind, Callable[[Scene, np.random.Generator], Forcing]] = {
    EnvironmentKind.CALM: calm,
    EnvironmentKind.GUSTY: gusty,
    EnvironmentKind.BOARDING: boarding,
    EnvironmentKind.REFUELLING: refuelling,
    EnvironmentKind.LOADING: loading,
    EnvironmentKind.ENGINES: engines,
    EnvironmentKind.GPU: gpu,
    EnvironmentKind.MAINTENANCE: maintenance,
    EnvironmentKind.SHIP: ship,
}
