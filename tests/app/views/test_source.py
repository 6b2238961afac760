"""The Source tab without a browser: which port it shows, what it calls a re-creation."""

from __future__ import annotations

import threading

import pytest
from tests.support.waiting import PATIENCE

from kalscope.papers.reproduction import list_experiments
from kalscope.sources.samples import list_samples
from kalscope.sources.synthetic import SHAPES
from kalscope_app.engine.jobs import Jobs
from kalscope_app.views.live import TYPED, port_to_show
from kalscope_app.views.source import specs_by_label


@pytest.mark.parametrize(
    ("shown", "kept", "before", "now", "expected"),
    [
        (TYPED, False, (), ("A", "B"), "A"),
        (TYPED, True, ("A",), ("A", "B"), TYPED),
        ("A", False, ("A",), ("A", "B"), "B"),
        ("A", True, ("A",), ("A", "B"), "A"),
        ("B", False, ("A", "B"), ("B",), "B"),
        ("A", False, ("A",), (), TYPED),
    ],
)
def test_the_port_that_was_just_plugged_in_is_shown_unless_the_user_chose_another(
    shown, kept, before, now, expected
):
    assert port_to_show(shown, before, now, kept=kept) == expected


def test_the_menu_says_what_was_not_measured_and_has_every_name_once():
    labels = {spec: label for label, spec in specs_by_label().items()}
    assert labels["sample:lis302dl"] == "Resting LIS302DL (re-creation)"
    assert labels["synthetic:random_walk"] == "random walk (generated)"
    measured = [spec for spec, label in labels.items() if not label.endswith(")") and spec.startswith("sample:")]
    assert measured == ["sample:nile"]
    assert len(labels) == len(list_samples()) + len(list_experiments()) + len(SHAPES)


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
