"""Who issues the reports, as the command line names them. Loads nothing."""

from infield.reports.issuer import Issuer as Issuer
from infield.reports.issuer import set_issuer as set_issuer
