"""Python, JavaScript, and MATLAB or Octave: code that needs nothing but the language."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from kalscope.export.job import (
    ExportJob,
    about,
    about_channel,
    commented,
    fill_sections,
    fill_template,
    start_of,
    step_of,
)
from kalscope.export.names import number_text
from kalscope.export.targets.stages import numbers_of, piece_of, used_pieces
from kalscope.tuning.tuning import ChannelTuning

Values = Mapping[str, float | tuple[float, ...] | None]


def _given(values: Values, mark: str) -> list[str]:
    """The values that are not automatic, as `name=1.0` or `name: [1.0, 2.0]`."""
    return [
        f"{name}{mark}[{', '.join(map(number_text, value))}]"
        if isinstance(value, tuple)
        else f"{name}{mark}{number_text(value)}"
        for name, value in values.items()
        if value is not None
    ]


def _about_one(job: ExportJob, mark: str) -> str:
    return commented((*about(job), *about_channel(job, job.fusion)), mark)


def _entries(job: ExportJob, mark: str, entry: str, made: Callable[[ChannelTuning], str]) -> str:
    """An entry for each channel, with its identifier and its filter, below the comment on it."""
    return "".join(
        commented(about_channel(job, channel), mark) + entry.format(word=word, made=made(channel))
        for word, channel in job.named_channels
    )


# Python: a small class that needs nothing but the language, and the call of Kalscope in a second file.
#
# A hostile name could form an encoding line: the first two lines, where Python looks for one, are constant.


def python_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.py` and `with_kalscope.py`; or `kalscope_fusion.py` and `fusion_with_kalscope.py`."""
    if job.fuses:
        start, each = start_of(job.fusion), job.sensor_values
        files = {
            "kalscope_fusion.py": start | step_of(job.fusion) | each,
            "fusion_with_kalscope.py": start
            | {"momentum": job.fusion.momentum or None}
            | each
            | {"r": job.fusion.r},
        }
        return {
            name: fill_template(
                f"fused/{name}.txt",
                job.marks,
                about=_about_one(job, "#"),
                words=", ".join(job.sensor_identifiers),
                values="".join(f"    {line},\n" for line in _given(values, "=")),
            )
            for name, values in files.items()
        }
    head, entry = commented(about(job), "#"), '    "{word}": {made},\n'
    own = fill_template(
        "python/kalscope_filter.py.txt",
        job.marks,
        heading="noise filters as they were" if job.has_chain else "scalar Kalman noise filter as it was",
        about=head,
        classes=_classes(job),
        filters=_entries(job, "    #", entry, _own),
    )
    kalscope = fill_template(
        f"python/{'chains_with_kalscope' if job.has_chain else 'with_kalscope'}.py.txt",
        about=head,
        filters=_entries(job, "    #", entry, partial(_for_kalscope, job)),
        names=_names(job),
    )
    return {"kalscope_filter.py": own, "with_kalscope.py": kalscope}


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


def _own(channel: ChannelTuning) -> str:
    """The filter of a channel by the classes of the file itself."""
    chain = channel.chain
    if chain is None or chain.then is None:
        last = f"KalmanFilter({', '.join(_given(start_of(channel) | step_of(channel), '='))})"
    else:
        numbers = ", ".join(f"{name}={value!r}" for name, value in numbers_of(chain.then).items())
        last = f"{piece_of(channel).title().replace('_', '')}({numbers})"
    return last if chain is None or chain.median == 1 else f"Chain(Median({chain.median}), {last})"


def _for_kalscope(job: ExportJob, channel: ChannelTuning) -> str:
    """The parameters of its Kalman filter for Kalscope, or the tuning of a channel beside one with a chain."""
    given = ", ".join(_given(start_of(channel) | {"momentum": channel.momentum or None}, "="))
    if not job.has_chain:
        return f"kalscope.FilterParams({given})"
    return f'ChannelTuning("", "", {given}{"" if channel.chain is None else f", chain={channel.chain!r}"})'


# JavaScript: an ES module with a small class that needs nothing but the language.


def javascript_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.mjs`, or `kalscope_fusion.mjs`."""

    def made(channel: ChannelTuning) -> str:
        return ", ".join(_given(start_of(channel) | step_of(channel), ": "))

    if job.fuses:
        given = _given(start_of(job.fusion) | step_of(job.fusion) | job.sensor_values, ": ")
        text = fill_template(
            "fused/kalscope_fusion.mjs",
            job.marks,
            about=_about_one(job, "//"),
            words=", ".join(job.sensor_identifiers),
            values="".join(f"  {line},\n" for line in given),
        )
        return {"kalscope_fusion.mjs": text}

    text = fill_template(
        "kalscope_filter.mjs",
        job.marks,
        about=commented(about(job), "//"),
        first=job.identifiers[0],
        filters=_entries(job, "  //", "  {word}: new KalmanFilter({{ {made} }}),\n", made),
    )
    return {"kalscope_filter.mjs": text}


# MATLAB and Octave: one script a channel, or of a fusion, in the style of Ma'arif et al. (2019).


def matlab_files(job: ExportJob) -> dict[str, str]:
    """`kalman_IDENTIFIER.m` for each channel, as a workspace has one filter; or `kalman_fusion_IDENTIFIER.m`."""
    template, prefix = ("fused/kalman_fusion.m", "fusion_") if job.fuses else ("kalman_channel.m", "")
    files: dict[str, str] = {}
    for word, one in job.named_channels:
        alone, unset = replace(job, channels=(one,)), {"p0": "Inf", "x0": "NaN", "gate": "Inf"}
        values = (start_of(one) | step_of(one)).items()
        texts = {name: number_text(value, unset.get(name, "")) for name, value in values}
        if job.fuses:
            texts |= {name: ", ".join(map(number_text, each)) for name, each in job.sensor_values.items()}
        files[f"kalman_{prefix}{word}.m"] = fill_template(
            template, alone.marks, about=_about_one(alone, "%"), **texts
        )
    return files
