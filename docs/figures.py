"""Makes the figures of concepts.md with the program's own code: `python docs/figures.py` (about a
minute on a quiet core).

Each is a simulated session, or what the program computes from it; nothing is drawn by hand.
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.store.table_store import TableStore
from infield.table.file import table_from_dict
from ins.attitude import dcm_from_rotation_vector
from ins.records import AXES, ImuLog, NavState
from ins.strapdown.mechanization import navigate
from ins.units import DEG_PER_HOUR
from recal.service.update import UpdateRequest, update_in_store
from trajectories.runs.directory import write_run
from trajectories.simulator.scenario import (
    read_scenario,
    scenario_from_dict,
    scenario_ideal,
    simulate_scenario,
)
from trajectories.simulator.thermal import thermal_history

OUT = Path(__file__).parent / "figures"
RATE_HZ = 20.0
UNIT_SEED = 4
COLOURS = {"x": "#0b5394", "y": "#c55a11", "z": "#548235"}
SEEN = ("parked_only", "straight_taxi", "cold_parked_taxi", "two_headings")
WORDS = ("parked only", "straight taxi", "taxi with turns and stops", "parked on two headings")
DRIFT_DEG_H = 0.01


def main() -> None:
    OUT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        sessions, truth = merged_sessions(Path(folder))
        save(draw_update(sessions[0], truth), "update")
        save(draw_merge(sessions, truth), "merge")
        save(draw_observability(Path(folder)), "observability")
    save(draw_heading(), "heading")
    save(draw_gap(), "gap")


def update(runs: list[Path], url: str, output: Path, *, commit: bool) -> Any:
    """The document of an update; its page is not drawn."""
    asked = UpdateRequest(runs=runs, store_url=url, commit=commit, output=output, html=False)
    return update_in_store(asked).document


def save(figure: Any, name: str) -> None:
    """SVG with the text as text, the same bytes for the same data."""
    import matplotlib

    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "recal"}):
        figure.savefig(OUT / f"{name}.svg", metadata={"Date": None})
    print(OUT / f"{name}.svg")


def panels(n: int, *, height: float = 3.4) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    # 9.2 inches at most: wider ones are drawn smaller on the page, and their letters with them
    figure = Figure(figsize=(min(4.6 * n, 9.2), height), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(1, n)))


def key(figure: Any, ax: Any) -> None:
    """What the lines of a panel are, above all panels."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=9, frameon=False)


def session(
    name: str, folder: Path, *, heading_deg: float | None = None
) -> tuple[Path, dict[str, Any], Any]:
    """A run of a packaged scenario at a low rate, the unit's factory table, and the unit itself."""
    plan = read_scenario(name)
    attitude = (
        plan.attitude if heading_deg is None else replace(plan.attitude, heading_deg=heading_deg)
    )
    plan = replace(
        plan,
        imu=replace(plan.imu, rate_hz=RATE_HZ),
        unit=replace(plan.unit, ageing_seed=UNIT_SEED),
        attitude=attitude,
    )
    simulated, unit = simulate_scenario(plan)
    write_run(folder / name, simulated.run)
    return folder / name, unit.factory_table(), unit


def merged_sessions(folder: Path) -> tuple[list[dict[str, Any]], Any]:
    """Three sessions of one unit, each committed before the next: their update documents, and the
    unit.
    """
    documents, url, unit = [], f"sqlite:///{folder / 'store.db'}", None
    for name, heading_deg in (
        ("cold_parked_taxi", 0.0),
        ("ambient_parked_taxi", 120.0),
        ("hot_parked_taxi", 250.0),
    ):
        run, table, unit = session(name, folder, heading_deg=heading_deg)
        if not documents:
            with TableStore.open(url, create=True) as store:
                store.import_table(table, note="factory")
        documents.append(update([run], url, folder / f"update-{name}", commit=True))
    return documents, unit


def true_bias(unit: Any, degC: NDArray) -> NDArray:
    """The unit's true bias at steady temperatures (n, 3) [deg/h]."""
    return np.stack([unit.bias_deg_h(axis, degC) for axis in AXES], axis=-1)


