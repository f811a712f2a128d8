"""Speed beside pyins (`pip install python-ins`) on the same hour of data, 200 Hz: mechanization and
a feedback filter.

CPU seconds of this one process, medians over the repeats; the filter of pyins is run once (it takes
minutes). Both come to the same result: speed against another program is worth nothing if
one of them does less.
"""

import datetime
import os
import platform
import statistics
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from alignment.motion import kinds
from alignment.navigation_filter import StepPlan, filter_steps, views_of
from benchmarks.study import Work, table
from ins import earth
from ins.attitude import (
    dcm_from_euler,
    dcm_from_rotation_vector,
    euler_from_dcm,
    rotation_vector_from_dcm,
)
from ins.estimation import error_model as em
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.tape import Tape
from ins.records import ImuLog, NavState, Site
from ins.strapdown.compensation import compensate
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G

HOUR_S, DT_S, STEP_S = 3600.0, 0.005, 0.1
SITE = Site(lat_rad=45 * DEG, lon_rad=0.3, height_m=100.0)
C_NB = dcm_from_euler(0.01, -0.02, 0.7)
ARW, VRW = 0.002 * DEG_PER_SQRT_HOUR, 10 * MICRO_G
GYRO_SIGMA, ACCEL_SIGMA, VELOCITY_SIGMA = 0.01 * DEG_PER_HOUR, 50 * MICRO_G, 0.005
TILT_SIGMA, HEADING_SIGMA = 0.05 * DEG, 0.5 * DEG


def parked_log(rng: np.random.Generator) -> ImuLog:
    """An hour at rest with noise, and constant biases of one sigma."""
    n = round(HOUR_S / DT_S)
    rate = C_NB.T @ earth.omega_ie_n(SITE.lat_rad) + GYRO_SIGMA * np.array([1.0, -1.0, 1.0])
    force = -C_NB.T @ earth.gravity_n(SITE.lat_rad, SITE.height_m) + ACCEL_SIGMA * np.array(
        [-1.0, 1.0, 0.0]
    )
    return ImuLog(
        time_s=DT_S * np.arange(1, n + 1),
        dt_s=np.full(n, DT_S),
        dtheta_rad=rate * DT_S + ARW * np.sqrt(DT_S) * rng.standard_normal((n, 3)),
        dv_m_s=force * DT_S + VRW * np.sqrt(DT_S) * rng.standard_normal((n, 3)),
    )


def start_at(C_nb: np.ndarray) -> NavState:
    return NavState(time_s=0.0, site=SITE, v_n_m_s=np.zeros(3), C_nb=C_nb)


def cpu_s(work: Callable[[], object], repeats: int = 1) -> float:
    """Median CPU seconds."""
    taken = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return statistics.median(taken)


# ------------------------------------------------------------------------------------------------
# pyins


class Pyins:
    """The same log and start in pyins's terms: degrees, DataFrames; the row before the first
    repeats it.
    """

    def __init__(self, imu: ImuLog) -> None:
        import pandas as pd
        from pyins import util

        repeat = np.concatenate([[0], np.arange(imu.time_s.size)])
        self.table = pd.DataFrame(
            np.hstack([imu.dtheta_rad[repeat], imu.dv_m_s[repeat]]),
            index=np.concatenate([[0.0], imu.time_s]),
            columns=util.GYRO_COLS + util.ACCEL_COLS,
        )

    @staticmethod
    def start(C_nb: np.ndarray):
        import pandas as pd
        from pyins import util

        place = np.degrees([SITE.lat_rad, SITE.lon_rad])
        values = [*place, SITE.height_m, 0.0, 0.0, 0.0, *np.degrees(euler_from_dcm(C_nb))]
        return pd.Series(values, index=util.TRAJECTORY_COLS, name=0.0)

    def increments(self):
        from pyins import strapdown

        return strapdown.compute_increments_from_imu(self.table, "increment")

    def whole(self):
        """From the log to a trajectory in one call."""
        from pyins import strapdown

        return strapdown.Integrator(self.start(C_NB)).integrate(self.increments())

    def by_epoch(self, minutes: float) -> None:
        """The same in epochs of 1 s, as a log comes in."""
        from pyins import strapdown

        increments = self.increments().iloc[: round(60 * minutes / DT_S)]
        integrator = strapdown.Integrator(self.start(C_NB))
        for a in range(0, len(increments), round(1 / DT_S)):
            integrator.integrate(increments.iloc[a : a + round(1 / DT_S)])

    def filtered(self, C_nb: np.ndarray, velocity: np.ndarray, minutes: float):
        """Its feedback filter, 15 states, a step every 0.1 s."""
        import pandas as pd
        from pyins import filters, inertial_sensor, measurements, util

        times = STEP_S * np.arange(1, round(60 * minutes / STEP_S) + 1)
        data = pd.DataFrame(velocity[: times.size], index=np.round(times, 6), columns=util.VEL_COLS)
        models = [
            inertial_sensor.EstimationModel(bias_sd=b, noise=n)
            for b, n in ((GYRO_SIGMA, ARW), (ACCEL_SIGMA, VRW))
        ]
        increments = self.increments().iloc[: round(60 * minutes / DT_S)]
        increments.index = np.round(increments.index, 6)
        return filters.run_feedback_filter(
            self.start(C_nb),
            0.01,
            0.01,
            np.degrees(TILT_SIGMA),
            np.degrees(HEADING_SIGMA),
            increments,
            *models,
            measurements=[measurements.NedVelocity(data, VELOCITY_SIGMA)],
            time_step=STEP_S,
        )


