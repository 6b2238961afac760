"""The tuning for a device that samples at another rate than the recording."""

from __future__ import annotations

from dataclasses import replace

from kalscope.errors import BadSetting
from kalscope.estimation.finding import Request
from kalscope.estimation.known import params_for_specification
from kalscope.tuning.tuning import ChannelTuning, Tuned, Tuning, same_period


def rescaled_to_period(tuning: Tuning, sample_period: float) -> Tuning:
    """The tuning for a device that samples every `sample_period` s; where q changes, `how` says from what.

    The filters stay those of the same movement: q grows with the period, so the lag in s changes too.
    """
    old, moved = tuning.sample_period, tuning.rescaled(sample_period)
    if old is None or same_period(old, sample_period):
        return moved
    fusion = None if moved.fusion is None else _said(moved.fusion, old, sample_period)
    channels = tuple(_said(one, old, sample_period) for one in moved.channels)
    return replace(moved, channels=channels, fusion=fusion)


def meeting_goal(tuning: Tuning, name: str, request: Request, sample_period: float) -> Tuning:
    """As `rescaled_to_period`, but one channel meets the goal of `request` at the new period too, with the same r.

    Args:
        tuning: What was found on the recording.
        name: The channel that the goal was chosen for.
        request: Has a target, such as {"lag_s": 0.05}.
        sample_period: Of the device, s.

    Raises:
        BadSetting: As `rescaled_to_period`; no such channel, no target, or the target is out of reach there.
    """
    if not request.target:
        raise BadSetting("the goal must be a lag, a cut-off, a noise reduction or a gain (got none)")
    own = tuning.rescaled(sample_period).channel(name)
    params = params_for_specification(
        own.r,
        **request.target,
        sample_period=sample_period,
        momentum=own.momentum if request.overshoot is None else 0.0,  # an overshoot gives the momentum too
        overshoot=request.overshoot,
    )
    how = f"at {sample_period:.4g} s: {request.goal}"
    met = replace(own, q=params.q, momentum=params.momentum, how=how)
    others = rescaled_to_period(tuning, sample_period)
    return replace(others, channels=tuple(met if one.name == name else one for one in others.channels))


def _said(new: Tuned, old: float, sample_period: float) -> Tuned:
    """The rescaled filter, with the period that it was found at in `how`.

    That period comes first: a header may cut the end, and a lag that was asked for does not hold at the new period.
    """
    momentum = " and momentum divided by it" if new.momentum > 0.0 else ""
    chain = ", chain rescaled" if isinstance(new, ChannelTuning) and new.chain is not None else ""
    return replace(new, how=f"at {old:.4g} s: {new.how}; q times {sample_period / old:.4g}{momentum}{chain}")
