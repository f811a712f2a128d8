"""The verbs as the commands call them, their documents and files, for tests."""

from pathlib import Path

from recal.service.align import align as align_run
from recal.service.check import check as check_run
from recal.service.replay import replay as replay_run
from recal.service.simulate import simulate as simulate_run
from recal.service.update import UpdateRequest, update_in_store


def check(path, *, serial=None):
    """recal.check/1 of a run directory."""
    return check_run(path, serial=serial).document


def align(run, *, store_url, twin=None, output=None):
    """recal.alignment/1; writes alignment.json."""
    aligned = align_run(run, twin=twin, store=store_url)
    aligned.write(output)
    return aligned.document


def update(runs, **asked):
    """recal.update/1; writes its files, and the store where asked to."""
    return update_in_store(UpdateRequest(runs=runs, **asked)).document


def replay(run, *, store_url, output=None, **asked):
    """recal.replay/1; writes its files."""
    flown = replay_run(run, store=store_url, **asked)
    flown.write(output)
    return flown.document


def simulate(scenario, output, *, twin=None, table=None, truth=None, table_out=None, seed=None):
    """recal.simulate/1; writes the run and what else is asked for."""
    simulated = simulate_run(scenario, seed=seed, twin=twin, table=table)
    return simulated.write(Path(output), table=table_out, truth=truth).document
