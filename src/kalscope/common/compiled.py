"""Loops that numba compiles, or loads from its cache on the disk, when they are first needed.

numba takes 0.4 s to import and to set up, longer than everything else that a command does with a small file. So
some loops run at first as the Python that they are written in, and are compiled once they have taken many samples.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec, TypeVar, cast

import numpy as np

from kalscope.errors import BadSetting

P = ParamSpec("P")
R = TypeVar("R")

MAX_PLAIN = 20_000
"""Samples that a loop takes as plain Python, in about 20 ms; a stream that continues needs the compiled loop."""

FEW = 4_000
"""Of these, those that it still takes once numba is loaded: to compile it at the first start takes 0.1 to 1 s."""

_numba = threading.Event()
"""Set once numba is loaded."""
_no_folder = threading.Event()
"""Set where numba found no folder that it may write its cache to."""
_at_load: list[Callable[[], None]] = []
_load = threading.Lock()
"""Held while `_numba` and `_at_load` change: two loops may be needed first at once, in two threads."""


def compiled(
    *, plain: bool = False, inner: bool = False, **options: Any
) -> Callable[[Callable[P, R]], Compiled[P, R]]:
    """Make a compiled loop of a function; it releases the GIL (a reader thread must not starve).

    Args:
        plain: it may run as plain Python at first, because this gives the same numbers to the last bit: neither
            fast-math flags, nor numpy's division by zero, nor integers that overflow.
        inner: only compiled loops call it, and keep it in their cache. One of its own would double its compilation.
        options: further options of numba's `njit`.
    """
    # Both are set, else a loop takes them from the one that happens to call it first, and caches what comes of it.
    defaults: dict[str, Any] = {"fastmath": False, "error_model": "python"}
    return lambda function: Compiled(function, plain, {"cache": not inner, "nogil": True, **defaults, **options})


@dataclass(frozen=True)
class Compiling:
    """How many of the loops that were not in the cache have been compiled."""

    done: int
    """Loops compiled so far."""
    is_busy: bool
    """Whether one is being compiled."""

    def __str__(self) -> str:
        each = "at each start, because no cache folder is writable"
        often = each if _no_folder.is_set() else "only at the first start"
        return f"compiling for this computer, {often}: {self.done} done"


def watch_compiling(report: Callable[[Compiling], None]) -> None:
    """From now on report when a loop is about to be compiled, and when it is done, on the thread that runs it."""
    listen = functools.partial(_listen, report)
    with _load:
        if not _numba.is_set():
            _at_load.append(listen)
            return
    listen()


def _listen(report: Callable[[Compiling], None]) -> None:
    from numba.core import event

    class Listener(event.Listener):
        depth = done = 0

        def on_start(self, event: object) -> None:
            del event
            self.depth += 1
            report(Compiling(self.done, is_busy=True))

        def on_end(self, event: object) -> None:
            del event
            self.depth, self.done = self.depth - 1, self.done + 1
            report(Compiling(self.done, is_busy=self.depth > 0))  # else inside of another one

    cast("Any", event).register("numba:compile", Listener())


class Compiled(Generic[P, R]):
    """A function of numbers and contiguous arrays; the first argument holds its samples."""

    def __init__(self, function: Callable[P, R], plain: bool, options: dict[str, Any]) -> None:
        self.py_func, self.may_be_plain, self.options = function, plain, options
        self._plain_left = MAX_PLAIN if plain else -1
        self._dispatcher: Any = None
        self._loading = threading.Lock()
        self._run: Callable[P, R] = self._while_few_samples
        functools.update_wrapper(cast("Any", self), function, updated=())

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Run the loop."""
        return self._run(*args, **kwargs)

    def _while_few_samples(self, *args: P.args, **kwargs: P.kwargs) -> R:
        self._plain_left -= getattr(args[0], "size", 1)
        if self._plain_left >= (MAX_PLAIN - FEW if _numba.is_set() else 0):
            return self.py_func(*cast("Any", map(_plain, args)), **kwargs)
        self._run = self.dispatcher
        return _with_room(self._run, *args, **kwargs)

    def __reduce__(self) -> str:
        """Another process imports it by its name."""
        return self.py_func.__name__

    @property
    def dispatcher(self) -> Any:
        """Numba's object."""
        with self._loading:  # two of them would be compiled twice
            if self._dispatcher is None:
                self._dispatcher = _dispatcher(self.py_func, self.options)
            return self._dispatcher

    @property
    def _numba_type_(self) -> Any:  # numba asks for this and the next where a compiled loop calls this one
        return self.dispatcher._numba_type_

    @property
    def targetoptions(self) -> Any:
        """Whether it is inlined."""
        return self.dispatcher.targetoptions


def _with_room(function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Call it, with room for the frames of what it calls."""
    return function(*args, **kwargs)


# CPython keeps frames in pieces of 16 kB. In the deep stack of a command numba's recursion crosses the end of one
# so often that compiling takes 1.5 times as long. A frame of 640 kB gets a piece of 1 MB, whose end is far.
_with_room.__code__ = _with_room.__code__.replace(co_stacksize=80_000)


def _plain(value: Any) -> Any:
    """An argument for plain Python: arrays become memoryviews, which yield Python's own numbers."""
    if isinstance(value, np.ndarray):
        return memoryview(cast("Any", value))
    if isinstance(value, tuple):
        return tuple(map(_plain, cast("tuple[Any, ...]", value)))
    return cast("Any", value).item() if isinstance(value, np.generic) else value


def _dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    try:
        from numba import njit
    except ValueError as error:  # an environment variable of numba, such as NUMBA_NUM_THREADS=0
        raise BadSetting(f"the environment must let numba start (got: {error} See the variables NUMBA_…)") from None

    with _load:
        while _at_load:
            _at_load.pop()()
        _numba.set()
    jit = cast("Any", njit)
    try:
        return jit(**options)(function)
    except RuntimeError:
        _no_folder.set()
        return jit(**{**options, "cache": False})(function)
