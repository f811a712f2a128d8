"""The table store of the front door: everything of `TableStore`, and `commit` of a result.

Fleet and web take the store's records and errors from here.
"""

import os
from dataclasses import replace
from datetime import datetime

from infield.session.disagreement import SessionEvidence as SessionEvidence
from infield.session.disagreement import utc
from infield.store.database import holds_store as holds_store
from infield.store.database import parsed_url
from infield.store.database import require_folder as require_folder
from infield.store.database import store_name as store_name
from infield.store.errors import WORTH_ANOTHER_TRY as WORTH_ANOTHER_TRY
from infield.store.errors import StoreBusy as StoreBusy
from infield.store.errors import StoreConflict as StoreConflict
from infield.store.errors import StoreError as StoreError
from infield.store.errors import StoreRefused as StoreRefused
from infield.store.errors import UnknownUnit as UnknownUnit
from infield.store.proposal_rows import Decided as Decided
from infield.store.proposals import signed_note as signed_note
from infield.store.rows import unit_of_table
from infield.store.table_store import FullProposal as FullProposal
from infield.store.table_store import MergedRun as MergedRun
from infield.store.table_store import Proposal as Proposal
from infield.store.table_store import Revision as Revision
from infield.store.table_store import TableStore as TableStore
from infield.store.table_store import UnitKey as UnitKey
from infield.store.table_store import UnitRecord as UnitRecord
from infield.store.table_store import UnitSummary as UnitSummary
from infield.store.table_store import store_exists as store_exists
from ins.errors.table import DEFAULT_SIGMA_deg_h as DEFAULT_SIGMA_deg_h
from ins.records import InputError
from ins.verdicts import Outcome
from recal.service.inputs.new_units import require_unit
from recal.service.update import Update, commit_update


class Store(TableStore):
    """Thermal tables by unit, append-only; a context manager that closes it."""

    def commit(
        self, result: Update, *, by: str, note: str = "", new_unit: bool = False
    ) -> Revision:
        """Make the table of an update the active one, in one transaction or not at all.

        Parameters
        ----------
        result : Update
            One whose verdict is `proposed`.
        by : str
            Who answers for it; kept with the revision.
        note : str
            Kept with the revision.
        new_unit : bool
            A unit that the store does not hold begins with the table before the update; else it is
            refused.

        Returns
        -------
        Revision
            The active revision.

        Raises
        ------
        InputError
            Where the update was refused or is inconsistent, or nobody signs.
        StoreConflict
            Where another table is active by now.
        StoreRefused
            Where the table holds one of the runs, or the store holds no table of the unit and
            `new_unit` is false.
        """
        if result.verdict != Outcome.PROPOSED:
            raise InputError(f"commit: the update is {result.verdict}, needed proposed")
        if not new_unit:
            require_unit(self, unit_of_table(result.unit.table))
        document = replace(result.record, verdict=Outcome.COMMITTED, store=self.name)
        signed = signed_note(by, note or "committed from Python", "by ")
        return commit_update(self, result.estimate, result.unit, document, signed)


def open_store(url: str, *, create: bool = True) -> Store:
    """The table store at an SQLAlchemy URL.

    Parameters
    ----------
    url : str
        Such as `sqlite:///recal.db` or `postgresql+psycopg://host/recal`.
    create : bool
        Make the store, or migrate it, if need be; else InputError where it is missing.

    Returns
    -------
    Store
        A context manager; `.commit(result, by="...")` makes an update's table the active one.

    Raises
    ------
    InputError
        Where the store cannot be opened.

    Examples
    --------
    >>> import recal
    >>> recal.open_store("sqlite:///nowhere.db", create=False)
    Traceback (most recent call last):
        ...
    infield.store.errors.NoStore: no store at sqlite:///nowhere.db
    """
    opened = Store.open(url, create=create)
    assert isinstance(opened, Store)
    return opened


def absolute_store(url: str) -> tuple[str, str | None]:
    """The URL with the absolute path of an SQLite file, and that path; None for a server."""
    parsed = parsed_url(url)
    if parsed.get_backend_name() != "sqlite":
        return url, None
    path = os.path.abspath(str(parsed.database))
    return parsed.set(database=path).render_as_string(hide_password=False), path


def moment(utc_text: str) -> datetime:
    """A time of run.json or a table as datetime."""
    return utc(utc_text)
