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


def levels(caplog):
    records = [record for record in caplog.records if record.name == "kalscope_app.views.window"]
    return [(record.levelname, record.message) for record in records]


def test_a_refusal_is_a_warning_and_good_news_is_none(notifications, caplog):
    notifications.tell("q must be positive (got 0)", failed=Failed.OPEN)
    notifications.tell("Saved.", good=True)
    assert levels(caplog) == [("WARNING", "q must be positive (got 0)"), ("INFO", "Saved.")]


def test_an_uncaught_exception_is_logged_and_explained_but_at_the_end_only_logged(notifications, caplog):
    notifications.tell(RuntimeError("torn"))
    (error, uncaught), (warning, sentence) = levels(caplog)
    assert (error, uncaught, warning) == ("ERROR", "uncaught RuntimeError", "WARNING")
    assert "RuntimeError: torn" in sentence
    assert any(record.exc_info for record in caplog.records)
    notifications.is_ending = True
    notifications.tell(RuntimeError("Event loop is closed"))
    assert levels(caplog)[2:] == [("INFO", "at the end: RuntimeError('Event loop is closed')")]
