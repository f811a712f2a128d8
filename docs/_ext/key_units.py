"""Units of the keys of results: of what a name ends in, or of the name itself. A test holds every
number of every result against them.
"""

RATIO = "1"
BESIDE = "in the unit beside it, or of what it is of"

# what the name of a key ends in; the longest ending counts
UNITS = {
    "K_delta": "deg/h per degC/min",
    "arcmin": "arcmin",
    "arcsec": "arcsec",
    "days": "days",
    "deg": "deg",
    "degC": "degC",
    "degC_min": "degC/min",
    "deg_h": "deg/h",
    "deg_h2": "(deg/h)^2",
    "deg_h_per_degC_min": "deg/h per degC/min",
    "deg_h_sqrt_h": "deg/h per sqrt(h)",
    "deg_sqrt_h": "deg per sqrt(h)",
    "gain": RATIO,
    "hours": "h",
    "hz": "Hz",
    "kt": "kt",
    "m": "m",
    "m_s": "m/s",
    "m_s2": "m/s^2",
    "min": "min",
    "mm": "mm",
    "mrad": "mrad",
    "nats": "nats",
    "nm": "NM",
    "nm_h": "NM/h",
    "per_degC_min": "1 per degC/min",
    "per_hour": "1/h",
    "percent": "%",
    "rad": "rad",
    "s": "s",
    "sigmas": "sigmas",
    "ug": "micro-g",
}

# numbers without a unit: ratios, probabilities, cosines, normalised sums
RATIOS = """
alpha axes_alike_p band_95 band_999 bic causal_ratio chi2 condition cos cos_typical cosine dof
effective_draws expected_gain floor fraction gain held_out_chi2 jitter limit_999 merge_nis nis
nis_mean nis_mean_as_declared noise_over_model noise_share odds over_noise p95 p_value
probability ratio residual_over_sigma rho rho_after score score_after
seen_over_sigma share share_inside shares sigma_cost sigma_log squared_innovation
squared_innovation_defaults strength unit_noise_scale vehicle_share white windows_left_out
over_temperature_only temperature_only all all_uncentred tolerated told_from
""".split()

# numbers whose unit stands beside them (`unit`), or is that of the effect, term or channel they are
# of
OF_THEIR_RECORD = """
active after allan allan_high allan_low allan_model amplitude before believed change coefficients
covariance curve default delta_needed delta_needed_typical delta_seen delta_usual expected heat
interval_95 limit lines max measured median nodes noise parameters previous prior_sigma seen
seen_from sigma sigma_after sigma_before size table_after table_before used usual value values
""".split()

# keys whose ending says nothing, or something else
OTHERS = {
    "days_one_way": "days",
    "excess_sigma": "sigmas of the null",
    "excess_sigma_after": "sigmas of the null",
    "largest_degC_min_K_at_test_rate": "degC/min",
    "nats_after": "nats",
    "needed_runs": "count",
    "power": "(rad/s)^2/Hz or (m/s^2)^2/Hz",
    "power_model": "(rad/s)^2/Hz or (m/s^2)^2/Hz",
    "seconds": "s",
    "z": "sigmas",
    "drift_now_95_nm_h": "NM/h",
}

NAMED = {**dict.fromkeys(RATIOS, RATIO), **dict.fromkeys(OF_THEIR_RECORD, BESIDE), **OTHERS}


def unit_of(key: str) -> str | None:
    """The unit of a number by its key, None where nobody says."""
    if key in NAMED:
        return NAMED[key]
    endings = [ending for ending in UNITS if key == ending or key.endswith("_" + ending)]
    return UNITS[max(endings, key=len)] if endings else None
