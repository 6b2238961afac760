import math
import shlex

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import ReadOptions, options_from_text, split_values
from kalscope.sources.reading.recording_file import read_recording

NAN = math.nan


def test_a_delimiter_outranks_what_is_found(read):
    text = "".join(f"{i},5;{i},25\n" for i in range(9))
    assert read(text).values.shape == (9, 2)
    assert read(text, delimiter=";", decimal=",").values[3].tolist() == [3.5, 3.25]


TIMED = "n,clock [ms],a\n" + "".join(f"{i},{20 * i},{i % 3}\n" for i in range(9))


def test_a_time_column_and_its_unit_are_chosen(read):
    for choice, names, period in (("n", ("clock", "a"), 1.0), ("clock", ("n", "a"), 0.02)):
        recording = read(TIMED, time_column=choice)
        assert (recording.names, recording.sample_period) == (names, period)
    assert read(TIMED, time_column="n", time_unit="us").sample_period == 1e-6
    assert read("t,a\n0.0,1\n8.5,2\n17,3\n", time_unit="ms").sample_period == 0.0085
    dated = "day;at;a\n" + "".join(f"2026-01-01;10:00:{i:02};{i}\n" for i in range(9))
    assert {read(dated, time_column=choice).sample_period for choice in ("day", "at", None)} == {1.0}


def test_missing_numbers_are_compared_as_numbers_and_texts_as_cells(read):
    text = "t,a,b\n0,-200,1\n1,-200.0,ERR\n2,5,-2e2\n3,6,err\n4,7,0\n"
    recording = read(text, missing=(-200.0, "ERR"))
    np.testing.assert_array_equal(recording.values, [[NAN, 1], [NAN, NAN], [5, NAN], [6, NAN], [7, 0]])
    assert recording.report.bad_cells == 0
    assert any("samples of -200 that are missing, as requested: 3" in note for note in recording.report.notes)


GAPPY = "t,a\n" + "".join(f"{t},{t * 10:.0f}\n" for t in (0.0, 0.1, 0.2, 0.6, 0.7, 0.65, 0.8, 0.9))


def test_gaps_become_rows_of_missing_samples_or_time_steps(read):
    recording = read(GAPPY, gaps="missing")
    assert (recording.report.inserted, recording.report.rows) == (3, 8)
    np.testing.assert_allclose(recording.time[2:7], [0.2, 0.3, 0.4, 0.5, 0.6])
    np.testing.assert_array_equal(np.isnan(recording.values[:, 0]), [0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0])
    recording = read(GAPPY, gaps="dt")
    assert recording.gaps == "dt"
    np.testing.assert_allclose(recording.steps(), [1, 1, 1, 4, 1, 0, 1.5, 1], rtol=1e-9)  # steps back are none


def test_a_rate_is_a_sample_period_in_other_words(read):
    assert read(TIMED, rate=25.0).sample_period == read(TIMED, period=0.04).sample_period == 0.04
    assert read(TIMED, rate=25.0, period=0.04).sample_period == 0.04
    assert read("a\n1\n2\n3\n", rate=4.0).time.tolist() == [0, 0.25, 0.5]
    with pytest.raises(BadSetting, match=r"rate and sample period must agree.*got 25 Hz and 0\.5 s"):
        read_recording("no such file", ReadOptions(rate=25.0), sample_period=0.5)


def test_a_gap_of_years_is_no_million_rows(read):
    text = "t,a\n" + "".join(f"{i},1\n" for i in range(20)) + "1e9,2\n"
    with pytest.raises(BadSetting, match='must not be "missing"'):
        read(text, gaps="missing")
    assert read(text, gaps="dt").steps()[-1] > 9e8


@pytest.mark.parametrize(("options", "said"), [
    ({"time_column": "x"}, "must be one of n, clock, a"), ({"time_column": 3}, "must be one of"),
    ({"time_column": -1}, "must be one of"), ({"time_column": "none", "time_unit": "s"}, "needs a time column"),
    ({"time_column": "none", "gaps": "dt"}, "has no time"),
])  # fmt: skip
def test_an_option_that_the_file_cannot_have_is_refused(read, options, said):
    with pytest.raises(BadSetting, match=said):
        read(TIMED, **options)


@pytest.mark.parametrize("options", [
    *({"delimiter": "x"}, {"decimal": ";"}, {"decimal": ",", "delimiter": ","}, {"time_unit": "fortnight"}),
    *({"gaps": "holes"}, {"missing": (math.inf,)}),
])  # fmt: skip
def test_impossible_options_are_refused(options):
    with pytest.raises(BadSetting, match="got"):
        ReadOptions(**options)


def test_options_as_a_person_types_them():
    options = options_from_text(
        delimiter="semicolon", time_column="2", time_unit="millis", missing=["-200", "ERR", "1e3"], gaps="dt"
    )
    assert options == ReadOptions(";", None, 1, "ms", (-200.0, "ERR", 1000.0), gaps="dt")
    assert options_from_text() == ReadOptions()
    assert options_from_text(time_column="column 3").time_column == 2
    assert options_from_text(time_column="none").time_column == "none"
    assert options_from_text(delimiter="\\t").delimiter == "\t"


@pytest.mark.slow
@given(st.lists(st.text(min_size=1)))
def test_values_joined_into_one_line_are_the_same_again_and_a_lone_quote_is_refused(values):
    assert split_values(shlex.join(values)) == values
    for text in ("it's", 'a "b', "'"):
        with pytest.raises(BadSetting, match="quotes must come in pairs"):
            split_values(text)
