"""What the server was started with: address, store, reports, tokens. No web library here, so that
refusals come first.
"""

import hashlib
import ipaddress
import os
import stat
from dataclasses import dataclass
from pathlib import Path

from ins.records import InputError
from recal.service.inputs.listings import read_small_text

TOKEN_VARIABLE = "RECAL_SERVE_TOKEN"
SHORTEST_TOKEN = 16  # characters: 16 random letters are 75 bits (26^16); docs/serve.md advises 32
LARGEST_TOKEN_FILE = 65_536  # bytes; chosen: 500 lines of a name and a token of 64 characters each
LOOPBACK_NAMES = ("localhost",)


@dataclass(frozen=True)
class Token:
    """A token by its hash. `name`: whose it is, empty where it is shared and names are typed."""

    sha256: bytes
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class ServeSettings:
    """`ticket`: of the link that signs in once; `hosts`: further names under which a browser may
    ask for the page; `https`: a proxy adds TLS before it.
    """

    store_url: str
    host: str = "127.0.0.1"
    port: int = 8000
    reports: Path | None = None
    tokens: tuple[Token, ...] = ()
    ticket: Token | None = None
    hosts: tuple[str, ...] = ()
    https: bool = False

    def __post_init__(self) -> None:
        if not self.tokens and self.reading_needs_token:
            why = (
                f"on {self.host}"
                if not is_loopback(self.host)
                else "under another name or behind a proxy"
            )
            raise InputError(
                f"serve: a token is needed {why}: give --token-file or set {TOKEN_VARIABLE}"
            )

    @property
    def reading_needs_token(self) -> bool:
        """Whoever is not on this machine signs in before reading, too."""
        return not is_loopback(self.host) or bool(self.hosts) or self.https


def is_loopback(host: str) -> bool:
    """127.0.0.0/8, ::1 or localhost."""
    if host in LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def token_of(text: str, name: str = "", *, source: str) -> Token:
    """A token; InputError where it is too short to be one. Its text is never in a message."""
    if len(text) < SHORTEST_TOKEN or not text.isascii() or not text.isprintable():
        raise InputError(
            f"{source}: a token of {len(text)} characters, needed at least {SHORTEST_TOKEN},"
            " printable ASCII"
        )
    return Token(hashlib.sha256(text.encode()).digest(), name)


def read_tokens(path: Path | None) -> tuple[Token, ...]:
    """Tokens of a file (a line each: TOKEN, or NAME and TOKEN), else the one of the environment,
    else none.
    """
    if path is None:
        text = os.environ.pop(TOKEN_VARIABLE, "").strip()  # popped: no child process inherits it
        return (token_of(text, source=TOKEN_VARIABLE),) if text else ()
    lines = read_small_text(path, most_bytes=LARGEST_TOKEN_FILE).splitlines()
    found = []
    for number, line in enumerate(lines, start=1):
        if line.strip() and not line.startswith("#"):
            name, _, token = line.strip().rpartition(" ")
            if not name.isprintable() or len(name) > 200:
                raise InputError(
                    f"{path}: line {number}: needed TOKEN, or a NAME of at most 200 characters and"
                    " TOKEN"
                )
            found.append(token_of(token, name.strip(), source=f"{path}: line {number}"))
    if not found:
        raise InputError(f"{path}: holds no token")
    if len({t.sha256 for t in found}) < len(found):
        raise InputError(f"{path}: the same token twice")
    return tuple(found)


def too_open(path: Path) -> bool:
    """Can others than the owner and the group read the token file?"""
    return bool(path.stat().st_mode & stat.S_IROTH)
