"""The folder of a small fleet, by the same steps as `kalscope fleet` but without Dask."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from kalscope.estimation.request import Request
from kalscope.fleet.read import FleetOptions, find_units
from kalscope.fleet.results import Devices, answer_for, devices_of, save_answer
from kalscope.fleet.store import Row, open_store, schema, stored
from kalscope.fleet.work import fit_unit

PLAIN = FleetOptions(Request(momentum=0.0, robust=False))
"""What is asked of each recording."""
NOISY = 3
"""The device with a hundred times the noise variance."""


def write_logs(folder, devices=12, n=300):
    """A file for each device, one of them noisy, and an empty file."""
    g = np.random.default_rng(4)
    folder.mkdir()
    for i in range(devices):
        sigma = 10.0 if i == NOISY else 1.0
        z = np.cumsum(0.2 * g.normal(size=n)) + sigma * g.normal(size=n)
        rows = (f"{k / 100:.2f},{value:.4f}\n" for k, value in enumerate(z))
        (folder / f"dev{i:02d}.csv").write_text("time (s),light (lx)\n" + "".join(rows))
    (folder / "empty.csv").write_text("")


def run_steps(source, folder, options=PLAIN):
    """The answer of a fleet, and its folder filled, by the steps of `run_fleet`."""
    with open_store(folder) as store:
        units = find_units([str(source)], folder)
        keys = [unit.key(options.fingerprint()) for unit in units]
        store.keep(stored(key, *fit_unit(unit, options)) for key, unit in zip(keys, units, strict=True))
        table, inputs, pool = store.merged(keys)
        answer = answer_for(devices_of(table, inputs), pool, options, folder)
        save_answer(answer, table, store)
    return answer


def finished_fleet(folder):
    """The folder of a finished fleet of 12 devices and an empty file, which lie beside it."""
    write_logs(folder / "logs")
    run_steps(folder / "logs", folder / "result")
    return folder / "result"


def devices_with(ids, q, r, interval=None, **known):
    """Devices with these arrays, 100 samples a second."""
    n = len(ids)
    nothing = np.full(n, np.nan)
    reasons = ["" if value > 0.0 else "it is empty" for value in q]
    rows = {
        "channels": ["light"] * n,
        "units": ["lx"] * n,
        "rate_hz": np.full(n, 100.0),
        "momentum": np.zeros(n),
        "gate": nothing,
        "verdicts": ["ok"] * n,
        "reasons": reasons,
        "sources": [""] * n,
    }
    ends = dict(zip(("q_low", "q_high", "r_low", "r_high"), interval or [nothing] * 4, strict=True))
    return Devices(ids, q=np.asarray(q, float), r=np.asarray(r, float), **(rows | ends | known))


def table_of(devices):
    """Merged rows with the names of these devices, and nothing else."""
    import pyarrow as pa

    return pa.Table.from_pylist([asdict(Row(name)) for name in devices.ids], schema())
