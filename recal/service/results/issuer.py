"""Who issues the reports: from a user's configuration to the pages. Loads nothing at import."""

from typing import Protocol


class NamesIssuer(Protocol):
    """A configuration that says who issues reports, and of which instruments."""

    @property
    def organisation(self) -> str: ...
    @property
    def department(self) -> str: ...
    @property
    def operator(self) -> str: ...
    @property
    def instrument_type(self) -> str: ...
    @property
    def part_number(self) -> str: ...


def name_issuer(configured: NamesIssuer) -> None:
    """Every report from now on names who the configuration says, where it says anyone."""
    named = (
        configured.organisation,
        configured.department,
        configured.operator,
        configured.instrument_type,
        configured.part_number,
    )
    if not any(named):
        return
    from infield.reports.issuer import Issuer, set_issuer

    set_issuer(
        Issuer(
            organisation=configured.organisation,
            department=configured.department,
            operator=configured.operator,
            instrument_type=configured.instrument_type,
            part_number=configured.part_number,
        )
    )
