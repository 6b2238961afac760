"""What may be a missing value is asked about; what is a state or a reading is not."""

import numpy as np
import pytest

from kalscope.sources.reading.recording_file import suggest_missing

N = 3000
RNG = np.random.default_rng(5)
WALK = 20.0 + np.cumsum(RNG.normal(0.0, 0.05, N))
ROWS = np.arange(N)


def asked(*channels):
    values = np.column_stack([np.asarray(channel, dtype=float) for channel in channels])
    names = [f"c{i}" for i in range(values.shape[1])]
    questions = suggest_missing(values, names, (np.nanmin(values, axis=0), np.nanmax(values, axis=0)))
    return [float(question.split()[1]) for question in questions]


def at_moments(signal, code, every=97, long=1):
    return np.where(ROWS % every < long, code, signal)


SURE = [-999.0, -9999.9, 9999.0, 999.9, -888.0, -200.0, -127.0, 85.0, -7999.0, 32767.0, -32768.0, 65535.0, 1e30]


@pytest.mark.parametrize("code", SURE)
@pytest.mark.parametrize("long", [1, 60])
def test_a_code_is_asked_about_however_long_it_lasts(code, long):
    assert asked(at_moments(WALK, code, long=long)) == [code]


@pytest.mark.parametrize("code", [0.0, -1.0, 400.0, 20000.0, 255.0])
def test_a_number_that_may_be_a_reading_is_one_unless_it_comes_for_moments(code):
    far = np.where(code == 0.0, 300.0, 50.0) + WALK
    assert asked(at_moments(far, code)) == [code]
    assert asked(at_moments(far, code, long=30)) == []


LIGHT = np.maximum(0.0, 900.0 * np.sin(ROWS / 200))
STATES = {
    "no light at night": LIGHT,
    "a motor that stands still": np.where(ROWS // 250 % 2, 563.0 + RNG.normal(0.0, 2.0, N), 0.0),
    "a motor at half duty": np.where(ROWS % 2, 563.0 + RNG.normal(0.0, 2.0, N), 0.0),
    "a signal that is cut off": np.clip(40.0 * np.sin(ROWS / 30), -20.0, 30.0),
    "a range of the converter": np.clip(np.rint(600.0 + 30.0 * WALK), 0.0, 1023.0),
    "a percentage": np.clip(60.0 + 60.0 * np.sin(ROWS / 90), 0.0, 100.0),
    "a switch": ROWS % 2,
    "a step that stays": np.where(ROWS > 2000, 400.0, WALK),
    "a step of a reference": np.where(ROWS // 60 % 7 == 3, 200.0, WALK),
    **{f"{code}, which is no code": at_moments(WALK, code) for code in (10.5, 563.0, -12.25, 71.3, 1234.0)},
    "once is chance": np.where(ROWS == 77, -999.0, WALK),
}


@pytest.mark.parametrize("signal", STATES.values(), ids=STATES)
def test_states_and_readings_raise_no_question(signal):
    assert asked(signal) == []


def test_a_code_of_several_channels_is_one_question_and_missing_samples_around_it_do_not_matter():
    values = np.column_stack([at_moments(WALK, -999.0), at_moments(WALK[::-1], -999.0), WALK])
    (question,) = suggest_missing(values, ["a", "b", "c"], (values.min(axis=0), values.max(axis=0)))
    assert 'times in "a", "b", far from' in question
    assert question.endswith("--missing -999")
    assert asked(np.where(RNG.random(N) < 0.05, np.nan, at_moments(WALK, 400.0))) == [400.0]
    assert asked(np.full(N, -999.0)) == []
    assert suggest_missing(np.full((5, 1), np.nan), ["a"], (np.array([np.nan]),) * 2) == []
