"""How a case differs from the stored one."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

RELATIVE = 1e-6
"""Difference of a number that is accepted."""
SHOWN_RELATIVE = 0.011
"""The same of a number in a sentence, which has three digits: the last may change at the edge of rounding."""
ABSOLUTE = {"prediction_gain": 1e-6}
"""Numbers that are differences of others."""

_NUMBER = re.compile(r"\d[\d\u202f]*(?:\.\d+)?(?:e[+-]?\d+)?")


def changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """What differs between two groups of cases, and which likelihoods became higher."""
    wrong, better = list[str](), list[str]()
    for name in {**old, **new}:
        if name not in new or name not in old:
            wrong.append(f"{name}: {'is gone' if name in old else 'is new'}")
        else:
            wrong += [f"{name}{difference}" for difference in differences(old[name], new[name], better, name)]
    return wrong, better


def differences(
    old: Any, new: Any, better: list[str], name: str, at: str = "", exact: bool = True
) -> Iterator[str]:
    """Each difference of two plain values; where a likelihood is higher, only those of codes and words."""
    if isinstance(old, dict) and isinstance(new, dict):
        logliks = [old.get("loglik"), new.get("loglik")]
        gain = logliks[1] - logliks[0] if all(map(is_number, logliks)) else 0.0
        if at.endswith((".tuned", ".plain")) and gain > 1e-6 + 1e-10 * abs(old["loglik"]):
            better.append(f"{name}{at}: log-likelihood {gain:.3g} higher")
            exact = False
        for key in {**old, **new}:
            yield from differences(old.get(key), new.get(key), better, name, f"{at}.{key}", exact)
    elif isinstance(old, list) and isinstance(new, list):
        for i, (one, other) in enumerate(zip_longest(old, new)):
            yield from differences(one, other, better, name, f"{at}[{i}]", exact)
    elif is_number(old) and is_number(new):
        near = ABSOLUTE.get(at.rpartition(".")[2], 0.0)
        if exact and not math.isclose(old, new, rel_tol=RELATIVE, abs_tol=near):
            yield f"{at}: {old!r} became {new!r}"
    elif old != new and not (isinstance(old, str) and isinstance(new, str) and same_words(old, new, exact)):
        yield f"{at}: {old!r} became {new!r}"


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def same_words(old: str, new: str, exact: bool) -> bool:
    """Whether two sentences are the same, their numbers but for the last digit shown."""
    if " " not in old or _NUMBER.sub("0", old) != _NUMBER.sub("0", new):
        return False
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    values = ([float(text.replace("\u202f", "")) for text in pair] for pair in pairs)
    return not exact or all(math.isclose(*pair, rel_tol=SHOWN_RELATIVE) for pair in values)
