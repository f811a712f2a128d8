"""The forecast of the store, made once a day and anew where a table or the priors changed: it takes
seconds.
"""

from collections.abc import Hashable
from datetime import UTC, datetime

from recal.service.priors.forecast import most_urgent
from recal.service.priors.forecast_records import ForecastReport
from recal.service.store import TableStore
from recal.web.drawings import Once


class Forecasts:
    """The latest forecast, by what it rests on."""

    def __init__(self) -> None:
        self._made = Once(1)

    def of(self, store: TableStore) -> tuple[Hashable, ForecastReport]:
        """A key that changes with it, and the forecast."""
        key = _key_of(store)
        return key, self._made.of(key, lambda: most_urgent(store))

    def at_hand(self, store: TableStore) -> ForecastReport | None:
        """The forecast where it is made already and still holds; making it takes seconds."""
        found: ForecastReport | None = self._made.at_hand(_key_of(store))
        return found


def _key_of(store: TableStore) -> Hashable:
    """What a forecast rests on, and the day."""
    tables = tuple((unit.unit, unit.sha256) for unit in store.overview())
    priors = tuple((p.gyro_technology, p.number, p.state) for p in store.priors())
    return datetime.now(UTC).date(), tables, priors