def draw_update(document: dict[str, Any], unit: Any) -> Any:
    """One session: its points with their sigmas, the table before and after, and the truth."""
    figure, axes = panels(3)
    before, after = (table_from_dict(document[f"table_{k}"], name=k) for k in ("before", "after"))
    degC = np.linspace(-10.0, 50.0, 121)
    for k, (axis, ax) in enumerate(zip(AXES, axes)):
        for table, colour, label in (
            (before, "#999999", "table before"),
            (after, COLOURS["x"], "table after"),
        ):
            bias, sigma = table.bias_deg_h(k, degC), table.sigma_deg_h(k, degC)
            ax.plot(degC, bias, color=colour, label=label)
            ax.fill_between(
                degC, bias - 2 * sigma, bias + 2 * sigma, color=colour, alpha=0.18, lw=0
            )
        points = [
            p
            for p in document["points"]
            if p["axis"] == axis and p["observability"] != "not_observable"
        ]
        ax.errorbar(
            [p["temperature_degC"] for p in points],
            [p["bias_deg_h"] for p in points],
            [p["sigma_deg_h"] for p in points],
            fmt="o",
            ms=3,
            color="black",
            lw=0.8,
            label="points of the session",
        )
        ax.plot(degC, true_bias(unit, degC)[:, k], "--", color="black", lw=1, label="truth")
        ax.set(
            title=f"gyro {axis}",
            xlabel="temperature [degC]",
            ylabel="bias [deg/h]" if k == 0 else "",
        )
    key(figure, axes[0])
    return figure


def draw_merge(documents: list[dict[str, Any]], unit: Any) -> Any:
    """Sigma, and error against the truth, over temperature after none to three sessions (gyro
    x).
    """
    figure, (left, right) = panels(2)
    degC = np.linspace(-10.0, 50.0, 121)
    tables = [documents[0]["table_before"], *(d["table_after"] for d in documents)]
    names = ("factory", "after a cold start", "and an ambient one", "and a hot one")
    for shade, table, name in zip(np.linspace(0.25, 1.0, 4), tables, names):
        record = table_from_dict(table, name=name)
        left.plot(degC, record.sigma_deg_h(0, degC), color=COLOURS["x"], alpha=shade, label=name)
        error = record.bias_deg_h(0, degC) - true_bias(unit, degC)[:, 0]
        right.plot(degC, np.abs(error), color=COLOURS["x"], alpha=shade)
    left.set(
        title="what the table claims: sigma",
        xlabel="temperature [degC]",
        ylabel="deg/h",
        ylim=(0, None),
    )
    right.set(
        title="what it is off by: |error|, one unit", xlabel="temperature [degC]", ylim=(0, None)
    )
    key(figure, left)
    return figure


def draw_observability(folder: Path) -> Any:
    """Sigma after over before of each gyro, for four ways to spend the session."""
    figure, (ax,) = panels(1, height=3.2)
    figure.set_size_inches(7.5, 3.2)
    place = folder / "seen"
    place.mkdir()
    for row, name in enumerate(SEEN):
        run, table, _ = session(name, place)
        url = f"sqlite:///{place / name}.db"
        with TableStore.open(url, create=True) as store:
            store.import_table(table, note="factory")
        seen = update([run], url, place / f"{name}-out", commit=False)["observability"]
        for k, axis in enumerate(AXES):
            ratio = seen[axis]["sigma_after_deg_h"] / seen[axis]["sigma_before_deg_h"]
            ax.barh(
                row + 0.25 * (k - 1),
                ratio,
                height=0.22,
                color=COLOURS[axis],
                label=f"gyro {axis}" if row == 0 else None,
            )
    for limit, word in ((0.5, "observed"), (0.9, "weak")):
        ax.axvline(limit, color="black", lw=0.8, ls=":")
        ax.text(limit - 0.01, -0.55, word, ha="right", fontsize=8)
    ax.set(
        yticks=range(4),
        yticklabels=WORDS,
        xlim=(0, 1.05),
        xlabel="sigma after / sigma before",
        ylim=(3.6, -0.75),
    )
    key(figure, ax)
    return figure


