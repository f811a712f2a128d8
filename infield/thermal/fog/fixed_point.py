"""Piecewise curves as whole numbers for an FPGA or a DSP: tables, the exact integer algorithm, its
worst rounding error.

Temperature t = T 2^f as an integer; a breakpoint is rounded to it before the polynomials are moved
there. In a segment of reach 2^s degC, v = (t - t_j) 2^-(f + s) lies in [0, 1] and is a shift, not a
division. Horner's rule with coefficients a_k 2^F and one rounded shift per step::

    y <- round(y (t - t_j) 2^-(f + s)) + a_k

Each rounding is at most half of 2^-F and |v| <= 1, so the worst error is (2 degree + 1) / 2 of
2^-F, beside what rounding T itself does.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.thermal.fog.piecewise import Piecewise

TEMPERATURE_BITS = 7  # fraction bits of T: 1/128 degC, +-256 degC in 16 bits
RATE_BITS = 12  # fraction bits of dT/dt: 1/4096 degC/min, +-8 degC/min in 16 bits


@dataclass(frozen=True)
class FixedTable:
    """One curve: edges (m + 1,), shift (m,) and coefficients (m, degree + 1) as integers; value = y
    2^-fraction_bits.

    rounding: worst |value - exact polynomial| at a temperature that is itself a multiple of
    2^-TEMPERATURE_BITS; temperature_rounding: what rounding the temperature adds at most. Both in
    the unit of the curve.
    """

    edges: NDArray
    shift: NDArray
    coefficients: NDArray
    fraction_bits: int
    word_bits: int
    rounding: float
    temperature_rounding: float

    @property
    def worst(self) -> float:
        return self.rounding + self.temperature_rounding


def fixed_table(curve: Piecewise, *, word_bits: int = 16) -> FixedTable:
    """The curve in words of 8 to 32 bits with as many fraction bits as its largest coefficient
    leaves.
    """
    if not 8 <= word_bits <= 32:
        raise ValueError(f"word_bits = {word_bits}, needed 8 to 32")
    one = 1 << TEMPERATURE_BITS
    edges = np.round(curve.edges_degC * one).astype(np.int64)
    reach = np.maximum(np.ceil(np.log2(np.diff(edges) / one)), 1 - TEMPERATURE_BITS).astype(
        np.int64
    )
    moved = np.stack(
        [
            _moved(row, edge / one - exact) * 2.0 ** (s * np.arange(row.size))
            for row, edge, exact, s in zip(curve.coefficients, edges, curve.edges_degC, reach)
        ]
    )
    largest = float(np.max(np.abs(moved)))
    bits = word_bits - 1 - int(np.floor(np.log2(max(largest, 2.0**-40)))) - 1
    if round(largest * 2.0**bits) >= 1 << (word_bits - 1):
        bits -= 1
    u = np.linspace(0.0, 1.0, 257)
    slopes = [
        np.abs(np.polynomial.polynomial.polyval(u, np.arange(1, c.size) * c[1:])).max() / 2.0**s
        for c, s in zip(moved, reach)
        if c.size > 1
    ]
    return FixedTable(
        edges=edges,
        shift=reach + TEMPERATURE_BITS,
        coefficients=np.round(moved * 2.0**bits).astype(np.int64),
        fraction_bits=bits,
        word_bits=word_bits,
        rounding=(2 * curve.degree + 1) / 2 * 2.0**-bits + _seam(curve, edges / one),
        temperature_rounding=0.5 / one * max(slopes, default=0.0),
    )


def _moved(row: NDArray, step: float) -> NDArray:
    """The polynomial about a point `step` further on: p(u + step)."""
    shifted = np.polynomial.Polynomial(row)(np.polynomial.Polynomial([step, 1.0])).coef
    return np.pad(shifted, (0, row.size - shifted.size))


def _seam(curve: Piecewise, edges_degC: NDArray) -> float:
    """What using a segment up to its rounded edge, instead of the exact one, adds at most."""
    gaps = [0.0]
    for j in range(1, len(curve.coefficients)):
        at = [
            np.polynomial.polynomial.polyval(
                edges_degC[j] - curve.edges_degC[i], curve.coefficients[i]
            )
            for i in (j - 1, j)
        ]
        gaps.append(abs(at[0] - at[1]))
    ends = [
        abs(float(curve(edges_degC[i : i + 1])[0]) - _beyond(curve, i, edges_degC[i]))
        for i in (0, len(edges_degC) - 1)
    ]
    return float(max(*gaps, *ends))


def _beyond(curve: Piecewise, edge: int, at_degC: float) -> float:
    """The end segment's polynomial at a rounded end, which may lie outside the curve."""
    j = 0 if edge == 0 else len(curve.coefficients) - 1
    return float(
        np.polynomial.polynomial.polyval(at_degC - curve.edges_degC[j], curve.coefficients[j])
    )


