"""Laws of the one judgement: what the data cannot contradict, advice that can be taken, and no two voices."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support.effort import EXAMPLES
from tests.truth.verdict_states import SIGNALS, N, walk, white

from kalscope import FilterParams, estimate, kalman_filter, open_source
from kalscope.analysis import actions
from kalscope.analysis.correction import find_change
from kalscope.analysis.diagnostics import diagnose, diagnose_held_out
from kalscope.analysis.findings import advice_text
from kalscope.analysis.judge import judge, needs_noise
from kalscope.estimation.momentum import likelihood_profile
from kalscope.estimation.request import Request

RIGHT = FilterParams(0.01, 1.0)


def with_runs(size, run):
    """Ten stretches of `run` samples that lie `size` off."""
    z = walk()
    for at in range(100, N - 50, N // 10):
        z[at : at + run] += size
    return z


def louder(first, last, times):
    z = np.random.default_rng(6).normal(size=N)
    z[first:last] *= times
    return z + walk(r=0.0)


def tails(seed):
    return walk(r=0.0) + np.random.default_rng(seed).standard_t(3, N)


RECORDS = SIGNALS | {
    "half a sine": np.r_[20.0 * np.sin(np.arange(1000) / 10.0), np.zeros(1000)] + white(4000, 5)[2000:],
    "spikes": with_runs(20.0, 1),
    "pairs": with_runs(20.0, 2),
    "runs": with_runs(20.0, 6),
    "tails": tails(2),
    "burst": louder(700, 730, 9.0),
    "loud half": louder(N // 2, N, 2.0),
}


def residuals(z, params, *, fitted=False):
    return diagnose(kalman_filter(z, params), fitted=fitted)


def judged(z, params):
    half = diagnose_held_out(z, params)
    return judge(residuals(z, params), half if half.n >= 20 else None)


# --- what is said -----------------------------------------------------------------------------------------


def test_an_excursion_is_one_spike_a_step_none_heavy_tails_no_change_and_a_loud_part_one_wherever_it_lies():
    for run in (1, 2, 4, 7):
        found = residuals(with_runs(20.0, run), RIGHT)
        assert (found.spikes, found.jumps) == (10, 0), run
    assert residuals(SIGNALS["steps"], RIGHT).jumps == 7
    assert all(residuals(tails(seed), RIGHT).evidence.change == 1.0 for seed in range(10))
    for first in range(0, N, N // 4):
        found = residuals(louder(first, first + N // 4, 2.0), RIGHT)
        assert found.evidence.change == pytest.approx(4.0, rel=0.5)


# --- one voice --------------------------------------------------------------------------------------------


def test_a_wrong_pair_is_wrong_on_both_halves_and_no_change():
    one = judged(walk(), FilterParams(0.1, 10.0))
    assert one.status == "band"
    sizes = [float(size) for size in re.findall(r"(\d\.\d+) ×", one.second_half)]
    assert sizes == pytest.approx([0.1, 0.1], rel=0.3)


# --- advice that can be taken -----------------------------------------------------------------------------


def test_advice_that_was_taken_is_not_given_again():
    for name in ("spikes", "pairs", "tails", "runs", "steps", "burst"):
        one = judged(RECORDS[name], replace(RIGHT, gate=16.0))
        assert "switch the outlier gate on" not in advice_text(one.findings), name
    z = RECORDS["sine"]
    plain = estimate(z, momentum=0.0)
    found = residuals(z, plain.params, fitted=True)
    assert any(isinstance(one.action, actions.EstimateAgain) for one in judge(found, None, plain).findings)
    searched = judge(found, None, plain, request=Request()).findings
    assert not any(isinstance(one.action, actions.EstimateAgain) for one in searched)


def test_spikes_of_a_plain_fit_are_set_aside_and_those_of_a_robust_fit_left_to_it():
    z = RECORDS["spikes"]
    plain, robust = estimate(z, robust=False), estimate(z, robust=True)
    first = judge(residuals(z, plain.params, fitted=True), None, plain)
    assert first.findings[0].action == actions.SetSpikesAside()
    then = judge(residuals(z, robust.params, fitted=True), None, robust)
    assert then.status == "fits"
    assert "10 more rejected by the gate" in then.headline


def test_the_still_stretch_that_a_record_shows_is_offered_where_r_is_open():
    z = np.sin(np.arange(300) / 30.0)
    found = estimate(z, momentum=0.0)
    assert found.verdict == "no_noise"
    assert needs_noise(found)
    plain, offered = judge(None, None, found), judge(None, None, found, still=(100, 250))
    assert plain.findings[0].action == actions.GiveNoise()
    assert offered.findings[0].action == actions.UseStillStretch(100, 250)
    assert offered.findings[1:] == plain.findings[1:]
    assert not needs_noise(estimate(walk()))


SAMPLES = ["sample:nile", "sample:ultrasonic", "sample:balancing_robot", "sample:ldr_pwm"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["walk", "loud half", "spikes", "sine", "half a sine", "demo", *SAMPLES])
def test_no_sentence_denies_a_better_fit_at_any_momentum(name):
    """Random q, r and τ: the profile at that τ, and the best fit of all."""
    z = RECORDS[name] if name in RECORDS else open_source(name).values[:, 0]
    best = estimate(z).params
    steady = find_change(residuals(z, best).e) == 1.0
    g = np.random.default_rng(7)
    for _ in range(EXAMPLES):
        q, r = np.nanvar(np.diff(z)) * 10.0 ** g.uniform(-4.0, 2.0, 2)
        tau = 0.0 if g.random() < 0.2 else 10.0 ** g.uniform(-0.5, 2.5)
        judgement = judged(z, FilterParams(float(q), float(r), momentum=tau))
        said = judgement.headline + advice_text(judgement.findings)
        if "fits clearly better" in said:
            profile = likelihood_profile(z, momentum=tau)
            own = np.interp(math.log(q / r), profile.log_ratios, profile.loglik)
            assert profile.loglik.max() < own + 5.0
        assert not (steady and "one pair cannot fit" in said)


def test_at_a_wrong_momentum_the_best_pair_is_known_and_a_change_of_the_noise_too():
    z = open_source("demo").values[:, 0]
    best = estimate(z, momentum=100.0).params
    said = judged(z, replace(best, q=5.0 * best.q, r=5.0 * best.r))
    assert said.headline.endswith(" No other q/r fits clearly better with this momentum.")
    best = estimate(RECORDS["loud half"], momentum=100.0).params
    assert judged(RECORDS["loud half"], best).status == "changes"
