"""Who issues the reports, as the command line names them. Loads nothing."""

from infield.reports.issuer import Issuer, set_issuer

__all__ = ["Issuer", "set_issuer"]
