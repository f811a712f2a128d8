"""The lines for people of a thermal fit."""

from infield.reports.documents.fog import FogDocument
from infield.reports.documents.rlg import RlgDocument, TermState

SETTLED_TERMS = ("K1", "K2", "K3")  # of a unit whose temperature stands still


def fog_summary(document: FogDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = _head(document)
    for axis, a in document.axes.items():
        K, s = a.K_delta_deg_h_per_degC_min, a.sigma_K_delta_deg_h_per_degC_min
        middle = len(K) // 2
        lines.append(
            f"  gyro {axis}: K_delta {K[0]:+.4f} .. {K[middle]:+.4f} .. {K[-1]:+.4f} +-"
            f" {s[middle]:.4f} deg/h per degC/min over {a.temperature_degC[0]:g} .."
            f" {a.temperature_degC[-1]:g} degC; K_T spans"
            f" {max(a.K_T_deg_h) - min(a.K_T_deg_h):.4f} deg/h; slow ramps up to"
            f" {a.slow_rate.largest_degC_min:.4f} degC/min"
        )
        if a.document is not None and a.document.gain is not None:
            lines.append(
                f"    the document's subtraction reads K_delta times {a.document.gain:.3f}"
            )
    for found in document.check:
        for axis, row in found.axes.items():
            lines.append(
                f"  {found.run_id} gyro {axis}: {row.before_deg_h:.4f} ->"
                f" {row.after_deg_h:.4f} deg/h RMS (noise {row.noise_deg_h:.4f}),"
                f" {row.causal_after_deg_h:.4f} in real-time order"
            )
    return lines


def rlg_summary(document: RlgDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = _head(document)
    for axis, a in document.axes.items():
        used = {name: t for name, t in a.terms.items() if t.state == TermState.USED}
        said = ", ".join(
            f"{name} {t.value:+.5f} +- {t.sigma:.5f}"
            for name, t in used.items()
            if name not in SETTLED_TERMS
        )
        h = a.held_out
        lines.append(
            f"  gyro {axis}: {said or 'no rate or gradient term'}; held out {h.before_deg_h:.4f}"
            f" -> {h.temperature_only_deg_h:.4f} (temperature) -> {h.model_deg_h:.4f} deg/h"
            f" RMS, noise {h.noise_deg_h:.4f}"
        )
    for found in document.check:
        for axis, row in found.axes.items():
            lines.append(
                f"  {found.run_id} gyro {axis}: {row.before_deg_h:.4f} ->"
                f" {row.temperature_only_deg_h:.4f} (temperature) -> {row.after_deg_h:.4f}"
                f" deg/h RMS (noise {row.noise_deg_h:.4f}), {row.causal_after_deg_h:.4f} in"
                " real-time order"
            )
    return lines


def _head(document: FogDocument | RlgDocument) -> list[str]:
    """Verdict, reasons, notes."""
    return [
        f"{document.imu_serial}: {document.verdict}",
        *(f"  because {reason}" for reason in document.reasons),
        *(f"  {note}" for note in document.notes),
    ]
