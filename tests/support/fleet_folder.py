"""The folder of a small fleet, by the same steps as `kalscope fleet` but without Dask."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from kalscope.cli.tune_options import TuneOptions
from kalscope.fleet.read import FleetOptions, find_units
from kalscope.fleet.results import Devices, answer_for, devices_of, save_answer
from kalscope.fleet.store import Row, find_parts, merge, schema, write_note, write_part
from kalscope.fleet.work import fit_unit

PLAIN = FleetOptions(TuneOptions(momentum=0.0, robust=False))
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


class FleetRun:
    """A run that can be stopped between two units."""

    def __init__(self, source, folder, asked=PLAIN):
        self.folder, self.asked, self.options = folder, asked, asked.fingerprint()
        folder.mkdir(exist_ok=True)
        self.units = find_units([str(source)], folder)
        pooled = asked.is_pooled
        write_note(folder, len(self.units), self.options, asked.reading, asked.sample_period, pooled=pooled)

    def do(self, first=0, last=None):
        """Write the parts of some units."""
        for unit in self.units[first:last]:
            fitted = fit_unit(unit, self.asked)
            write_part(self.folder, {unit.key(self.options): (fitted.rows, fitted.pool)})
        return self

    def finish(self):
        """Merge the table and write the answer."""
        keys = [[unit.key(self.options) for unit in self.units]]
        table, pool = merge(keys, find_parts(self.folder))
        answer = answer_for(devices_of(table), pool, self.asked.question)
        save_answer(answer, table, self.folder)
        return answer


def finished_fleet(folder):
    """The folder of a finished fleet of 12 devices and an empty file, which lie beside it."""
    write_logs(folder / "logs")
    FleetRun(folder / "logs", folder / "result").do().finish()
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
