"""The recordings of sample_data: list them, open one by its name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from kalscope.errors import BadFile, BadSetting
from kalscope.recording import Recording
from kalscope.sources.reading.recording_file import read_recording

DEMO = "flex_finger"
"""The sample that "demo" opens: the lag of the first filter and the noise left by a faster one are both visible."""


@dataclass(frozen=True)
class Sample:
    """One recording of sample_data."""

    name: str
    """What follows "sample:"."""
    title: str
    """Heading of its note."""
    made: str
    """"re-creation" of an experiment, "simulated", or "" where its numbers were published."""


def sample_data_dir() -> Path:
    """The folder of the samples: beside the installed package, or at the top of a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "sample_data", package.parents[1] / "sample_data"):
        if folder.is_dir():
            return folder
    raise BadFile(f"the sample recordings are not installed: no folder sample_data beside {package}")


def list_samples() -> list[Sample]:
    """All samples by name, the demo first."""
    samples = [_describe(path) for path in sorted(sample_data_dir().glob("*.csv"))]
    return sorted(samples, key=lambda sample: sample.name != DEMO)


def _describe(path: Path) -> Sample:
    note = path.with_suffix(".md")
    text = note.read_text(encoding="utf-8").strip() if note.is_file() else path.stem
    made = "re-creation" if "**re-creation" in text else "simulated" if "make.py" in text else ""
    return Sample(path.stem, text.partition("\n")[0].lstrip("# ").rstrip(), made)


def open_sample(name: str, sample_period: float | None = None) -> Recording:
    """Open the sample of this name; BadSetting where there is none."""
    samples = {sample.name: sample for sample in list_samples()}
    if name not in samples:
        raise BadSetting(f"sample must be one of {', '.join(samples)} (got {name!r})")
    recording = read_recording(sample_data_dir() / f"{name}.csv", sample_period=sample_period)
    return replace(recording, source=f"sample:{name}", title=samples[name].title)
