"""Makes the figures of concepts.md with the program's own code: `python docs/figures.py` (about a
minute on a quiet core).

Each is a simulated session, or what the program computes from it; nothing is drawn by hand.
Chromium draws, by the script of the pages.
"""

import json
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from infield.reports.drawing import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    DASHED,
    DOTTED,
    GREY,
    KEY_ABOVE,
    KEY_PX,
    NEW,
    OLD,
    ORANGE,
    SKY,
    VERMILLION,
    Boxes,
    Item,
    Line,
    Marks,
    Panel,
    ShadedSpan,
    Texts,
    page_script,
    spanned,
    specification,
)
from infield.store.table_store import TableStore
from infield.table.file import table_from_dict
from ins.attitude import dcm_from_rotation_vector
from ins.records import AXES, ImuLog, NavState
from ins.strapdown.mechanization import navigate
from ins.units import DEG_PER_HOUR
from recal.service.update import UpdateRequest, update_in_store
from tests.recal.chromium import chromium
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
WIDTH_PX, HEIGHT_PX = 860, 340
SEEN = ("parked_only", "straight_taxi", "cold_parked_taxi", "two_headings")
WORDS = ("parked only", "straight taxi", "taxi with turns and stops", "parked on two headings")
DRIFT_DEG_H = 0.01


def main() -> None:
    OUT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        sessions, truth = merged_sessions(Path(folder))
        save(draw_update(sessions[0], truth), "update", columns=3)
        save(draw_merge(sessions, truth), "merge", columns=2)
        save(draw_observability(Path(folder)), "observability", columns=1)
    save(draw_heading(), "heading", columns=2)
    save(draw_gap(), "gap", columns=2)


def update(runs: list[Path], url: str, output: Path, *, commit: bool) -> Any:
    """The document of an update; its page is not drawn."""
    asked = UpdateRequest(runs=runs, store_url=url, commit=commit, output=output, html=False)
    return update_in_store(asked).document


def save(panels: list[Panel], name: str, *, columns: int) -> None:
    drawn = specification(panels, columns=columns)
    drawn["layout"] |= {"showlegend": True, "legend": dict(KEY_ABOVE)}
    drawn["layout"]["margin"] |= {"t": KEY_PX}
    (OUT / f"{name}.svg").write_text(svg_of(drawn, name), "utf-8")
    print(OUT / f"{name}.svg")


def svg_of(drawn: dict[str, Any], name: str) -> str:
    """What plotly makes of a specification in Chromium: text as text, the same bytes for the same
    data. The name stands in place of the random number with which plotly marks its parts.
    """
    size = {"width": WIDTH_PX, "height": HEIGHT_PX}
    drawn = {"data": drawn["data"], "layout": drawn["layout"] | size}
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder) / "profile") as browser:
        page = Path(folder) / "page.html"
        page.write_text(f"<div></div>{page_script()}", "utf-8")
        browser.open(page.as_uri())
        told = json.dumps({"format": "svg", **size})
        browser.evaluate(
            f"Plotly.toImage({json.dumps(drawn)}, {told}).then(url => {{ window.made = url; }})"
        )
        browser.until("window.made !== undefined")
        found = unquote(browser.evaluate("window.made").partition(",")[2])
    (mark,) = set(re.findall(r'id="defs-(\w+)"', found))
    return found.replace(mark, name)


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


def draw_update(document: dict[str, Any], unit: Any) -> list[Panel]:
    """One session: its points with their sigmas, the table before and after, and the truth."""
    before, after = (table_from_dict(document[f"table_{k}"], name=k) for k in ("before", "after"))
    degC = np.linspace(-10.0, 50.0, 121)
    panels = []
    for k, axis in enumerate(AXES):
        items: list[Item] = []
        for table, colour, name in ((before, OLD, "table before"), (after, NEW, "table after")):
            bias, sigma = table.bias_deg_h(k, degC), table.sigma_deg_h(k, degC)
            items.append(
                Line(degC, bias, colour, name, low=bias - 2 * sigma, high=bias + 2 * sigma)
            )
        points = [
            p
            for p in document["points"]
            if p["axis"] == axis and p["observability"] != "not_observable"
        ]
        T, bias, sigma = (
            np.array([p[key] for p in points])
            for key in ("temperature_degC", "bias_deg_h", "sigma_deg_h")
        )
        name = "points of the session"
        items.append(
            Marks(T, bias, "o", BLACK, name, size=3.0, low=bias - sigma, high=bias + sigma)
        )
        items.append(Line(degC, true_bias(unit, degC)[:, k], GREY, "truth", dash=DASHED))
        panels.append(
            Panel(
                items=items,
                title=f"gyro {axis}",
                x_label="temperature [degC]",
                y_label="bias [deg/h]" if k == 0 else "",
            )
        )
    return panels


