"""Results that are kept while nothing they depend on has changed."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")

PLAIN = (bool, int, float, str, tuple, type(None))
"""Types that are compared by value; anything else, such as a recording, by identity."""


class Cache(Generic[T]):
    """The results of one round of questions, reused in the next one. One thread at a time."""

    def __init__(self) -> None:
        self._scope: tuple[object, ...] = ()
        self._last: dict[Hashable, T] = {}
        self._kept: dict[Hashable, T] = {}

    def begin(self, *scope: object) -> None:
        """Begin a round: drop what the last one did not ask for, and everything if the scope differs."""
        same = len(scope) == len(self._scope) and all(map(_same, scope, self._scope))
        self._scope, self._last, self._kept = scope, self._kept if same else {}, {}

    def get(self, key: Hashable, compute: Callable[[], T]) -> T:
        """The result for a key, computed if neither this round nor the last one asked for it."""
        if key not in self._kept:
            self._kept[key] = self._last[key] if key in self._last else compute()
        return self._kept[key]

    def once(self, compute: Callable[[], T], *scope: object) -> T:
        """The only result of a scope."""
        self.begin(*scope)
        return self.get(None, compute)


def _same(one: object, other: object) -> bool:
    return one is other or (isinstance(one, PLAIN) and one == other)
