"""A file read by compiled loops and line by line: one recording and one account."""

import numpy as np
import pytest

from kalscope.errors import KalscopeError
from kalscope.sources.reading import rows
from kalscope.sources.reading.recording_file import read_recording


def assert_same_by_line(path):
    """The recording of a file, or the error that it raises, if it is the same both ways."""
    read = []
    for limit in (0, 1 << 40):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rows, "MAX_BYTES_BY_LINE", limit)
            try:
                read.append(read_recording(path))
            except KalscopeError as error:
                read.append(error)
    fast, slow = read
    if isinstance(fast, KalscopeError):
        assert (type(fast), str(fast)) == (type(slow), str(slow))
    else:
        for name in ("report", "names", "units", "sample_period"):
            assert getattr(fast, name) == getattr(slow, name), name
        np.testing.assert_array_equal(fast.time, slow.time)
        np.testing.assert_array_equal(fast.values, slow.values)
    return fast
