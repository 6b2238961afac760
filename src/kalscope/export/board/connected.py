"""A connected board: which of its filters a channel belongs to, and which values it uses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalscope.errors import BadDevice, BadSetting
from kalscope.export.board.commands import BoardAnswer, FixedFilter, is_refusal, read_answer

if TYPE_CHECKING:
    from collections.abc import Callable

    from kalscope.sources.live.live_source import LiveSource


@dataclass(frozen=True)
class BoardFilter:
    """One filter of a board."""

    number: int | None
    """Its place among the board's, from 1; None = the only one."""
    filtered: str
    """The channel in which the board sends the filtered values of the measured one."""


def board_filter(names: tuple[str, ...], channel: str, filters: int = 0) -> BoardFilter:
    """Which filter of the board a channel belongs to.

    Args:
        names: All that the board sends.
        channel: What is measured.
        filters: How many filters the board says it has. It sends names only when it starts: otherwise the columns
            have none, and are measured, filtered, measured, filtered …

    Raises:
        BadSetting: the board sends no filtered value beside this channel.
    """
    filtered = filtered_channels(names, filters)
    if channel not in filtered:
        raise BadSetting(
            f"this board cannot be tuned: it sends no filtered column for {channel[:40]} "
            f"(only {', '.join(names)[:100]}). Flash the exported sketch first"
        )
    return BoardFilter(None if len(filtered) == 1 else list(filtered).index(channel) + 1, filtered[channel])


def filtered_channels(names: tuple[str, ...], filters: int = 0) -> dict[str, str]:
    """The channels that a board filters, in its order, and those in which it sends the result.

    Args:
        names: All that the board sends.
        filters: How many filters it says it has.
    """
    if is_unnamed(names) and len(names) == 2 * filters:
        return dict(zip(names[::2], names[1::2], strict=True))
    named = {name: f"{name}_filtered" for name in names if f"{name}_filtered" in names}
    return {"raw": "filtered"} if not named and {"raw", "filtered"} <= set(names) else named


def is_unnamed(names: tuple[str, ...]) -> bool:
    """Whether the board has not sent the names of its columns."""
    return names == tuple(f"value {i + 1}" for i in range(len(names)))


def values_in_use(
    source: LiveSource, line: str = "?", check: Callable[[], object] = bool
) -> list[BoardAnswer | FixedFilter]:
    """What the filters of a board use, in its order, after a command if one is given; `check` as for `send`.

    Raises:
        BadDevice: the board did not answer, or did not take the value.
    """
    replies = source.commands.send(line, is_reply=_is_answer, check=check)
    for reply in filter(is_refusal, replies):
        raise BadDevice(f"the board did not take {line!r}: it answered {reply[:100]!r}")
    return [answer for answer in map(read_answer, replies) if answer is not None]


def _is_answer(remark: str) -> bool:
    return is_refusal(remark) or read_answer(remark) is not None
