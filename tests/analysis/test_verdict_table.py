"""Laws of the one judgement, and of over a hundred filters on known records: no words that the data contradict."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.support.effort import EXAMPLES, FUZZ
from tests.truth.verdict_states import SIGNALS, STATES, N, VerdictState, row_of, walk, white

from kalscope import FilterParams, estimate, kalman_filter, open_source, steady_state
from kalscope.analysis import actions
from kalscope.analysis.correction import find_change
from kalscope.analysis.diagnostics import diagnose, diagnose_held_out
from kalscope.analysis.findings import KEEP, advice_text, request_in, still_met
from kalscope.analysis.judge import judge, needs_noise
from kalscope.estimation.momentum import likelihood_profile
from kalscope.estimation.request import Noise, Request, find_parameters

pytestmark = pytest.mark.slow

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
    "pairs": with_runs(20.0, 2),
    "runs": with_runs(20.0, 6),
    "tails": tails(2),
    "burst": louder(700, 730, 9.0),
}


def residuals(z, params, fitted=False):
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
    assert "spikes" not in residuals(louder(400, 800, 2.4), RIGHT).advice  # the change explains them


# --- advice that can be taken -----------------------------------------------------------------------------


def test_a_wrong_pair_is_wrong_on_both_halves_and_no_change():
    one = judged(walk(), FilterParams(0.1, 10.0))
    sizes = [float(size) for size in re.findall(r"(\d\.\d+) ×", one.second_half)]
    assert (one.status, sizes) == ("band", pytest.approx([0.1, 0.1], rel=0.3))


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
    many = walk() + np.where(np.arange(N) % 8 == 5, np.random.default_rng(1).choice([-20.0, 20.0], N), 0.0)
    assert judged(many, RIGHT).status == "bursts"  # too many for outliers
    then = judge(residuals(z, robust.params, fitted=True), None, robust)
    assert then.status == "fits"
    assert "10 more rejected by the gate" in then.headline


def test_the_still_stretch_that_a_record_shows_is_offered_where_r_is_open():
    z = np.sin(np.arange(300) / 30.0)
    found = estimate(z, momentum=0.0)
    assert (found.verdict, needs_noise(found)) == ("no_noise", True)
    plain, offered = judge(None, None, found), judge(None, None, found, still=(100, 250))
    assert plain.findings[0].action == actions.GiveNoise()
    assert offered.findings[0].action == actions.UseStillStretch(100, 250)
    assert offered.findings[1:] == plain.findings[1:]
    assert not needs_noise(estimate(walk()))


SAMPLES = ["sample:nile", "sample:ultrasonic", "sample:balancing_robot", "sample:ldr_pwm"]


@pytest.mark.parametrize("name", ["walk", "loud half", "spikes", "sine", "half a sine", "demo", *SAMPLES])
def test_no_sentence_denies_a_better_fit_at_any_momentum(name):
    """Random q, r and τ: the profile at that τ, and the best fit of all."""
    z = RECORDS[name] if name in RECORDS else open_source(name).values[:, 0]
    best = estimate(z).params
    steady = find_change(residuals(z, best).e) == 1.0
    g = np.random.default_rng(7)
    for _ in range(EXAMPLES // 2):
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


row = cache(row_of)

CHANCE = 3.29
"""Standard errors: once in a thousand."""


def random_states(count, seed=11):
    """Filters from one end of the sliders to the other, on every record."""
    g = np.random.default_rng(seed)
    states = []
    for name in g.choice(list(SIGNALS), count):
        q, r = (float(10.0 ** g.uniform(low, high)) for low, high in ((-8, 3), (-5, 4)))
        more = [{}, {"gate": 9.0}, {"gate": 16.0}, {"p0": 1e-6, "x0": 0.0}, {"momentum": 20.0}][int(g.integers(5))]
        states.append(VerdictState(str(name), FilterParams(q, r, **more)))
    return states


ALL = [*STATES, *random_states(30 * FUZZ)]
every_state = pytest.mark.parametrize("state", ALL, ids=[one.name() for one in ALL])


def worse(before, after):
    """By how many standard errors the mean of `after` exceeds that of `before`; their difference goes by blocks."""
    difference = after - before
    difference = difference[np.isfinite(difference)]
    means = np.array([part.mean() for part in np.array_split(difference, 16)])
    error = means.std(ddof=1) / 4.0
    return 0.0 if error == 0.0 else float(means.mean() / error)


def second_half(z, params):
    """−2 log-likelihood of each sample in the half that is not the first, without the gate."""
    result = kalman_filter(z, replace(params, gate=None))
    v, s = (column[len(z) // 2 :] for column in (result.innovation, result.s))
    with np.errstate(divide="ignore", invalid="ignore"):
        return v**2 / s + np.log(s)


# --- what is called a fit -------------------------------------------------------------------------------


@every_state
def test_what_is_bad_can_be_mended_by_a_button_and_what_is_good_needs_none_and_hides_no_misfit(state):
    one = row(state)
    said, mended = one.said, any(advice.action is not None for advice in one.said.findings)
    assert (said.tone == "bad") <= mended
    assert (said.tone == "good") <= (not mended)
    assert (said.headline[0].isupper(), said.headline[-1], len(said.word) <= 16) == (True, ".", True)
    if said.tone == "good":
        for d in (one.whole, one.half):
            assert 1 / 1.5 < d.nis < 1.5 or abs(d.nis - 1.0) < CHANCE * math.sqrt(2.0 / d.n)
        assert abs(one.whole.r1) < max(0.2, CHANCE / math.sqrt(one.whole.n))
        assert one.whole.slow_share < 0.1
        assert said.findings == ()


@every_state
def test_the_advised_q_and_r_predict_the_second_half_no_worse(state):
    for advice in (one for one in row(state).said.findings if isinstance(one.action, actions.Scale)):
        action, advised = advice.action, taken(state.params, advice.action)
        assert worse(second_half(state.z, state.params), second_half(state.z, advised)) < CHANCE
        for name, factor in (("q", action.q_factor), ("r", action.r_factor)):
            assert (f"raise {name} " in advice.text) <= (factor > 1.0)
            assert (f"lower {name} " in advice.text) <= (factor < 1.0)


def taken(params, action):
    """The filter after an action that needs no search; None for any other."""
    match action:
        case actions.Scale(q_factor, r_factor):
            return replace(params, q=params.q * q_factor, r=params.r * r_factor)
        case actions.SetGate(sigma):
            return replace(params, gate=None if sigma is None else sigma**2)
        case actions.UnsetStart():
            return replace(params, x0=None, p0=None)
        case _:
            return None


@every_state
def test_the_first_button_clicked_again_and_again_comes_to_an_end(state):
    params, said, seen = state.params, row(state).said, set()
    while said.tone == "bad":
        after = next((one for one in (taken(params, advice.action) for advice in said.findings) if one), None)
        if after is None:
            return
        assert said.findings not in seen, "it goes round in a circle"
        seen.add(said.findings)
        assert len(seen) < 8
        said = row_of(VerdictState(state.signal, params := after)).said


# --- a goal ---------------------------------------------------------------------------------------------

GOALS = [
    *(Request(target={"lag_s": lag}) for lag in (0.02, 2.0)),
    Request(target={"lag_samples": 10.0}),
    Request(target={"cutoff_hz": 0.5}),
    Request(target={"noise_reduction_db": 12.0}),
    Request(target={"gain": 0.9}),
    Request(ratio=0.01),
    Request(target={"lag_s": 0.2}, overshoot=0.05),
]
each_goal = pytest.mark.parametrize("at", range(len(GOALS)), ids=[one.goal for one in GOALS])
MOVING = ["white", "walk", "noisy ramp", "sine", "slow sine", "steps", "spikes", "coloured", "hum", "gaps"]


@cache
def chosen(name, at):
    """A record, the filter that a goal gives, and what is said of it."""
    z, request = SIGNALS[name], GOALS[at]
    found = find_parameters(z, request, sample_period=0.01)
    return z, found.params, judge(residuals(z, found.params), None, found.estimate, request=request)


@each_goal
@pytest.mark.parametrize("name", MOVING)
def test_a_goal_is_never_called_a_mistake_and_no_advice_undoes_it(name, at):
    _, params, said = chosen(name, at)
    assert said.status not in ("too_slow", "too_fast")
    ratio = float(params.q) / float(params.r)
    for advice in said.findings:
        match advice.action:
            case None | actions.SetGate() | actions.UnsetStart():
                pass
            case actions.Scale(q_factor, r_factor):
                assert ratio * q_factor / r_factor == pytest.approx(ratio, rel=0.5)
            case other:
                raise AssertionError(other)
    goal = GOALS[at].goal
    if said.status == "as_chosen":
        momentum = "with this momentum " if params.momentum else ""
        assert said.headline.startswith(f"You chose {goal}. The best statistical fit {momentum}would ")
        assert (said.word, said.tone) == ("set by your goal", "note")
    elif said.tone != "bad":
        assert said.headline.startswith(f"You chose {goal}. ")


@each_goal
@pytest.mark.parametrize("name", MOVING)
def test_the_best_fit_lies_where_the_words_say(name, at):
    """The oracle: the likelihood with the best r over a fine grid of q/r, by the filter itself."""
    z, params, said = chosen(name, at)
    words = said.headline, *(one.text for one in said.findings)
    texts = [text for verb in ("would follow", "would smooth") for text in words if verb in text]
    if name in ("spikes", "steps"):  # a plain likelihood is not what judges them
        return
    own = float(params.q) / float(params.r)
    factors = np.geomspace(1e-4, 1e4, 65)
    best = factors[int(np.argmax([concentrated(z, own * factor, params.momentum) for factor in factors]))]
    if not texts:
        gain = concentrated(z, own * best, params.momentum) - concentrated(z, own, params.momentum)
        assert gain < 8.0 or 0.5 < best < 2.0
        return
    assert ("follow faster" in texts[0]) == (best > 1.0)
    if "more than 1000" not in texts[0] and 1e-3 < best < 1e3:
        size = float(texts[0].split("about ")[1].split(" ×")[0].replace("\u202f", ""))
        assert size == pytest.approx(max(best, 1.0 / best), rel=0.5)


def concentrated(z, ratio, momentum=0.0):
    result = kalman_filter(z, FilterParams(ratio, 1.0, momentum=momentum))
    seen = np.isfinite(result.innovation) & (result.k > 0.0)
    v, s = result.innovation[seen], result.s[seen]
    return -0.5 * (len(v) * math.log(float(np.mean(v**2 / s))) + float(np.log(s).sum()))


@pytest.mark.parametrize(("r", "words"), [(100.0, "smaller"), (0.01, "larger")])
def test_an_r_that_was_given_stays_and_its_advice_says_what_it_relies_on(r, words):
    z = SIGNALS["walk"]
    request = Request(noise=Noise(sigma=math.sqrt(r)))
    found = find_parameters(z, request)
    said = judge(residuals(z, found.params), None, found.estimate, request=request)
    assert said.status == "as_chosen"
    assert said.headline.startswith("You gave r from the data sheet. The best statistical fit has an r about ")
    assert said.headline.endswith(f"{words}: keep yours if you trust the data sheet.")
    assert not any(isinstance(one.action, actions.Scale) for one in said.findings)


@each_goal
def test_a_tuning_file_names_the_goal_which_another_sample_period_may_break(at):
    _, params, _ = chosen("walk", at)
    asked = GOALS[at]
    if not asked.overshoot:
        assert request_in(asked.goal, 1.0) == asked
        known = request_in(f"{asked.goal}, r from a still stretch", 4.0)
        assert (known.goal, known.noise) == (asked.goal, Noise(r=4.0))
    for lag in (2e-7, 30.0, 1500.0, 2.5 * 86400.0, 31557600.0):
        assert request_in(Request(target={"lag_s": lag}).goal, 1.0).target == {"lag_s": pytest.approx(lag)}
    assert still_met(asked, params, 0.01) == asked
    in_seconds = bool({"lag_s", "cutoff_hz"} & set(asked.target))
    assert still_met(asked, params, 0.02) == (None if in_seconds else asked)
    if in_seconds:
        assert still_met(replace(asked, noise=Noise(r=1.0)), params, 0.02) == Request(noise=Noise(r=1.0))


# --- the best fit ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SIGNALS)
def test_a_first_answer_that_may_look_worse_says_what_to_do(name):
    found = find_parameters(SIGNALS[name])
    tested = residuals(SIGNALS[name], found.params, found.reason == "best_fit")
    said = judge(tested, None, found.estimate, found.request)
    keeps = any(advice.text.startswith(KEEP) for advice in said.findings)
    assert keeps == (name == "sine")  # a lag would lose it
    assert said.status not in ("too_slow", "too_fast", "no_pair")
    if said.tone == "good":
        assert float(steady_state(found.params).noise_reduction_db) >= 3.0
    elif said.status not in ("start", "constant", "too_few"):
        assert keeps or any(advice.action is not None for advice in said.findings)
