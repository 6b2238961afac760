"""Samples kept: views never change, old ones leave in big steps, nothing is lost or reordered."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.live.samples import SampleStore


def fill(store, begin, count):
    numbers = np.arange(begin, begin + count, dtype=float)
    store.append((numbers / 10).tolist(), np.column_stack([numbers, -numbers]).tolist())


def check(store, came):
    time, values = store.views()
    numbers = np.arange(store.first, came, dtype=float)
    np.testing.assert_array_equal(time, numbers / 10)
    np.testing.assert_array_equal(values, np.column_stack([numbers, -numbers]))


@given(st.integers(1, 50), st.lists(st.integers(0, 60), max_size=20))
def test_the_last_samples_are_kept_in_order_whatever_the_pieces(keep, pieces):
    store, came = SampleStore(2, keep), 0
    for count in pieces:
        fill(store, came, count)
        came += count
        assert store.end == came
        assert min(keep, came) <= len(store) <= keep + max(keep // 4, 1)
        check(store, came)


def test_a_view_never_changes_and_cannot_be_written():
    store, views, came = SampleStore(2, 1000), [], 0
    while came < 10_000:
        fill(store, came, 37)
        came += 37
        views.append((*store.views(), *(view.copy() for view in store.views())))
    for time, values, time_then, values_then in views:
        np.testing.assert_array_equal(time, time_then)
        np.testing.assert_array_equal(values, values_then)
        with pytest.raises(ValueError, match="read-only"):
            values[0, 0] = 1.0
