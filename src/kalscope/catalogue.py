r"""Everything that can become a Recording, and the one grammar that names it.

    demo                                     the sample for a first look
    sample:NAME                              a recording of sample_data
    synthetic:SHAPE?n=2000&sigma=1.5&seed=3  a simulated sensor
    experiment:NAME                          a figure of a source document
    file:PATH                                a file that is followed elsewhere: read once, as far as it is written
    anything else                            the path of a file (C:\x.csv is one)

Other live sources, such as `serial:PORT@BAUD`, never end: `is_live` knows them, `sources.live` opens them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields
from typing import Any
from urllib.parse import parse_qsl

import msgspec

from kalscope.common.progress import OnProgress
from kalscope.errors import BadSetting
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.port.reader import quoted
from kalscope.sources.port.registry import is_live
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.samples import DEMO, open_sample
from kalscope.sources.synthetic import SignalSettings, synthesize

# Two letters at least before the colon: C:\x.csv and C:/x.csv are files.
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):(.*)", re.DOTALL)


def open_source(
    spec: str,
    options: ReadOptions = DEFAULTS,
    *,
    sample_period: float | None = None,
    progress: OnProgress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Recording:
    """Open what `spec` names, in the grammar above.

    Args:
        spec: "demo", "sample:NAME", "synthetic:SHAPE?…", "experiment:NAME" or a path.
        options: How to read a file; other sources ignore it.
        sample_period: Nominal sample period in s for a file, see `read_recording`; for a synthetic signal
            the setting of that name.
        progress: See `read_recording`.
        cancelled: See `read_recording`.

    Returns:
        The Recording; its `source` reopens it.

    Raises:
        BadFile: the file cannot be read.
        BadSetting: an unknown sample, shape or setting; a live source; a URL; an option the file cannot have.
        Cancelled: `cancelled()` was true.
    """
    if not spec.strip():
        raise BadSetting('source must be a file, "demo", "sample:NAME" or "synthetic:SHAPE" (got nothing)')
    if spec == "demo":
        return open_sample(DEMO, sample_period)
    match = _SCHEME.fullmatch(spec)
    scheme = match[1].lower() if match else ""
    if match and scheme == "sample":
        return open_sample(match[2], sample_period)
    if match and scheme == "synthetic":
        return _open_synthetic(match[2], sample_period)
    if match and scheme == "experiment":
        from kalscope.papers.reproduction import open_experiment  # which reads the samples through this module

        return open_experiment(match[2])[0]
    is_url = match is not None and match[2].startswith("//")
    if match and scheme == "file" and not is_url:
        spec = match[2]  # read once, as far as it is written
    elif is_live(spec) and scheme != "file":
        raise BadSetting(
            f"source must be a file or another finished recording (got {quoted(spec)}, a board that streams: first"
            " kalscope record PORT -o FILE.csv, or kalscope open PORT to tune it live)"
        )
    elif is_url:
        raise BadSetting(f"source must be a file to be read (got {spec!r}, a web address)")
    return read_recording(spec, options, sample_period=sample_period, progress=progress, cancelled=cancelled)


def _open_synthetic(text: str, sample_period: float | None) -> Recording:
    shape, _, query = text.partition("?")
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError:
        raise BadSetting(f"synthetic settings must be written key=value&key=value (got {query!r})") from None
    texts = dict(pairs)
    if len(texts) != len(pairs):
        raise BadSetting(f"each synthetic setting must be given once (got {query!r})")
    kinds = {item.name: str(item.type) for item in fields(SignalSettings) if item.name != "shape"}
    if unknown := [key for key in texts if key not in kinds]:
        raise BadSetting(f"synthetic setting must be one of {', '.join(kinds)} (got {unknown[0]!r})")
    values = {key: value.split(",") if "tuple" in kinds[key] and value else value for key, value in texts.items()}
    try:
        checked = msgspec.convert(
            {key: value for key, value in values.items() if value}, SignalSettings, strict=False
        )
    except msgspec.ValidationError as error:
        raise BadSetting(f"synthetic settings must be numbers in their ranges (got {query!r}: {error})") from None
    settings: dict[str, Any] = {key: getattr(checked, key) for key in texts}
    if sample_period is not None:
        settings["sample_period"] = sample_period
    return synthesize(shape, **settings)
