"""How a file was read, and the form that decides otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from kalscope.recording import LineIssue, ReadReport, Recording
from kalscope.sources.grammar.read_options import ReadOptions, options_from_text
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.engine.frame import compute_frame
from kalscope_app.guard.server import guarded_server
from kalscope_app.session.opening import opened
from kalscope_app.views.signal import heading_of
from kalscope_app.views.source import ReadingForm, import_summary, in_words_of_form

EXAMPLES = [
    {},
    {"delimiter": "tab", "decimal": "comma", "time_column": "3", "time_unit": "millis", "missing": ["-200", "n/x"]},
    {"time_column": "none", "header_row": "0", "unit_row": "2", "rate": "250", "gaps": "dt", "part": "/imu"},
    {"time_format": "%d.%m.%Y %H:%M", "day_first": False},
    {"missing": ["no data", "-200", "it's", "\\N", "#N/A"]},
]


@pytest.fixture(scope="module")
def form():
    seen = []
    with guarded_server(port=0) as guarded:
        made = ReadingForm(guarded.server.gui, seen.append)
        made.seen = seen
        yield made


@pytest.mark.parametrize("given", EXAMPLES)
def test_the_form_shows_what_was_decided_and_reads_it_the_same(form, given):
    options = options_from_text(**given)
    form.show(options)
    form._submit()
    assert form.seen[-1] == options


def test_the_form_has_every_option(form):
    assert set(form._boxes) == set(ReadOptions.__dataclass_fields__) - {"header"}


def test_what_is_typed_stays_until_another_file_is_open(form):
    options = options_from_text(rate="9")
    form.show(options)
    form._boxes["rate"].value = "10"
    form.show(options)
    form._submit()
    assert form.seen[-1].rate == 10.0
    form.show(ReadOptions())
    form._submit()
    assert form.seen[-1] == ReadOptions()


ISSUES = (LineIssue(5, "must have 3 fields (got 1)", "<b>x</b>"), LineIssue(7, "must be a number", "`e`", "a|b"))


def recording(report):
    values = np.column_stack([np.arange(50.0), np.sin(np.arange(50.0)), np.ones(50)])
    names = ("seq", "a|b", "stuck")
    return Recording(np.arange(50.0), names, ("", "", ""), values, 1.0, report, sha256="0")


def plain(text):
    return text.replace("\\", "")


def test_the_summary_comes_first_then_the_warning_then_the_rest():
    report = ReadReport(lines=56, rows=50, rejected=5, bad_cells=1, headers=1, issues=ISSUES, notes=("a *note*",))
    head, warning, rest = import_summary(recording(report)).split("\n\n")
    assert plain(head).startswith("50 rows, 3 channels, 1.00 Hz; 5 lines rejected: must have 3 fields; 1 cell")
    assert warning.startswith("**9")
    assert "of the lines were rejected, the first is line 5" in warning
    assert "- not shown first: seq (a counter), stuck (constant)" in plain(rest)
    assert "- a \\*note\\*" in rest


def test_nothing_of_a_file_is_markup():
    text = import_summary(recording(ReadReport(lines=51, rows=50, rejected=1, bad_cells=1, issues=ISSUES)))
    assert "<b>" not in text
    assert "`e`" not in text


def test_a_growing_recording_is_not_judged_at_every_frame():
    live = replace(recording(ReadReport(lines=50, rows=50)), sha256="")
    assert "not shown first" not in import_summary(live)


def test_the_heading_points_to_the_summary_where_part_of_a_file_was_lost():
    def heading(report):
        state = opened(recording(report))
        return heading_of(compute_frame(state, 0, choose_samples(state.recording, state.channel, None)))

    assert "could not be read" not in heading(ReadReport(lines=51, rows=50, rejected=1))
    told = "**part of the file could not be read: see Source**"
    assert told in heading(ReadReport(lines=55, rows=50, rejected=5))


@pytest.mark.parametrize(
    ("console", "form"),
    [
        (
            "stamps are read as ms (assumed: --time-unit changes it)",
            "stamps are read as ms (assumed: “time unit” changes it)",
        ),
        ("sample period unknown (see --rate)", "sample period unknown (see “rate (Hz)”)"),
        (
            "it could also be: --delimiter semicolon --decimal comma",
            "it could also be: “delimiter”: semicolon “decimal mark”: comma",
        ),
        (
            "read it with --gaps missing (adds 3 rows) or --gaps dt",
            "read it with “gaps in time”: as missing samples (adds 3 rows) or “gaps in time”: as elapsed time",
        ),
        ("they could be month first: --month-first", "they could be month first: “date order”: month first"),
        ('the time could be "my t": --time-column "my t"', 'the time could be "my t": “time column”: "my t"'),
        ("if so, read with --missing -200", "if so, read with “missing values”: -200"),
        ("--part NAME chooses another: b (3 × 2)", "“part” chooses another: b (3 × 2)"),
        ("nothing -- of --this - is an option", "nothing -- of --this - is an option"),
    ],
)
def test_the_summary_names_the_boxes_of_the_form_where_the_console_names_options(console, form):
    assert in_words_of_form(console) == form
