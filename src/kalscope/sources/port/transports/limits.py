"""Limits that every transport keeps."""

from __future__ import annotations

READ_TIMEOUT = 0.1
"""Seconds after which a read without data returns, so that close never waits longer."""
WRITE_TIMEOUT = 2.0
"""Seconds after which a write that is not accepted fails."""
CONNECT_TIMEOUT = 5.0
"""Seconds within which the other side must answer."""
MAX_READ_BYTES = 1 << 13
"""Bytes of one read: whether to stop is checked between two of them."""
