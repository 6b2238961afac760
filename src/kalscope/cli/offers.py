"""Commands that are imported when they run: --help and a mistyped option do not wait for what the others import."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

Function = Callable[..., Any]
"""A command: its options are its arguments."""


@dataclass(frozen=True)
class Offer:
    """A command that can be asked for."""

    help: str
    """What it does: the first sentence of its own help."""
    load: Callable[[], Function]
    """Imports and returns it."""


OFFERS: dict[str, Offer] = {}
"""By name, in the order of --help."""


def offers(name: str, text: str) -> Callable[[Callable[[], Function]], Callable[[], Function]]:
    """Offer the command that a function imports and returns.

    Args:
        name: what the user types.
        text: what the command does, as its own help begins.
    """

    def decorate(load: Callable[[], Function]) -> Callable[[], Function]:
        OFFERS[name] = Offer(text, load)
        return load

    return decorate


class _Loaded(Mapping[str, Any]):
    """The commands as typer knows them, each made when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        only = typer.Typer(add_completion=False, rich_markup_mode=None)
        only.command(name)(OFFERS[name].load())
        return get_command(only)

    def __iter__(self) -> Iterator[str]:
        return iter(OFFERS)

    def __len__(self) -> int:
        return len(OFFERS)


class OfferedCommands(TyperGroup):
    """The program: its commands are those of OFFERS."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        commands: Any = _Loaded()
        self.commands = commands

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names."""
        del ctx
        return list(OFFERS)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of --help, as typer does for commands that are there."""
        del ctx
        width = formatter.width - 6 - max(map(len, OFFERS))
        with formatter.section("Commands"):
            texts = {name: TyperCommand(name, help=offer.help) for name, offer in OFFERS.items()}
            formatter.write_dl([(name, one.get_short_help_str(width)) for name, one in texts.items()])
