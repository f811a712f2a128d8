"""What a count of a NovAtel RAWIMU log is worth, by the type of the IMU.

Source: OEM7 documentation, table "Raw IMU Scale Factors" (RAWIMUS), as NovAtel's own driver has it
(novatel_oem7_driver, oem7_imu.cpp and oem7_imu.hpp); FSAS, ADIS16488, STIM300, ISA-100C and G320
again in Apollo (drivers/gnss, GetImuParameter). Rates from RAWIMUS. ft is the international foot;
the Epson types log rates, not increments.
"""

import re
from dataclasses import dataclass

from ins.records import InputError


@dataclass(frozen=True, kw_only=True)
class ImuType:
    """One type: its number in RAWIMUX, its names, what gyro and accelerometer are made of, counts
    to units, rate [Hz].
    """

    number: int
    names: tuple[str, ...]
    technology: str
    gyro: tuple[float, str]
    accel: tuple[float, str]
    rate_hz: float


_HG1700 = ((2.0**-33, "rad"), (2.0**-27, "ft/s"))
_KVH = ((0.1 / (3600 * 256), "rad"), (0.05 * 2.0**-15, "m/s"))
_LITEF = ((1e-9, "rad"), (2e-8, "m/s"))
_STIM = ((2.0**-21, "deg"), (2.0**-22, "m/s"))
_HG4930 = ((2.0**-33, "rad"), (2.0**-29, "m/s"))
_G320 = ((0.008 / 65536, "deg/s"), (0.2 / 65536, "mg"))
_G370 = ((0.0151515 / 65536, "deg/s"), (0.4 / 65536, "mg"))


def _type(number: int, names: str, technology: str, scales: tuple, rate_hz: float) -> ImuType:
    gyro, accel = scales
    return ImuType(
        number=number,
        names=tuple(names.split()),
        technology=technology,
        gyro=gyro,
        accel=accel,
        rate_hz=rate_hz,
    )


TYPES = (
    _type(1, "HG1700_AG11", "rlg", _HG1700, 100),
    _type(4, "HG1700_AG17", "rlg", ((2.0**-33, "rad"), (2.0**-26, "ft/s")), 100),
    _type(5, "HG1900_CA29", "mems", _HG1700, 100),
    _type(8, "LN200", "fog", ((2.0**-19, "rad"), (2.0**-14, "m/s")), 200),
    _type(11, "HG1700_AG58", "rlg", _HG1700, 100),
    _type(12, "HG1700_AG62", "rlg", ((2.0**-33, "rad"), (2.0**-26, "ft/s")), 100),
    _type(13, "IMAR_FSAS FSAS", "fog", ((0.1 / 256, "arcsec"), (0.05 * 2.0**-15, "m/s")), 200),
    _type(16, "KVH_COTS CPT", "fog", _KVH, 100),
    _type(20, "HG1930_AA99", "mems", _HG1700, 100),
    _type(26, "ISA100C ISA_100C", "fog", _LITEF, 200),
    _type(27, "HG1900_CA50", "mems", _HG1700, 100),
    _type(28, "HG1930_CA50", "mems", _HG1700, 100),
    _type(31, "ADIS16488", "mems", ((720 / 2.0**31, "deg"), (200 / 2.0**31, "m/s")), 200),
    _type(32, "STIM300", "mems", _STIM, 125),
    _type(33, "KVH_1750 KVH1750", "fog", _KVH, 200),
    _type(41, "EPSON_G320 G320 G320N EG320N", "mems", _G320, 125),
    _type(52, "LITEF_MICROIMU UIMU MICROIMU UIMU_IC", "mems", _LITEF, 200),
    _type(56, "STIM_300D STIM300D", "mems", _STIM, 125),
    _type(58, "HG4930_AN01 HG4930", "mems", _HG4930, 100),
    _type(61, "EPSON_G370 G370 G370N EG370N", "mems", _G370, 200),
    _type(62, "EPSON_G320_200HZ EG320N_200HZ", "mems", _G320, 200),
    _type(68, "HG4930_AN04", "mems", _HG4930, 100),
    _type(69, "HG4930_AN04_400HZ HG4930_400HZ", "mems", _HG4930, 400),
)


def imu_type(text: str) -> ImuType:
    """The type of a name ("ISA-100C", "OEM-IMU-STIM300") or a number. InputError lists the known
    ones.
    """
    wanted = _plain(text)
    for known in TYPES:
        if wanted in (str(known.number), *map(_plain, known.names)):
            return known
    names = ", ".join(f"{known.names[0]} ({known.number})" for known in TYPES)
    raise InputError(
        f"imu_type {text[:40]!r} has no documented scale: needed imu_scale in the map, or one of"
        f" {names}"
    )


def _plain(text: str) -> str:
    """The name of a model without what is written before it: letters and digits."""
    return re.sub(
        r"^(OEM)?(IMU)?(?=[A-Z])",
        "",
        re.sub(r"[^A-Z0-9]", "", text.upper().replace("µ", "U").replace("Μ", "U")),
    )
