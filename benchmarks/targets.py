"""A target of the project as one printed line: met or missed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """One target, and what was measured."""

    what: str
    """What is to be reached."""
    got: float
    """The measured value."""
    limit: float
    """The value of the target."""
    unit: str
    """Unit of both."""
    at_least: bool = False
    """Whether the value must be as high as the limit; otherwise as low."""

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        return self.got >= self.limit if self.at_least else self.got <= self.limit

    def __str__(self) -> str:
        bound = "at least" if self.at_least else "at most"
        verdict = "met   " if self.met else "MISSED"
        return f"{verdict} {self.what}: {self.got:.3g} {self.unit} ({bound} {self.limit:.4g} {self.unit})"
