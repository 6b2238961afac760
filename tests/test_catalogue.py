import hashlib

import numpy as np
import pytest
from each import each

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


def test_an_unknown_sample_is_refused_with_the_choices():
    for name in ("none", "../pyproject", ""):
        with pytest.raises(BadSetting, match=r"sample must be one of.*nile"):
            open_source(f"sample:{name}")


def test_all_settings_of_a_synthetic_signal_can_be_said():
    spec = (
        "synthetic:ramp?n=7&sample_period=0.5&channels=2&amplitude=2&level=-1&period=3&noise=uniform&sigma=1.5"
        "&outliers=0.1&outlier_size=9&quantum=0.25&drop_outs=0.2&limits=-5,5&seed=3"
    )
    expected = synthesize(
        "ramp",
        n=7,
        sample_period=0.5,
        channels=2,
        amplitude=2.0,
        level=-1.0,
        period=3.0,
        noise="uniform",
        sigma=1.5,
        outliers=0.1,
        outlier_size=9.0,
        quantum=0.25,
        drop_outs=0.2,
        limits=(-5.0, 5.0),
        seed=3,
    )
    np.testing.assert_array_equal(open_source(spec).values, expected.values)


def test_a_given_sample_period_reaches_file_and_signal(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a\n1\n5\n2\n")
    assert open_source(str(path), sample_period=0.25).sample_period == 0.25
    assert open_source("synthetic:sine?n=3", sample_period=0.25).sample_period == 0.25


@each(
    "query",
    ["volume=11", "n=many", "n=1.5", "sigma=-1", "n=1&n=2", "n", "sigma=nan", "limits=1", "shape=ramp"],
)
def test_a_bad_synthetic_setting_is_refused(query):
    with pytest.raises(BadSetting, match="must"):
        open_source(f"synthetic:sine?{query}")


@each(
    "spec",
    [
        "serial:/dev/ttyACM0@9600",
        "serial:COM3",
        "socket://host:1",
        "https://a.b/c.csv",
        "loop://",
        "file:///x",
    ],
)
def test_live_sources_and_addresses_are_no_files(spec):
    with pytest.raises(BadSetting, match="must be a file"):
        open_source(spec)


@pytest.mark.parametrize("spec", ["", "  "])
def test_nothing_is_no_source(spec):
    with pytest.raises(BadSetting, match="source must be"):
        open_source(spec)


@each("spec", [r"C:\x.csv", "C:/x.csv", "none.csv", "a:b.csv"])
def test_all_else_is_a_path(spec):
    with pytest.raises(BadFile, match="file not found"):
        open_source(spec)
