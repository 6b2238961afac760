"""Text in UTF-16, as Windows programs write it."""

from __future__ import annotations

_MARKS = (b"\xff\xfe", b"\xfe\xff")


def wide_encoding(head: bytes) -> str | None:
    """The kind of UTF-16 that a file begins with; None for other text.

    Without a byte order mark: in such text every second byte is NUL, and hardly any other.
    """
    if head.startswith(_MARKS):
        return "utf-16"
    pairs = len(head) // 2
    even, odd = head[0 : 2 * pairs : 2].count(0), head[1 : 2 * pairs : 2].count(0)
    if pairs and odd > 0.8 * pairs and even < 0.05 * pairs:
        return "utf-16-le"
    return "utf-16-be" if pairs and even > 0.8 * pairs and odd < 0.05 * pairs else None
