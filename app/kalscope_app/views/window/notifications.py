"""Sentences that appear over the screen: what was done, what was refused, what went wrong."""

from __future__ import annotations

import logging
from pathlib import Path
from weakref import WeakKeyDictionary

import viser

from kalscope_app.program.error_reporting import sentence_for
from kalscope_app.session.session import Failed

log = logging.getLogger(__name__)


class Notifications:
    """Shows one sentence at a time in every browser, and logs it. Any thread may call it."""

    def __init__(self, server: viser.ViserServer, log_file: Path | None) -> None:
        """Args: the server of the browsers; the log, named where something went wrong."""
        self._server, self._log_file = server, log_file
        self._shown = WeakKeyDictionary[viser.ClientHandle, viser.NotificationHandle]()
        self._early: tuple[str, str, bool] | None = None
        self._has_met = False
        self.is_ending = False
        """True during shutdown: errors are only logged, since what still runs may find the server closed."""

    def tell(self, message: str | Exception, *, good: bool = False, failed: Failed = Failed.OTHER) -> None:
        """Show one sentence.

        Args:
            message: the sentence, or an uncaught exception, which is logged.
            good: whether it is not an error.
            failed: the heading of a refusal.
        """
        if not isinstance(message, Exception):
            self._show("Kalscope" if good else failed, message, good=good)
        elif self.is_ending:
            log.info("at the end: %r", message)
        else:
            log.error("uncaught %s", type(message).__name__, exc_info=message)
            self.show_failure(message)

    def show_failure(self, error: Exception) -> None:
        """Show what to do after an uncaught exception."""
        self._show("Something went wrong", sentence_for(error, self._log_file))

    def attach(self, client: viser.ClientHandle) -> None:
        """Show the first browser what was said before it came, such as the note of what is opened first."""
        if self._early is not None and not self._has_met:
            self._show_in(client, *self._early)
        self._has_met = True

    def forget(self, client: viser.ClientHandle) -> None:
        """The browser has disconnected."""
        self._shown.pop(client, None)

    def _show(self, title: str, message: str, *, good: bool = False) -> None:
        """One notification; plain text, so nothing in it can act as markup."""
        (log.info if good else log.warning)("%s", message)
        clients = self._server.get_clients().values()
        if not self._has_met and not clients:
            self._early = title, message, good
        for client in clients:
            self._show_in(client, title, message, good)

    def _show_in(self, client: viser.ClientHandle, title: str, message: str, good: bool) -> None:
        before = self._shown.get(client)
        if before is not None:  # one at a time: a stack of them would cover the charts
            before.remove()
        self._shown[client] = client.add_notification(
            title=title,
            body=message[:1000],
            auto_close_seconds=5.0 if good else 8.0,
            color=(0, 158, 115) if good else (213, 94, 0),
        )