def draw_merge(documents: list[dict[str, Any]], unit: Any) -> list[Panel]:
    """Sigma, and error against the truth, over temperature after none to three sessions (gyro
    x).
    """
    degC = np.linspace(-10.0, 50.0, 121)
    tables = [documents[0]["table_before"], *(d["table_after"] for d in documents)]
    names = ("factory", "after a cold start", "and an ambient one", "and a hot one")
    claimed: list[Line] = []
    off: list[Item] = []
    for colour, table, name in zip((GREY, ORANGE, SKY, BLUE), tables, names):
        record = table_from_dict(table, name=name)
        claimed.append(Line(degC, record.sigma_deg_h(0, degC), colour, name))
        error = record.bias_deg_h(0, degC) - true_bias(unit, degC)[:, 0]
        off.append(Line(degC, np.abs(error), colour, name))
    x_label = "temperature [degC]"
    sigma = Panel(
        items=list(claimed),
        title="what the table claims: sigma",
        x_label=x_label,
        y_label="[deg/h]",
        y_limits=(0.0, spanned([line.y for line in claimed])[1]),
    )
    error = Panel(items=off, title="what it is off by: |error|, one unit", x_label=x_label)
    return [sigma, error]


def draw_observability(folder: Path) -> list[Panel]:
    """Sigma after over before of each gyro, for four ways to spend the session."""
    place = folder / "seen"
    place.mkdir()
    bars: dict[str, list[tuple[float, float, float, float]]] = {axis: [] for axis in AXES}
    for row, name in enumerate(SEEN):
        run, table, _ = session(name, place)
        url = f"sqlite:///{place / name}.db"
        with TableStore.open(url, create=True) as store:
            store.import_table(table, note="factory")
        seen = update([run], url, place / f"{name}-out", commit=False)["observability"]
        for k, axis in enumerate(AXES):
            ratio = seen[axis]["sigma_after_deg_h"] / seen[axis]["sigma_before_deg_h"]
            middle = row + 0.25 * (k - 1)
            bars[axis].append((0.0, ratio, middle - 0.11, middle + 0.11))
    items: list[Item] = [
        Boxes(rows, AXIS_COLOURS[axis], name=f"gyro {axis}") for axis, rows in bars.items()
    ]
    limits = ((0.5, "observed"), (0.9, "weak"))
    items += [Line(np.full(2, at), np.array([-0.75, 3.6]), GREY, dash=DOTTED) for at, _ in limits]
    items.append(Texts([(at, -0.6, word, BLACK, False) for at, word in limits], middle=False))
    return [
        Panel(
            items=items,
            x_label="sigma after / sigma before",
            x_limits=(0.0, 1.05),
            y_limits=(3.6, -0.75),
            y_ticks=list(enumerate(WORDS)),
        )
    ]


def draw_heading() -> list[Panel]:
    """Velocity across body and across the true track after an alignment that an east gyro bias has
    turned.
    """
    panels = []
    for angle, title in ((None, "straight on"), (90.0, "after a turn of 90 deg")):
        time_s, body, track, turned = cross_velocities(angle)
        panels.append(
            Panel(
                items=[
                    Line(time_s, 1e3 * track, GREY, "across the true track (needs GNSS)"),
                    Line(time_s, 1e3 * body, ORANGE, "across the body (the unit alone)"),
                ],
                title=title,
                x_label="time since the start of the taxi [s]",
                y_label="" if panels else "computed velocity [mm/s]",
                y_limits=(-25.0, 12.0),
                spans=[ShadedSpan(*turned)] if turned else (),
            )
        )
    return panels


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


def draw_gap() -> list[Panel]:
    """Two causes that one warm-up cannot tell apart, and a second start that can."""
    t = np.arange(0.0, 3600.0, 10.0)
    transient = np.exp(-t / 1500.0)
    traces: list[tuple[NDArray, NDArray]] = []
    panels = []
    for start in ("cold", "cooling"):
        degC = thermal_history(start).at(t).gyro_degC[:, 0]
        a, b = (x - x.mean() for x in (degC, -transient))
        traces.append((a, b))
        cos = cosine(*np.concatenate(traces, axis=1))
        drawn = b / np.abs(b).max() * np.abs(traces[0][0]).max() / 12.0
        panels.append(
            Panel(
                items=[
                    Line(t / 60, a / 12.0, BLUE, "linear in temperature"),
                    Line(t / 60, drawn, VERMILLION, "transient of power-on", dash=DASHED),
                ],
                title=f"{start} start, {cos:.3f} alike" + (" of both runs" if panels else ""),
                x_label="min parked",
                y_ticks=[],
            )
        )
    return panels


def cosine(a: NDArray, b: NDArray) -> float:
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b)))


if __name__ == "__main__":
    main()
