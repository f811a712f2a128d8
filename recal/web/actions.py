"""Everything that is written: sign in and out, approve or reject a proposal, roll a table back.
Every form is checked.
"""

import secrets
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import HTMLResponse, Response

from ins.records import InputError
from recal.web import views
from recal.web.door import same
from recal.web.guard import form_of
from recal.web.pages import Number, Reader, Unit
from recal.web.site import Visit

OTHER_PAGE = (
    "The form is not the one that this page gave you, or it is older than your session. Open the"
    " page again."
)
USED_LINK = (
    "This link was used already, or is older than 10 minutes. Sign in with the token that recal"
    " serve printed, or start it again."
)
VERDICTS = ("approved", "rejected")

router = APIRouter()
Visitor = Annotated[Visit, Depends()]


class Sent(Visit):
    """A form that a page of this site has sent, with the token that goes with the cookie."""

    needs_session = False

    def __init__(self, request: Request, form: Annotated[dict[str, str], Depends(form_of)]) -> None:
        super().__init__(request)
        self.form = form
        if self.site.door.locked:
            raise HTTPException(
                403, "The server was started without a token: nothing can be written here."
            )
        if self.needs_session and self.session is None:
            raise HTTPException(
                403,
                "You are not signed in, or your session is over. Sign in and send the form again.",
            )
        if not self.cookie:
            raise HTTPException(403, f"{OTHER_PAGE} Cookies must be allowed.")
        if not same(self.site.door.form_token(self.cookie), form.get("form_token", "")):
            raise HTTPException(403, OTHER_PAGE)

    def number(self, name: str) -> int:
        """A field that is a whole number."""
        text = self.form.get(name, "")
        if not (text.isascii() and text.isdecimal() and len(text) < 10):
            raise InputError(f"{name}: got {text[:20]!r}, needed a whole number")
        return int(text)


class Signed(Sent):
    """A form of one who is signed in."""

    needs_session = True

    @property
    def by(self) -> str:
        """Whose token opened the session; the name that is typed where several share the token."""
        name = self.session.name if self.session else ""
        return name or self.form.get("by", "")

    @property
    def unit(self) -> tuple[str, str, str]:
        """Serial, technology and mode."""
        if not self.form.get("serial") or not self.form.get("technology"):
            raise InputError("serial and technology: needed, to name the unit")
        return self.form["serial"], self.form["technology"], self.form.get("mode", "")


@router.get("/signin")
def sign_in_page(visit: Visitor, next: str = "/") -> HTMLResponse:
    return _sign_in_page(visit, next)


@router.post("/signin")
def sign_in(visit: Annotated[Sent, Depends()]) -> Response:
    peer = visit.request.client.host if visit.request.client else ""
    session_id = visit.site.door.sign_in(visit.form.get("token", ""), peer)
    path = visit.form.get("next", "/")
    if session_id is None:
        return _sign_in_page(visit, path, wrong=True)
    return _signed_in(visit, session_id, local_path(path))


@router.get("/login")
def sign_in_once(visit: Visitor, ticket: str = "") -> Response:
    session_id = visit.site.door.sign_in_once(ticket)
    if session_id is not None:
        return _signed_in(visit, session_id, "/")
    if visit.session is not None:
        return visit.go_to("/")  # clicked again by a browser that is signed in
    raise HTTPException(403, USED_LINK)


@router.post("/signout")
def sign_out(visit: Annotated[Signed, Depends()]) -> Response:
    visit.site.door.sign_out(visit.cookie)
    answer = visit.go_to("/")
    visit.set_cookie(answer, "")
    return answer


@router.post("/decide")
def decide(visit: Annotated[Signed, Depends()]) -> Response:
    verdict = visit.form.get("verdict", "")
    if verdict not in VERDICTS:
        raise HTTPException(400, "verdict: needed approved or rejected")
    with visit.site.tables() as opened:
        done = opened.decide(
            visit.number("number"),
            verdict,
            *visit.unit,
            by=visit.by,
            reason=visit.form.get("reason", ""),
        )
    return visit.go_to(views.address("/unit", done.unit, done=verdict))


@router.get("/rollback")
def confirm_rollback(reader: Reader, asked: Unit, to: Number) -> HTMLResponse:
    reader.need_session()
    with reader.site.tables() as opened:
        active = opened.active(*asked.key)
        target = opened.revision(to, *asked.key)
    return reader.page(
        "rollback.html.j2",
        unit=active.unit,
        active=active,
        target=target,
        change=views.change_rows(active, target),
        made_from=views.provenance_change(active, target),
    )


@router.post("/rollback")
def rollback(visit: Annotated[Signed, Depends()]) -> Response:
    serial, technology, mode = visit.unit
    with visit.site.tables() as opened:
        done = opened.rollback(
            serial,
            visit.number("to"),
            technology,
            mode,
            by=visit.by,
            reason=visit.form.get("reason", ""),
            active_number=visit.number("active"),
        )
    return visit.go_to(views.address("/unit", done.unit, done="rolled back"))


def local_path(path: str) -> str:
    """A path on this site to go on to, "/" where it would lead elsewhere."""
    parts = urlsplit(path)
    here = path.startswith("/") and not path.startswith("//") and "\\" not in path
    elsewhere = parts.scheme or parts.netloc
    plain = path.isascii() and path.isprintable()
    return path if here and plain and not elsewhere else "/"


def _sign_in_page(visit: Visit, path: str, *, wrong: bool = False) -> HTMLResponse:
    cookie = visit.cookie or secrets.token_urlsafe(32)
    answer = visit.page(
        "signin.html.j2",
        403 if wrong else 200,
        next=local_path(path),
        wrong=wrong,
        form_token=visit.site.door.form_token(cookie),
    )
    visit.set_cookie(answer, cookie)
    return answer


def _signed_in(visit: Visit, session_id: str, path: str) -> Response:
    answer = visit.go_to(path)
    visit.set_cookie(answer, session_id)
    return answer
