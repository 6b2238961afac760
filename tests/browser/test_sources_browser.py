"""The Source tab: a figure, a sample, a generated signal, an upload, and a question about a file."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.screen import FIND, filtered

from kalscope import open_source
from kalscope.papers.reproduction import list_experiments, open_experiment
from kalscope_app.views.source import experiment_label

pytestmark = pytest.mark.browser
BAD_FILES = {"empty.csv": b"", "picture.png": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256)) * 4}


def test_a_figure_a_sample_a_generated_signal_and_an_upload_are_opened_and_what_is_bad_is_refused(start, tmp_path):
    screen = start("demo")
    screen.tab("Source")
    experiment = next(one for one in list_experiments() if one.name == "generalized_figure_7")
    screen.choose("sample or figure", experiment_label(experiment))
    recording, filters = open_experiment(experiment.name)
    channel = recording.names[0]
    screen.wait_for_line("filtered", filters[channel].run(recording.channel(channel)).x)
    screen.choose("sample or figure", "Nile at Aswan")
    screen.wait_for_line("filtered", filtered(open_source("sample:nile").values[:, 0]))
    assert screen.range("x") == pytest.approx((1871, 1970))
    screen.type("path", "synthetic:step?n=500&sigma=0.2")
    made = open_source("synthetic:step?n=500&sigma=0.2")
    screen.wait_for_line("truth", made.truth[:, 0])
    screen.wait_for_line("filtered", filtered(made.values[:, 0]))
    screen.type("path", "synthetic:step?sigma=-3")
    screen.wait_for_notice("sigma must")

    upload = screen.page.get_by_role("button", name="Upload a file", disabled=False)
    for name, content in BAD_FILES.items():
        (tmp_path / name).write_bytes(content)
        upload.locator("xpath=preceding-sibling::input").set_input_files(tmp_path / name)
        screen.wait_for_notice(f"{name} must")
    good = tmp_path / "my <img src=x onerror=alert(1)> sensor.csv"
    good.write_text("time,temp <b>\n" + "".join(f"{i / 10},{i % 7}\n" for i in range(50)))
    screen.upload("Upload a file", good)
    screen.wait_for_line("raw", np.arange(50) % 7)
    assert screen.page.locator("img[src=x]").count() == 0


def test_a_question_about_the_file_is_answered_by_its_button_and_missing_samples_are_gaps(start, tmp_path):
    log = tmp_path / "echo.csv"
    values = np.array([400.0 if i % 6 == 3 or 80 <= i < 100 else 20 + i % 30 for i in range(200)])
    log.write_text("time_ms,distance (cm)\n" + "".join(f"{60 * i},{z:.0f}\n" for i, z in enumerate(values)))
    screen = start("echo.csv")
    screen.wait_for_line("raw", values)
    question = screen.page.locator("p", has_text="Is 400 a missing value? It occurs 49 times")
    question.wait_for()
    screen.wait_for_fit()
    screen.press("Read 400 as missing")
    known = np.where(values == 400, np.nan, values)
    screen.wait_for_line("filtered", filtered(known), tolerance=1e-12)
    screen.wait(f"() => ({FIND})('raw').data[1].some(Number.isNaN)")
    for label in ("raw", "innovation"):
        _, y = screen.line(label)
        assert np.array_equal(np.isfinite(y[1:]), np.isfinite(known[1:]))  # the first sample has no innovation
    screen.page.get_by_text("200 samples · 49 missing").wait_for()
    question.wait_for(state="detached")
    screen.tab("Source")
    screen.wait_for_value("import options", "--missing 400")
    log.write_text(log.read_text() + "12000,21\n")
    screen.press("Re-import")
    screen.wait_for_text("201 samples")
    screen.type("import options", "--speed 3", enter=False)
    screen.press("Re-import")
    screen.wait_for_notice("import options must be some of --delimiter")
