"""Parameters without code: JSON, a parameter file of ROS 2, and compiler flags of PlatformIO."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Any

from kalscope.errors import BadSetting
from kalscope.export.float32 import runs_kalman
from kalscope.export.job import ExportJob, about, about_channel, ascii_squared, commented, fill_template, step_of
from kalscope.export.names import comment_text, number_text, quoted
from kalscope.export.targets.stages import numbers_of
from kalscope.filtering.classic import Chain
from kalscope.filtering.steady import SteadyState
from kalscope.tuning.toml_text import plain_chain
from kalscope.tuning.tuning import ChannelTuning

# JSON: the parameters for your own program. JSON has no comments, so the words are values.


FORMAT, CHAIN_FORMAT, FUSION_FORMAT = "kalscope-parameters-1", "kalscope-parameters-2", "kalscope-fusion-1"
"""Name and number of each layout; the second one where any channel has a chain."""


def json_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_parameters.json`; names are whole, in escapes."""
    head = _head(job, CHAIN_FORMAT if job.has_chain else FORMAT)
    document = {**head, "channels": [_channel(job, *named) for named in job.named_channels]}
    return {"kalscope_parameters.json": _text(document)}


def json_fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.json`; names are whole, in escapes."""
    fusion, steady = job.fusion, job.steady(job.fusion)
    shares = fusion.params.shares.tolist()
    values = zip(fusion.sensors, job.sensor_identifiers, fusion.r, fusion.offset, fusion.gain, shares, strict=True)
    fused = {
        "name": _clean(fusion.name),
        "identifier": job.identifiers[-1],
        "unit": _clean(fusion.unit),
        "unit_of_variances": ascii_squared(fusion.unit),
        "process_noise_q": fusion.q,
        **_start(fusion),
        **({"momentum": _momentum(steady, fusion)} if job.has_momentum else {}),
        "found": _clean(fusion.how),
        "steady_gain": steady.gain,
        "lag_samples": steady.lag_samples if fusion.q > 0.0 else None,
        "about": list(about_channel(job, job.fusion)),
    }
    sensors = [
        {"name": _clean(name), "identifier": word, "measurement_noise_r": r, "offset": b, "gain": c, "share": share}
        for name, word, r, b, c, share in values
    ]
    return {"kalscope_fusion.json": _text({**_head(job, FUSION_FORMAT), "fusion": fused, "sensors": sensors})}


def _head(job: ExportJob, layout: str) -> dict[str, Any]:
    return {
        "format": layout,
        "about": list(about(job)),
        "sample_period_s": job.sample_period,
        "recording": {"name": _clean(job.source_name), "sha256": _clean(job.sha256)},
        "tool": _clean(job.tool),
        "date": _clean(job.date),
    }


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _start(one: ChannelTuning) -> dict[str, float | None]:
    return {"start_variance_p0": one.p0, "start_value_x0": one.x0, "outlier_gate": one.gate}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> dict[str, Any]:
    """One channel; a null is an automatic start or a gate that is off."""
    return {
        "name": _clean(channel.name),
        "identifier": word,
        "unit": _clean(channel.unit),
        **({} if channel.chain is None else {"chain": _chain(channel.chain)}),
        **(_kalman(job, channel) if runs_kalman(channel) else {}),
        "about": list(about_channel(job, channel)),
    }


def _kalman(job: ExportJob, channel: ChannelTuning) -> dict[str, Any]:
    steady = job.steady(channel)
    return {
        "unit_of_variances": ascii_squared(channel.unit),
        "process_noise_q": channel.q,
        "measurement_noise_r": channel.r,
        **_start(channel),
        **({"momentum": _momentum(steady, channel)} if channel.momentum > 0.0 else {}),
        "found": _clean(channel.how),
        "steady_gain": steady.gain,
        "lag_samples": steady.lag_samples if channel.q > 0.0 else None,  # JSON has no infinity
    }


def _chain(chain: Chain) -> dict[str, Any]:
    """The window of the median, 1 for none, then the filter, its settings, and what it computes with."""
    known = {name: value for name, value in (plain_chain(chain) or {}).items() if value is not None}
    return {"words": chain.words, "median": 1, **known, **({} if chain.then is None else numbers_of(chain.then))}


def _momentum(steady: SteadyState, channel: ChannelTuning) -> dict[str, Any]:
    """How long the signal keeps its direction, and the constants of one sample period that follow."""
    constants = step_of(channel)
    return {
        "tau_samples": constants.pop("momentum"),
        **constants,
        "velocity_gain": steady.velocity_gain,
        "overshoot": steady.overshoot,
    }


def _clean(text: str) -> str:
    return text.encode("utf-8", "replace").decode()


# ROS 2: a parameter file, written by hand because each value's type must be unambiguous to its reader.
#
# rcl's parser (rcl_yaml_param_parser/src/parse.c) takes `1` for an integer, on which a node that declared a
# double stops; and what strtod reports as out of range, subnormal numbers too, for a text.


_CHANNEL = """\
{about}      {word}:
        name: {name}
        process_noise_q: {q}
        measurement_noise_r: {r}
{rest}"""


def ros2_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_parameters.yaml`.

    Raises:
        BadSetting: A number is too small for the parser.
    """
    text = fill_template(
        "kalscope_parameters.yaml",
        about=commented(about(job), "#"),
        period=_period(job),
        names=", ".join(map(quoted, job.identifiers)),
        channels="".join(_ros2_channel(job, *named) for named in job.named_channels),
    )
    return {"kalscope_parameters.yaml": text}


def ros2_fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.yaml`; errors as `ros2_files`."""
    fusion = job.fusion
    values = zip(fusion.sensors, job.sensor_identifiers, fusion.r, fusion.offset, fusion.gain, strict=True)
    fused = {"name": quoted(comment_text(fusion.name)), "process_noise_q": _number(fusion.q)}
    lines = [*(f"        {name}: {value}\n" for name, value in fused.items()), *_rest(fusion)]
    text = fill_template(
        "fused/kalscope_fusion.yaml",
        about=commented((*about(job), *about_channel(job, job.fusion)), "#"),
        period=_period(job),
        fusion="".join(("      fused:\n", *lines)),
        names=", ".join(map(quoted, job.sensor_identifiers)),
        sensors="".join(
            f"      sensor_{word}:\n"
            f"        name: {quoted(comment_text(name))}\n"
            f"        measurement_noise_r: {_number(r)}\n"
            f"        offset: {_number(offset)}\n"
            f"        gain: {_number(gain)}\n"
            for name, word, r, offset, gain in values
        ),
    )
    return {"kalscope_fusion.yaml": text}


