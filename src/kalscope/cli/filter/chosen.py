"""What `kalscope filter` runs: a filter a channel, or one that fuses several of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from kalscope.cli.filter.line_filter import Filters
from kalscope.cli.filter.options import GivenParams
from kalscope.errors import BadSetting
from kalscope.export.filtered_csv import filtered_csv_chunks, fused_csv_chunks
from kalscope.recording import Recording
from kalscope.tuning.choose import filters_for, tunings_for_stdin
from kalscope.tuning.choose_fusion import FusionGiven, fusion_for, fusion_for_stdin
from kalscope.tuning.tuning_file import load_tuning


def fusion_given(
    config: Path | None, given: GivenParams, channel: str | None, fuse: str | None
) -> FusionGiven | None:
    """What the options say of a fused filter; None where channels are filtered one by one.

    Raises:
        BadFile: `config` is not a tuning file.
        BadSetting: --fuse with --channel, or an r of each sensor without a fusion.
    """
    if fuse is not None and channel is not None:
        raise BadSetting(f"--fuse must be used without --channel: it names its channels (got {channel!r})")
    fused = fuse is not None or (config is not None and channel is None and load_tuning(config).fusion is not None)
    if not fused:
        if given.r_of_each:
            raise BadSetting(f"--r must be one number without --fuse (got one for {', '.join(given.r_of_each)})")
        return None
    if given.values.get("chain") is not None:
        raise BadSetting("--chain must be used without fused channels: a chain filters one (got both)")
    others = {name: value for name, value in given.values.items() if name != "r"}
    return FusionGiven(fuse, given.r_of_each or given.values.get("r"), others)


def filtered(
    recording: Recording, config: Path | None, given: GivenParams, channel: str | None, fusion: FusionGiven | None
) -> tuple[Iterator[str], list[str]]:
    """The CSV of a recording in pieces, and notes on the choice of the filter; errors as the functions it calls."""
    if fusion is not None:
        chosen, notes = fusion_for(recording, config, fusion)
        return fused_csv_chunks(recording, chosen), notes
    filters, notes = filters_for(recording, config, given.values, channel)
    return filtered_csv_chunks(recording, filters), notes


def filters_of_lines(
    config: Path | None,
    given: GivenParams,
    channel: str | None,
    fusion: FusionGiven | None,
    period: float | None,
) -> tuple[Filters, list[str]]:
    """The filters of lines on stdin, and notes on their choice; errors as the functions it calls."""
    if fusion is not None:
        chosen, notes = fusion_for_stdin(config, fusion, period)
        return chosen.params, notes
    tunings, notes = tunings_for_stdin(config, given.values, channel, period)
    return [one.filter for one in tunings] if isinstance(tunings, list) else tunings.filter, notes
