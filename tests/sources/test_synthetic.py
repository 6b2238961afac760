"""Made signals and sample data: what was asked for, the same each time."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.catalogue import open_source
from kalscope.errors import BadSetting
from kalscope.sources.samples import list_samples, sample_data_dir
from kalscope.sources.synthetic import NOISES, SHAPES, SignalSettings, synthesize


# Kurtosis of each law: 3 (normal), 9/5 (uniform), 12/5 (triangular).
@pytest.mark.parametrize(("noise", "kurtosis"), [("gaussian", 3.0), ("uniform", 1.8), ("triangular", 2.4)])
def test_noise_has_the_law_and_the_sigma_asked_for(noise, kurtosis):
    recording = synthesize("constant", n=200_000, noise=noise, sigma=2.5)
    errors = recording.values - recording.truth
    assert errors.mean() == pytest.approx(0, abs=4 * 2.5 / math.sqrt(200_000))
    assert errors.std() == pytest.approx(2.5, rel=0.01)
    assert (errors**4).mean() / errors.var() ** 2 == pytest.approx(kurtosis, rel=0.02)


def test_truths_follow_their_formulas():
    given = {"n": 400, "sample_period": 0.1, "period": 8.0, "amplitude": 3.0, "level": 1.0}
    time = np.arange(400) * 0.1
    truth = {shape: synthesize(shape, **given).truth[:, 0] for shape in SHAPES}
    np.testing.assert_allclose(truth["constant"], 1.0)
    np.testing.assert_allclose(truth["step"], np.where(time / 8 >= 1, 4.0, 1.0))
    np.testing.assert_allclose(truth["ramp"], 1 + 3 * time / 8)
    np.testing.assert_allclose(truth["sine"], 1 + 3 * np.sin(2 * np.pi * time / 8), atol=1e-9)
    assert (truth["triangle"].min(), truth["triangle"].max()) == pytest.approx((-2.0, 4.0))
    np.testing.assert_allclose(np.abs(np.diff(truth["triangle"])), 4 * 3 * 0.1 / 8)
    assert truth["random_walk"][0] == 1.0


def test_faults_come_as_often_as_asked():
    recording = synthesize("constant", n=20000, noise="none", outliers=0.1, outlier_size=7.0, drop_outs=0.2)
    values = recording.values[:, 0]
    lost = np.isnan(values)
    assert lost.mean() == pytest.approx(0.2, abs=0.015)
    assert set(np.unique(values[~lost])) == {-7.0, 0.0, 7.0}
    assert (values[~lost] != 0).mean() == pytest.approx(0.1, abs=0.01)


BAD = [
    *({"n": n} for n in (0, 1.5, True, 10**9)), *({"sample_period": value} for value in (0.0, math.nan)),
    *({"channels": count} for count in (0, 17)), *({"amplitude": value} for value in (math.inf, "1")),
    *({"limits": limits} for limits in (5.0, (1.0,), (1.0, 1.0), (0.0, math.nan))),
    *({"noise": "pink"}, {"sigma": -1.0}, {"outliers": 1.1}, {"volume": 11}),
]  # fmt: skip


@pytest.mark.parametrize("settings", BAD, ids=str)
def test_a_bad_setting_is_refused_and_named(settings):
    with pytest.raises(BadSetting, match=rf"(?=.*{next(iter(settings))}).*must (be|rise).*got"):
        synthesize("sine", **settings)


def test_several_sensors_of_one_signal_share_its_truth():
    offsets = (0.0, 5.0, -2.0)
    recording = synthesize("random_walk", n=50_000, sigmas=(0.5, 1, 2), offsets=offsets, every=(1, 1, 5), seed=2)
    assert recording.names == ("a", "b", "c")
    np.testing.assert_array_equal(recording.truth, recording.truth[:, :1].repeat(3, axis=1))
    error = recording.values - recording.truth
    np.testing.assert_array_equal(np.isnan(error), (np.arange(50_000)[:, None] % [1, 1, 5]) != 0)
    np.testing.assert_allclose(np.nanstd(error, axis=0), [0.5, 1.0, 2.0], rtol=0.03)
    np.testing.assert_allclose(np.nanmean(error, axis=0), offsets, atol=0.08)
    noise = (error - offsets)[::5]
    assert abs(np.corrcoef(noise.T)[np.triu_indices(3, 1)]).max() < 4 / math.sqrt(len(noise))


@pytest.mark.parametrize(("wrong", "must"), [
    ({"sigmas": ()}, "sigmas must be 1 to 16 numbers, one per sensor"),
    ({"sigmas": (1.0, -1.0)}, "sigmas must be a number from 0"),
    ({"sigmas": (1.0, 1.0), "channels": 2}, "channels must be left out"),
    ({"sigmas": (1.0, 1.0), "offsets": (1.0,)}, "offsets must have a number for each of sigmas"),
    ({"every": (1.0, 2.0)}, "every must have a number for each of sigmas, None"),
    ({"sigmas": (1.0, 1.0), "every": (1.0, 2.5)}, "every must be a whole number from 1"),
    ({"sigmas": (1.0, 1.0), "every": (0.0, 2)}, "every must be a whole number from 1"),
    ({"sigmas": (1.0,) * 16, "n": 5_000_000}, r"n \* channels must be at most 50000000"),
])  # fmt: skip
def test_sensors_that_contradict_each_other_are_refused(wrong, must):
    with pytest.raises(BadSetting, match=must):
        synthesize("sine", **wrong)


REAL, TIME, SIZE, SHARE = st.floats(-1e50, 1e50), st.floats(1e-50, 1e50), st.floats(0, 1e50), st.floats(0, 1)
SETTINGS = {
    "shape": st.sampled_from(SHAPES), "noise": st.sampled_from(NOISES), "seed": st.integers(0, 2**63 - 1),
    "n": st.integers(1, 40), "channels": st.integers(1, 16), "sample_period": TIME, "period": TIME,
    "amplitude": REAL, "level": REAL, "sigma": SIZE, "outliers": SHARE, "outlier_size": SIZE, "quantum": SIZE,
    "drop_outs": SHARE, "limits": st.none() | st.tuples(st.floats(-1e50, -1), SIZE),
}  # fmt: skip


@pytest.mark.slow
@given(st.builds(SignalSettings, **SETTINGS), st.integers(0, 4))
def test_every_valid_setting_gives_finite_numbers_and_reopens_from_its_source(chosen, sensors):
    if sensors:
        each = {name: (value,) * sensors for name, value in (("sigmas", chosen.sigma), ("offsets", chosen.level))}
        chosen = replace(chosen, channels=1, every=(2.0,) * sensors, **each)
    recording = synthesize(chosen)
    assert np.isfinite(recording.truth).all()
    assert not np.isinf(recording.values).any()
    again = open_source(recording.source)
    assert again.source == recording.source
    np.testing.assert_array_equal(again.values, recording.values)


FOLDER = Path(__file__).parents[2] / "sample_data"
NAMES = sorted(path.stem for path in FOLDER.glob("*.csv"))


def _maker():
    spec = importlib.util.spec_from_file_location("make", FOLDER / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_script_makes_every_sample_again_bit_for_bit(tmp_path):
    maker = _maker()
    maker.make(tmp_path)
    made = {path.stem: path.read_bytes() for path in tmp_path.iterdir()}
    assert sorted(made) == sorted(set(NAMES) - {"nile"})
    for name, content in made.items():
        assert content == (FOLDER / f"{name}.csv").read_bytes(), name


def test_the_list_is_the_folder():
    assert sample_data_dir() == FOLDER
    assert sorted(sample.name for sample in list_samples()) == NAMES
    assert len(NAMES) >= 6
