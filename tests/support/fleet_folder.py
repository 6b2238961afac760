"""The folder of a small fleet, by the same steps as `kalscope fleet` but without Dask."""

from __future__ import annotations

import numpy as np

from kalscope.cli.tune.options import TuneOptions
from kalscope.tuning.fleet.answer.answer import answer_for
from kalscope.tuning.fleet.answer.devices import read_devices
from kalscope.tuning.fleet.answer.save import save_answer
from kalscope.tuning.fleet.recordings.find import find_units
from kalscope.tuning.fleet.store.begun import note_begun
from kalscope.tuning.fleet.store.merge import merge
from kalscope.tuning.fleet.store.parts import find_parts, write_part
from kalscope.tuning.fleet.work.asked import Asked
from kalscope.tuning.fleet.work.task import fit_unit

PLAIN = Asked(TuneOptions(momentum=0.0, robust=False))
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
        self.units = find_units([str(source)], folder, asked.row_groups)
        pooled = asked.is_pooled
        note_begun(folder, len(self.units), self.options, asked.reading, asked.sample_period, pooled=pooled)

    def do(self, first=0, last=None):
        """Write the parts of some units."""
        for unit in self.units[first:last]:
            fitted = fit_unit(unit, self.asked)
            write_part(self.folder, {unit.key(self.options): (fitted.rows, fitted.pool)})
        return self

    def finish(self):
        """Merge the table and write the answer."""
        keys = [[unit.key(self.options) for unit in self.units]]
        pool = merge(self.folder, keys, find_parts(self.folder))
        answer = answer_for(read_devices(self.folder), pool, self.asked.question)
        save_answer(answer, self.folder)
        return answer


def finished_fleet(folder):
    """The folder of a finished fleet of 12 devices and an empty file, which lie beside it."""
    write_logs(folder / "logs")
    FleetRun(folder / "logs", folder / "result").do().finish()
    return folder / "result"
