"""All commands: the headless ones, and `open`, the dashboard."""

from __future__ import annotations

from kalscope.cli.app import COMMANDS, app, run

__all__ = ["app", "run"]

COMMANDS["open"] = ("Open the dashboard in a browser.", "kalscope_app.open_command:open_dashboard")
