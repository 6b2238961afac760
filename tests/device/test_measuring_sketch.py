"""A sketch that measures r itself, run in a simulated Uno: the bits of the same code here, refusals, EEPROM."""

from __future__ import annotations

import numpy as np
import pytest
from tests.device.exported_sketch import FAST, MISSING, Talk, exported
from tests.support.board import FLAT_OUT
from tests.support.exported_rule import compiled_rule, rows_of

from kalscope.estimation.noise import noise_from_still
from kalscope.export.board import Calibrated, NotCalibrated, read_calibration
from kalscope.export.board import read_answer as read_values
from kalscope.tuning.tuning import ChannelTuning

COUNTS = (1.0, 0.0, 1023.0)
SECONDS = 0.4
ROWS = rows_of(SECONDS, 0.001)


def values(talk, channels):
    """What the filters use."""
    return [read_values(text) for text in talk.ask("?", "bits=", channels)]


def noise(sigma, level=500.3, seed=0, rows=2000):
    return level + np.random.default_rng(seed).normal(0.0, sigma, rows)


def as_counts(*columns):
    return np.clip(np.rint(np.column_stack(columns)), 0, 1023).astype(int)


FOUR = [ChannelTuning(name, "", 0.01, 4.0) for name in ("slow", "drifts", "spiky", "loud")]


def test_what_it_measures_is_that_of_this_computer_to_the_last_bit_and_the_hosts_figure_within_one_percent(
    start_board, workshop, tmp_path
):
    """Noise of a fifth of a step to 80 steps, drift, spikes and missing samples; the others keep their values."""
    spiky = noise(7.0, seed=3)
    spiky[200::97], spiky[150::61] = 900.0, 0.0
    counts = as_counts(noise(0.2, 500.45), noise(2.0) + np.arange(2000) / 800, spiky, noise(80.0, seed=4))
    firmware = exported(workshop, *FOUR, edits=(*FAST, MISSING), calibration=True)
    board = Talk(start_board(firmware, counts, *FLAT_OUT))
    measure = compiled_rule(tmp_path)
    board.ask(f"c {SECONDS}", "calibrating rows=", 4)
    begun = [text for _, text in board.said[-4:]]
    assert begun == [f"# {channel.name} calibrating rows={ROWS}" for channel in FOUR]
    first = board.said[-1][0]
    board.until(" calibrated r=", 4)
    read = [(row, read_calibration(text)) for row, text in board.said]
    answers = {answer.name: (row, answer) for row, answer in read if isinstance(answer, Calibrated)}
    z = np.array(board.rows)[:, ::2]
    for i, channel in enumerate(FOUR):
        name = channel.name
        row, found = answers[name]
        expected = measure(z[first:row, i], *COUNTS)
        assert found.r.view(np.uint32) == expected.r.view(np.uint32), name
        assert (found.samples, found.spikes, found.missing) == (expected.used, expected.spikes, expected.missing)
        assert found.q == np.float32(channel.q / channel.r) * found.r
        assert found.r == pytest.approx(noise_from_still(z[row - found.rows : row, i], 1.0).r, rel=0.01)
    assert answers["spiky"][1].spikes > 1
    assert answers["spiky"][1].missing > 3
    for used, (_, found) in zip(values(board, 4), answers.values(), strict=True):
        assert (used.q, used.r, used.p0) == (found.q, found.r, np.inf)


