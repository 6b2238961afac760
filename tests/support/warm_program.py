"""What the fork server has done before it forks: modules, kernels, late imports of a dashboard, and no thread."""

from __future__ import annotations

import contextlib
import gc
import io
from functools import partial

import imageio.v3
import numpy as np
import rich.panel  # noqa: F401
import serial.tools.list_ports  # noqa: F401

import kalscope_app.dashboard
import kalscope_app.guard.server
import kalscope_app.views.window
from kalscope.catalogue import open_source
from kalscope.cli.app import COMMANDS, function_of, run
from kalscope.export import registry  # noqa: F401
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import compute_frame
from kalscope_app.guard.requests import served_page
from kalscope_app.main import add_dashboard
from kalscope_app.session.opening import opened
from kalscope_app.studies import checks, comparisons, tuning_map
from kalscope_app.views.window import page_script

STUDIES = (
    compute_frame,
    partial(comparisons.compute_variants, kept=Cache()),
    partial(tuning_map.compute_map, kept=Cache()),
    checks.compute_checks,
    partial(comparisons.compute_overview, kept=Cache()),
    checks.compute_spectra,
    checks.compute_allan,
    partial(comparisons.compute_alternatives, kept=Cache()),
)

demo = opened(open_source("demo"))
for study in STUDIES:
    study(demo)
imageio.v3.imwrite("<bytes>", np.zeros((2, 2), np.uint8), extension=".png")  # as viser makes pictures
kalscope_app.dashboard.WARM_UP_AFTER_S = 1e6  # the worker of a forked program starts with its first task
add_dashboard()
with contextlib.redirect_stderr(io.StringIO()):
    run(["open", "no such file"])  # the command line is imported and built; a refusal ends it
for name in COMMANDS:
    function_of(name)
served_page(page_script())
"".encode("idna")  # as a connection does with the name of a host
gc.freeze()  # looking for garbage would write to all the memory that the programs share
