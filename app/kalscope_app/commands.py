"""All commands: the headless ones, and `open`, the dashboard."""

from __future__ import annotations

from kalscope.cli.app import Function, app, offers, run

__all__ = ["app", "run"]


@offers("open", "Open the dashboard in a browser.")
def _open() -> Function:
    from kalscope_app.open_command import open_dashboard

    return open_dashboard
