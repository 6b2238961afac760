"""The Source tab without a browser: which port it shows, what it calls a re-creation."""

from __future__ import annotations

import threading

import pytest
from each import each
from waiting import PATIENCE

from kalscope.papers.reproduction import list_experiments
from kalscope.sources.samples import list_samples
from kalscope_app.engine.jobs import Jobs
from kalscope_app.views.live import TYPED, has_baud, port_to_show
from kalscope_app.views.source import experiment_label, sample_label


@pytest.mark.parametrize(
    ("shown", "kept", "before", "now", "expected"),
    [
        (TYPED, False, (), (), TYPED),
        (TYPED, False, (), ("A", "B"), "A"),
        (TYPED, True, (), ("A",), TYPED),
        (TYPED, True, ("A",), ("A", "B"), TYPED),
        ("A", False, ("A",), ("A", "B"), "B"),
        ("A", True, ("A",), ("A", "B"), "A"),
        ("A", True, ("A", "B"), ("B", "C"), "C"),
        ("B", False, ("A", "B"), ("A",), "A"),
        ("B", False, ("A", "B"), ("B",), "B"),
        ("A", False, ("A",), (), TYPED),
    ],
)
def test_the_port_that_was_just_plugged_in_is_shown_unless_the_user_chose_another(
    shown, kept, before, now, expected
):
    assert port_to_show(shown, before, now, kept=kept) == expected


@each(
    ("address", "expected"),
    [("", True), ("/dev/ttyACM0", True), ("COM3", True), ("ssh://pi/dev/ttyACM0", True)]
    + [(text, False) for text in ("tcp://h:1", " UDP://:47269", "mqtt://broker/t", "file:log.csv")],
)
def test_a_baud_rate_is_offered_where_it_means_something(address, expected):
    assert has_baud(address) is expected


def test_the_menus_say_what_was_not_measured():
    labels = {sample.name: sample_label(sample.title, sample.made) for sample in list_samples()}
    assert labels["nile"] == "Nile at Aswan"
    assert labels["lis302dl"] == "Resting LIS302DL (re-creation)"
    assert labels["ultrasonic"].endswith("(simulated)")
    assert [name for name, label in labels.items() if not label.endswith(")")] == ["nile"]
    figures = [experiment_label(one) for one in list_experiments()]
    assert len(set(figures)) == len(figures)


def test_idle_work_is_repeated_between_jobs_and_ends_with_its_failure():
    turns, told, done, failed = [], [], threading.Event(), threading.Event()
    jobs = Jobs(lambda *said, **_more: told.append(said))

    def work():
        turns.append(len(turns))
        if len(turns) == 3:
            failed.set()
            raise OSError("no ports")

    jobs.when_idle(work, 0.001)
    assert failed.wait(PATIENCE)
    jobs.run(done.set)
    assert done.wait(PATIENCE)
    assert (turns, told) == ([0, 1, 2], [])
