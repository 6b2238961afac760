"""Bytes of a file: their text, found without the reader under test, and damage to them."""

import codecs


def decoded(data):
    """The text of these bytes: UTF-16 where they say so, else UTF-8, else Latin-1."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    if data.startswith(codecs.BOM_UTF8):
        return data.decode("utf-8-sig", "replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def damaged(data, changes):
    """The bytes after changes, each (flip, cut, end, insert or line; place; byte, length or bytes)."""
    data = bytearray(data)
    for kind, place, what in changes:
        at = min(place, len(data))
        if kind == "flip" and at < len(data):
            data[at] = what
        elif kind == "cut":
            del data[at : at + what]
        elif kind == "end":
            del data[at:]
        elif kind in ("insert", "line"):
            at = data.rfind(b"\n", 0, at) + 1 if kind == "line" else at
            data[at:at] = what
    return bytes(data)
