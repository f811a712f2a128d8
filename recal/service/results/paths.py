"""What counts as a path."""

from os import PathLike

AnyPath = str | PathLike[str]
