"""Python, JavaScript, and MATLAB or Octave: code that needs nothing but the language."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from kalscope.export.job import ExportJob, about, about_channel, commented, fill_sections, fill_template, step_of
from kalscope.export.names import number_text
from kalscope.export.targets.stages import numbers_of, piece_of, used_pieces
from kalscope.tuning.tuning import ChannelTuning

# Python: a small class that needs nothing but the language, and the call of Kalscope in a second file.


HEADING = "The scalar Kalman noise filter as it was tuned"
"""First line of the file where no channel has a chain."""


def python_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.py` and `with_kalscope.py`.

    A hostile name could form an encoding line: the first two lines, where Python looks for one, are constant.
    """
    head = commented(about(job), "#")
    own = fill_template(
        "python/kalscope_filter.py.txt",
        job.marks,
        heading="The noise filters as they were tuned" if job.has_chain else HEADING,
        about=head,
        classes=_classes(job),
        filters=_entries(job, _own),
    )
    whole = "chains_with_kalscope" if job.has_chain else "with_kalscope"
    kalscope = fill_template(
        f"python/{whole}.py.txt",
        about=head,
        filters=_entries(job, _tuning if job.has_chain else _params),
        **({"names": _names(job)} if job.has_chain else {}),
    )
    return {"kalscope_filter.py": own, "with_kalscope.py": kalscope}


def python_fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.py` and `fusion_with_kalscope.py`, whose first two lines are constant as well."""
    single, each = job.arguments
    own = _lines(single, each)
    constants = step_of(job.fusion).keys() - {"momentum"}
    known = {name: value for name, value in single.items() if name not in constants}
    kalscope = _lines(known, {**each, "r": job.fusion.r})
    return {
        name: fill_template(
            f"fused/{name}.txt",
            job.marks,
            about=commented((*about(job), *about_channel(job, job.fusion)), "#"),
            words=", ".join(job.sensor_identifiers),
            values=values,
        )
        for name, values in (("kalscope_fusion.py", own), ("fusion_with_kalscope.py", kalscope))
    }


def _lines(values: dict[str, float], each: dict[str, tuple[float, ...]]) -> str:
    """Arguments, one a line."""
    listed = {name: f"[{', '.join(map(number_text, numbers))}]" for name, numbers in each.items()}
    single = {name: number_text(value) for name, value in values.items()}
    return "".join(f"    {name}={text},\n" for name, text in (single | listed).items())


def _classes(job: ExportJob) -> str:
    """The code of the filters that the export has."""
    classes, used = fill_sections("python/stages.py.txt", job.marks), used_pieces(job)
    if job.has_median:
        used = (*dict.fromkeys((*used, "median")), "chain")
    return "".join(classes[name] for name in used).lstrip("\n")


def _names(job: ExportJob) -> str:
    """What the export takes from `kalscope.classic`."""
    chains = (channel.chain for channel in job.channels if channel.chain is not None)
    names = {type(chain.then).__name__ for chain in chains if chain.then is not None}
    return ", ".join(sorted(names | {"Chain"}))


def _entries(job: ExportJob, made: Callable[[ChannelTuning], str]) -> str:
    return "".join(
        commented(about_channel(job, channel), "    #") + f'    "{word}": {made(channel)},\n'
        for word, channel in job.named_channels
    )


def _own(channel: ChannelTuning) -> str:
    """The filter of a channel by the classes of the file itself."""
    chain = channel.chain
    if chain is None or chain.then is None:
        last = f"KalmanFilter({_arguments(channel, step_of(channel))})"
    else:
        numbers = ", ".join(f"{name}={value!r}" for name, value in numbers_of(chain.then).items())
        last = f"{piece_of(channel).title().replace('_', '')}({numbers})"
    return last if chain is None or chain.median == 1 else f"Chain(Median({chain.median}), {last})"


def _params(channel: ChannelTuning) -> str:
    """The parameters of its Kalman filter, for Kalscope."""
    return f"kalscope.FilterParams({_of_kalscope(channel)})"


def _tuning(channel: ChannelTuning) -> str:
    """The tuning of a channel with its chain, for Kalscope; its name comes before it."""
    chain = "" if channel.chain is None else f", chain={channel.chain!r}"
    return f'ChannelTuning("", "", {_of_kalscope(channel)}{chain})'


def _of_kalscope(channel: ChannelTuning) -> str:
    return _arguments(channel, {"momentum": channel.momentum} if channel.momentum > 0.0 else {})


def _arguments(channel: ChannelTuning, momentum: dict[str, float]) -> str:
    """The numbers that the tuning gives; a start or a gate that is left out is the automatic one in both."""
    values = {name: getattr(channel, name) for name in ("q", "r", "p0", "x0", "gate")} | momentum
    return ", ".join(f"{name}={number_text(value)}" for name, value in values.items() if value is not None)


# JavaScript: an ES module with a small class that needs nothing but the language.


def javascript_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.mjs`."""
    text = fill_template(
        "kalscope_filter.mjs",
        job.marks,
        about=commented(about(job), "//"),
        first=job.identifiers[0],
        filters="".join(_entry(job, *named) for named in job.named_channels),
    )
    return {"kalscope_filter.mjs": text}


def javascript_fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.mjs`."""
    single, each = job.arguments
    given = {name: number_text(value) for name, value in single.items()}
    given |= {name: f"[{', '.join(map(number_text, numbers))}]" for name, numbers in each.items()}
    text = fill_template(
        "fused/kalscope_fusion.mjs",
        job.marks,
        about=commented((*about(job), *about_channel(job, job.fusion)), "//"),
        words=", ".join(job.sensor_identifiers),
        values="".join(f"  {name}: {value},\n" for name, value in given.items()),
    )
    return {"kalscope_fusion.mjs": text}


