from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from each import each

from kalscope.errors import BadSetting, Cancelled
from kalscope.estimation.fit import METHODS, estimate
from kalscope.estimation.request import (
    METHOD_NAMES,
    TARGETS,
    Found,
    Noise,
    Request,
    find_parameters,
    shows_no_noise,
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


def local_level(q: float, r: float, n: int = 400, seed: int = 5) -> np.ndarray:
    """A random walk under noise; constant for its first 60 samples."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(scale=math.sqrt(q), size=n)
    steps[:60] = 0.0
    return 20.0 + np.cumsum(steps) + rng.normal(scale=math.sqrt(r), size=n)


Z = local_level(0.1, 1.0)


def ask(
    z: np.ndarray,
    *,
    sample_period: float | None = None,
    cancelled: Callable[[], bool] | None = None,
    **asked: Any,
) -> Found:
    return find_parameters(z, Request(**asked), sample_period=sample_period, cancelled=cancelled)


EDGES = {
    "no_noise": np.sin(np.arange(300) / 30.0),
    "no_movement": np.random.default_rng(1).normal(size=300),
    "too_few": np.array([1.0, 2.0, math.nan, 3.0]),
    "constant": np.full(50, 4.0),
}


def test_spikes_are_set_aside_where_something_is_estimated_and_may_be_kept() -> None:
    spiky = Z.copy()
    spiky[20 :: len(Z) // 8] += 40.0
    for asked in ({}, {"noise": Noise(r=1.0)}, {"ratio": 0.1}):
        found, kept = ask(spiky, **asked), ask(spiky, **asked, robust=False)
        assert found.estimate is not None
        assert found.estimate.outliers is not None
        assert found.params == found.estimate.params
        assert found.params is not None
        assert found.params.gate == 16.0
        assert kept.estimate is not None
        assert kept.estimate.outliers is None
    r = ask(spiky, target={"gain": 0.2}).params
    assert r is not None
    kept = ask(spiky, target={"gain": 0.2}, robust=False).params
    assert kept is not None
    assert 10.0 * float(r.r) < float(kept.r)


# ---- the truth table: who decides λ, who decides r, and what is left to the record


@pytest.mark.slow
@each("method", METHODS)
@each("known", KNOWN)
@each("ratio", [None, 0.01])
@each("target", [None, *TARGETS])
def test_a_wish_fixes_the_ratio_the_noise_fixes_r_and_the_rest_is_estimated(
    target: str | None, ratio: float | None, known: str, method: str
) -> None:
    noise, r = KNOWN[known]
    asked = {target: WISHED[target]} if target else None
    if target and ratio is not None:
        with pytest.raises(BadSetting, match="only one target for λ may be given"):
            ask(Z, sample_period=PERIOD, method=method, target=asked or {}, ratio=ratio, noise=noise)
        return
    found = ask(Z, sample_period=PERIOD, method=method, target=asked or {}, ratio=ratio, noise=noise)
    assert found.params is not None
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
        assert found.how == METHOD_NAMES[method]


def expected_method(target: str | None, ratio: float | None, r: float | None, method: str) -> str | None:
    if target or (ratio is not None and r is not None):
        return None  # all is said, nothing is left to estimate
    if ratio is not None:
        return "fixed_ratio"
    return method if r is None else "fixed_r"


def test_without_a_known_noise_a_wish_takes_r_from_the_likelihood() -> None:
    found = ask(Z, target={"gain": 0.2})
    assert found.params is not None
    assert found.params.r == estimate(Z).r


def test_spikes_do_not_raise_the_r_of_a_goal_and_the_answer_says_that_no_gate_is_set() -> None:
    z = Z.copy()
    z[20::100] += 40.0 * np.std(np.diff(Z))
    plain, found = ask(Z, target={"gain": 0.2}), ask(z, target={"gain": 0.2})
    assert plain.params is not None
    assert found.params is not None
    assert found.params.r == pytest.approx(plain.params.r, rel=0.1)
    assert found.params.gate is None
    assert "spikes set aside for it. A goal sets no outlier gate" in found.message
    assert "spike" not in plain.message


def test_the_words_for_the_tuning_file_name_what_decided() -> None:
    def how(**asked) -> str:
        return ask(Z, sample_period=PERIOD, **asked).how

    assert how() == "maximum likelihood"
    assert how(target={"lag_s": 0.1}) == "a lag of 100 ms"
    assert how(target={"lag_s": 2.0}) == "a lag of 2000 ms"
    assert how(target={"cutoff_hz": 2.5}, noise=Noise(sigma=1.0)) == (
        "a −3 dB cut-off at 2.5 Hz, r from the data sheet"
    )
    assert how(noise=Noise(still=(0, 60))) == "r from a still stretch, q by maximum likelihood"
    assert how(ratio=0.01) == "q/r = 0.01, r by maximum likelihood"
    assert how(ratio=0.01, noise=Noise(r=1.0)) == "q/r = 0.01, r as given"


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_the_answer_does_not_depend_on_the_unit(scale: float) -> None:
    cases: list[dict[str, Any]] = [
        {},
        {"target": {"lag_samples": 5.0}},
        {"ratio": 0.01},
        {"noise": KNOWN["still"][0]},
    ]
    for asked in cases:
        plain, scaled = ask(Z, **asked).params, ask(Z * scale, **asked).params
        assert plain is not None
        assert scaled is not None
        assert (scaled.q, scaled.r) == pytest.approx((plain.q * scale**2, plain.r * scale**2), rel=1e-6)


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
]


@each(("asked", "says"), CONTRADICTIONS)
def test_contradictions_and_numbers_out_of_range_are_refused(asked: dict, says: str) -> None:
    with pytest.raises(BadSetting, match=says):
        ask(Z, **asked)


@pytest.mark.parametrize("asked", [{}, {"method": "als"}, {"target": {"gain": 0.2}}])
def test_a_search_can_be_cancelled(asked: dict) -> None:
    with pytest.raises(Cancelled):
        ask(Z, cancelled=lambda: True, **asked)


# ---- the edges


@each("verdict", EDGES)
def test_an_edge_carries_no_parameters_and_says_what_to_do(verdict: str) -> None:
    found = ask(EDGES[verdict])
    assert found.params is None
    assert found.estimate is not None
    assert found.estimate.verdict == verdict
    assert says_what_to_do(found)


@each("verdict", EDGES)
@each("target", TARGETS)
def test_at_an_edge_a_wish_still_gives_its_filter(verdict: str, target: str) -> None:
    found = ask(EDGES[verdict], sample_period=PERIOD, target={target: WISHED[target]})
    assert found.params is not None
    assert found.params.r > 0.0
    assert getattr(steady_state(found.params, PERIOD), target) == pytest.approx(WISHED[target], rel=1e-9)


def test_at_the_edge_without_movement_the_likelihood_still_gives_r_for_a_wish() -> None:
    found = ask(EDGES["no_movement"], target={"gain": 0.2})
    assert found.params is not None
    assert found.params.r == pytest.approx(np.var(EDGES["no_movement"], ddof=1), rel=1e-3)


def test_a_placeholder_is_called_one() -> None:
    assert "placeholder" in ask(np.full(50, 4.0), target={"gain": 0.2}).message
    assert "placeholder" in ask(np.full(50, math.nan), target={"gain": 0.2}).message
    counter = ask(1e6 + np.arange(5000.0), target={"gain": 0.2})  # a column of row numbers
    assert "placeholder" in counter.message
    assert counter.params is not None
    assert counter.params.r == pytest.approx(0.5)
    assert "placeholder" not in ask(EDGES["no_noise"], target={"gain": 0.2}).message


def test_a_given_r_that_explains_everything_is_not_called_good() -> None:
    found = ask(Z, noise=Noise(r=1e6))
    assert found.params is None
    assert "The r found is good" not in found.message
    assert "too large" in found.message
    assert says_what_to_do(found)


@each(("verdict", "silent"), list(zip(EDGES, [False, False, True, True], strict=True)))
def test_a_constant_and_an_even_ramp_show_no_noise(verdict: str, silent: bool) -> None:
    assert shows_no_noise(EDGES[verdict]) is silent
    assert shows_no_noise(np.array([1.0, math.nan, 2.0]))


def says_what_to_do(found: Found) -> bool:
    return any(words in found.message for words in ("Instead:", "Record longer", "Record while"))


def test_all_pairs_of_two_noises_are_refused() -> None:
    values = {"r": 1.0, "sigma": 1.0, "density": 1.0, "still": (0, 60)}
    for a, b in itertools.combinations(values, 2):
        with pytest.raises(BadSetting, match="must come from one source"):
            ask(Z, noise=Noise(**{a: values[a], b: values[b]}))  # pyright: ignore


# ---- an overshoot beside the target


@each("target", TARGETS)
def test_target_and_overshoot_are_both_met(target: str) -> None:
    found = ask(Z, sample_period=PERIOD, target={target: WISHED[target]}, overshoot=0.06)
    assert found.params is not None
    steady = steady_state(found.params, PERIOD)
    assert getattr(steady, target) == pytest.approx(WISHED[target], rel=1e-9)
    assert steady.overshoot == pytest.approx(0.06, rel=1e-6)
    assert found.how.endswith(" and 6 % overshoot")
    assert "with a momentum of " in found.message


@pytest.mark.parametrize("noise", [Noise(), Noise(r=1.5)])
def test_a_target_is_met_at_the_momentum_that_is_given(noise: Noise) -> None:
    found = ask(Z, target={"lag_samples": 7.0}, momentum=15.0, noise=noise)
    assert found.params is not None
    assert found.params.momentum == 15.0
    assert steady_state(found.params).lag_samples == pytest.approx(7.0, rel=1e-9)


@each(
    ("asked", "says"),
    [
        ({"overshoot": 0.1}, r"overshoot needs a target .* \(got none\)"),
        ({"overshoot": 0.1, "ratio": 0.1}, r"overshoot needs a target .* \(got none\)"),
        ({"overshoot": 0.1, "target": {"gain": 0.1}, "momentum": 0.0}, r"no momentum.*\(got momentum = 0.0\)"),
        ({"overshoot": 0.3, "target": {"gain": 0.1}}, r"overshoot must be at most 19\.\d+ % of a step"),
        ({"ratio": 0.1, "momentum": 3.0}, r'momentum must be "auto" or 0 with a ratio or known noise'),
        ({"noise": Noise(r=1.0), "momentum": 3.0}, r'momentum must be "auto" or 0 with a ratio or known noise'),
    ],
)
def test_an_overshoot_or_momentum_that_does_not_go_with_the_rest_is_refused(
    asked: dict[str, Any], says: str
) -> None:
    with pytest.raises(BadSetting, match=says):
        ask(Z, **asked)
