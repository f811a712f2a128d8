"""Who issues the reports of this program, as the user's configuration names them.

Set once by the program that runs; every page of `base.html.j2` shows what is set. Loads nothing.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Issuer:
    """Texts of people, empty where nobody gave them."""

    organisation: str = ""
    department: str = ""
    operator: str = ""
    instrument_type: str = ""
    part_number: str = ""

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """What there is, with its name for people."""
        all_of_them = (
            ("issued by", ", ".join(filter(None, (self.organisation, self.department)))),
            ("operator", self.operator),
            ("instrument type", self.instrument_type),
            ("part number", self.part_number),
        )
        return tuple(row for row in all_of_them if row[1])


_set = [Issuer()]


def issuer() -> Issuer:
    """Who issues the reports."""
    return _set[0]


def set_issuer(found: Issuer) -> None:
    """Name who issues the reports from now on."""
    _set[0] = found
