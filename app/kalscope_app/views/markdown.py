"""Words in markdown: names from outside the program, and the beginning of a sentence."""

from __future__ import annotations

import re


def escape_markdown(text: str, limit: int = 60) -> str:
    """A name from outside the program on one line, cut to `limit`, with every markup character escaped."""
    line = re.sub(r"[^\S\u202f\xa0]+", " ", text).strip()  # no break within a number
    line = line if len(line) <= limit else line[: limit - 1] + "…"
    return re.sub(r"([\\`*_{}\[\]()#+\-.!|<>&~:$@\"'/^=])", r"\\\1", line)


def capitalised(words: str) -> str:
    """Words with a capital first letter, as at the beginning of a sentence."""
    return f"{words[:1].upper()}{words[1:]}"
