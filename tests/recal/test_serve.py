"""The review page as a reader and a reviewer use it: what is shown, what is recorded, what is
refused.
"""

import html
import json
import re
from contextlib import closing

import pytest

from infield.table.thermal_table import EvenNodes

pytest.importorskip("fastapi")

from infield.store.table_store import TableStore
from recal.web import pages
from tests.drawn import specifications
from tests.infield import stores
from tests.recal.serving import NAMED_TOKEN, Visitor, merged, put_unit, report, serving, shifted

url = stores.url
HOSTILE = "SN\"><script>alert(1)</script>&'/../%2e%2e"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Three units in a store, two folders with diagnoses."""
    folder = tmp_path_factory.mktemp("site")
    url = f"sqlite:///{folder}/recal.db"
    put_unit(url, "SN-1")
    put_unit(url, "SN-2", kind=("fog", "dithered"), updates=0, proposals=0)
    put_unit(url, HOSTILE, note="<img src=x onerror=alert(2)>", updates=0, run="<b>run</b>")
    for name, serial in (("2026/march", "SN-1"), ("april", HOSTILE)):
        (folder / "reports" / name).mkdir(parents=True)
        said = {
            "schema": "recal.diagnosis/1",
            "verdict": "refused",
            "sentence": "No run: <i>none</i>.",
            "imu_serial": serial,
        }
        (folder / "reports" / name / "diagnosis.json").write_text(json.dumps(said))
        (folder / "reports" / name / "diagnosis.html").write_text(
            f"<!DOCTYPE html><p>diagnosis of {name}"
        )
    with serving(url, reports=folder / "reports") as base:
        yield base, url


@pytest.fixture
def visitor(site):
    with Visitor(site[0]) as found:
        yield found


@pytest.fixture
def fresh(url):
    """A store of one unit, two proposals, on either database: address and URL."""
    put_unit(url, proposals=2)
    with serving(url) as base:
        yield base, url


@pytest.fixture(scope="module", params=stores.DATABASES)
def untouched(request, tmp_path_factory):
    """As `fresh`, but one for all tests that change nothing."""
    with stores.database_url(request.param, tmp_path_factory.mktemp("untouched")) as url:
        put_unit(url, proposals=2)
        with serving(url) as base:
            yield base, url


def text_of(answer):
    return " ".join(
        html.unescape(
            re.sub(r"<(style|svg)\b.*?</\1>|<[^>]*>", " ", answer.text, flags=re.DOTALL)
        ).split()
    )


def waiting(visitor, *paths):
    """The numbers of proposals to decide that the bars of these pages show."""
    bars = [visitor.get(path).text.partition("<header>")[0] for path in paths]
    shown = [re.search(r'class="count">(\d+)', bar) for bar in bars]
    return {int(found[1]) if found else 0 for found in shown}


def test_units_are_listed_searched_and_sorted(visitor):
    page = visitor.get("/")
    assert page.status_code == 200
    assert "3 units in the store" in text_of(page)
    assert "proposed update" in text_of(page)
    assert [m in visitor.get("/?q=dither").text for m in ("SN-2", ">SN-1<")] == [True, False]
    down = visitor.get("/?sort=technology&down=true").text
    assert down.index(">SN-1<") < down.index(">SN-2<") and 'aria-sort="descending"' in down
    none = visitor.get("/?q=zzz")
    assert "No unit matches “zzz”. Show all units" in text_of(none) and 'href="/">Show' in none.text


def test_one_unit_shows_table_plot_history_and_proposals(visitor):
    page = visitor.get("/unit?serial=SN-1&technology=rlg")
    words = text_of(page)
    assert "Revision 2 is active" in words
    assert len(specifications(page.text)) == 3
    assert "style=" not in page.text
    assert page.text.count("Bias of gyro x against temperature: factory, active table") == 1
    assert "+0.0010 0.020" in words or "+0.001 0.020" in words  # bias and U(k=2) of the rlg default
    assert "proposal 1" in words
    assert "SHA-256" in words
    assert "run-0" in words
    assert "2026/march" in words
    with_mode = visitor.get("/unit?serial=SN-2&technology=fog&mode=dithered")
    assert with_mode.status_code == 200 and "Compare" not in text_of(with_mode)
    assert "waits for a decision: proposal 1" in words and "waits" not in text_of(with_mode)
    assert "1e" not in "".join(re.findall(r"<text.*?</text>", with_mode.text, re.DOTALL))
    assert visitor.get("/unit?serial=SN-2&technology=fog").status_code == 404


@pytest.mark.parametrize(
    "path, status, words",
    [
        ("/unit?serial=SN-9&technology=rlg", 404, "no table for serial SN-9."),
        ("/unit?serial=SN-1", 400, "at this address: technology is missing."),
        ("/diff?serial=SN-1&technology=rlg&before=9", 400, "no revision 9, needed 1 to 2"),
        ("/?sort=colour", 400, "sort is 'colour', needed 'next', 'serial'"),
        ("/diff?serial=SN-1&technology=rlg&before=x", 400, "before is 'x'"),
        ("/nothing", 404, "no page here"),
        ("/proposals?state=banana", 400, "state is 'banana', needed 'open', 'out of date'"),
        ("/?page=0", 400, "page is '0', needed a whole number from 1 on."),
        ("/proposal?serial=SN-1&technology=rlg&number=7", 400, "no proposal 7"),
        ("/unit?serial=a%00b&technology=rlg", 404, "no table"),
        ("/revision/report?serial=SN-1&technology=rlg&number=1", 404, "without a report"),
        ("/diagnosis?folder=none", 404, "no diagnosis"),
        (
            "/proposal?serial=SN-1&technology=rlg&number=99999999999999999999",
            400,
            "needed a whole number",
        ),
        ("/diff?serial=SN-1&technology=rlg&before=99999999999999999999", 400, ""),
    ],
)
def test_a_wrong_address_is_a_readable_line(visitor, path, status, words):
    answer = visitor.get(path)
    assert answer.status_code == status and words in text_of(answer)
    assert "Traceback" not in answer.text and "sqlite" not in answer.text


def test_hostile_texts_stay_texts(visitor):
    listed = visitor.get("/").text
    link = re.search(r'href="(/unit\?serial=SN%22[^"]*)"', listed)[1].replace("&amp;", "&")
    unit = visitor.get(link)
    assert unit.status_code == 200
    assert "&lt;script&gt;" in unit.text
    assert "&lt;img src=x" in unit.text
    proposal = visitor.get(
        re.search(r'href="(/proposal\?[^"]*)"', unit.text)[1].replace("&amp;", "&")
    )
    searched = visitor.get("/", params={"q": '"><script>alert(3)</script>'})
    lost = visitor.get("/unit", params={"serial": "<script>alert(4)</script>", "technology": "rlg"})
    folder = visitor.get("/diagnosis", params={"folder": "april"})
    for page in (
        listed,
        unit.text,
        proposal.text,
        searched.text,
        lost.text,
        visitor.get("/diagnoses").text,
        visitor.get("/forecast").text,
        folder.text,
    ):
        page = re.sub(r'<script src="/figures\.js[^"]*"></script>', "", page)
        page = re.sub(r'<script type="application/json">[^<]*</script>', "", page)
        assert not re.search(
            r"<script|<img|<b>run|onerror=alert\(\d\)>(?!&)|<i>none", page, re.IGNORECASE
        )
    assert proposal.status_code == folder.status_code == 200


def test_a_report_is_shown_alone_in_a_sandbox(visitor, monkeypatch):
    monkeypatch.setattr(
        pages,
        "stored_update_html",
        lambda document: f"<p>report {document['proposal']} <script>1</script>",
    )
    page = visitor.get("/proposal?serial=SN-1&technology=rlg&number=1").text
    frame = re.search(
        r'<iframe [^>]*sandbox="allow-scripts allow-downloads"[^>]*src="([^"]*)"', page
    )[1].replace("&amp;", "&")
    report = visitor.get(frame)
    policy = report.headers["content-security-policy"].split("; ")
    assert report.text.startswith("<p>report 1")
    assert policy[0] == "sandbox allow-scripts allow-downloads"
    assert all(source.startswith("'sha256-") for source in policy[2].split()[1:])
    assert "default-src 'none'" in policy
    assert report.headers["x-frame-options"] == "SAMEORIGIN" and "frame-ancestors 'self'" in policy
    document = visitor.get("/proposal/update.json?serial=SN-1&technology=rlg&number=1")
    assert document.json()["verdict"] == "proposed"
    assert document.headers["content-disposition"].startswith("attachment")


def test_approval_is_recorded_and_commits(fresh):
    base, url = fresh
    with Visitor(base) as visitor:
        page = "/proposal?serial=SN-1&technology=rlg&number=1"
        assert "Sign in to decide" in visitor.get(page).text
        assert 'name="verdict"' not in visitor.get(page).text
        assert visitor.sign_in(next=page).headers["location"] == page
        assert waiting(visitor, "/", "/forecast", "/nothing", "/signin") == {2}
        token = visitor.form_token(page)
        done = visitor.decide(token, by="A. Reviewer", reason="white residuals")
        assert done.status_code == 303
        assert "Recorded: approved" in text_of(visitor.get(done.headers["location"]))
        with TableStore.open(url) as store:
            decided = store.proposals()[0].decision
            assert decided.decided_by == "A. Reviewer"
            assert decided.reason == "white residuals"
            assert decided.revision_number == 3
            assert store.active().sha256 == store.proposals()[0].sha256
        assert waiting(visitor, "/", "/nothing") == {0}  # the other one is out of date by now
        late = "/proposal?serial=SN-1&technology=rlg&number=2"
        assert "Out of date" in visitor.get(late).text
        assert 'value="approved"' not in visitor.get(late).text
        again = visitor.decide(token, number="2", reason="all the same")
        assert again.status_code == 409 and "update again" in text_of(again)
        with TableStore.open(url) as store:
            assert len(store.history()) == 3 and store.proposals()[1].decision is None
        decided = text_of(visitor.get(page))
        assert "was decided once" in decided and "What changed" in decided
        assert "revision 2, U(k=2) band" in decided and "table now" not in decided


def test_rejection_and_rollback_carry_the_name_of_the_token(fresh):
    base, url = fresh
    with Visitor(base) as visitor:
        visitor.sign_in(NAMED_TOKEN)
        token = visitor.form_token("/proposal?serial=SN-1&technology=rlg&number=2")
        unit = {
            "form_token": token,
            "serial": "SN-1",
            "technology": "rlg",
            "mode": "",
            "by": "Somebody Else",
        }
        assert (
            visitor.decide(token, number="2", verdict="rejected", reason="towed").status_code == 303
        )
        confirm = visitor.get("/rollback?serial=SN-1&technology=rlg&to=1")
        assert "Please confirm" in confirm.text
        assert "Nothing is deleted" in confirm.text
        assert 'name="by"' not in confirm.text
        assert (
            visitor.submit("/rollback", **unit, to="1", active="2", reason="wrong run").status_code
            == 303
        )
        stale = visitor.submit("/rollback", **unit, to="2", active="2", reason="seen before")
        assert stale.status_code == 409 and "revision 3 is active now, not 2" in text_of(stale)
    with TableStore.open(url) as store:
        assert store.proposals()[1].decision.decided_by == "R. Eviewer"
        assert store.active().note == "rolled back by R. Eviewer: wrong run"
        assert store.active().restored_number == 1


@pytest.mark.parametrize(
    "change, status, words",
    [
        ({"reason": " "}, 400, "reason: got 0 characters"),
        ({"by": ""}, 400, "by: got"),
        ({"verdict": "maybe"}, 400, "verdict"),
        ({"number": "x"}, 400, "number: got 'x'"),
        ({"number": "77"}, 400, "no proposal 77"),
        ({"serial": ""}, 400, "serial"),
        ({"serial": "SN-9"}, 404, "no proposal for serial SN-9"),
        ({"number": "９"}, 400, "whole number"),
        ({"reason": "x" * 30000}, 400, "reason"),
        ({"by": "a\nb"}, 400, "by: got"),
    ],
)
def test_a_wrong_form_is_a_readable_line_and_changes_nothing(untouched, change, status, words):
    base, url = untouched
    with Visitor(base) as visitor:
        visitor.sign_in()
        token = visitor.form_token("/proposal?serial=SN-1&technology=rlg&number=1")
        answer = visitor.decide(token, **change)
        assert answer.status_code == status and words in text_of(answer)
    with TableStore.open(url) as store:
        assert len(store.history()) == 2 and not any(p.decision for p in store.proposals())


def test_a_first_table_waits_without_one_in_use(tmp_path):
    from infield.store.table_store import MergedRun
    from infield.table.file import table_sha256, table_to_dict
    from infield.table.thermal_table import default_table

    url = f"sqlite:///{tmp_path}/recal.db"
    old = default_table(
        imu_serial="NEW",
        gyro_technology="rlg",
        created_utc="2026-03-01T05:00:00Z",
        span=EvenNodes(high_degC=20),
    )
    first = table_to_dict(old)
    said = {"parent_sha256": table_sha256(first), "runs": []}
    with TableStore.open(url, create=True) as store:
        store.propose(
            table_sha256(first),
            old.replaced(provenance=said),
            [MergedRun(run_id="r", sha256="r")],
            '{"verdict": "proposed"}',
            first_table=first,
            by="fleet",
        )
    with serving(url) as base, Visitor(base) as visitor:
        assert "none yet" in text_of(visitor.get("/"))
        assert "No table is active" in visitor.get("/unit?serial=NEW&technology=rlg").text
        page = "/proposal?serial=NEW&technology=rlg&number=1"
        assert "first table" in visitor.get(page).text
        visitor.sign_in()
        done = visitor.decide(visitor.form_token(page), serial="NEW", reason="first")
        assert "Revision 2 is active" in visitor.get(done.headers["location"]).text


def test_a_damaged_row_is_told_and_nothing_else_fails(tmp_path):
    import sqlite3

    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url, "SN-1")
    put_unit(url, "SN-2")
    with closing(sqlite3.connect(tmp_path / "recal.db")) as raw, raw:
        raw.execute("UPDATE recal_revision SET note = 'x' WHERE unit_id = 1 AND number = 2")
    raw.close()
    with serving(url) as base, Visitor(base) as visitor:
        broken = visitor.get("/unit?serial=SN-1&technology=rlg")
        assert broken.status_code == 503
        assert "the row was changed" in text_of(broken)
        assert "recal table verify" in text_of(broken)
        assert str(tmp_path) not in broken.text
        assert visitor.get("/unit?serial=SN-2&technology=rlg").status_code == 200
        (tmp_path / "recal.db").unlink()
        assert "the store is not where it was." in text_of(visitor.get("/"))


def test_hundreds_of_units_come_in_pages(tmp_path):
    from sqlalchemy import insert

    from infield.store.schema import revision, tag, unit

    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url, "A-000", updates=0, proposals=0)
    with TableStore.open(url) as store:

        def add(c):
            row = dict(c.execute(revision.select()).one()._mapping)
            for k in range(2, 452):
                c.execute(
                    insert(unit).values(
                        id=k, imu_serial=f"A-{k:03}", gyro_technology="rlg", gyro_mode=""
                    )
                )
                c.execute(insert(revision).values(**{**row, "unit_id": k}))
                c.execute(insert(tag).values(unit_id=k, name="active", number=1))

        store._database.write(add)
    with serving(url) as base, Visitor(base) as visitor:
        first, last = visitor.get("/"), visitor.get("/?page=3")
        assert first.text.count('<th scope="row">') == 200
        assert last.text.count('<th scope="row">') == 51
        assert "page 1 of 3" in text_of(first)
        assert "A-451" in last.text
        assert visitor.get("/?page=99").text.count("A-451")
        assert visitor.get("/?q=a-45").text.count('<th scope="row">') == 2


def test_who_put_it_forward_does_not_approve_it_on_the_page(fresh):
    base, url = fresh
    with Visitor(base) as visitor, TableStore.open(url) as store:
        active = store.active()
        runs = [merged("own")]
        own = store.propose(
            active.sha256, shifted(active, 0.004), runs, report("SN-1"), by="r. eviewer"
        )
        visitor.sign_in(NAMED_TOKEN)
        page = f"/proposal?serial=SN-1&technology=rlg&number={own.number}"
        token = visitor.form_token(page)
        refused = visitor.decide(token, number=str(own.number), by="Somebody Else", reason="good")
        assert refused.status_code == 409 and "was put forward by r. eviewer" in text_of(refused)
        assert store.active() == active


def test_sessions_that_contradict_are_shown_against_the_table(tmp_path):
    from infield.session.disagreement import SessionEvidence

    url = f"sqlite:///{tmp_path}/recal.db"
    put_unit(url)
    said = SessionEvidence(
        run_id="run-<x>",
        run_sha256="c" * 64,
        start_utc="2026-03-09T05:00:00Z",
        temperature_degC=[5.0, 5.0, 5.0],
        bias_deg_h=[0.041, 0.001, 0.001],
        bend_deg_h=[0.0, 0.0, 0.0],
        covariance=[[4e-6, 0, 0], [0, 4e-6, 0], [0, 0, 4e-6]],
    )
    with TableStore.open(url) as store:
        store.remember_contradictions("SN-1", "rlg", "", [said])
        sigma = store.active().table.sigma_deg_h("x", 5.0)[0]
    with serving(url) as base, Visitor(base) as visitor:
        words = text_of(visitor.get("/unit?serial=SN-1&technology=rlg"))
        expanded = 2 * (4e-6 + sigma**2) ** 0.5
        assert (
            f"run-<x> cccccccccccc 2026-03-09T05:00:00Z +0.0400 ± {expanded:.4f} (k=2) at 5.0 °C"
            in words
        )
        assert "contradicted 1 session" in words
        assert "--accept-step --commit" in words
        assert "session that contradicts it, U(k=2)" in words
        listed = text_of(visitor.get("/?sort=contradictions&down=true"))
        assert re.search(
            r"SN-1 contradicted .* rlg revision 2, update \w{12} \S+ \S+ – 1 1 by technology",
            listed,
        )


def test_a_report_that_cannot_be_drawn_says_so(visitor):
    answer = visitor.get("/revision/report?serial=SN-1&technology=rlg&number=2")
    assert answer.status_code == 409 and "cannot draw the stored report" in text_of(answer)


def test_two_revisions_are_compared(visitor):
    words = text_of(visitor.get("/diff?serial=SN-1&technology=rlg&before=1&after=2"))
    assert "revision 1 against 2" in words
    assert re.search(r"Largest change: gyro x \+0\.0010* deg/h", words)
    assert "same table" in text_of(visitor.get("/diff?serial=SN-1&technology=rlg&before=2&after=2"))
