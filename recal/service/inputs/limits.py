"""How much a packed file may unpack to, for the command line."""

from trajectories.runs.limits import unpack_limit

__all__ = ["unpack_limit"]
