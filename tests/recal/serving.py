"""A served store for the tests of `recal serve`: uvicorn in a thread, a few units, forms as a
browser sends them.
"""

import json
import re
import socket
import threading
import time
from contextlib import contextmanager

import httpx
import uvicorn

from infield.store.table_store import MergedRun, TableStore
from infield.table.file import table_to_dict
from infield.table.thermal_table import EvenNodes, default_table
from recal.web.app import build_app
from recal.web.guard import server_config
from recal.web.settings import ServeSettings, token_of

TOKEN, NAMED_TOKEN = "0123456789abcdef-shared", "0123456789abcdef-of-her"
DECISION = {
    "serial": "SN-1",
    "technology": "rlg",
    "mode": "",
    "number": "1",
    "verdict": "approved",
    "by": "A",
    "reason": "why",
}
TOKENS = (token_of(TOKEN, source="test"), token_of(NAMED_TOKEN, "R. Eviewer", source="test"))


@contextmanager
def serving(url, *, tokens=TOKENS, **more):
    """The address of a running server."""
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    settings = ServeSettings(store_url=url, port=port, tokens=tokens, **more)
    server = uvicorn.Server(server_config(build_app(settings), settings, log=False))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    try:
        while not server.started:
            time.sleep(0.01)
        yield f"http://127.0.0.1:{port}"
    finally:
        server.should_exit = True
        thread.join()
        listener.close()


class Visitor(httpx.Client):
    """Keeps cookies, sends forms with the page's own form token and Origin."""

    def __init__(self, base, **more):
        super().__init__(base_url=base, timeout=60.0, trust_env=False, **more)

    def form_token(self, path):
        return re.search(r'name="form_token" value="([0-9a-f]+)"', self.get(path).text)[1]

    def submit(self, path, *, headers=None, **fields):
        base = str(self.base_url).rstrip("/")
        return self.post(
            path,
            data=fields,
            headers={"origin": base, "sec-fetch-site": "same-origin", **(headers or {})},
        )

    def decide(self, form_token, **changes):
        return self.submit("/decide", form_token=form_token, **{**DECISION, **changes})

    def sign_in(self, token=TOKEN, **more):
        return self.submit(
            "/signin", token=token, form_token=self.form_token("/signin"), **{"next": "/", **more}
        )


def put_unit(url, serial="SN-1", *, kind=("rlg", ""), updates=1, proposals=1, note="", run="run"):
    """A unit with a factory table, so many updates and so many open proposals; kind: technology
    and mode of its gyros.
    """
    with TableStore.open(url, create=True) as store:
        old = default_table(
            imu_serial=serial,
            gyro_technology=kind[0],
            gyro_mode=kind[1],
            created_utc="2026-03-01T05:00:00Z",
            span=EvenNodes(low_degC=0, high_degC=20),
        )
        active = store.import_table(table_to_dict(old), note=note)
        for k in range(updates):
            runs = [merged(f"{run}-{k}")]
            active = store.commit_update(
                active.sha256, shifted(active, 0.001), runs, '{"verdict": "committed"}'
            )
        for k in range(proposals):
            store.propose(
                active.sha256,
                shifted(active, 0.001 * (k + 2)),
                [merged(f"{run}-p{k}")],
                report(serial),
                by="fleet",
                note=note,
            )


def shifted(revision, shift_deg_h):
    said = {"parent_sha256": revision.sha256, "runs": []}
    return revision.table.replaced(
        parameters=revision.table.parameters + shift_deg_h, provenance=said
    )


def merged(name):
    return MergedRun(run_id=name, sha256=name)


def report(serial):
    return json.dumps({"verdict": "proposed", "imu_serial": serial, "observability": {}})