# ------------------------------------------------------------------------------------------------
# ours


def our_filter(
    imu: ImuLog, C_nb: np.ndarray, velocity: np.ndarray, passes: int = 2
) -> tuple[np.ndarray, np.ndarray]:
    """Navigate, estimate, correct the start and the biases, again: attitude and its sigma (heading)
    at the end.

    A step every 0.1 s with the two level velocities as scalar updates, 27 states; nothing is
    assumed of the motion.
    """
    noise = em.ProcessNoise(
        arw=ARW, vrw=VRW, accel_rrw=0.0, yaw_creep=0.0, lateral_rms=1e-3, lateral_time_s=2.0
    )
    gyro, accel = np.zeros(3), np.zeros(3)
    for _ in range(passes):
        corrected = compensate(imu, gyro_bias_rad_s=gyro, accel_bias_m_s2=accel)
        history = navigate(
            corrected, start_at(C_nb), epoch_s=STEP_S, vertical=VerticalChannel(mode="hold")
        )
        last = np.arange(1, history.time_s.size)
        none = np.zeros(last.size, dtype=np.int64)
        plan = StepPlan(
            last - 1, last, np.full(last.size, kinds.DISTURBED), none, np.zeros(last.size)
        )
        tape = Tape(filter_steps(views_of(history, plan)))
        z = (history.v_n_m_s[1:, :2] - velocity[: last.size, :2]).T
        tape.measure(
            "velocity",
            none + last - 1,
            z,
            [{em.W.start: 1.0}, {em.W.start + 1: 1.0}],
            [VELOCITY_SIGMA**2] * 2,
        )
        tape.clone(np.array([last.size - 1]), em.THETA_CLONE)
        flt = ErrorFilter(
            sigma0={"W": 0.01, "POS": 0.01, "THETA": TILT_SIGMA, "ACCEL": ACCEL_SIGMA},
            noise=noise,
            bias_mean=-gyro,
            bias_covariance=GYRO_SIGMA**2 * np.eye(3),
        )
        flt.x[em.ACCEL] = -accel[:2]
        flt.widen_prior(em.THETA.stop - 1, HEADING_SIGMA)
        flt.clone_start()
        flt.run(tape)
        C_nb = dcm_from_rotation_vector(-flt.x[em.THETA_START]) @ C_nb
        gyro, accel = gyro + flt.bias[0], accel + np.append(flt.x[em.ACCEL], 0.0)
    end = dcm_from_rotation_vector(-flt.x[em.THETA]) @ history.C_nb[-1]
    return end, np.sqrt(flt.P.diagonal()[em.THETA])


# ------------------------------------------------------------------------------------------------
# tables


def machine() -> str:
    model = platform.processor()
    if (info := Path("/proc/cpuinfo")).exists():
        models = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = models[0].split(":", 1)[1].strip() if models else model
    today = datetime.datetime.now(datetime.UTC).date()
    return (
        f"{os.cpu_count()} cores of {model}, load {os.getloadavg()[0]:.1f}, Python"
        f" {platform.python_version()}, {today}"
    )


