"""The priors that a store keeps: listed, approved, rejected."""

from collections.abc import Sequence
from dataclasses import dataclass

from infield.store.errors import NoStore
from infield.store.priors import PriorsRecord
from infield.store.table_store import TableStore
from recal.service.inputs.unit_inputs import open_store
from recal.service.results.result import Result


@dataclass(frozen=True, kw_only=True)
class PriorsList:
    """What `recal fleet priors --json` prints."""

    schema: str = "recal.priors_list/1"
    store: str
    priors: Sequence[PriorsRecord]


@dataclass(frozen=True, repr=False, eq=False)
class ListedPriors(Result[PriorsList]):
    """The priors of a store."""

    def lines(self, *, verbose: bool = False) -> list[str]:
        """One line each, and one for each decision."""
        lines = []
        for row in self.record.priors:
            by = f" by {row.learnt_by}" if row.learnt_by else ""
            lines.append(
                f"{row.gyro_technology} priors {row.number}  {row.state:9s} learnt"
                f" {row.learnt_utc}{by}  {row.sha256[:12]}{'  ' if row.note else ''}{row.note}"
            )
            lines += [f"  {decision.words()}" for decision in row.decisions]
        return lines or ["the store holds no priors: recal fleet learn"]


def listed_priors(store_url: str) -> ListedPriors:
    """All priors of a store; InputError where there is none."""
    store = open_store(store_url)
    if store is None:
        raise NoStore(f"no store at {store_url}")
    return ListedPriors(PriorsList(store=store.name, priors=store.priors()))


def decide(
    store_url: str, technology: str, number: int, verdict: str, *, by: str, reason: str
) -> ListedPriors:
    """Approve or reject priors; the list of this one record.

    Parameters
    ----------
    store_url : str
        The store of tables.
    technology : str
        The technology: rlg, fog or mems.
    number : int
        The number of the priors.
    verdict : str
        approved or rejected.
    by : str
        The name of who decides.
    reason : str
        Why, kept with the decision.
    """
    if open_store(store_url) is None:
        raise NoStore(f"no store at {store_url}")
    with TableStore.open(store_url, create=True) as store:
        record = store.decide_priors(technology, number, verdict, by=by, reason=reason)
        return ListedPriors(PriorsList(store=store.name, priors=[record]))
