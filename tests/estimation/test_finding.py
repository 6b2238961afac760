from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope.errors import BadSetting
from kalscope.estimation.fit import METHODS
from kalscope.estimation.request import (
    TARGETS,
    Noise,
    Request,
    find_parameters,
)
from kalscope.filtering.steady import steady_state

PERIOD = 0.02
WISHED = {"lag_s": 0.1, "lag_samples": 7.0, "cutoff_hz": 2.5, "noise_reduction_db": 12.0, "gain": 0.15}
KNOWN = {
    "nothing": (Noise(), None),
    "r": (Noise(r=1.5), 1.5),
    "sigma": (Noise(sigma=1.25), 1.5625),
    "density": (Noise(density=0.25, bandwidth_hz=25.0), 1.5625),
    "still": (Noise(still=(0, 60)), "still"),
}


def local_level(q, r, n=400, seed=5):
    """A random walk under noise; constant for its first 60 samples."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(scale=math.sqrt(q), size=n)
    steps[:60] = 0.0
    return 20.0 + np.cumsum(steps) + rng.normal(scale=math.sqrt(r), size=n)


Z = local_level(0.1, 1.0)


def ask(z, *, sample_period=None, **options):
    return find_parameters(z, Request(**options), sample_period=sample_period)


EDGES = {
    "no_noise": np.sin(np.arange(300) / 30.0),
    "no_movement": np.random.default_rng(1).normal(size=300),
    "too_few": np.array([1.0, 2.0, math.nan, 3.0]),
    "constant": np.full(50, 4.0),
}


# ---- the truth table: who decides λ, who decides r, and what is left to the record


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("ratio", [None, 0.01])
@pytest.mark.parametrize("target", [None, *TARGETS])
def test_a_wish_fixes_the_ratio_the_noise_fixes_r_and_the_rest_is_estimated(target, ratio, known, method):
    noise, r = KNOWN[known]
    asked = {target: WISHED[target]} if target else None
    if target and ratio is not None:
        with pytest.raises(BadSetting, match="only one target for λ may be given"):
            ask(Z, sample_period=PERIOD, method=method, target=asked or {}, ratio=ratio, noise=noise)
        return
    found = ask(Z, sample_period=PERIOD, method=method, target=asked or {}, ratio=ratio, noise=noise)
    assert found.message.endswith(".")
    if r == "still":
        residuals = Z[:60] - np.polyval(np.polyfit(np.arange(60), Z[:60], 1), np.arange(60))
        r = float(residuals @ residuals) / 58.0
    if r is not None:
        assert found.params.r == pytest.approx(r, rel=1e-12)
    if target:
        assert getattr(steady_state(found.params, PERIOD), target) == pytest.approx(WISHED[target], rel=1e-9)
    if ratio is not None:
        assert found.params.ratio == pytest.approx(ratio, rel=1e-12)
    by = expected_method(target, ratio, r, method)
    assert (found.estimate.method if found.estimate else None) == by
    assert found.estimate is None or found.estimate.params == found.params
    if by in METHODS:
        assert found.how == METHODS[method]


def expected_method(target, ratio, r, method):
    if target or (ratio is not None and r is not None):
        return None  # all is said, nothing is left to estimate
    if ratio is not None:
        return "fixed_ratio"
    return method if r is None else "fixed_r"


def test_spikes_do_not_raise_the_r_of_a_goal_and_the_answer_says_that_no_gate_is_set():
    z = Z.copy()
    z[20::100] += 40.0 * np.std(np.diff(Z))
    plain, found = ask(Z, target={"gain": 0.2}), ask(z, target={"gain": 0.2})
    assert found.params.r == pytest.approx(plain.params.r, rel=0.1)
    assert found.params.gate is None
    assert "spikes set aside for it. A goal sets no outlier gate" in found.message
    assert "spike" not in plain.message


def test_the_words_for_the_tuning_file_name_what_decided():
    def how(**asked):
        return ask(Z, sample_period=PERIOD, **asked).how

    assert how() == "maximum likelihood"
    assert how(target={"lag_s": 0.1}) == "a lag of 100 ms"
    assert how(noise=Noise(still=(0, 60))) == "r from a still stretch, q by maximum likelihood"
    assert how(ratio=0.01) == "q/r = 0.01, r by maximum likelihood"
    assert how(ratio=0.01, noise=Noise(r=1.0)) == "q/r = 0.01, r as given"


# ---- what is refused


CONTRADICTIONS = [
    ({"target": {"gain": 0.2, "lag_s": 0.1}}, r"only one target for λ may be given \(got gain and lag_s\)"),
    ({"target": {"gain": 0.2}, "ratio": 0.01}, r"only one target for λ may be given \(got gain and q/r\)"),
    ({"target": {"speed": 1.0}}, "target must be one of lag_s, .* 'speed'"),
    ({"method": "magic"}, "method must be one of ml, .* 'magic'"),
    ({"ratio": 0.0}, "q/r must be a finite number above 0"),
    ({"ratio": math.inf}, "q/r must be a finite number above 0"),
    ({"noise": Noise(r=1.0, sigma=1.0)}, r"one source \(got r, sigma\)"),
    ({"noise": Noise(still=(0, 60), density=1.0, bandwidth_hz=1.0)}, r"one source \(got density, still\)"),
    ({"noise": Noise(sigma=1.0, bandwidth_hz=1.0)}, "bandwidth_hz needs density"),
    ({"noise": Noise(bandwidth_hz=1.0)}, "bandwidth_hz needs density"),
    ({"noise": Noise(density=1.0)}, "density needs bandwidth_hz"),
    ({"noise": Noise(r=0.0)}, "r must be a finite number above 0"),
    ({"noise": Noise(r=math.nan)}, "r must be a finite number above 0"),
    ({"noise": Noise(still=(0, 5))}, "still stretch must hold at least 8"),
    ({"target": {"lag_s": 0.1}}, "lag_s needs sample_period"),
    ({"target": {"gain": 1.5}}, "gain must lie between 0 and 1"),
    ({"target": {"cutoff_hz": 26.0}, "sample_period": PERIOD}, "at most half the sample rate"),
    ({"target": {"noise_reduction_db": 9e9}}, "q above 0"),
    ({"overshoot": 0.1}, r"overshoot needs a target .* \(got none\)"),
    ({"overshoot": 0.1, "ratio": 0.1}, r"overshoot needs a target .* \(got none\)"),
    ({"overshoot": 0.1, "target": {"gain": 0.1}, "momentum": 0.0}, r"no momentum.*\(got momentum = 0.0\)"),
    ({"overshoot": 0.3, "target": {"gain": 0.1}}, r"overshoot must be at most 19\.\d+ % of a step"),
    ({"ratio": 0.1, "momentum": 3.0}, r'momentum must be "auto" or 0 with a ratio or known noise'),
    ({"noise": Noise(r=1.0), "momentum": 3.0}, r'momentum must be "auto" or 0 with a ratio or known noise'),
]


@pytest.mark.parametrize(("asked", "says"), CONTRADICTIONS)
def test_contradictions_and_numbers_out_of_range_are_refused(asked, says):
    with pytest.raises(BadSetting, match=says):
        ask(Z, **asked)


# ---- the edges


@pytest.mark.parametrize("verdict", EDGES)
@pytest.mark.parametrize("target", TARGETS)
def test_at_an_edge_a_wish_still_gives_its_filter(verdict, target):
    found = ask(EDGES[verdict], sample_period=PERIOD, target={target: WISHED[target]})
    assert found.params.r > 0.0
    assert getattr(steady_state(found.params, PERIOD), target) == pytest.approx(WISHED[target], rel=1e-9)


def test_a_placeholder_is_called_one():
    assert "placeholder" in ask(np.full(50, 4.0), target={"gain": 0.2}).message
    assert "placeholder" in ask(np.full(50, math.nan), target={"gain": 0.2}).message
    counter = ask(1e6 + np.arange(5000.0), target={"gain": 0.2})  # a column of row numbers
    assert "placeholder" in counter.message
    assert counter.params.r == pytest.approx(0.5)
    assert "placeholder" not in ask(EDGES["no_noise"], target={"gain": 0.2}).message


def test_a_given_r_that_explains_everything_is_not_called_good():
    found = ask(Z, noise=Noise(r=1e6))
    assert (found.reason, found.params.ratio) == ("slow", 0.01)
    assert "The r found is good" not in found.message
    assert "Record while the signal moves" in found.message


# ---- an overshoot beside the target


@pytest.mark.parametrize("target", TARGETS)
def test_target_and_overshoot_are_both_met(target):
    found = ask(Z, sample_period=PERIOD, target={target: WISHED[target]}, overshoot=0.06)
    steady = steady_state(found.params, PERIOD)
    assert getattr(steady, target) == pytest.approx(WISHED[target], rel=1e-9)
    assert steady.overshoot == pytest.approx(0.06, rel=1e-6)
    assert found.how.endswith(" and 6 % overshoot")
    assert "with a momentum of " in found.message


@pytest.mark.parametrize("noise", [Noise(), Noise(r=1.5)])
def test_a_target_is_met_at_the_momentum_that_is_given(noise):
    found = ask(Z, target={"lag_samples": 7.0}, momentum=15.0, noise=noise)
    assert found.params.momentum == 15.0
    assert steady_state(found.params).lag_samples == pytest.approx(7.0, rel=1e-9)
