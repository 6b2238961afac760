import hashlib

import numpy as np
import pytest

from kalscope.catalogue import open_source
from kalscope.errors import BadFile, BadSetting
from kalscope.sources.samples import list_samples, sample_data_dir
from kalscope.sources.synthetic import synthesize


@pytest.mark.slow
def test_samples_have_their_title_source_and_bytes_and_the_demo_is_the_first():
    for sample in list_samples():
        recording = open_source(f"sample:{sample.name}")
        assert (recording.title, recording.source) == (sample.title, f"sample:{sample.name}")
        content = (sample_data_dir() / f"{sample.name}.csv").read_bytes()
        assert recording.sha256 == hashlib.sha256(content).hexdigest()
    assert open_source("demo").sha256 == open_source(f"sample:{list_samples()[0].name}").sha256


def test_all_settings_of_a_synthetic_signal_can_be_said():
    numbers = "n=7&sample_period=0.5&channels=2&amplitude=2&level=-1&period=3&sigma=1.5&outliers=0.1&outlier_size=9"
    settings = {key: float(value) for key, _, value in (one.partition("=") for one in numbers.split("&"))}
    settings |= {"n": 7, "channels": 2}
    others = {"noise": "uniform", "quantum": 0.25, "drop_outs": 0.2, "limits": (-5.0, 5.0), "seed": 3}
    spec = f"synthetic:ramp?{numbers}&noise=uniform&quantum=0.25&drop_outs=0.2&limits=-5,5&seed=3"
    np.testing.assert_array_equal(open_source(spec).values, synthesize("ramp", **settings, **others).values)


SETTINGS = "volume=11 n=many n=1.5 sigma=-1 n=1&n=2 n sigma=nan limits=1 shape=ramp"
REFUSED = [
    ("serial:/dev/ttyACM0@9600 serial:COM3 socket://host:1 https://a.b/c.csv loop:// file:///x", "must be a file"),
    (r"C:\x.csv C:/x.csv none.csv a:b.csv", "file not found"),
    ("sample:none sample:../pyproject sample:", "sample must be one of.*nile"),
    (" ".join(f"synthetic:sine?{setting}" for setting in SETTINGS.split()), "must"),
]


@pytest.mark.parametrize(("sources", "says"), REFUSED)
def test_what_is_no_recording_is_refused_by_what_it_looks_like(sources, says):
    for source in sources.split():
        with pytest.raises(BadFile if says == "file not found" else BadSetting, match=says):
            open_source(source)
