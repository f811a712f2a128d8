"""Why a number of a twin cannot be told from runs, what would tell it, and what a reader of a fit
must know: codes with the templates of their sentences.
"""

from ins.verdicts import ReasonCode


class Why(ReasonCode):
    """Why a parameter of a twin cannot be told from the runs."""

    NOTHING_SEEN = "nothing_seen", "not distinguishable from the other noise"
    TOO_LOOSE = "too_loose", "detected, but its size is too uncertain"
    FEW_RUNS = "few_runs", "too few power-ons"
    NO_STREAM = "no_stream", "no such stream at rest in these runs"
    EXACT_ZERO = "exact_zero", "all readings are the same, which shows no noise"
    BELOW_RESOLUTION = "below_resolution", "the readings' step hides it"
    ROUNDED = "rounded", "each row is rounded to steps larger than its noise"
    NOT_ON_A_GRID = "not_on_a_grid", "readings lie on no grid"
    GYROS_DIFFER = ("gyros_differ", "the gyros differ, and no other sensor observes yaw")
    CONTRADICTED = (
        "contradicted",
        "the data contradict the model by far: a filter in the logger, or vibration that it does"
        " not describe",
    )


class Lacking(ReasonCode):
    """What would tell a parameter that the runs do not tell."""

    POWER_ONS = ("power_ons", "needs {count:.0f} power-ons of a unit, each: {recording}")
    RECORDING = "recording", "needs one recording: {recording}"
    NO_RECORDING = "no_recording", "no parked recording up to 128 h suffices"


class FitReason(ReasonCode):
    """Why nothing was fitted."""

    NEVER_RESTS = (
        "never_rests",
        "{run_ids:, |}: never at rest for {needed_s:.0f} s",
        "needed a parked stretch",
    )
    NOTHING_TOLD = (
        "nothing_told",
        "from the {rest_min:.0f} min at rest none of the {of:.0f} parameters can be estimated, so"
        " no twin is written",
        "the list of parameters says what each needs",
    )


class FitNote(ReasonCode):
    """What a reader must know of a fit."""

    CONTRADICTED = (
        "contradicted",
        "the data contradict every model of the {triad} noise by far: a filter in the logger,"
        " vibration that the model does not describe, or a rest too short; its parameters keep"
        " their values, except white noise where the spectra are flat over three octaves",
    )
    FILTERED = (
        "filtered",
        "a filter takes noise out of the {triad} rows at high frequencies; their white noise is"
        " read below {hz:.3g} Hz, where it takes out next to nothing",
    )
    ROCKED = (
        "rocked",
        "people or wind move the vehicle on its gear: of {channels:, |} only the rows' noise above"
        " {hz:g} Hz is read; the rest rests on the other channels",
    )
    FLICKER_FOR_MARKOV = (
        "flicker_for_markov",
        "the twin knows no Gauss-Markov process; its {triad} flicker is set to {size:.3g} {unit},"
        " which covers the process that was found",
    )
    AXES_DIFFER = (
        "axes_differ",
        "the white noise of the {triad} axes differs ({sizes:, |.3g}); the twin has their root"
        " mean square",
    )
    YAW_OR_GYRO = (
        "yaw_or_gyro",
        "yaw creep is the slow noise of the vertical gyro in excess of the level ones; no other"
        " sensor observes yaw, so a noisier vertical gyro looks the same",
    )
    LINES_LEFT_OUT = (
        "lines_left_out",
        "{count} lines of dither or engines on {channels} channels are left out of the noise, such"
        " as {frequency_hz:.4g} Hz on {channel}, amplitude {amplitude:.2g} {unit}; the twin lists"
        " them for recal diagnose",
    )
    RUNS_NOT_USED = "runs_not_used", "never at rest, not used: {run_ids:, |}"
