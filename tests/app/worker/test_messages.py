"""Messages over a pipe: arrays of every kind arrive as they were, and what ends midway is noticed."""

import io
import os
import pickle
import threading

import numpy as np
import pytest

from kalscope_app.worker import messages
from kalscope_app.worker.messages import Done, receive, send


@pytest.fixture
def pipe():
    ends = os.pipe()
    with io.FileIO(ends[0], "r") as out, io.FileIO(ends[1], "w") as into:
        yield out, into


def passed(pipe, message):
    """A message through a pipe that holds only a part of it at a time."""
    out, into = pipe
    sender = threading.Thread(target=send, args=(into, message))
    sender.start()
    got = receive(out)
    sender.join()
    return got


def test_arrays_arrive_bit_for_bit_in_their_order_and_beside_the_pickle(pipe):
    values = np.asfortranarray(np.random.default_rng(1).normal(size=(50_000, 3)))
    values[5] = np.nan
    readonly = np.frombuffer(b"abc", np.uint8)
    sent = {
        "f": values,
        "c": values.T,
        "back": values[::-2, 1],
        "empty": np.empty((0, 3)),
        "0": np.float64(1.5),
        "r": readonly,
    }
    got = passed(pipe, Done(sent)).answer
    assert got.keys() == sent.keys()
    for name, array in sent.items():
        assert np.array_equal(got[name], array, equal_nan=name in "f c back"), name
        assert got[name].dtype == array.dtype
    assert got["f"].flags.f_contiguous
    body = []
    messages._Pickler(io.BytesIO(), 5, buffer_callback=body.append).dump(sent)
    assert sum(buffer.raw().nbytes for buffer in body) >= values.nbytes * 2 + values[::2, 1].nbytes


def test_a_message_that_ends_midway_is_an_end(pipe):
    out, into = pipe
    buffer = io.BytesIO()
    send(buffer, Done(np.arange(1000.0)))
    into.write(buffer.getvalue()[:-1])
    into.close()
    with pytest.raises(EOFError):
        receive(out)


def test_a_message_that_the_memory_cannot_hold_is_refused_before_it_is_read(pipe, monkeypatch):
    out, into = pipe
    monkeypatch.setattr(messages, "free_memory", lambda: 1000)
    send(into, Done(np.zeros(1000)))
    with pytest.raises(MemoryError):
        receive(out)
    assert pickle.loads(pickle.dumps(Done(1))) == Done(1)
