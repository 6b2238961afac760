"""Every real recording within reach: an estimate or a verdict in words, never an exception, never NaN."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from effort import FUZZ

from kalscope import KalscopeError, read_recording
from kalscope.estimation.fit import METHODS, estimate
from kalscope.estimation.result import USABLE

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[3] / "shared" / "data"
MAX_SAMPLES, MAX_BYTES = (400, 30_000) if FUZZ == 1 else (20_000, 10_000_000)
"""What is looked at of a recording, and read of a text: a longer part takes longer and shows nothing else."""
FILES = sorted(p for p in DATA.rglob("*") if p.is_file() and p.name != "README.md")


@pytest.mark.skipif(not FILES, reason="the shared recordings are not here")
@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_every_channel_gets_an_estimate_or_a_verdict_in_words(path, tmp_path):
    values, refusal = read(beginning(path, tmp_path))
    if values is None:  # not every file is a table of numbers; then that is said
        assert path.name in refusal
        return
    values = values[:MAX_SAMPLES]
    for method in METHODS:
        for z in values.T:
            judge(estimate(z, method, momentum=0.0))
    judge(estimate(values[:, values.shape[1] // 2]))  # with momentum, which takes ten times as long


def beginning(path, folder):
    """A text without its later lines, which take long to read; whatever else as it is."""
    if (data := path.read_bytes()).count(0) or len(data) <= MAX_BYTES:
        return path
    (short := folder / path.name).write_bytes(data[: data.rindex(b"\n", 0, MAX_BYTES) + 1])
    return short


def read(path):
    try:
        return read_recording(path).values, ""
    except KalscopeError as refusal:
        return None, str(refusal)


def judge(found):
    for f in fields(found):
        value = getattr(found, f.name)
        if not isinstance(value, str) and value is not None and f.name != "params":
            assert not np.isnan(value).any(), f.name
    assert len(found.message) > 40
    assert found.message.endswith(".")
    usable = found.verdict in USABLE
    assert usable == (found.params is not None)
    if usable:
        assert found.q > 0
        assert found.r > 0
