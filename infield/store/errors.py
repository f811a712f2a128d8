"""What can stand in the way of the store, as types; a caller asks for the type, never for words."""

from ins.records import InputError, Refusal


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

    code: str


class StoreConflict(StoreRefused):
    """Somebody else changed this unit meanwhile, or holds the store: read again and retry."""


class TableMoved(StoreConflict):
    """Another table than the update's parent is active by now."""

    code = "table_moved"


class RevisionMoved(StoreConflict):
    """Another revision than the one that the caller saw is active by now."""

    code = "revision_moved"


class StoreBusy(StoreConflict):
    """Other writers held the store all the time."""

    code = "store_busy"


class RunAlreadyMerged(StoreRefused):
    """The active table of this unit already holds this run."""

    code = "run_already_merged"


class AlreadyRejected(StoreRefused):
    """The same update was rejected before, and nothing new is said for it."""

    code = "already_rejected"


class SamePerson(StoreRefused):
    """Who approves a proposal is who put it forward, or nobody is named who did."""

    code = "same_person"


class StoreNotAskedFor(StoreRefused):
    """There is no store, and nobody asked for a new one."""

    code = "no_store"


class UnitNotInStore(StoreRefused):
    """The store holds no table of the unit, and nobody asked for a new unit."""

    code = "unit_not_in_store"


# refusals that another estimate, from the table that is active by then, may overcome
WORTH_ANOTHER_TRY = (TableMoved.code, StoreBusy.code)
