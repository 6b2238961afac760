"""PlatformIO: compiler flags in a file of their own, so that platformio.ini stays as it is."""

from __future__ import annotations

from collections.abc import Iterator

from kalscope.export.header_text import about, about_channel, commented, fill_template
from kalscope.export.job import ExportJob, step_of
from kalscope.export.names import number_text


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_flags.ini`: KALSCOPE_IDENTIFIER_Q and the others, double literals that suit float as well."""
    channels = (line for channel in job.channels for line in about_channel(job, channel))
    flags = "".join(f"    -D {name}={number_text(value)}\n" for name, value in _macros(job))
    head = commented((*about(job), *channels), ";")
    text = fill_template("kalscope_flags.ini", about=head, flags=flags)
    return {"kalscope_flags.ini": text}


def _macros(job: ExportJob) -> Iterator[tuple[str, float]]:
    if job.sample_period is not None:
        yield "KALSCOPE_SAMPLE_PERIOD_S", job.sample_period
    for word, channel in job.named_channels:
        for name in ("q", "r", "p0", "x0", "gate"):
            value = getattr(channel, name)
            if value is not None:
                yield f"KALSCOPE_{word}_{name}".upper(), value
        for name, value in step_of(channel).items():
            yield f"KALSCOPE_{word}_{name}".upper(), value