def test_a_refusal_says_why_and_keeps_the_old_values_while_the_filter_goes_on(start_board, workshop):
    unplugged = noise(3.0)
    unplugged[200:] = 0.0
    counts = as_counts(
        noise(3.0) + np.arange(2000) / 20,
        unplugged,
        np.full(2000, 1023.0),
        noise(1.0) + 3.0 * np.sin(np.arange(2000) * 0.9),
        np.where(np.arange(2000) < 250, noise(2.0), noise(2.0, 900.0)),
        np.where(np.arange(2000) < 250, noise(2.0), noise(8.0)),
    )
    names = ("drift", "unplugged", "saturated", "hum", "jump", "shaken")
    channels = [ChannelTuning(name, "", 0.25, 4.0) for name in names]
    firmware = exported(workshop, *channels, edits=(*FAST, MISSING), calibration=True)
    board = Talk(start_board(firmware, counts, *FLAT_OUT))
    board.ask(f"c {SECONDS}", " not calibrated: ", 6)
    read = [read_calibration(text) for _, text in board.said]
    said = {answer.name: answer.reason for answer in read if isinstance(answer, NotCalibrated)}
    measured = 8 * ((ROWS - 16) // 9)
    assert said == {
        "drift": "the level moves",
        "unplugged": f"no reading in {measured // 10 + 1} of {measured} samples",
        "saturated": f"{measured} of {measured} readings at an end of the range",
        "hum": "neighbouring readings depend on each other",
        "jump": f"spikes in {measured // 20 + 1} of {measured} samples",
        "shaken": "the noise is uneven",
    }
    for command, words in (("c 0.05", "too short; 0.09 s at least"), ("c 99", "too long; 72.01 s at most")):
        assert words in board.ask(command, " not calibrated: ", 6)[-1]
    board.ask("2 c 0.2", "unplugged calibrating rows=196")
    board.ask("2 c 0", "unplugged not calibrated: cancelled")
    for line in ("c", "c -1", "c nan", "c inf", "7 c 1", "k 1", "2 k", "cf"):
        board.ask(line, "# not understood")
    assert {(used.q, used.r, used.p0) for used in values(board, 6)} == {(0.25, 4.0, np.inf)}


BY_ITSELF = (
    (r"(?<=KALSCOPE_CALIBRATE_PIN) -1", " 2"),
    (r"(?<=KALSCOPE_CALIBRATE_S) 10", f" {SECONDS}"),
    (r"(?<=KALSCOPE_CALIBRATE_KEEP) 0", " 1"),
)
SPOILED = (
    (r"(?=void printBits)", "uint16_t worn = 0xFFFF;\n"),
    (r"if \(EEPROM.read\(at\) != value\)", "if (at != worn && EEPROM.read(at) != value)"),
    (r"(?=  if \(strcmp\(line, .k.\) == 0\))", "  if (*line == 'w') EEPROM.write(atoi(line + 1), 0x55);\n"),
    (r"(?=  if \(strcmp\(line, .f.\) == 0\))", "  if (*line == 'v') worn = atoi(line + 1);\n"),
)
"""Commands that break the EEPROM: `w 5` writes nonsense into a cell, from `v 5` on a cell holds what it has."""


def test_kept_values_survive_a_reset_unless_they_are_forgotten_damaged_or_anothers(start_board, workshop):
    channel = ChannelTuning("light", "", 0.25, 4.0, momentum=20.0)
    firmware = exported(workshop, channel, edits=(*FAST, *BY_ITSELF, *SPOILED), calibration=True)
    uno = start_board(firmware, as_counts(noise(3.0)), *FLAT_OUT, "--low", 2)
    board = Talk(uno)

    def started():
        """What it says from a reset to the names of its columns."""
        uno.reset()
        board.said.clear()
        board.until("raw,filtered")
        begin = f"# light calibrating rows={ROWS}"
        texts = [text for _, text in board.said]
        assert texts[-2:] == [begin, "# raw,filtered"]
        return texts[:-2]

    board.until("# kept 1 channel")
    found = next(answer for _, text in board.said if isinstance(answer := read_calibration(text), Calibrated))
    (used,) = values(board, 1)
    assert (used.q, used.r, used.momentum) == (np.float32(0.0625) * found.r, found.r, 20.0)
    assert used.q != channel.q
    kept, told = started()
    assert (kept, read_values(told)) == ("# kept values are in use", used)
    board.ask("w9", "# not understood")
    assert started() == ["# kept values refused: they are damaged"]
    assert values(board, 1)[0].r == 4.0
    board.ask("k", "# kept 1 channel")
    board.ask("w0", "# not understood")
    assert started() == ["# kept values refused: they are another sketch's"]
    board.ask("v9", "# not understood")
    board.ask("r 5", "bits=")
    board.ask("k", "# not kept: the EEPROM does not hold what was written")
    board.ask("f", "# forgotten")
    assert started() == []
    assert values(board, 1)[0].r == 4.0
