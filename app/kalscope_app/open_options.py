"""The options of `kalscope open` that name a channel and its setting; light, because every start reads it."""

from __future__ import annotations

from typing import Annotated

import typer

Channel = Annotated[
    str | None,
    typer.Option("--channel", metavar="NAME", help="Channel to look at: its name, or its number from 1."),
]
Q = Annotated[
    str | None, typer.Option("--q", metavar="NUMBER", help="Process noise q of that channel, a variance.")
]
R = Annotated[str | None, typer.Option("--r", metavar="NUMBER", help="Its measurement noise r, a variance.")]
P0 = Annotated[
    str | None, typer.Option("--p0", metavar="NUMBER", help="Its start variance, or automatic: the first sample.")
]
X0 = Annotated[
    str | None, typer.Option("--x0", metavar="NUMBER", help="Its start value, or first; goes with --p0.")
]
Gate = Annotated[
    str | None, typer.Option("--gate", metavar="NUMBER", help="Its outlier gate on v²/s, such as 9, or off.")
]