def draw_heading() -> Any:
    """Velocity across body and across the true track after an alignment that an east gyro bias has
    turned.
    """
    figure, axes = panels(2)
    for ax, angle, title in zip(axes, (None, 90.0), ("straight on", "after a turn of 90 deg")):
        time_s, body, track, turned = cross_velocities(angle)
        ax.plot(time_s, 1e3 * track, color="#999999", label="across the true track (needs GNSS)")
        ax.plot(time_s, 1e3 * body, color=COLOURS["y"], label="across the body (the unit alone)")
        if turned:
            ax.axvspan(*turned, color="#dddddd", lw=0)
        ax.set(title=title, xlabel="time since the start of the taxi [s]", ylim=(-25, 12))
    axes[0].set_ylabel("computed velocity [mm/s]")
    key(figure, axes[0])
    return figure


def cross_velocities(
    angle_deg: float | None,
) -> tuple[NDArray, NDArray, NDArray, tuple[float, float] | None]:
    """Free-inertial velocity across body and track over a taxi at 10 m/s, an east bias hidden in
    the first heading.
    """
    turn = (
        [] if angle_deg is None else [{"segment": "turn", "angle_deg": angle_deg, "speed_m_s": 5.0}]
    )
    ideal = scenario_ideal(
        scenario_from_dict(
            {
                "schema": "recal.scenario/1",
                "site": {"lat_deg": 45.0, "lon_deg": 7.0, "height_m": 0.0},
                "imu": {"rate_hz": 50},
                "thermal": {"start": "ambient"},
                "motion": [
                    {"segment": "park", "duration_s": 30},
                    *turn,
                    {"segment": "taxi", "duration_s": 200, "speed_m_s": 10.0},
                ],
            },
            name="taxi",
        )
    )
    dt = ideal.dt_s
    drift = np.array([0.0, DRIFT_DEG_H * DEG_PER_HOUR, 0.0])  # body y points east on heading 0
    log = ImuLog(
        time_s=ideal.time_s,
        dt_s=np.full(ideal.time_s.size, dt),
        dtheta_rad=ideal.dtheta_rad + drift * dt,
        dv_m_s=ideal.dv_m_s,
    )
    psi = -drift[1] / (7.292115e-5 * np.cos(ideal.truth.site.lat_rad))  # CONVENTIONS.md
    C_nb = dcm_from_rotation_vector(np.array([0.0, 0.0, psi])) @ ideal.C_nb[0]
    found = navigate(
        log,
        NavState(time_s=0.0, site=ideal.truth.site, v_n_m_s=np.zeros(3), C_nb=C_nb),
        epoch_s=1.0,
    )
    rows = np.searchsorted(ideal.time_s, found.time_s[1:] - 0.5 * dt)
    v, heading = found.v_n_m_s[1:], ideal.euler_rad[rows, 2]
    body = np.einsum("nji,nj->ni", found.C_nb[1:], v)[:, 1]
    track = -np.sin(heading) * v[:, 0] + np.cos(heading) * v[:, 1]
    t = found.time_s[1:] - 30.0
    turning = t[np.abs(np.gradient(heading, t)) > 1e-3]
    return (
        t[t > 0],
        body[t > 0],
        track[t > 0],
        (float(turning[0]), float(turning[-1])) if turning.size else None,
    )


def draw_gap() -> Any:
    """Two causes that one warm-up cannot tell apart, and a second start that can."""
    figure, axes = panels(2)
    t = np.arange(0.0, 3600.0, 10.0)
    transient = np.exp(-t / 1500.0)
    traces = []
    for ax, start in zip(axes, ("cold", "cooling")):
        degC = thermal_history(start).at(t).gyro_degC[:, 0]
        a, b = (x - x.mean() for x in (degC, -transient))
        traces.append((a, b))
        cos = cosine(*np.concatenate(traces, axis=1)) if len(traces) > 1 else cosine(a, b)
        ax.plot(t / 60, a / 12.0, color=COLOURS["x"], label="linear in temperature")
        ax.plot(
            t / 60,
            b / np.abs(b).max() * np.abs(traces[0][0]).max() / 12.0,
            "--",
            color=COLOURS["y"],
            label="transient of power-on",
        )
        ax.set(
            title=f"{start} start, {cos:.3f} alike" + (" of both runs" if len(traces) > 1 else ""),
            xlabel="min parked",
            yticks=[],
        )
    key(figure, axes[0])
    return figure


def cosine(a: NDArray, b: NDArray) -> float:
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b)))


if __name__ == "__main__":
    main()
