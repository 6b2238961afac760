"""How the methods differ, in sentences: shown where they disagree, or on request."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.common.text import number, percent
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict.conclude import gain_of

MAX_CHANCE = 0.006
"""Chance does not explain what fewer of the simulated records show."""
_SAME_GAIN = 0.1
"""A filter whose gain differs by less than this share is the same filter."""
_SAME_SIZE = 1.3
"""Variances that differ by less than this factor are the same size."""
_NAMES = {"moments": "the moments of the differences", "als": "the innovations", "allan": "the Allan variance"}
_NO_RECORD = ("too_few", "constant", "bad_unit")
"""Verdicts of a record in which no method finds anything."""


def disagreement(estimates: Sequence[Estimate], momentum: float = 0.0) -> str:
    """A sentence on how other methods contradict the first, for one channel; "" where they do not.

    Args:
        estimates: what `compare_methods` gave, or one channel of each.
        momentum: of the chosen filter; the second opinions have none, and do not count where it is above 0.
    """
    against = [one for one in estimates[1:] if _contradicts(one, estimates[0])]
    if not against or momentum > 0.0 or estimates[0].verdict == "below_resolution":
        return ""
    first = estimates[0]
    named = ", ".join(f"{_NAMES[one.method]} {_describe(one, first)}" for one in against)
    chance = max(float(one.agreement) for one in against)
    return (
        f"The model does not describe this signal: maximum likelihood finds gain {number(_gain(first), 2)}, "
        f"{named}. Chance makes them differ as much in at most {percent(chance)} of simulated records."
    )


def worth_showing(estimates: Sequence[Estimate], momentum: float = 0.0) -> bool:
    """Whether to show second opinions without a request: only where they contradict, never as reassurance."""
    return bool(disagreement(estimates, momentum))


def comparison(estimates: Sequence[Estimate], momentum: float = 0.0) -> str:
    """What to tell a user who asks for second opinions, for one channel.

    Args:
        estimates: what `compare_methods` gave, or one channel of each.
        momentum: of the filter that was chosen.
    """
    if momentum > 0.0:
        return "They need not agree here: all of them look for a signal without momentum."
    if estimates[0].verdict in _NO_RECORD:
        return ""
    if estimates[0].verdict == "below_resolution":
        return "They need not agree here: the sensor rounds its readings to steps larger than the noise."
    second = [one for one in estimates if one.method in _NAMES]
    reasons: dict[str, list[str]] = {}
    for one in second:
        if one.not_counted:
            reasons.setdefault(str(one.not_counted), []).append(_NAMES[one.method])
    left_out = [
        f"{_listed(names)} {'does' if names == [_NAMES['allan']] else 'do'} not count: {reason}."
        for reason, names in reasons.items()
    ]
    counted = [one for one in second if not one.not_counted]
    said = disagreement(estimates)
    if counted and not said:
        said = "They differ by no more than chance explains." if not left_out else _agreed(counted)
    return " ".join([*([said] if said else []), *(text[0].upper() + text[1:] for text in left_out)])


def _agreed(counted: Sequence[Estimate]) -> str:
    named = _listed([_NAMES[one.method] for one in counted])
    differ = "differs" if named == _NAMES["allan"] else "differ"
    return f"Chance explains how far {named} {differ} from maximum likelihood."


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _contradicts(one: Estimate, first: Estimate) -> bool:
    """Whether another filter would follow from this opinion, and chance does not explain it."""
    if _size(first) == 0.0:  # out of the range of numbers: there is no pair to compare with
        return False
    if one.method not in _NAMES or one.not_counted or float(one.agreement) >= MAX_CHANCE:
        return False
    return _other_gain(one, first) or not 1.0 / _SAME_SIZE < _size(one) / _size(first) < _SAME_SIZE


def _describe(one: Estimate, first: Estimate) -> str:
    """What the other method finds: its gain, or the factor of its variances where the gain is the same."""
    if _other_gain(one, first):
        return f"gain {number(_gain(one), 2)}"
    return f"the same gain from {number(_size(one) / _size(first), 2)} times the variances"


def _gain(one: Estimate) -> float:
    return gain_of(float(one.ratio))


def _size(one: Estimate) -> float:
    """The variance of the difference of two samples."""
    return float(one.q) + 2.0 * float(one.r)


def _other_gain(one: Estimate, first: Estimate) -> bool:
    return abs(_gain(one) - _gain(first)) > _SAME_GAIN * max(_gain(one), _gain(first))
