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
    return [
        (record.levelname, record.message)
        for record in caplog.records
        if record.name == "kalscope_app.views.window"
    ]


def test_a_refusal_is_a_warning_and_good_news_is_none(notifications, caplog):
    notifications.tell("q must be positive (got 0)", failed=Failed.OPEN)
    notifications.tell("Saved.", good=True)
    assert levels(caplog) == [("WARNING", "q must be positive (got 0)"), ("INFO", "Saved.")]


def test_an_uncaught_exception_is_logged_with_its_traceback_and_explained(notifications, caplog):
    notifications.tell(RuntimeError("torn"))
    (error, uncaught), (warning, sentence) = levels(caplog)
    assert (error, uncaught, warning) == ("ERROR", "uncaught RuntimeError", "WARNING")
    assert "RuntimeError: torn" in sentence
    assert any(record.exc_info for record in caplog.records)


def test_at_the_end_an_error_of_what_still_runs_is_only_logged(notifications, caplog):
    notifications.is_ending = True
    notifications.tell(RuntimeError("Event loop is closed"))
    notifications.tell("The disk is full.")
    only_logged = ("INFO", "at the end: RuntimeError('Event loop is closed')")
    assert levels(caplog) == [only_logged, ("WARNING", "The disk is full.")]
