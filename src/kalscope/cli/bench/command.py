"""`kalscope bench`: all contests one after the other, as a table or as JSON."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Annotated

import typer

from kalscope.cli.bench.contest import Contest, Q, Row, Work, measure
from kalscope.cli.options import BadValue

MIN_SAMPLES = 10_000
"""Shortest record worth timing: below it the call costs more than the filter."""
MAX_SAMPLES = 50_000_000
"""Longest record: kalman_filter keeps five numbers per sample, 2 GB here."""
WIDTHS = (25, 11, 11, 10, 20, 10)
"""Widths of the columns; the note follows the last."""


@dataclass(frozen=True)
class Sizes:
    """How much work a run does."""

    samples: int
    """Samples of the long record, for what is fast."""
    repetitions: int
    """Timed runs of each side; their median counts."""
    slowness: float
    """Slow peers process their own number of samples over this."""


FULL = Sizes(samples=10_000_000, repetitions=7, slowness=1.0)
QUICK = Sizes(samples=200_000, repetitions=3, slowness=10.0)


def sample_count(text: str) -> int:
    """The number of samples that was asked for, also written as 1e6."""
    try:
        samples = float(text)
    except ValueError:
        samples = math.nan
    if not (MIN_SAMPLES <= samples <= MAX_SAMPLES and samples.is_integer()):
        raise BadValue(f"a whole number from {MIN_SAMPLES:,} to {MAX_SAMPLES:,}", text)
    return int(samples)


def bench_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
    samples: Annotated[
        int | None,
        typer.Option(metavar="N", parser=sample_count, help="Length of the long record; default: 10 million."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer samples and repetitions, rougher figures.")] = False,
) -> None:
    """Compare the filter's speed with other libraries.

    The peers are numpy, scipy and other Kalman libraries; the figures are ratios.
    """
    sizes = QUICK if quick else FULL
    rows = run_bench(sizes if samples is None else replace(sizes, samples=samples))
    if as_json:
        print(json.dumps([asdict(row) for row in rows], indent=1, ensure_ascii=False))
    else:
        print_table(rows)


def run_bench(sizes: Sizes) -> Iterator[Row]:
    """All rows, each as soon as it is measured."""
    from kalscope.cli.bench.own import (
        denoise_contests,
        kalman_filter_contest,
        many_contest,
        profile_contest,
        python_contest,
    )
    from kalscope.cli.bench.peers import peer_contests

    work = Work.make(sizes.samples)

    def size(samples: int) -> Work:
        return work.first(max(500, round(samples / sizes.slowness)))

    def contests() -> Iterator[Contest | Row]:
        yield from denoise_contests(work)
        yield kalman_filter_contest(size(1_000_000))
        yield python_contest(size(200_000))
        yield from peer_contests(size)
        yield profile_contest(size(100_000))
        yield many_contest(size(300_000))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of the peers
        for contest in contests():
            yield contest if isinstance(contest, Row) else measure(contest, sizes.repetitions)


def print_table(rows: Iterator[Row]) -> None:
    """One line per row, as soon as it is measured, then what the columns mean."""
    print(_line("", "samples", "µs/sample", "ratio", "against", "difference", ""))
    for row in rows:
        print(line_of(row), flush=True)
    print(
        f"\nratio: time over the time of the other side, both in turns on the same samples (λ = {Q:g}); median."
        "\ndifference: largest |result − x of kalman_filter| / max |z|, unless the note says otherwise."
    )


def line_of(row: Row) -> str:
    """A row as one line of the table."""
    if row.microseconds_per_sample is None or row.ratio is None:
        return _line(row.name, "", "", "", row.against, "", row.note)
    speed, difference = f"{row.microseconds_per_sample:.3g}", f"{row.difference:.1e}"
    ratio = f"{row.ratio:,.0f} ×" if row.ratio >= 100.0 else f"{row.ratio:.3g} ×"
    return _line(row.name, f"{row.n:,}", speed, ratio, row.against, difference, row.note)


def _line(name: str, n: str, speed: str, ratio: str, against: str, difference: str, note: str) -> str:
    w = WIDTHS
    columns = (f"{name:<{w[0]}}", f"{n:>{w[1]}}", f"{speed:>{w[2]}}", f"{ratio:>{w[3]}}")
    return "  ".join((*columns, f"{against:<{w[4]}}", f"{difference:>{w[5]}}", note)).rstrip()