def mechanization(imu: ImuLog, peer: Pyins, repeats: int) -> str:
    n, start = imu.time_s.size, start_at(C_NB)
    first_theirs, first_ours = cpu_s(peer.whole) / n, cpu_s(lambda: navigate(imu, start)) / n
    theirs = cpu_s(peer.whole, repeats) / n
    epochs_min = 10.0
    by_epoch = cpu_s(lambda: peer.by_epoch(epochs_min)) / (60 * epochs_min / DT_S)
    ours = cpu_s(lambda: navigate(imu, start), repeats) / n
    costs = {
        "pyins Integrator, the whole hour in one call": theirs,
        "pyins, first call of a process": first_theirs,
        f"pyins, second by second ({epochs_min:.0f} min)": by_epoch,
        "recal navigate, 1 s epochs": ours,
        "recal navigate, first call of a process": first_ours,
    }
    rows = [
        (name, f"{1e-6 / cost:.2f} M", f"{theirs / cost:.3g}", f"{by_epoch / cost:.3g}")
        for name, cost in costs.items()
    ]
    head = ("mechanization", "samples per CPU second", "to pyins in one call")
    return table((*head, "to pyins second by second"), rows)


def agreement(imu: ImuLog, peer: Pyins) -> str:
    end, h = peer.whole().iloc[-1], navigate(imu, start_at(C_NB), epoch_s=HOUR_S)
    offset = earth.displacement_ned(
        np.radians(end.lat),
        np.radians(end.lon),
        lat0_rad=h.lat_rad[-1],
        lon0_rad=h.lon_rad[-1],
        height0_m=0.0,
    )
    C_nb = dcm_from_euler(*np.radians([end.roll, end.pitch, end.heading]))
    turned = np.linalg.norm(rotation_vector_from_dcm(C_nb @ h.C_nb[-1].T))
    apart = f"{np.linalg.norm(offset):.2g} m and {turned / ARCSEC:.1g} arcsec"
    return f"Mechanizations after the hour: {apart} apart.\n"


def feedback_filter(imu: ImuLog, peer: Pyins, minutes: float, repeats: int) -> str:
    rng = np.random.default_rng(2)
    C_nb = dcm_from_rotation_vector([TILT_SIGMA, -TILT_SIGMA, HEADING_SIGMA]) @ C_NB
    velocity = VELOCITY_SIGMA * rng.standard_normal((round(HOUR_S / STEP_S), 3))
    log = imu.between(0.0, 60 * minutes)
    (end, sigma), found = our_filter(log, C_nb, velocity), {}
    ours = cpu_s(lambda: our_filter(log, C_nb, velocity), repeats)
    theirs = cpu_s(lambda: found.update(peer.filtered(C_nb, velocity, minutes)))
    last, last_sd = found["trajectory"].iloc[-1], found["trajectory_sd"].iloc[-1]
    angles = dcm_from_euler(*np.radians([last.roll, last.pitch, last.heading]))
    solutions = {
        "pyins run_feedback_filter, 15 states": (theirs, angles, np.radians(last_sd.heading)),
        "recal, 27 states, two passes": (ours, end, sigma[2]),
    }
    rows = []
    for name, (cost, C, s) in solutions.items():
        phi = rotation_vector_from_dcm(C @ C_NB.T)
        step_ms = 1e3 * cost / (60 * minutes / STEP_S)
        heading = f"{1e3 * phi[2]:+.3f}, {1e3 * s:.3f}"
        tilt = f"{np.linalg.norm(phi[:2]) / ARCSEC:.2f}"
        rows.append((name, f"{step_ms:.3g}", f"{theirs / cost:.0f}", heading, tilt))
    head = ("feedback filter at 10 Hz", "ms a step", "to pyins", "heading error, sigma [mrad]")
    return table((*head, "tilt error [arcsec]"), rows)


def beside_pyins(repeats: int, minutes: float) -> str:
    warnings.filterwarnings("ignore", module="pyins")
    warnings.filterwarnings("ignore", message="The copy keyword is deprecated")  # pandas 3 on pyins
    imu = parked_log(np.random.default_rng(1))
    peer = Pyins(imu)
    parts = [machine() + "\n", mechanization(imu, peer, repeats), agreement(imu, peer)]
    return "\n".join([*parts, feedback_filter(imu, peer, minutes, repeats)])


def run(work: Work, *, repeats: int = 5, filter_minutes: float = 60.0) -> str:
    """filter_minutes: how much of the hour the filters are given."""
    return "".join(work.each(beside_pyins, [(repeats, filter_minutes)]))
