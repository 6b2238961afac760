"""Samples kept: views never change, old ones leave in big steps, nothing is lost or reordered."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.live.samples import SampleStore


def rows(begin, end):
    numbers = np.arange(begin, end, dtype=float)
    return numbers / 10, np.column_stack([numbers, -numbers])


@given(st.integers(1, 50), st.lists(st.integers(0, 60), max_size=20))
def test_the_last_samples_are_kept_in_order_and_views_never_change(keep, pieces):
    store, came, views = SampleStore(2, keep), 0, []
    for count in pieces:
        store.append(*(part.tolist() for part in rows(came, came + count)))
        came += count
        assert store.end == came
        assert min(keep, came) <= len(store) <= keep + max(keep // 4, 1)
        views.append((store.views(), rows(store.first, came)))
    for found, expected in views:
        for view, numbers in zip(found, expected, strict=True):
            np.testing.assert_array_equal(view, numbers)
            assert not view.flags.writeable
