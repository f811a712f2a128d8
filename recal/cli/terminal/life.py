"""Signs of life: a line on a terminal before a command's libraries are loaded, and the log that
RECAL_LOG asks for on standard error.
"""

import logging
import os
import sys

LEVELS = ("debug", "info", "warning", "error")
log = logging.getLogger("recal")
_shown = False


def begin(words: str, *, quiet: bool) -> None:
    """Say on a terminal that a command begins, until `clear`."""
    global _shown
    log.info("%s begins", words)
    if not quiet and sys.stderr.isatty():
        sys.stderr.write(f"{words} ...")
        sys.stderr.flush()
        _shown = True


def clear() -> None:
    """Take that line away before anything else is written."""
    global _shown
    if _shown:
        sys.stderr.write("\r\x1b[K")
        sys.stderr.flush()
        _shown = False


def set_log_level() -> str:
    """The level of RECAL_LOG, none where it is not set; what is wrong with it, else empty."""
    level = os.environ.get("RECAL_LOG", "").lower()
    if not level:
        return ""
    if level not in LEVELS:
        return f"RECAL_LOG: got {level[:40]!r}, needed one of {', '.join(LEVELS)}"
    shown = logging.StreamHandler(sys.stderr)
    shown.setFormatter(logging.Formatter("%(relativeCreated)8.0f ms %(levelname)s %(message)s"))
    log.handlers[:] = [shown]
    log.setLevel(level.upper())
    log.propagate = False
    return ""