def _period(job: ExportJob) -> str:
    return "" if job.sample_period is None else f"      sample_period: {_number(job.sample_period)}\n"


def _ros2_channel(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    return _CHANNEL.format(
        about=commented(about_channel(job, channel), "      #"),
        word=f"channel_{word}",  # so that no channel's name equals a key of the level above
        name=quoted(comment_text(channel.name)),  # harmless: launch files may substitute "$(…)"
        q=_number(channel.q),
        r=_number(channel.r),
        rest="".join(_rest(channel)),
    )


def _rest(one: ChannelTuning) -> Iterator[str]:
    """A parameter cannot be null or unset: a bool says what is automatic, and the number is left out."""
    known = {
        "start_variance_known": ("start_variance_p0", one.p0),
        "start_value_known": ("start_value_x0", one.x0),
        "outlier_gate_on": ("outlier_gate", one.gate),
    }
    for switch, (name, value) in known.items():
        yield f"        {switch}: {'false' if value is None else 'true'}\n"
        if value is not None:
            yield f"        {name}: {_number(value)}\n"
    for name, value in step_of(one).items():
        yield f"        {name if name == 'momentum' else f'momentum_{name}'}: {_number(value)}\n"


def _number(value: float) -> str:
    if 0.0 < abs(value) < sys.float_info.min:
        raise BadSetting(
            f"numbers for ROS 2 must be 0 or at least {sys.float_info.min:.3g} (got {value!r}: its parser takes"
            " smaller ones for texts)"
        )
    return number_text(value)


# PlatformIO: compiler flags in a file of their own, so that platformio.ini stays as it is.


def platformio_files(job: ExportJob) -> dict[str, str]:
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
