"""`alignment.json` of formats.md, section 5."""

from typing import Any

from alignment.result import Alignment
from ins.records import Run
from ins.units import DEG


def alignment_document(result: Alignment, run: Run) -> dict[str, Any]:
    """The alignment as a plain document; angles not found are NaN (null in the file)."""
    phases = result.phases or run.phases
    return {
        "schema": "recal.alignment/1",
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "run_id": run.header.run_id,
        "imu_serial": run.header.imu_serial,
        "time_s": result.time_s,
        "roll_deg": result.roll_rad / DEG,
        "pitch_deg": result.pitch_rad / DEG,
        "heading_deg": result.heading_rad / DEG % 360.0,
        "sigma_roll_deg": result.sigma_roll_rad / DEG,
        "sigma_pitch_deg": result.sigma_pitch_rad / DEG,
        "sigma_heading_deg": result.sigma_heading_rad / DEG,
        "latitude_found_deg": result.latitude_rad / DEG,
        "sigma_latitude_deg": result.sigma_latitude_rad / DEG,
        "phases": [{"phase": p.phase, "start_s": p.start_s, "end_s": p.end_s} for p in phases],
        "duration_s": result.duration_s,
        "excluded": [
            {"start_s": s.start_s, "end_s": s.end_s, "reason": s.reason} for s in result.excluded
        ],
        "consistency": {"nis_mean": result.nis_mean, "dof": result.dof},
    }
