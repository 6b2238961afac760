"""What the first lines of a file say by the rules of instruments."""

from kalscope.sources.reading.preface import find_preface


def head(text):
    """The lines of a text, without the blank ones around it."""
    return text.strip("\n").split("\n")


def preface(text):
    """What a rule found in the text; one must know it."""
    found = find_preface(head(text))
    assert found is not None
    return found
