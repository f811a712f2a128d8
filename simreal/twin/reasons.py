"""Why a number of a twin cannot be told from runs, what would tell it, and what a reader of a fit
must know: codes with the templates of their sentences.
"""

from ins.verdicts import ReasonCode


class Why(ReasonCode):
    """Why a parameter of a twin cannot be told from the runs."""

    NOTHING_SEEN = "nothing_seen", "none of it is seen beside the rest"
    TOO_LOOSE = "too_loose", "something of it is seen, too little to tell its size"
    FEW_RUNS = "few_runs", "too few power-ons"
    NO_STREAM = "no_stream", "no such stream at rest in these runs"
    EXACT_ZERO = "exact_zero", "all readings are the same, which shows no noise"
    BELOW_RESOLUTION = "below_resolution", "the readings' step hides it"
    ROUNDED = "rounded", "rows are rounded one by one, to steps that hide their noise"
    NOT_ON_A_GRID = "not_on_a_grid", "readings lie on no grid"
    GYROS_DIFFER = (
        "gyros_differ",
        "the gyros differ, and nothing beside the vertical one witnesses a yaw",
    )
    CONTRADICTED = (
        "contradicted",
        "the data contradict the model by far: filtered by the logger, or shaken by what it does"
        " not know",
    )


class Lacking(ReasonCode):
    """What would tell a parameter that the runs do not tell."""

    POWER_ONS = ("power_ons", "{count:.0f} power-ons of a unit would tell it, each: {recording}")
    RECORDING = "recording", "one recording would tell it: {recording}"
    NO_RECORDING = "no_recording", "no parked recording of 128 h or less would"


class FitReason(ReasonCode):
    """Why nothing was fitted."""

    NEVER_RESTS = (
        "never_rests",
        "{run_ids:, |}: never at rest for {needed_s:.0f} s",
        "needed a parked stretch",
    )
    NOTHING_TOLD = (
        "nothing_told",
        "the {rest_min:.0f} min at rest tell none of the {of:.0f} numbers, so there is no twin of"
        " this unit to write",
        "its parameters say what each needs",
    )


class FitNote(ReasonCode):
    """What a reader must know of a fit."""

    CONTRADICTED = (
        "contradicted",
        "the data contradict any model of the {triad} noise by far: filtered by the logger, shaken"
        " by what the model does not know, or a rest too short; its numbers stay what they were,"
        " but for white noise where the rows' spectra are flat over three octaves",
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
        "yaw creep is what the vertical gyro has beyond the level ones: nothing else witnesses a"
        " yaw, so a vertical gyro that is noisier in itself looks the same",
    )
    LINES_LEFT_OUT = (
        "lines_left_out",
        "{count} lines of dither or engines on {channels} channels are left out of the noise, such"
        " as {frequency_hz:.4g} Hz on {channel}, amplitude {amplitude:.2g} {unit}; the twin lists"
        " them for recal diagnose",
    )
    RUNS_NOT_USED = "runs_not_used", "never at rest, not used: {run_ids:, |}"
