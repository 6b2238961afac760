import hashlib

import numpy as np
import pytest

from kalscope.catalogue import open_source
from kalscope.errors import BadFile, BadSetting
from kalscope.sources.samples import DEMO, list_samples, sample_data_dir
from kalscope.sources.synthetic import synthesize


def test_demo_is_the_first_sample():
    assert list_samples()[0].name == DEMO
    np.testing.assert_array_equal(open_source("demo").values, open_source(f"sample:{DEMO}").values)


@pytest.mark.parametrize("sample", list_samples(), ids=lambda sample: sample.name)
def test_a_sample_knows_its_title_its_source_and_its_bytes(sample):
    recording = open_source(f"sample:{sample.name}")
    assert recording.title == sample.title
    assert recording.source == f"sample:{sample.name}"
    content = (sample_data_dir() / f"{sample.name}.csv").read_bytes()
    assert recording.sha256 == hashlib.sha256(content).hexdigest()


def test_all_settings_of_a_synthetic_signal_can_be_said():
    numbers = "n=7&sample_period=0.5&channels=2&amplitude=2&level=-1&period=3&sigma=1.5&outliers=0.1&outlier_size=9"
    settings = {key: float(value) for key, _, value in (one.partition("=") for one in numbers.split("&"))}
    settings |= {"n": 7, "channels": 2}
    others = {"noise": "uniform", "quantum": 0.25, "drop_outs": 0.2, "limits": (-5.0, 5.0), "seed": 3}
    spec = f"synthetic:ramp?{numbers}&noise=uniform&quantum=0.25&drop_outs=0.2&limits=-5,5&seed=3"
    np.testing.assert_array_equal(open_source(spec).values, synthesize("ramp", **settings, **others).values)


def test_a_given_sample_period_reaches_file_and_signal(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a\n1\n5\n2\n")
    assert open_source(str(path), sample_period=0.25).sample_period == 0.25
    assert open_source("synthetic:sine?n=3", sample_period=0.25).sample_period == 0.25


REFUSED = {
    "must be a file": (
        "serial:/dev/ttyACM0@9600 serial:COM3 socket://host:1 https://a.b/c.csv loop:// file:///x",
        BadSetting,
    ),
    "file not found": (r"C:\x.csv C:/x.csv none.csv a:b.csv", BadFile),
    r"sample must be one of.*nile": ("sample:none sample:../pyproject sample:", BadSetting),
    "must": (
        "synthetic:sine?volume=11 synthetic:sine?n=many synthetic:sine?n=1.5 synthetic:sine?sigma=-1 "
        "synthetic:sine?n=1&n=2 synthetic:sine?n synthetic:sine?sigma=nan synthetic:sine?limits=1 "
        "synthetic:sine?shape=ramp",
        BadSetting,
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_no_recording_is_refused_by_what_it_looks_like(words):
    specs, error = REFUSED[words]
    for spec in specs.split():
        with pytest.raises(error, match=words):
            open_source(spec)
    with pytest.raises(BadSetting, match="source must be"):
        open_source("  ")
