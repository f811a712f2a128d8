"""The forecast of the store, made once a day and anew where a table or the priors changed: it takes
seconds.
"""

import threading
from collections.abc import Hashable
from datetime import UTC, datetime

from recal.service.priors.forecast import most_urgent
from recal.service.priors.forecast_records import ForecastDocument
from recal.service.store import TableStore


class Forecasts:
    """The latest forecast and what it rests on."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._key: Hashable = None
        self._document: ForecastDocument | None = None

    def of(self, store: TableStore) -> tuple[Hashable, ForecastDocument]:
        """A key that changes with it, and the forecast."""
        key = _key_of(store)
        with self._lock:
            if self._document is None or key != self._key:
                self._key, self._document = key, most_urgent(store)
            return key, self._document

    def at_hand(self, store: TableStore) -> ForecastDocument | None:
        """The forecast where it is made already and still holds; making it takes seconds."""
        key = _key_of(store)
        with self._lock:
            return self._document if key == self._key else None


def _key_of(store: TableStore) -> Hashable:
    """What a forecast rests on, and the day."""
    tables = tuple((unit.unit, unit.sha256) for unit in store.overview())
    priors = tuple((p.gyro_technology, p.number, p.state) for p in store.priors())
    return datetime.now(UTC).date(), tables, priors
