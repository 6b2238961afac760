"""What is shown over the screen, and what is only logged."""

from __future__ import annotations

import logging

import pytest

from kalscope_app.guard.server import guarded_server
from kalscope_app.session.session import Failed
from kalscope_app.views.window import Notifications


@pytest.fixture
def notifications(caplog):
    caplog.set_level(logging.INFO, logger="kalscope_app")
    with guarded_server(port=0) as guarded:
        yield Notifications(guarded.server, None)


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