def _entry(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    values = {name: getattr(channel, name) for name in ("q", "r", "p0", "x0", "gate")} | step_of(channel)
    given = ", ".join(f"{name}: {number_text(value)}" for name, value in values.items() if value is not None)
    return commented(about_channel(job, channel), "  //") + f"  {word}: new KalmanFilter({{ {given} }}),\n"


# MATLAB and Octave: one script a channel, or of a fusion, in the style of Ma'arif et al. (2019).


def matlab_files(job: ExportJob) -> dict[str, str]:
    """`kalman_IDENTIFIER.m`, one a channel: the workspace of a script has one filter."""
    return {f"kalman_{word}.m": _script(job, channel) for word, channel in job.named_channels}


def _script(whole: ExportJob, channel: ChannelTuning) -> str:
    job = replace(whole, channels=(channel,))
    return fill_template(
        "kalman_channel.m",
        job.marks,
        about=commented((*about(job), *about_channel(job, channel)), "%"),
        r=number_text(channel.r),
        **_values(channel),
    )


def matlab_fused_files(job: ExportJob) -> dict[str, str]:
    """`kalman_fusion_IDENTIFIER.m`."""
    each = {"r": job.noise, "offset": job.fusion.offset, "gain": job.fusion.gain}
    text = fill_template(
        "fused/kalman_fusion.m",
        job.marks,
        about=commented((*about(job), *about_channel(job, job.fusion)), "%"),
        **{name: ", ".join(map(number_text, numbers)) for name, numbers in each.items()},
        **_values(job.fusion),
    )
    return {f"kalman_fusion_{job.identifiers[-1]}.m": text}


def _values(one: ChannelTuning) -> dict[str, str]:
    return {
        "q": number_text(one.q),
        "p0": number_text(one.p0, "Inf"),
        "x0": number_text(one.x0, "NaN"),
        "gate": number_text(one.gate, "Inf"),
        **{name: number_text(value) for name, value in step_of(one).items()},
    }
