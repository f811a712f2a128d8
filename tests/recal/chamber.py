"""Chamber runs on disk for the tests of `recal thermal`."""

from pathlib import Path

from tests.recal.verbs import simulate

SCENARIO = Path(__file__).with_name("chamber.toml").read_text("utf-8")
START_degC, SOAK_S = -10.0, 900.0


def make(folder, name, *, rate, end_degC, seed=1, back=True, **lines):
    """A run in folder/name, of soaks and ramps. lines: technology and terms of the unit; more of
    the scenario, heater of its thermal section.
    """
    ramp_s = SOAK_S + 60.0 * (end_degC - START_degC) / rate
    text = SCENARIO.format(
        **{"more": "", "heater": "", **lines},
        seed=seed,
        seconds=SOAK_S + (2 if back else 1) * ramp_s,
        start_degC=START_degC,
        end_degC=end_degC,
        rate=rate,
        soak_s=SOAK_S,
        back=str(back).lower(),
    )
    (folder / f"{name}.toml").write_text(text)
    simulate(str(folder / f"{name}.toml"), folder / name)
    return folder / name
