"""Values for text boxes, and names from outside the program for markdown. Pure."""

from __future__ import annotations

import re


def typed(value: float) -> str:
    """A value for a text box, up to eight digits, without padding zeros: 0.0589, 1e-9, 1469.18."""
    text = f"{value:.8g}"
    return re.sub(r"e([+-])0*(\d)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", text)


def escape_markdown(text: str, limit: int = 60) -> str:
    """A name from outside the program on one line, cut to `limit`, with every markup character escaped."""
    line = re.sub(r"[^\S\u202f\xa0]+", " ", text).strip()  # no break within a number
    line = line if len(line) <= limit else line[: limit - 1] + "…"
    return re.sub(r"([\\`*_{}\[\]()#+\-.!|<>&~:$@\"'/^=])", r"\\\1", line)


def capitalised(words: str) -> str:
    """Words as a sentence begins."""
    return f"{words[:1].upper()}{words[1:]}"
