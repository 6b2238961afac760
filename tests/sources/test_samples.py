import importlib.util
from pathlib import Path

import pytest

from kalscope.catalogue import open_source
from kalscope.sources.samples import list_samples, sample_data_dir

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


def test_nile_is_the_published_series():
    recording = open_source("sample:nile")
    volume = recording.channel("volume")
    # Durbin and Koopman (2012): 100 years from 1871; statistics of the series as R prints them.
    assert (len(volume), volume[0], volume[-1], volume.min(), volume.max()) == (100, 1120, 740, 456, 1370)
    assert volume.mean() == pytest.approx(919.35)
    assert volume.std(ddof=1) == pytest.approx(169.227501)
    assert recording.units == ("1e8 m3",)
