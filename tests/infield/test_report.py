"""The update report against R27: what every kind of update must show, safely, small and the same
each time.

The documents are real ones, of 10 Hz simulated runs: proposed, committed (two runs), refused,
inconsistent.
"""

import copy
import html
import math
import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from infield.reports import page as report_page
from infield.reports import update_figures, update_page
from infield.reports.documents.update import update_document
from infield.reports.documents.update_records import update_of
from infield.reports.drawing import MAX_POINTS, specification
from infield.session.pipeline import UnitHistory, update_calibration
from infield.table.file import table_from_dict, table_sha256
from ins.documents import plain
from ins.records import TwinModel
from tests.drawn import column, specifications, unscripted
from trajectories.simulator.scenario import read_scenario, simulate_scenario
from trajectories.simulator.segments import Park

KINDS = ("proposed", "committed", "refused", "inconsistent")
PAGE_LIMIT_BYTES = 2_500_000
CONTRACT_KEYS = (  # formats.md, section 5: all that any update document is sure to have
    "schema",
    "verdict",
    "reasons",
    "imu_serial",
    "runs",
    "heading_error",
    "observability",
    "points",
    "excluded",
    "consistency",
    "table_before",
    "table_after",
    "uncertainty_budget",
)


def _simulated(seed, *, start_utc="2026-03-01T05:00:00Z", heading_deg=0.0):
    plan = read_scenario("cold_parked_taxi")
    short = (Park(duration_s=1800.0), *plan.segments[1:])
    plan = replace(
        plan,
        segments=short,
        imu=replace(plan.imu, rate_hz=10.0),
        run=replace(plan.run, start_utc=start_utc),
        attitude=replace(plan.attitude, heading_deg=heading_deg),
    )
    simulated, unit = simulate_scenario(plan, seed=seed)
    return simulated.run, unit.factory_table()


def _document(runs, table, **facts):
    parsed, twin = table_from_dict(table, name="table"), TwinModel(source="defaults of rlg")
    result = update_calibration(
        runs, parsed, twin, history=UnitHistory(parent_sha256=table_sha256(table))
    )
    document = update_document(result, version="9.8.7", table_before=table)
    return plain(replace(document, **{"store": "sqlite:///recal.db", **facts}))


def update_html(document):
    """The page of a document as JSON."""
    return update_page.update_html(update_of(document))


@pytest.fixture(scope="module")
def documents():
    first, table = _simulated(3)
    second, _ = _simulated(4, start_utc="2026-04-01T06:00:00Z", heading_deg=120.0)
    cold = replace(first, temperature=None)
    wrong = copy.deepcopy(table)
    wrong["axes"]["x"]["bias_deg_h"] = [b + 0.2 for b in table["axes"]["x"]["bias_deg_h"]]
    rollback = "recal table rollback --store 'sqlite:///recal.db' --serial SN-0042 --to 1"
    found = {
        "proposed": _document([first], table),
        "committed": _document(
            [first, second], table, verdict="committed", revision=2, rollback_command=rollback
        ),
        "refused": _document([cold], table),
        "inconsistent": _document([first], wrong),
    }
    assert {kind: d["verdict"] for kind, d in found.items()} == {kind: kind for kind in KINDS}
    return found


@pytest.fixture(scope="module")
def pages(documents):
    return {kind: update_html(document) for kind, document in documents.items()}


class Page(HTMLParser):
    """Tags in order, text, attributes; checks that elements nest."""

    VOID = frozenset({"meta", "br", "link", "img", "input", "hr"})

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(page)
        assert not self._open, f"left open: {self._open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script", "noscript"} & set(self._open):
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def _expected(document):
    """What R27 and ISO/IEC 17025 7.8 ask for, in the words of this document."""
    d = document
    yield from (
        d["imu_serial"],
        d["issued_utc"],
        d["verdict"],
        d["method"]["name"],
        "recal version 9.8.7",
    )
    yield from (
        d["decision_rule"],
        "Statement of conformity",
        "Out of scope",
        "U(k=2)",
        "Authorised by",
    )
    yield from (
        d["table_before_sha256"],
        d["table_after_sha256"],
        "defaults of rlg",
        *d["assumptions"],
        *d["reasons"],
    )
    for run in d["runs"]:
        yield from (run["run_id"], run["sha256"])
    for session in d["sessions"]:
        yield from (
            session["start_utc"],
            session["tail"],
            report_page.number(session["site"]["lat_deg"], 4),
        )
        yield report_page.duration(session["duration_s"])
    yield from {term["term"] for term in d["uncertainty_budget"]}
    yield from {span["reason"] for span in d["excluded"]}
    yield (
        d["rollback_command"]
        or "recal table rollback --store sqlite:///recal.db --serial SN-0042 --to previous"
        " --by NAME --reason WHY"
    )
    yield "recal update RUN"


