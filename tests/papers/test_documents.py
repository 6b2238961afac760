"""The documents' tables and claims, reproduced: published numbers and the laws behind them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope.errors import BadSetting
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.papers import interactive_matter_2009 as lis302dl
from kalscope.papers import khan as generalized
from kalscope.papers import maarif_2019 as noise_reducer
from kalscope.papers.reproduction import list_experiments, open_experiment

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("ratio", [10.0, 1.0, 0.1, 0.01, 0.001])
def test_the_mean_error_formula_holds_on_a_long_record(ratio):
    """c σ (1 − K) √(2/(2 − K)) within 1.5 % on 200,000 samples."""
    z = noise_reducer.white_noise(1, samples=200_000, seed=8)[:, 0]
    x = denoise(z, FilterParams(q=ratio, r=1.0))
    formula = noise_reducer.theoretical_mean_error(ratio, noise_reducer.SIGMA)
    gain = steady_state(FilterParams(q=ratio, r=1.0)).gain
    assert formula == pytest.approx(math.sqrt(2 / math.pi) * 72 * (1 - gain) * math.sqrt(2 / (2 - gain)))
    assert noise_reducer.mean_error(z, x) == pytest.approx(formula, rel=0.015)
    assert np.sqrt(np.mean(x * x)) == pytest.approx(noise_reducer.theoretical_rmse(ratio, 72.0), rel=0.03)


def test_mean_error_rewards_no_filter_and_rmse_does_not():
    z, table = noise_reducer.white_noise(1)[:, 0], noise_reducer.simulate_table(200)
    assert noise_reducer.mean_error(z, denoise(z, FilterParams(q=1.0, r=0.0))) < 1e-12
    assert (np.diff([row["simulated"] for row in table]) > -1e-9).all()  # rows 3 and 4 are equal
    assert (np.diff([row["rmse"] for row in table]) < 1e-9).all()


def test_figure_7_forgets_a_high_start_and_without_the_slip_it_freezes():
    z = generalized.channel("flex_sensor")
    printed = generalized.FLEX.run(z)
    assert printed.x[0] > 900.0
    assert generalized.samples_to_forget()[0] < 40
    assert np.ptp(printed.x[900:]) > 220.0
    assert np.ptp(generalized.FLEX_WITHOUT_SLIP.run(z).x[900:]) < 10.0


def test_the_moved_board_is_eight_bits_with_a_known_truth():
    board = lis302dl.moved_board()
    np.testing.assert_array_equal(board.values, np.clip(np.round(board.values), -128, 127))
    assert (board.values - board.truth).std(axis=0) == pytest.approx([3.0] * 3, rel=0.1)
    np.testing.assert_allclose(np.linalg.norm(board.truth, axis=1), 55.0, rtol=1e-12)  # 1 g, whatever the tilt


def test_q_and_r_can_be_estimated_and_serve_better_than_the_eye():
    answer = lis302dl.answer_estimation(10)
    assert answer["found"] == 1.0
    assert answer["q_low"] < 0.125 < answer["q_high"]
    assert answer["board_rmse"] < 0.7 * answer["by_eye_rmse"]
    assert answer["verdicts"] == "no movement"


def test_experiments_open_with_settings_for_every_channel():
    names = [experiment.name for experiment in list_experiments()]
    assert len(set(names)) == len(names) == 20
    for experiment in list_experiments():
        recording, filters = open_experiment(experiment.name)
        assert recording.source == f"experiment:{experiment.name}"
        assert recording.title == experiment.title
        assert tuple(filters) == recording.names
        for channel in recording.names:
            assert np.isfinite(filters[channel].run(recording.channel(channel)).x).all()
        again, _ = open_experiment(recording.source)
        np.testing.assert_array_equal(again.values, recording.values)


def test_an_unknown_experiment_names_the_choices():
    with pytest.raises(BadSetting, match=r"experiment must be one of noise_reducer_figure_3.*got 'x'"):
        open_experiment("experiment:x")
