"""`kalscope bench`: the rows of `kalscope.cli.bench.contest` as a table or as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, replace
from typing import Annotated

import typer

from kalscope.cli.bench.contest import RATIO, Row
from kalscope.cli.bench.run import FULL, QUICK, check_samples, run_bench

WIDTHS = (25, 11, 11, 10, 20, 10)
"""Widths of the columns; the note follows the last."""


def bench(*, as_json: bool, samples: str | None, quick: bool) -> None:
    """Run the contests and print them: a table grows row by row, JSON comes at the end.

    Raises:
        BadSetting: `samples` is not a number of samples that can be timed.
    """
    sizes = QUICK if quick else FULL
    if samples is not None:
        sizes = replace(sizes, samples=check_samples(samples))
    rows = run_bench(sizes)
    if as_json:
        print(json.dumps([asdict(row) for row in rows], indent=1, ensure_ascii=False))
        return
    print_table(rows)


def print_table(rows: Iterable[Row]) -> None:
    """One line a row, as soon as it is measured; what they mean below."""
    print(_line("", "samples", "µs/sample", "ratio", "against", "difference", ""))
    for row in rows:
        print(line_of(row))
        sys.stdout.flush()
    print(
        f"\nratio: time over the time of the other side, both in turns on the same samples (λ = {RATIO:g}); median."
        "\ndifference: largest |result − x of kalman_filter| / max |z|, unless the note says otherwise."
    )


def line_of(row: Row) -> str:
    """A row as one line of the table."""
    if row.microseconds_per_sample is None or row.ratio is None:
        return _line(row.name, "", "", "", row.against, "", row.note)
    difference = "" if row.difference is None else f"{row.difference:.1e}"
    return _line(
        row.name,
        f"{row.n:,}",
        f"{row.microseconds_per_sample:.3g}",
        f"{row.ratio:,.0f} ×" if row.ratio >= 100.0 else f"{row.ratio:.3g} ×",
        row.against,
        difference,
        row.note,
    )


def _line(name: str, n: str, speed: str, ratio: str, against: str, difference: str, note: str) -> str:
    w = WIDTHS
    columns = (f"{name:<{w[0]}}", f"{n:>{w[1]}}", f"{speed:>{w[2]}}", f"{ratio:>{w[3]}}")
    return "  ".join((*columns, f"{against:<{w[4]}}", f"{difference:>{w[5]}}", note)).rstrip()


def bench_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
    samples: Annotated[
        str | None, typer.Option("--samples", metavar="N", help="Length of the long record; else 10 million.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Less work and fewer turns, rougher figures.")] = False,
) -> None:
    """Measure the speed of the filter against numpy, scipy and other Kalman libraries, as ratios."""
    from kalscope.cli.bench.command import bench

    bench(as_json=as_json, samples=samples, quick=quick)