@pytest.mark.parametrize("kind", KINDS)
def test_every_required_item_is_on_the_page(documents, pages, kind):
    text = Page(pages[kind]).text
    items = [" ".join(item.replace("+-", "±").split()) for item in _expected(documents[kind])]
    missing = [item for item in items if item not in text]
    assert not missing


@pytest.mark.parametrize("kind", ["proposed", "committed", "inconsistent"])
def test_an_estimated_run_shows_its_evidence(documents, pages, kind):
    d, text = documents[kind], Page(pages[kind]).text
    titles = [s["layout"].get("title", {}).get("text") for s in specifications(pages[kind])]
    assert "Time in each 5 °C band" in titles
    assert report_page.number(d["consistency"]["nis_mean"], 3) in text
    assert report_page.number(d["consistency"]["band_999"][1], 3) in text
    if d["heading_error"]["value_mrad"] is not None:
        value, sigma = d["heading_error"]["value_mrad"], d["heading_error"]["sigma_mrad"]
        assert f"{report_page.number(value, 2, sign=True)} ± {report_page.number(sigma, 2)}" in text


@pytest.mark.parametrize("kind", ["proposed", "committed"])
def test_a_change_is_shown_node_by_node_with_expanded_uncertainty(documents, pages, kind):
    d, text = documents[kind], Page(pages[kind]).text
    decimals = report_page.decimals_for(
        [s["sigma_after_deg_h"] for s in d["observability"].values()]
        + [r["U_after_k2_deg_h"] for r in d["changes"]]
    )
    for row in d["changes"]:
        cells = [
            row[k] for k in ("before_deg_h", "U_before_k2_deg_h", "after_deg_h", "U_after_k2_deg_h")
        ]
        assert " ".join(report_page.number(c, decimals) for c in cells) in text
    effect = d["predicted_effect"]
    sides = (effect["drift_removed_nm_h"], effect["drift_left_sigma_nm_h"])
    assert "{} ± {} NM/h".format(*(report_page.number(v, 2) for v in sides)) in text


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_is_self_contained_small_and_sound(pages, kind):
    text = unscripted(pages[kind])
    page = Page(text)
    assert not re.search(r"https?:|//[a-z]|@import|javascript:", re.sub(r"sqlite:///", "", text))
    assert not {"script", "link", "img", "iframe", "object", "embed"} & set(page.tags)
    assert not [a for a in page.attributes if a[1].startswith("on") or a[1] in ("src", "srcset")]
    ids = Counter(value for _, name, value in page.attributes if name == "id")
    assert max(ids.values()) == 1
    links = [value for _, name, value in page.attributes if name == "href"]
    links += ["#" + target for target in re.findall(r"url\(#([^)]*)\)", text)]
    assert links and all(link[1:] in ids for link in links)
    assert len(pages[kind].encode()) < PAGE_LIMIT_BYTES
    assert "None" not in page.text and "nan" not in page.text.split()


HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{ 7*7 }}$\\frac{\u2620"


def _poisoned(value, old):
    """Every text that comes from a file replaced; keys and words of the program stay."""
    if isinstance(value, dict):
        return {k: _poisoned(v, old) for k, v in value.items()}
    if isinstance(value, list):
        return [_poisoned(v, old) for v in value]
    return HOSTILE if value in old else value


@pytest.mark.parametrize("kind", ["committed", "refused"])
def test_hostile_texts_from_files_change_no_tag(documents, pages, kind):
    d = documents[kind]
    old = {d["imu_serial"], d["store"], d["noise_model"]["source"]} | {
        s["tail"] for s in d["sessions"]
    }
    poisoned = _poisoned(d, old)
    for part in (poisoned["excluded"], *(s.get("phases", []) for s in poisoned["sessions"])):
        for span in part:
            span |= {k: HOSTILE for k in ("reason", "phase") if k in span}
    poisoned["reasons"] = [HOSTILE for _ in d["reasons"]]
    page = unscripted(update_html(poisoned))
    assert html.escape("<script>alert(1)", quote=False) in page
    assert "<script" not in page and "<img" not in page
    harmless = _poisoned(d, set())
    for part in (harmless["excluded"], *(s.get("phases", []) for s in harmless["sessions"])):
        for span in part:
            span |= {k: "one" for k in ("reason", "phase") if k in span}
    assert Page(page).tags == Page(unscripted(update_html(harmless))).tags
    assert HOSTILE.split("{{")[0] in "".join(Page(page).words)


def test_the_bare_document_of_the_contract_is_enough(documents):
    for kind in KINDS:
        bare = {k: documents[kind][k] for k in CONTRACT_KEYS}
        bare["consistency"] = {k: bare["consistency"][k] for k in ("nis_mean", "dof", "band_95")}
        keys = ("axis", "time_s", "temperature_degC", "bias_deg_h", "sigma_deg_h")
        bare["points"] = [{k: p[k] for k in keys} for p in bare["points"]]
        assert bare["imu_serial"] in Page(update_html(bare)).text


def test_no_curve_has_more_points_than_allowed(documents):
    d = copy.deepcopy(documents["proposed"])
    n = 30_000
    t = np.linspace(0.0, d["sessions"][0]["duration_s"], n)
    wild = np.random.default_rng(5).standard_normal(n)
    d["sessions"][0]["velocity"] = {
        "time_s": t.tolist(),
        "north_m_s": wild.tolist(),
        "east_m_s": wild.tolist(),
        "heading_deg": (90.0 + wild).tolist(),
    }
    panels = update_figures.timeline_panels(update_of(d).sessions[0], [])
    sizes = [column(t["y"]).size for t in specification(panels)["data"]]
    assert len(panels) == 3 and max(sizes) == MAX_POINTS


def test_numbers_are_plain_or_not_available():
    assert report_page.number(-0.00004, 4) == "0.0000"
    assert report_page.number(-0.00004, 4, sign=True) == "+0.0000"
    assert report_page.number(-1.25, 1) == "\u22121.2"
    assert report_page.number(0.5, 2, sign=True) == "+0.50"
    assert [report_page.number(v) for v in (None, math.nan, math.inf)] == ["n/a"] * 3
    assert [report_page.decimals_for([s]) for s in (0.0017, 0.03, 0.5, 30.0)] == [4, 3, 2, 0]
    assert report_page.decimals_for([None, 0.0]) == 4
    assert report_page.heading(-0.004, 2) == "0.00" and report_page.heading(-90.0) == "270.00"
    found = [report_page.duration(s) for s in (45.0, 600.0, 9000.0, None)]
    assert found == ["45 s", "10.0 min", "2.50 h", "n/a"]


@pytest.mark.parametrize(
    "state, shown, absent",
    [
        ("open", "recal table approve 3", "recal table export"),
        ("approved", "recal table export", "recal table approve"),
        ("rejected", "--propose --note WHY", "recal table approve"),
        ("out of date", "--propose --note WHY", "recal table approve"),
    ],
)
def test_a_proposal_s_page_offers_what_its_state_allows(documents, state, shown, absent):
    d = {**documents["proposed"], "proposal": 3, "proposal_state": state}
    if state in ("approved", "rejected"):
        revision = 7 if state == "approved" else None
        signed = {"by": "A. Reviewer", "decided_utc": "2026-04-02T08:00:00Z", "reason": "white"}
        d["decision"] = {**signed, "revision": revision}
    text = Page(update_html(d)).text
    assert shown in text and absent not in text
    assert ("A. Reviewer" in text) == ("decision" in d)
    assert ("revision 7" in text) == (state == "approved")


def test_commands_are_quoted_for_the_shell(documents):
    d = {**documents["proposed"], "store": "sqlite:///my store.db; rm x"}
    page = update_html(d)
    assert (
        "recal table rollback --store 'sqlite:///my store.db; rm x' --serial SN-0042"
        in Page(page).text
    )
