"""The peers of Kalscope: bare viser, and Dash, each with a slider of q over the same two lines of a source.

    python benchmarks/peer_servers.py viser|dash SOURCE

Both filter all samples with `denoise` at every move, and draw the samples that Kalscope draws while nothing moves.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope import FilterParams, denoise, open_source
from kalscope_app.engine.filter_runs import DrawnSamples, choose_samples

PEERS = Path(__file__)
"""What to start with `viser` or `dash`."""
SIGMA = 0.5
"""Standard deviation of the measurement noise that both filter with."""
Q_RANGE = (-9.0, 3.0, 0.01)
"""Least, most and step of log₁₀ q, as in Kalscope."""
HEIGHT = 400
"""Of the chart, px."""


class TwoLines:
    """The raw line of a source, and the filtered line for every q."""

    def __init__(self, source: str) -> None:
        recording = open_source(source)
        self.drawn: DrawnSamples = choose_samples(recording, recording.names[0], None)
        self._z = np.ascontiguousarray(recording.values[:, 0])

    def filtered(self, exponent: float) -> NDArray[np.float64]:
        """The filtered line for 10^exponent, at the samples drawn."""
        return denoise(self._z, FilterParams(10.0**exponent, SIGMA**2))[self.drawn.indices]


def serve_viser(source: str, mark: Callable[[str], None] = lambda _: None) -> None:
    """A slider and a chart on a stock viser server, until SIGTERM.

    Args:
        source: what is drawn.
        mark: called with the name of each step of a move, as it ends.
    """
    import viser
    from viser.uplot import Scale, Series

    lines = TwoLines(source)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    q = server.gui.add_slider("log₁₀ q", *Q_RANGE, initial_value=0.0)
    chart = server.gui.add_uplot(
        (lines.drawn.time, lines.drawn.raw, lines.filtered(0.0)),
        (Series(label="time"), Series(label="raw", stroke="gray"), Series(label="filtered", stroke="red")),
        scales={"x": Scale(time=False)},
        padding=(8, 24, 0, 0),
        height=HEIGHT,
    )

    @q.on_update
    def _(_: Any) -> None:
        mark("requested")
        filtered = lines.filtered(q.value)
        mark("computed")
        chart.data = (lines.drawn.time, lines.drawn.raw, filtered)
        server.flush()  # without it each move waits up to 1/60 s more

    wait_for_end(f"http://127.0.0.1:{server.get_port()}")
    server.stop()


def serve_dash(source: str) -> None:
    """A slider and a figure in Dash, until SIGTERM; a move sends the filtered line alone, by a Patch."""
    from dash import Dash, Input, Output, Patch, dcc, html
    from werkzeug.serving import make_server

    lines = TwoLines(source)
    figure = {
        "data": [
            {"x": lines.drawn.time, "y": lines.drawn.raw, "name": "raw", "line": {"color": "gray"}},
            {"x": lines.drawn.time, "y": lines.filtered(0.0), "name": "filtered", "line": {"color": "red"}},
        ],
        "layout": {"height": HEIGHT},
    }
    app = Dash(__name__)
    moves = {"value": 0.0, "marks": None, "updatemode": "drag", "included": False}
    app.layout = html.Div([dcc.Slider(*Q_RANGE, id="q", **moves), dcc.Graph(id="chart", figure=figure)])

    @app.callback(Output("chart", "figure"), Input("q", "value"), prevent_initial_call=True)
    def _(exponent: float) -> Patch:
        patch = Patch()
        patch["data"][1]["y"] = lines.filtered(exponent)
        return patch

    server = make_server("127.0.0.1", 0, app.server, threaded=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    wait_for_end(f"http://127.0.0.1:{server.server_port}")


def wait_for_end(url: str) -> None:
    """Print the link as Kalscope does, and wait for SIGTERM."""
    end = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: end.set())
    print(f"Kalscope: {url}", flush=True)
    end.wait()


def main() -> None:
    {"viser": serve_viser, "dash": serve_dash}[sys.argv[1]](sys.argv[2])


if __name__ == "__main__":
    main()
