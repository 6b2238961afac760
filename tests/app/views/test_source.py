"""The Source tab without a browser: how a file was read, other options, the question, the ports."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from tests.support.waiting import PATIENCE

from kalscope.errors import BadSetting
from kalscope.papers.reproduction import list_experiments
from kalscope.recording import Assumption, LineIssue, ReadReport, Recording
from kalscope.sources.grammar.read_options import options_from_text
from kalscope.sources.samples import list_samples
from kalscope.sources.synthetic import SHAPES
from kalscope_app.engine.frame import compute_frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.opening import opened
from kalscope_app.views.live import TYPED, port_to_show
from kalscope_app.views.signal import heading_of
from kalscope_app.views.source import import_summary, options_of, question_about, specs_by_label, words_of


def test_the_box_shows_what_was_decided_and_reads_it_the_same_and_what_is_no_option_is_refused():
    for given in (
        {"delimiter": "tab", "decimal": "comma", "time_column": "3", "time_unit": "millis", "rate": "250"},
        {"time_column": "none", "header_row": "0", "unit_row": "2", "gaps": "dt", "part": "/imu"},
        {"time_format": "%d.%m.%Y %H:%M", "day_first": False},
        {"missing": ["no data", "-200", "it's", "\\N", "#N/A"]},
    ):
        options = options_from_text(**given)
        assert options_of(words_of(options)) == options
    for text, refusal in (
        *(("--speed 3", "import options must be some of --delimiter"), ("--rate", "--rate must have a value")),
        *(("--rate fast", "rate"), ('--missing "no', "quotes must come in pairs")),
    ):
        with pytest.raises(BadSetting, match=refusal):
            options_of(text)


def recording(report, period=1.0):
    values = np.column_stack([np.arange(50.0), np.sin(np.arange(50.0)), np.ones(50)])
    names = ("seq", "a|b", "stuck")
    return Recording(np.arange(50.0), names, ("", "", ""), values, period, report, sha256="0")


def test_the_summary_comes_first_then_the_account_and_nothing_of_it_is_markup():
    fields, text = LineIssue(5, "must have 3 fields (got 1)", "<b>x</b>"), LineIssue(7, "not one", "`e`", "a|b")
    issues = fields, text
    report = ReadReport(lines=56, rows=50, rejected=5, bad_cells=1, headers=1, issues=issues, notes=("a *note*",))
    text = import_summary(recording(report))
    assert ("<b>" in text, "`e`" in text.replace("\\`", "")) == (False, False)
    head, rest = text.replace("\\", "").split("\n\n")
    assert head.startswith("50 rows, 3 channels, 1.00 Hz; 5 lines rejected: must have 3 fields; 1 cell")
    for line in ("not shown first: seq (a counter), stuck (constant)", "56 lines = 50 with data + 5", "a *note*"):
        assert f"- {line}" in rest
    assert "not shown first" not in import_summary(replace(recording(report), sha256=""))  # of a board, it grows
    for rejected, told in (1, False), (5, True):
        frame = compute_frame(opened(recording(replace(report, rejected=rejected))))
        assert ("**part of the file could not be read: see Source**" in heading_of(frame)) is told


CODE = 'is 400 a missing value? It occurs 26 times in "d", far from the rest; if so, read with --missing 400'
GAPS = "time has a gap after sample 9; read it with --gaps missing (adds 1 row) or --gaps dt (elapsed time)"
UNIT = "the time is read as ms (assumed from their size: 0.5 Hz; 500 Hz with --time-unit us)"


@pytest.mark.parametrize(
    ("notes", "button", "options"),
    [
        ((GAPS, Assumption(CODE)), "Read 400 as missing", "--missing 400"),
        ((GAPS,), "Read gaps as missing samples", "--gaps missing"),
        ((Assumption(UNIT),), "Read the time in us", "--time-unit us"),
        ((Assumption("they could also be month first: --month-first"),), "Read the month first", "--month-first"),
        (('the time could be "t": --time-column "t"',), None, None),  # a note that is no assumption
        ((), None, None),
    ],
)
def test_a_question_has_one_button_that_reads_the_file_otherwise(notes, button, options):
    report = ReadReport(notes=notes, assumptions=tuple(note for note in notes if isinstance(note, Assumption)))
    question = question_about(recording(report))
    assert (question and question.button, question and question.options) == (button, options)
    if question is not None:
        assert question.sentence.endswith(".")
        assert question.sentence.count("(") == question.sentence.count(")")
        options_of(options)
    unknown = question_about(recording(report, period=None))
    assert unknown == question or unknown.button == "Give the sample period"


def test_the_port_that_was_just_plugged_in_is_shown_unless_the_user_chose_another():
    for shown, kept, before, now, expected in (
        *((TYPED, False, "", "AB", "A"), (TYPED, True, "A", "AB", TYPED), ("A", False, "A", "AB", "B")),
        *(("A", True, "A", "AB", "A"), ("B", False, "AB", "B", "B"), ("A", False, "A", "", TYPED)),
    ):
        assert port_to_show(shown, tuple(before), tuple(now), kept=kept) == expected


def test_the_menu_says_what_was_not_measured_and_has_every_name_once():
    labels = {spec: label for label, spec in specs_by_label().items()}
    assert labels["synthetic:random_walk"] == "random walk (generated)"
    measured = [spec for spec, label in labels.items() if not label.endswith(")") and spec.startswith("sample:")]
    assert measured == ["sample:nile"]
    assert len(labels) == len(list_samples()) + len(list_experiments()) + len(SHAPES)


def test_idle_work_is_repeated_between_jobs_and_ends_with_its_failure():
    turns, told, done, failed = [], [], threading.Event(), threading.Event()
    jobs = Jobs(lambda *said, **_more: told.append(said))

    def work():
        turns.append(len(turns))
        if len(turns) == 3:
            failed.set()
            raise OSError("no ports")

    jobs.when_idle(work, 0.001)
    assert failed.wait(PATIENCE)
    jobs.run(done.set)
    assert done.wait(PATIENCE)
    assert (turns, told) == ([0, 1, 2], [])
