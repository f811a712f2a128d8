"""Who may write: tokens, sessions, form tokens, a limit on wrong guesses. All in memory: it ends
with the process.
"""

import hashlib
import hmac
import secrets
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass

from starlette.exceptions import HTTPException

from recal.web.settings import Token

SESSION_S = 8 * 3600.0
# chosen: 10 min to click a link that was printed; a link in a log or a screenshot is dead by then
TICKET_S = 600.0
# chosen: far more than people who review one fleet; the oldest of 501 signs in again
MAX_SESSIONS = 500
MAX_FAILURES = 5  # of one address within FAILURE_WINDOW_S (docs/serve.md): 1,440 guesses a day
# 57,600 guesses a day; the shortest token, 16 letters, is one of 26^16 = 4e22 (docs/serve.md)
MAX_FAILURES_IN_ALL = 200
FAILURE_WINDOW_S = 300.0  # chosen: 5 min; who mistyped waits no longer (docs/serve.md)


class TooManyGuesses(HTTPException):
    """Wrong tokens came too often; `seconds`: when to try again."""

    def __init__(self, seconds: int) -> None:
        said = f"too many wrong tokens; try again in {seconds} s"
        super().__init__(429, said, {"retry-after": str(seconds)})


@dataclass(frozen=True)
class Session:
    """`name`: whose token opened it, empty for a shared one; `form_token` goes into each of its
    forms.
    """

    name: str
    form_token: str
    ends: float


class Door:
    """Sessions by the hash of their id; thread-safe."""

    def __init__(
        self,
        tokens: tuple[Token, ...],
        clock: Callable[[], float] = time.monotonic,
        ticket: Token | None = None,
    ) -> None:
        self._tokens, self._clock = tokens, clock
        self._ticket, self._ticket_ends = ticket, clock() + TICKET_S
        self._secret = secrets.token_bytes(32)
        self._sessions: OrderedDict[bytes, Session] = OrderedDict()
        self._failures: dict[str, deque[float]] = {}
        self._lock = threading.Lock()

    @property
    def locked(self) -> bool:
        """No token exists: nobody can sign in, the page only reads."""
        return not self._tokens

    def sign_in(self, token: str, peer: str) -> str | None:
        """The id of a new session, None for a wrong token; TooManyGuesses where wrong ones came too
        often.
        """
        with self._lock:
            self._require_patience(peer)
            given, found = hashlib.sha256(token.encode(errors="replace")).digest(), None
            for known in self._tokens:  # all of them, whatever the first ones say
                if hmac.compare_digest(known.sha256, given):
                    found = known
            if found is None:
                self._failures.setdefault(peer, deque()).append(self._clock())
                return None
            self._failures.pop(peer, None)
            return self._let_in(found)

    def sign_in_once(self, ticket: str) -> str | None:
        """The id of a new session for the ticket of a login link, which is spent by that; None for
        a wrong, a spent or an old one. Wrong ones are not counted: nobody guesses one of 2^192, and
        a page of another site can make a browser send them.
        """
        with self._lock:
            known, given = self._ticket, hashlib.sha256(ticket.encode(errors="replace")).digest()
            right = known is not None and hmac.compare_digest(known.sha256, given)
            if known is None or not right or self._clock() >= self._ticket_ends:
                return None
            self._ticket = None
            return self._let_in(known)

    def session(self, session_id: str) -> Session | None:
        """The session of a cookie, None where it is unknown or over."""
        with self._lock:
            found = self._sessions.get(_hash(session_id))
            if found is not None and found.ends <= self._clock():
                del self._sessions[_hash(session_id)]
                found = None
            return found

    def sign_out(self, session_id: str) -> None:
        with self._lock:
            self._sessions.pop(_hash(session_id), None)

    def form_token(self, cookie: str) -> str:
        """What a form must carry beside this cookie; only this process can make it."""
        return hmac.new(self._secret, cookie.encode(errors="replace"), hashlib.sha256).hexdigest()

    def _let_in(self, token: Token) -> str:
        """The id of a new session; the oldest of too many ends."""
        session_id = secrets.token_urlsafe(32)
        self._sessions[_hash(session_id)] = Session(
            token.name, self.form_token(session_id), self._clock() + SESSION_S
        )
        while len(self._sessions) > MAX_SESSIONS:
            self._sessions.popitem(last=False)
        return session_id

    def _require_patience(self, peer: str) -> None:
        now = self._clock()
        for name in list(self._failures):
            recent = self._failures[name]
            while recent and recent[0] <= now - FAILURE_WINDOW_S:
                recent.popleft()
            if not recent:
                del self._failures[name]
        mine = self._failures.get(peer, deque())
        if (
            len(mine) >= MAX_FAILURES
            or sum(map(len, self._failures.values())) >= MAX_FAILURES_IN_ALL
        ):
            oldest = mine[0] if mine else min(recent[0] for recent in self._failures.values())
            raise TooManyGuesses(max(1, round(oldest + FAILURE_WINDOW_S - now)))


def same(one: str, other: str) -> bool:
    """Equality in constant time."""
    return hmac.compare_digest(one.encode(errors="replace"), other.encode(errors="replace"))


def _hash(session_id: str) -> bytes:
    return hashlib.sha256(session_id.encode(errors="replace")).digest()
