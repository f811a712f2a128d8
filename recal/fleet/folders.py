"""Where the reports of units and runs go in the output folder: names that any file system takes and
that sort by time.
"""

import hashlib
import re
from datetime import UTC

from recal.fleet.records import PlannedRun
from recal.service.store import UnitKey, moment

LONGEST = 80  # characters kept of a name


def unit_folder(key: UnitKey) -> str:
    """A folder name for a unit."""
    return _safe("-".join(filter(None, (key.imu_serial, key.gyro_technology, key.gyro_mode))))


def run_folder(run: PlannedRun) -> str:
    """A folder name for a run's report, in time order among those of its unit."""
    stamp = moment(run.start_utc).astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
    return f"{stamp}-{_safe(run.run_id)}-{hashlib.sha256(run.path.encode()).hexdigest()[:6]}"


def _safe(text: str) -> str:
    """The text where it is a plain name, else what is left of it with digits of its hash, so that
    no two are the same.
    """
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", text)[:LONGEST]
    return (
        safe
        if safe == text and not text.startswith(".")
        else f"_{safe}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    )
