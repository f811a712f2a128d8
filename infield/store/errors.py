"""What can stand in the way of the store, as types; a caller asks for the type, never for words."""

from enum import StrEnum

from ins.records import InputError, Refusal


class StoreRefusal(StrEnum):
    """Why the store did not take an update or a decision."""

    TABLE_MOVED = "table_moved"
    REVISION_MOVED = "revision_moved"
    BUSY = "store_busy"
    RUN_ALREADY_MERGED = "run_already_merged"
    ALREADY_REJECTED = "already_rejected"
    SAME_PERSON = "same_person"
    NO_STORE = "no_store"
    UNIT_NOT_IN_STORE = "unit_not_in_store"


class StoreError(InputError):
    """The store cannot be opened, read or written: no fault of the run that is in hand."""


class NoStore(StoreError):
    """Nothing at this URL is a store."""


class UnknownTableHash(StoreError):
    """No table of the store has this content hash."""


class RowFault(StoreError):
    """A row was changed or is missing.

    Parameters
    ----------
    message : str
        The whole line, with store and unit.
    row : str
        The same without them: which row, and what is wrong with it.
    """

    def __init__(self, message: str, row: str = "") -> None:
        super().__init__(message)
        self.row = row


class UnknownUnit(InputError):
    """The store holds nothing under this serial (and mode)."""


class StoreRefused(Refusal):
    """The store stands as it was; `code` says why."""

    code: StoreRefusal


class StoreConflict(StoreRefused):
    """Somebody else changed this unit meanwhile, or holds the store: read again and retry."""


class TableMoved(StoreConflict):
    """Another table than the update's parent is active by now."""

    code = StoreRefusal.TABLE_MOVED


class RevisionMoved(StoreConflict):
    """Another revision than the one that the caller saw is active by now."""

    code = StoreRefusal.REVISION_MOVED


class StoreBusy(StoreConflict):
    """Other writers held the store all the time."""

    code = StoreRefusal.BUSY


class RunAlreadyMerged(StoreRefused):
    """The active table of this unit already holds this run."""

    code = StoreRefusal.RUN_ALREADY_MERGED


class AlreadyRejected(StoreRefused):
    """The same update was rejected before, and nothing new is said for it."""

    code = StoreRefusal.ALREADY_REJECTED


class SamePerson(StoreRefused):
    """Who approves a proposal is who put it forward, or nobody is named who did."""

    code = StoreRefusal.SAME_PERSON


class StoreNotAskedFor(StoreRefused):
    """There is no store, and nobody asked for a new one."""

    code = StoreRefusal.NO_STORE


class UnitNotInStore(StoreRefused):
    """The store holds no table of the unit, and nobody asked for a new unit."""

    code = StoreRefusal.UNIT_NOT_IN_STORE


# refusals that another estimate, from the table that is active by then, may overcome
WORTH_ANOTHER_TRY = (StoreRefusal.TABLE_MOVED, StoreRefusal.BUSY)
