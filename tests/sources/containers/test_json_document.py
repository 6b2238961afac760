"""JSON documents: one value that holds all samples."""

import json

import numpy as np
import pytest

from kalscope.common import files
from kalscope.errors import BadFile, BadSetting, NoMemory

X = [round(0.5 * i, 3) for i in range(12)]


@pytest.fixture
def read_json(read):
    def read_document(document, part=None, **how):
        return read(document if isinstance(document, str) else json.dumps(document, **how), "log.json", part=part)

    return read_document


@pytest.mark.parametrize("how", [{}, {"indent": 2}])
def test_a_list_of_objects(read_json, how):
    recording = read_json([{"t": i * 0.1, "imu": {"x": x}, "who": "me"} for i, x in enumerate(X)], **how)
    assert recording.names == ("imu.x",)
    np.testing.assert_array_equal(recording.values[:, 0], X)
    assert recording.sample_period == pytest.approx(0.1)


def test_the_pairs_of_prometheus(read_json):
    result = [
        {
            "metric": {"__name__": "temp", "host": host},
            "values": [[1.7e9 + 15 * i, str(x)] for i, x in enumerate(X)],
        }
        for host in ("a", "b")
    ]
    recording = read_json({"status": "success", "data": {"resultType": "matrix", "result": result}})
    assert (recording.names, recording.sample_period) == (("temp a", "temp b"), 15.0)
    np.testing.assert_array_equal(recording.values[:, 1], X)


def test_the_longest_list_is_read_and_another_by_name(read_json):
    document = {"a": [{"t": 0, "x": 1}, {"t": 1, "x": 2}], "b": {"c": [{"t": i, "y": x} for i, x in enumerate(X)]}}
    assert read_json(document).names == ("y",)
    assert read_json(document, "a").names == ("x",)
    with pytest.raises(BadSetting, match=r'"b\.c"'):
        read_json(document, "d")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '[{"a": 1}, {"a"', "{}", '{"a": 5}', "[]", '[{"a": "b"}]', "[1, 2", '{"']
)
def test_a_document_without_samples_is_refused(read_json, text):
    with pytest.raises(BadFile):
        read_json(text)


def test_a_document_that_will_not_fit_into_memory_is_refused_before_it_is_parsed(read_json, monkeypatch):
    document = [{"t": i, "x": x} for i, x in enumerate(X)]
    monkeypatch.setattr(files, "free_memory", lambda: 10_000)
    assert len(read_json(document)) == len(X)
    monkeypatch.setattr(files, "free_memory", lambda: 4_000)
    with pytest.raises(NoMemory, match=r"^log.json must fit into the memory that is free.*one object per line$"):
        read_json(document)