def worst_error_deg_h(
    K_T: FixedTable, K_delta: FixedTable, *, largest_rate: float, largest_K_delta: float
) -> float:
    """Worst rounding error of K_T + K_delta dT/dt [deg/h] up to a rate [degC/min]: tables,
    temperature, rate and product.
    """
    rate_step = 0.5 * 2.0**-RATE_BITS
    product = K_delta.worst * (largest_rate + rate_step) + largest_K_delta * rate_step
    return K_T.worst + product + 0.5 * 2.0**-K_T.fraction_bits


def to_csv(tables: dict[str, FixedTable]) -> str:
    """Name, segment, first and last edge, shift and coefficients as integers, one row a segment."""
    most = max(t.coefficients.shape[1] for t in tables.values())
    lines = [
        "table,segment,t_first,t_last,shift,fraction_bits," + ",".join(f"a{k}" for k in range(most))
    ]
    for name, table in tables.items():
        for j, row in enumerate(table.coefficients):
            cells = [
                name,
                j,
                table.edges[j],
                table.edges[j + 1],
                table.shift[j],
                table.fraction_bits,
                *row,
            ]
            lines.append(",".join(map(str, cells + [0] * (most - row.size))))
    return "\n".join(lines) + "\n"


C_HEAD = """/* Thermal compensation of a fibre-optic gyro: {serial}. Written by recal thermal fog.
   bias [deg/h] = K_T(T) + K_delta(T) dT/dt [degC/min]; subtract it from the gyro's output.
   t = T[degC] * 2^{tbits}; r = dT/dt[degC/min] * 2^{rbits}; tables in deg/h and deg/h per degC/min times 2^fraction_bits.
   Right shifts of negative numbers must be arithmetic. Products fit 64 bits. */
#include <stdint.h>

static inline int64_t recal_piecewise(int32_t t, int segments, int degree, const int32_t *edge, const int32_t *shift,
                                      const int32_t *a) {{
    int j = segments - 1;
    if (t < edge[0]) t = edge[0];
    if (t > edge[segments]) t = edge[segments];
    while (j > 0 && t < edge[j]) j--;
    int64_t y = a[j * (degree + 1) + degree];
    for (int k = degree - 1; k >= 0; k--)
        y = ((y * (t - edge[j]) + ((int64_t)1 << (shift[j] - 1))) >> shift[j]) + a[j * (degree + 1) + k];
    return y;
}}
"""


def to_c_header(
    tables: dict[str, FixedTable], worst_deg_h: dict[str, float], *, serial: str
) -> str:
    """One C99 header: the tables x_kt, x_kd ... and one function an axis; the worst rounding error
    in a comment.
    """
    plain = "".join(c if c.isalnum() or c in "-_. " else "_" for c in serial)
    parts = [C_HEAD.format(serial=plain, tbits=TEMPERATURE_BITS, rbits=RATE_BITS)]
    for name, table in tables.items():
        for kind, values in (
            ("edge", table.edges),
            ("shift", table.shift),
            ("a", table.coefficients.ravel()),
        ):
            parts.append(
                f"static const int32_t {name}_{kind}[] = {{{', '.join(map(str, values))}}};"
            )
        parts.append(
            f"enum {{ {name}_segments = {len(table.shift)}, {name}_degree ="
            f" {table.coefficients.shape[1] - 1}, {name}_fraction_bits = {table.fraction_bits} }};"
        )
    for axis, worst in worst_deg_h.items():
        kt, kd = (
            f"recal_piecewise(t, {n}_segments, {n}_degree, {n}_edge, {n}_shift, {n}_a)"
            for n in (f"{axis}_kt", f"{axis}_kd")
        )
        down = RATE_BITS + tables[f"{axis}_kd"].fraction_bits - tables[f"{axis}_kt"].fraction_bits
        scaled = (
            f"(({kd} * r + ((int64_t)1 << {down - 1})) >> {down})"
            if down > 0
            else f"{kd} * r * {1 << -down}"
        )
        parts.append(f"\n/* worst rounding error {worst:.3g} deg/h */")
        parts.append(f"static inline int64_t {axis}_bias(int32_t t, int32_t r) {{")
        parts.append(f"    return {kt}\n        + {scaled};\n}}")
    return "\n".join(parts) + "\n"
