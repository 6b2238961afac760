"""Python, JavaScript, and MATLAB or Octave: code that needs nothing but the language."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

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
from kalscope.export.targets.c import numbers_of, piece_of, two_speeds_of, used_pieces
from kalscope.filtering.classic import Notch, Stage
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


def _script(
    job: ExportJob,
    ending: str,
    mark: str,
    equals: str,
    entry: str,
    made: Callable[[ChannelTuning], str],
    **texts: str,
) -> dict[str, str]:
    """`kalscope_filter` or `kalscope_fusion` in one of the languages.

    Args:
        job: The filters, or a fusion.
        ending: Of the file and its template.
        mark: Begins a comment.
        equals: Between the name and the value of an argument.
        entry: Of one channel, with its identifier `word` and its filter, `made`.
        made: The filter of a channel.
        texts: More for the template of the filters.
    """
    indent = entry[: -len(entry.lstrip())]
    if job.fuses:
        given = _given(start_of(job.fusion) | step_of(job.fusion) | job.sensor_values, equals)
        name, texts = (
            f"kalscope_fusion.{ending}",
            {
                "about": _about_one(job, mark),
                "words": ", ".join(job.sensor_identifiers),
                "values": "".join(f"{indent}{line},\n" for line in given),
            },
        )
    else:
        filters = (
            commented(about_channel(job, channel), indent + mark) + entry.format(word=word, made=made(channel))
            for word, channel in job.named_channels
        )
        name = f"kalscope_filter.{ending}"
        texts |= {"about": commented(about(job), mark), "filters": "".join(filters), "first": job.identifiers[0]}
    return {name: fill_template(f"{name}.txt", job.marks, **texts)}


def python_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.py`, or `kalscope_fusion.py`: a small class that needs nothing but the language.

    A hostile name could form an encoding line: the first two lines, where Python looks for one, are constant.
    """
    sections, used = fill_sections("stages.py.txt", job.marks, **two_speeds_of(repr)), used_pieces(job)
    if first := [name for name in ("median", "notch") if name in job.marks]:
        used = (*dict.fromkeys((*used, *first)), "chain")
    return _script(
        job,
        "py",
        "#",
        "=",
        '    "{word}": {made},\n',
        _in_python,
        heading="noise filters as they were" if job.has_kinds else "scalar Kalman noise filter as it was",
        classes="".join(sections[name] for name in used).lstrip("\n"),
    )


def _in_python(channel: ChannelTuning) -> str:
    chain = channel.chain
    if chain is None or chain.then is None:
        kind = "KalmanFilter" if channel.fast is None else "TwoSpeeds"
        last = f"{kind}({', '.join(_given(start_of(channel) | step_of(channel), '='))})"
    else:
        last = f"{piece_of(channel).title().replace('_', '')}({_numbers(chain.then)})"
    for stage in reversed(() if chain is None else chain.first):
        last = f"Chain({stage.name}({_numbers(stage)}), {last})"
    return last


def _numbers(stage: Stage | Notch) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in numbers_of(stage).items())


def javascript_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.mjs`, or `kalscope_fusion.mjs`: an ES module with a small class."""

    def made(channel: ChannelTuning) -> str:
        kind = "KalmanFilter" if channel.fast is None else "TwoSpeeds"
        return f"new {kind}({{ {', '.join(_given(start_of(channel) | step_of(channel), ': '))} }})"

    return _script(job, "mjs", "//", ": ", "  {word}: {made},\n", made, **two_speeds_of(repr))


def matlab_files(job: ExportJob) -> dict[str, str]:
    """`kalman_IDENTIFIER.m` for each channel, as a workspace has one filter; or `kalman_fusion_IDENTIFIER.m`.

    For MATLAB and Octave, in the style of Ma'arif et al. (2019).
    """
    prefix, files = "kalman_fusion" if job.fuses else "kalman", dict[str, str]()
    for word, one in job.named_channels:
        alone, unset = replace(job, channels=(one,)), {"p0": "Inf", "x0": "NaN", "gate": "Inf"}
        values = (start_of(one) | step_of(one)).items()
        texts = {name: number_text(value, unset.get(name, "")) for name, value in values}
        if job.fuses:
            texts |= {name: ", ".join(map(number_text, each)) for name, each in job.sensor_values.items()}
        texts |= two_speeds_of(repr)
        template = "kalman_fusion.m" if job.fuses else "kalman_channel.m"
        template = template if one.fast is None else "two_speeds.m"
        files[f"{prefix}_{word}.m"] = fill_template(template, alone.marks, about=_about_one(alone, "%"), **texts)
    return files
