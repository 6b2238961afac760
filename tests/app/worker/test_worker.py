"""The worker: tasks run in another process, which can be ended at any moment, and the next task finds a new one."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.support.forked import Forked
from tests.support.waiting import PATIENCE, wait_until
from viser import UploadedFile

from kalscope.catalogue import open_source
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, Cancelled, NoMemory
from kalscope_app.dashboard import Dashboard
from kalscope_app.guard.server import guarded_server
from kalscope_app.session.opening import opened
from kalscope_app.views.window import Notifications
from kalscope_app.worker import worker as worker_module
from kalscope_app.worker.worker import Worker

posix = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")

BUSY = "import re; open({!r}, 'w').close(); re.fullmatch('(a+)+b', 'a' * 60)"
"""It ends in years, and lets no other thread of its process run meanwhile."""


@pytest.fixture(scope="module")
def worker():
    one = Worker()
    yield one
    one.close()


def run(worker, code):
    """Run a statement in the process."""
    return worker.run(partial(exec, f"import os, signal\n{code}"), "log.csv")


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_file_is_read_in_another_process_with_the_same_result(worker, tmp_path):
    rows = "".join(f"{0.01 * i:.2f},{i % 7}.5,{'' if i % 9 == 0 else i % 5}\n" for i in range(9000))
    log = tmp_path / "log.csv"
    log.write_text(f"t,a (V),b\n{rows}torn line\n")
    shown = []
    there = worker.run(partial(open_source, str(log)), "log.csv", Progress(lambda *said: shown.append(said)))
    here = open_source(str(log))
    assert worker.run(os.getpid, "") == worker.run(os.getpid, "") != os.getpid()
    assert np.array_equal(there.values, here.values, equal_nan=True)
    assert np.array_equal(there.time, here.time)
    assert there.values.flags.f_contiguous
    for name in ("names", "units", "report", "source", "sha256"):
        assert getattr(there, name) == getattr(here, name)
    assert all(0.0 <= fraction <= 1.0 for fraction, _ in shown)


def test_the_errors_of_a_task_come_back_as_they_are(worker):
    with pytest.raises(RuntimeError, match="ZeroDivisionError") as raised:
        run(worker, "1 // 0")
    assert "Traceback" in raised.value.__notes__[0]
    with pytest.raises(BadFile, match=r"^file not found: 'no such file'$"):
        worker.run(partial(open_source, "no such file"), "no such file")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        run(worker, "os.stat('nowhere')")


@posix
def test_cancel_ends_what_nothing_else_can_with_all_it_started_and_leaves_no_file(worker, tmp_path):
    before, folder = worker.run(os.getpid, ""), Path(worker.run(tempfile.mkdtemp, "")).parent
    begun, pid = tmp_path / "begun", tmp_path / "pid"
    start = f"import subprocess; open({str(pid)!r}, 'w').write(str(subprocess.Popen(['sleep', '600']).pid))\n"
    with pytest.raises(Cancelled):
        worker.run(partial(exec, start + BUSY.format(str(begun))), "log.csv", Progress(cancelled=begun.exists))
    assert not is_running(before)
    assert not folder.exists()
    assert worker.run(os.getpid, "") not in (before, os.getpid())
    wait_until(lambda: not is_running(int(pid.read_text())), "the end of the process that was started")


@posix
def test_an_end_of_the_process_is_one_line_and_the_next_file_opens(worker):
    for code, said in (
        ("os.kill(os.getpid(), 11)", "could not be read: the process that read it crashed (status -11)"),
        ("os._exit(3)", "could not be read: the process that read it crashed (status 3)"),
        ("os.kill(os.getpid(), 9)", "could not be read: the system ended the process that read it"),
        ("os.kill(os.getpid(), signal.SIGPROF)", "must be read within 1800 s of processor time"),
    ):
        with pytest.raises(BadFile, match=re.escape(f"log.csv {said}")) as raised:
            run(worker, code)
        assert "\n" not in str(raised.value)
    assert len(worker.run(partial(open_source, "demo"), "demo")) == 1000
    worker._process.kill()  # while it has no task
    wait_until(lambda: not worker._process.is_alive(), "the end of the process")
    assert len(worker.run(partial(open_source, "demo"), "demo")) == 1000


def test_a_task_that_says_nothing_is_given_up(worker, monkeypatch):
    monkeypatch.setattr(worker_module, "MAX_SILENCE_S", 0.2)
    with pytest.raises(BadFile, match=r"^log.csv must show progress every 0.2 s while it is read"):
        run(worker, "import time; time.sleep(600)")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="free memory is known on Linux only")
def test_what_the_memory_cannot_hold_is_one_line_and_the_process_goes_on(worker):
    free = "import kalscope_app.worker.child as child, kalscope.common.files as memory; child.free_memory = "
    pid = worker.run(os.getpid, "")
    run(worker, f"{free} lambda: 8 << 20")
    for task in partial(open_source, "synthetic:sine?n=4000000"), partial(bytearray, 1 << 26):
        with pytest.raises(NoMemory, match=r"^log.csv must fit into the memory that is free, and it does not"):
            worker.run(task, "log.csv")
    run(worker, f"{free} memory.free_memory")
    assert len(worker.run(partial(open_source, "demo"), "demo")) == 1000
    assert worker.run(os.getpid, "") == pid


def test_the_end_of_the_dashboard_ends_a_task(tmp_path):
    worker, begun, ended = Worker(), tmp_path / "begun", []

    def task():
        try:
            worker.run(partial(exec, BUSY.format(str(begun))), "log.csv")
        except Cancelled as error:
            ended.append(error)

    thread = threading.Thread(target=task)
    thread.start()
    wait_until(begun.exists, "the task")
    pid = worker._process.pid
    worker.close()
    thread.join(PATIENCE)
    assert len(ended) == 1
    assert not is_running(pid)
    with pytest.raises(Cancelled):
        worker.run(os.getpid, "")


KILLED = """
import os, tempfile
from kalscope_app.worker.worker import Worker
worker = Worker()
print(worker.run(os.getpid, ""), worker.run(tempfile.mkdtemp, ""), flush=True)
os._exit(9)
"""


@posix
def test_no_process_or_file_outlives_a_dashboard_that_was_killed(tmp_path):
    with Forked(KILLED, tmp_path, os.environ) as program:
        pid, made = program.communicate(timeout=PATIENCE)[0].split()
    wait_until(lambda: not is_running(int(pid)), "the end of the process")
    assert not Path(made).parent.exists()


def test_the_source_tab_reads_in_the_worker(tmp_path, monkeypatch):
    """The reader of this process may not be used, and what the worker refuses is said."""
    log, state, told = tmp_path / "log.csv", opened(open_source("demo")), []
    log.write_text("t,a\n" + "".join(f"{i},{i % 7}.5\n" for i in range(100)))
    monkeypatch.setattr(Notifications, "tell", lambda _self, said, **_how: told.append(said))
    with guarded_server(port=0) as guarded:
        dashboard = Dashboard(guarded.server, state, tmp_path)
        monkeypatch.setattr("kalscope.sources.reading.recording_file.open_raw", None)
        session, source = dashboard.session, dashboard._source
        upload = UploadedFile("load.csv", log.read_bytes())
        for opens, given, name in (source.open_spec, str(log), "log.csv"), (source._upload, upload, "load.csv"):
            opens(given)
            wait_until(lambda name=name: session.apply_requests()[0].recording.title == name, name)
        source.open_spec("nowhere.csv")
        wait_until(lambda: told, "the refusal")
        dashboard._worker.close()
    assert told == ["file not found: 'nowhere.csv'"]
