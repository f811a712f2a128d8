"""A fitted model that the data beside it contradict is not drawn."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ins.records import AXES
from recal.service.look.series import shown_noise
from recal.service.results.plots import figure_of
from simreal.report.twin_page import allan_panels
from simreal.twin.fit.result import ChannelCurve

TAU = np.array([1.0, 2.0, 4.0, 8.0, 16.0])


@pytest.fixture
def fit(monkeypatch):
    """The parts of a fit that `look` shows: six channels on their model, a number a sensor."""
    import recal.service.look.series as room

    monkeypatch.setattr(room, "replace", changed)
    channels = [channel(f"{sensor}_{a}") for sensor in ("gyro", "accel") for a in AXES]
    names = ("gyro.bias_instability_deg_h", "accel.vrw_ug_sqrt_hz", "vehicle.sway_m_s")
    parameters = [SimpleNamespace(name=name, identified=True) for name in names]
    return SimpleNamespace(channels=channels, parameters=parameters, found=None, read_above_hz={})


def changed(record, **fields):
    """`dataclasses.replace`, of the stand-ins too."""
    if isinstance(record, SimpleNamespace):
        return SimpleNamespace(**{**vars(record), **fields})
    return replace(record, **fields)


def channel(name: str, *, factor: float = 1.0, p_value: float = 0.5) -> ChannelCurve:
    """White noise, and a model that is `factor` times it with a band of 20 %."""
    data = 1e-4 / np.sqrt(TAU)
    nothing = dict.fromkeys(("frequency_hz", "power", "power_model", "dof"), np.zeros(0))
    return ChannelCurve(
        channel=name,
        p_value=p_value,
        white=None,
        tau_s=TAU,
        allan=data,
        allan_model=(factor * data),
        allan_low=(0.8 * factor * data),
        allan_high=(1.2 * factor * data),
        **nothing,
    )


@pytest.mark.parametrize(("factor", "p_value"), [(1.1, 1e-20), (1.4, 1e-20), (3.0, 0.1)])
def test_a_model_near_the_data_or_their_spectrum_stands(fit, factor, p_value):
    """Lines that were left out of the spectrum are in the Allan deviation all the same."""
    fit.channels[1] = channel("gyro_y", factor=factor, p_value=p_value)
    shown, notes = shown_noise(fit)
    assert notes == [] and shown is fit


@pytest.mark.parametrize("factor", [2.6, 0.3])
def test_a_model_that_the_data_contradict_is_left_out(fit, factor):
    fit.channels[1] = channel("gyro_y", factor=factor, p_value=1e-20)
    shown, notes = shown_noise(fit)
    assert len(notes) == 1
    assert f" s the fitted model is {factor} times the data (gyro_y)" in notes[0]
    assert shown.parameters is fit.parameters  # which numbers are told is for the fit to say
    drawn = {c.channel for c in shown.channels if np.isfinite(c.allan_low).any()}
    assert drawn == {"accel_x", "accel_y", "accel_z"}
    panels = allan_panels(shown)
    assert [len(panel.items) for panel in panels] == [1, 1, 1, 3, 3, 3]
    figure = figure_of(panels)
    axes = Counter(trace.xaxis or "x" for trace in figure.data)
    assert [axes[f"x{k}"] for k in ("", 2, 3, 4, 5, 6)] == [1, 1, 1, 3, 3, 3]
    assert {figure.layout[f"yaxis{k}"].type for k in ("", 2, 3, 4, 5, 6)} == {"log"}


def test_channels_that_people_move_are_named_where_they_are_drawn(fit):
    fit.read_above_hz = {"gyro_x": 16.0, "accel_y": 16.0}
    fit.channels[1] = channel("gyro_y", factor=3.0, p_value=1e-20)
    _, notes = shown_noise(fit)
    assert len(notes) == 2
    assert "accel_y" in notes[1]
