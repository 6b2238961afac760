"""Damaged containers: cut short or with wrong bytes they are refused, or still read; nothing else happens."""

import random

import numpy as np
import pytest
from effort import FUZZ
from required import needs

from kalscope.errors import BadFile
from kalscope.sources.reading.recording_file import read_recording

needs("h5py", "nptdms", "openpyxl", "python_calamine", "rosbags", "mcap", "pyulog")

from made_containers import CONTAINERS  # noqa: E402


@pytest.fixture(params=CONTAINERS)
def container(request, tmp_path):
    return CONTAINERS[request.param](tmp_path / request.param)


def read_or_refuse(path, data):
    path.write_bytes(data)
    refusal = None
    try:
        recording = read_recording(path)
    except BadFile as error:
        refusal = str(error)
    if refusal is not None:
        assert "\n" not in refusal
        assert path.name in refusal
    else:
        assert recording.values.shape == (len(recording), len(recording.names))
        assert not np.isinf(recording.values).any()


@pytest.mark.slow
def test_a_container_cut_short_is_refused_or_read(container):
    data = container.read_bytes()
    for cut in {1, 8, 100, *(len(data) * k // 8 for k in range(1, 8)), len(data) - 1}:
        read_or_refuse(container, data[:cut])


@pytest.mark.slow
def test_a_container_with_wrong_bytes_is_refused_or_read(container):
    data, random_bytes = container.read_bytes(), random.Random(7)
    for _ in range(8 * FUZZ):
        damaged = bytearray(data)
        for _ in range(random_bytes.choice((1, 1, 3, 20))):
            # The beginning holds the structure.
            at = random_bytes.randrange(min(len(data), random_bytes.choice((300, len(data)))))
            damaged[at] ^= 1 << random_bytes.randrange(8)
        read_or_refuse(container, bytes(damaged))
