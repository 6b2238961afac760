"""What is shown over the screen, and what is only logged."""

from __future__ import annotations

import logging

import pytest
from tests.app.wire import Guest

from kalscope_app.guard.server import guarded_server
from kalscope_app.session.session import Failed
from kalscope_app.views.window import Notifications


@pytest.fixture
def guarded():
    with guarded_server(port=0) as running:
        yield running


@pytest.fixture
def notifications(guarded, caplog):
    caplog.set_level(logging.INFO, logger="kalscope_app")
    return Notifications(guarded.server, None)


def test_a_refusal_is_a_warning_and_good_news_is_none(notifications, caplog):
    notifications.tell("q must be positive (got 0)", failed=Failed.OPEN)
    notifications.tell("Saved.", good=True)
    notifications.tell(RuntimeError("torn"))
    notifications.is_ending = True
    notifications.tell(RuntimeError("Event loop is closed"))
    records = [record for record in caplog.records if record.name == "kalscope_app.views.window"]
    *others, (warning, sentence), ending = [(record.levelname, record.message) for record in records]
    refused = ("WARNING", "q must be positive (got 0)")
    assert others == [refused, ("INFO", "Saved."), ("ERROR", "uncaught RuntimeError")]
    assert (warning, "RuntimeError: torn" in sentence, bool(records[2].exc_info)) == ("WARNING", True, True)
    assert ending == ("INFO", "at the end: RuntimeError('Event loop is closed')")


def test_what_nobody_saw_to_its_end_is_shown_to_the_next_browser(guarded, notifications):
    """A page that waits for the program connects anew each second: the first connections may end at once."""
    guarded.server.on_client_connect(notifications.attach)
    notifications.tell("The filter is as you left it.", good=True)
    for _ in range(2):
        guest = Guest(guarded.port, guarded.token)
        guest.read_until(lambda guest=guest: guest.notices)
        assert "The filter is as you left it." in guest.notices[0]
        guest.connection.close()
