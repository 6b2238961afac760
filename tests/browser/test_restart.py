"""The end of the program as its page shows it, and what the next start brings back."""

import pytest
from tests.browser.screen import Screen, settings_in
from tests.support.program import end, free_port, running
from tests.support.waiting import wait_until

from kalscope_app.program.user_settings import UserSettings

pytestmark = pytest.mark.browser
Q = "process noise q"


def test_the_page_says_that_the_program_has_ended_and_a_restart_brings_file_filter_and_map_back(browser, tmp_path):
    log, kept, env = tmp_path / "log.csv", tmp_path / "config" / "tunings", settings_in(tmp_path / "config")
    log.write_text("time_s,a\n" + "".join(f"{i / 100},{i * i % 17}\n" for i in range(300)))
    port = "--port", str(free_port())
    with running(tmp_path, *port, source=str(log), env=env) as (program, url):
        screen = Screen(browser, url)
        starting = screen.text_box(Q).input_value()
        screen.type(Q, "0.25")
        wait_until(lambda: any("q = 0.25" in file.read_text() for file in kept.glob("*.toml")), "the kept filter")
        screen.press("Map")
        screen.button("Hide map").wait_for()
        wait_until(lambda: UserSettings(tmp_path / "config").has("map_shown"), "the setting of the map")
        program.kill()
        bar = screen.page.get_by_text("Kalscope has stopped: start it again.")
        bar.wait_for()
    with screen:
        with running(tmp_path, *port, source=str(log), env=env) as (program, _):
            bar.wait_for(state="detached")
            screen.wait_for_value(Q, "0.25")
            screen.wait_for_notice("The filter is as you left it")
            screen.press("Undo")
            screen.wait_for_value(Q, starting)
            screen.press("Redo")
            screen.wait_for_value(Q, "0.25")
            assert end(program)[0] == 0
        with running(tmp_path, *port, "--q", "7", source=str(log), env=env):
            screen.wait_for_value(Q, "7")
        with running(tmp_path, "open", *port, source="", env=env):
            screen.wait_for_notice("log.csv was open last")
            screen.tab("Source")
            assert screen.text_box("path").input_value() == str(log)
            screen.button("Hide map").wait_for()
