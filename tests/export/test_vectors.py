"""The vector files, and the shared vectors on our own filter."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from kalscope import BadSetting, ChannelTuning, Recording, Tuning, export_tuning, kalman_filter
from kalscope.export.job import job_of
from kalscope.export.registry import MAX_ROWS, vector_files


def read(text, *more):
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[0] == ["time", "raw", "filtered", "gain", *more]
    return np.array([[float(cell) for cell in row] for row in rows[1:]])


def test_the_shared_vectors_hold_all_difficulties(shared):
    z = shared.recording.values
    assert np.isnan(z[0]).any()
    refused = [kalman_filter(z[:, i], channel.params).rejected for i, channel in enumerate(shared.tuning.channels)]
    assert sum(count > 0 for count in refused) >= 2
    assert np.nanmax(np.abs(z)) > 1e140
    assert 0.0 < np.nanmax(np.abs(z[:, shared.recording.index("subnormal")])) < 1e-150


def test_our_filter_answers_as_the_textbook_bit_for_bit(either):
    for i, channel in enumerate(either.tuning.channels):
        result = kalman_filter(either.recording.values[:, i], channel.params)
        np.testing.assert_array_equal(result.x, either.x[:, i], err_msg=channel.name)
        np.testing.assert_array_equal(result.k, either.k[:, i], err_msg=channel.name)


def test_a_vector_file_reads_back_bit_for_bit(either):
    files = vector_files(job_of(either.tuning), either.recording)
    assert len(files) == len(either.names)
    for i, text in enumerate(files.values()):
        channel = either.tuning.channels[i]
        columns = read(text, *(["velocity"] if channel.momentum else []))
        np.testing.assert_array_equal(columns[:, 0], either.recording.time)
        np.testing.assert_array_equal(columns[:, 1], either.recording.values[:, i])
        np.testing.assert_array_equal(columns[:, 2], either.x[:, i])
        np.testing.assert_array_equal(columns[:, 3], either.k[:, i])
        if channel.momentum:
            velocity = kalman_filter(either.recording.values[:, i], channel.params).velocity
            np.testing.assert_array_equal(columns[:, 4], velocity)


def test_vectors_are_the_start_of_a_long_recording():
    z = np.linspace(0.0, 1.0, 5000)[:, None]
    recording = Recording(np.arange(5000.0), ("a",), ("",), z, 1.0)
    job = job_of(Tuning((ChannelTuning("another name", "", 1.0, 1.0),)))
    assert len(read(vector_files(job, recording)["groundtruth.csv"])) == MAX_ROWS


def test_a_recording_that_does_not_fit_is_refused(shared):
    short = Recording(np.arange(3.0), ("a",), ("",), np.ones((3, 1)), 1.0)
    with pytest.raises(BadSetting, match="channel must be one of a"):
        export_tuning(shared.tuning, "json", vectors=short)
    with pytest.raises(BadSetting, match="at least one row"):
        vector_files(job_of(shared.tuning), replace(short, time=short.time[:0], values=short.values[:0]))
