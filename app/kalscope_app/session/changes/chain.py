"""Changes of the chain of filters that a channel runs in place of the Kalman filter alone."""

from __future__ import annotations

from kalscope.errors import BadSetting
from kalscope.filtering.classic.chain import Chain
from kalscope_app.session.state import Change, State

MEDIANS = ("off", "3 samples", "5 samples")
"""Medians that may be chosen as the first filter, in the words on screen."""


def median_words(window: int) -> str:
    """A median of `window` samples as the menu names it."""
    return "off" if window == 1 else f"{window} samples"


def use_chain(chain: Chain) -> Change:
    """The channel on screen runs this chain; its q and r stay."""

    def change(state: State) -> State:
        state.require_one_channel()
        if state.tuning.chain == chain:
            return state
        after = state.with_standard_filter().with_tuning(chain=chain)
        words = f"{chain.words[:1].upper()}{chain.words[1:]}"
        return after.with_answers(note=f"{words} runs now; Undo reverts it.")

    return change


def use_kalman_filter(state: State) -> State:
    """The Kalman filter alone again, at the q and r that it had."""
    return state.with_standard_filter()


def set_median(words: str) -> Change:
    """Put a median before the filter that runs, or none."""

    def change(state: State) -> State:
        chain = state.tuning.chain
        if words == median_words(1 if chain is None else chain.median):
            return state
        if words not in MEDIANS:
            raise BadSetting(f"the median must be one of {', '.join(MEDIANS)} (got {words[:40]!r})")
        then, off = None if chain is None else chain.then, words == "off"
        window = 1 if off else int(words.partition(" ")[0])
        return state.with_tuning(chain=None if off and then is None else Chain(window, then))

    return change
