"""Commands, answers and rows of a board as texts, and one that measures its noise; tests/device has real boards."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.measuring_board import MeasuringBoard
from tests.support.waiting import wait_until

from kalscope import BadSetting, FilterParams
from kalscope.common.progress import Progress
from kalscope.errors import BadDevice, Cancelled
from kalscope.estimation.noise import noise_from_still
from kalscope.export import board as boards
from kalscope.export.float32 import Float32Params, filter_float32, float32_params, without_momentum
from kalscope.sources.live.source import LiveSource

F = np.float32


def test_a_command_says_the_float32_exactly_and_fits_the_line_of_a_board():
    rng = np.random.default_rng(2)
    values = rng.integers(0x00800000, 0x7E000000, (500, 3), dtype=np.uint32).view(np.float32)
    for q, r, p0 in values:
        tau = F(10.0 ** rng.uniform(-3, 5))
        momentum = replace(without_momentum(q), momentum=tau)
        lines = boards.commands(Float32Params(q, r, p0, momentum=momentum), channel=6, knows_momentum=True)
        assert max(map(len, lines)) <= 30  # letters that the exported sketch takes in a line
        said = {line.split()[1]: F(line.split()[2]) for line in lines}
        assert said == {"q": q, "r": r, "t": tau, "p": p0}


def test_momentum_goes_to_a_board_that_knows_it_only_and_is_switched_off_there():
    plain, held = (float32_params(FilterParams(0.5, 4.0, momentum=momentum)) for momentum in (0.0, 20.0))
    assert boards.commands(plain) == ("q 0.5", "r 4", "p inf")
    assert boards.commands(float32_params(FilterParams(0.0, 4.0))) == (
        "r 4",
        "q 0",
        "p inf",
    )  # zero after the other
    assert boards.commands(plain, knows_momentum=True) == ("q 0.5", "r 4", "t 0", "p inf")
    assert boards.commands(held, 2, knows_momentum=True) == ("2 q 0.5", "2 r 4", "2 t 20", "2 p inf")
    with pytest.raises(BadSetting, match=r"momentum must be 0 for this board, .* \(got 20 samples\): export"):
        boards.commands(held)
    with pytest.raises(BadSetting, match=r"at least 0.001 samples for a board \(got 0.0001\)"):
        boards.commands(float32_params(FilterParams(0.5, 4.0, momentum=1e-4)), knows_momentum=True)


def test_an_answer_says_which_filter_the_board_runs():
    """With momentum, behind a median, or one that takes no values."""
    line = "# light q=1.000000e-2 r=4.000000 p=inf t=20.000000 m=5 bits=3C23D70A,40800000,7F800000,41A00000\r\n"
    answer = boards.read_answer(line)
    assert answer == boards.BoardAnswer("light", F(0.01), F(4.0), F(np.inf), F(20.0), 5)
    asked = float32_params(FilterParams(1e-14, 4.0, gate=9.0, momentum=10.0))
    used = answer.applied_to(asked)
    assert (used.q, used.r, used.gate, used.median) == (F(0.01), F(4.0), F(9.0), 5)
    assert used.momentum == boards.momentum_on_board(F(0.01), F(20.0))
    assert replace(answer, momentum=F(0.0)).applied_to(asked).momentum is None
    plain = boards.read_answer(line.replace(" t=20.000000 m=5", "").replace(",41A00000", ""))
    assert plain == boards.BoardAnswer("light", F(0.01), F(4.0), F(np.inf))
    fixed = "# tilt takes no values while it runs: export the sketch again to change it\r\n"
    assert boards.read_answer(fixed) == boards.FixedFilter("tilt")


def test_any_other_line_is_no_answer():
    for line in (
        "512.0,500.5",
        "# raw,filtered",
        "# too slow: samples left out: 3",
        "# a q=1 r=1 p=1 bits=1,2,3",
        "",
    ):
        assert (boards.read_answer(line), boards.is_refusal(line)) == (None, False)


PARAMS = Float32Params(F(0.01), F(4.0))


@pytest.mark.parametrize("params", [PARAMS, replace(PARAMS, p0=F(2.0), x0=F(500.0))])
def test_from_its_restart_on_a_board_is_equal_or_its_distance_is_told(params):
    rng = np.random.default_rng(5)
    raw = rng.integers(0, 1024, 500).astype(F)
    before = np.cumsum(rng.random(100)).astype(F) + F(0.37)  # another filter, before the restart
    board = np.concatenate([before, filter_float32(raw[100:], params)])
    assert boards.check_board(raw, board, params) == boards.BoardCheck(400, 0, 0.0)
    exact = float(board[300])
    board[300] = np.nextafter(board[300], F(np.inf))
    assert boards.check_board(raw, board, params) == boards.BoardCheck(400, 1, float(board[300]) - exact)
    assert boards.check_board(raw[:100], board[:100], params) is None
    other = replace(params, q=F(0.0100001))
    assert boards.check_board(raw, board, other).different > 100
    raw[200] = np.nan
    board[100:] = filter_float32(raw[100:], params)
    board[250] = np.nan  # a line that was rejected
    assert boards.check_board(raw, board, params) == boards.BoardCheck(399, 0, 0.0)


@pytest.mark.parametrize("resting", [0, 1, 8, 200])
def test_a_restart_while_the_input_rests_is_found_where_it_was(resting):
    """The old filter has come to rest on the input: each of its rows looks like a start."""
    old, new = Float32Params(F(1.0), F(1.0)), Float32Params(F(1e-4), F(1.0))
    rest, later = np.full(200 + resting, 512.0), np.concatenate([np.full(20, 512.0), 512 + np.arange(400.0) % 300])
    board = np.concatenate([filter_float32(rest, old)[200:], filter_float32(later, new)])
    check = boards.check_board(np.concatenate([rest[200:], later]), board, new)
    assert check.different == 0
    assert check.rows >= len(later)
    board[-1] += 1.0
    assert boards.check_board(np.concatenate([rest[200:], later]), board, new).different == 1


GOOD = "# light calibrated r=1.234560e+01 q=1.234560e-03 n=1997 spikes=3 missing=0 step=1.000000 bits=BITS"
ANSWER = boards.Calibrated("light", np.float32(12.3456), np.float32(1.23456e-3), np.float32(1.0), 1997, 3, 0)
OTHER = ["# light q=1.0 r=2.0 p=inf bits=3F800000,40000000,7F800000", "# light calibrating rows=2016"]
OTHER += [f"# light not calibrated: {text}" for text in ("\x1b[31mred", "x" * 200)]


def bits_of(*values):
    return ",".join(f"{np.float32(value).view(np.uint32):08X}" for value in values)


def test_every_answer_is_read_and_nothing_else():
    good = GOOD.replace("BITS", bits_of(12.3456, 1.23456e-3, 1.0))
    assert boards.read_calibration(good) == ANSWER
    refusal = "# light not calibrated: the level moves"
    assert boards.read_calibration(refusal) == boards.NotCalibrated("light", "the level moves")
    bad = [GOOD.replace("BITS", bits_of(*values)) for values in ((0.0, 1e-3, 1.0), (12.0, -1.0, 1.0))]
    bad += [refusal.replace("# ", "#"), good.replace("n=1997 ", ""), good.replace("n=1997", "n=0")]
    assert [boards.read_calibration(line) for line in (*OTHER, *bad)] == [None] * 9


def test_an_impossible_time_is_refused():
    assert boards.calibration_command(None, 3) == "3 c 0"
    for seconds in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(BadSetting, match="the time to measure for must be above 0 s"):
            boards.calibration_command(seconds)


@pytest.fixture
def connected():
    """A board, and the source that reads it."""
    opened = []

    def connect(*args, **options):
        board = MeasuringBoard(*args, **options).__enter__()
        source = LiveSource(board.port)
        opened.extend([source.close, board.unplug])
        source.start(require=True)
        wait_until(lambda: source.snapshot() is not None and len(source.snapshot().recording) > 20)
        return board, source

    yield connect
    for close in opened:
        close()


@pytest.mark.slow
def test_both_figures_are_of_the_same_samples_and_each_channel_has_its_own(connected):
    board, source = connected(("light", "temp"))
    told = []
    one = boards.measure(source, "temp", 2.0, Progress(lambda fraction, _text: told.append(fraction)))
    both = boards.measure(source, None, 2.0, Progress())
    assert [line for line in board.asked if "c" in line] == ["2 c 2", "c 2"]
    assert [[each.answer.name for each in found] for found in (one, both)] == [["temp"], ["light", "temp"]]
    for each in (*one, *both):
        assert (each.answer.rows, each.here.samples) == (336, each.answer.samples)
        assert np.float32(each.here.r) == each.answer.r
    assert both[0].answer.r != both[1].answer.r
    assert [*told, 1.0] == sorted([*told, 1.0])


@pytest.mark.slow
def test_what_keeps_a_board_from_measuring_is_said_and_nothing_waits_for_ever(connected, monkeypatch):
    board, source = connected()
    board.knows = False
    with pytest.raises(BadDevice, match="cannot measure by itself: export the Arduino sketch with self-calib"):
        boards.measure(source, "light", 2.0, Progress())
    board.knows = True
    with pytest.raises(BadSetting, match="sends no filtered column for light_filtered"):
        boards.measure(source, "light_filtered", 2.0, Progress())
    (short,) = boards.measure(source, "light", 0.1, Progress())
    assert short.answer == boards.NotCalibrated("light", "too short; 0.44 s at least")
    board.refuses = "the level moves"
    (refused,) = boards.measure(source, "light", 2.0, Progress())
    assert (refused.answer.reason, refused.here) == ("the level moves", None)
    board.refuses = ""
    board.mute, board.remark = ("light",), "# other calibrating rows=5"  # no answer among remarks without end
    monkeypatch.setattr(boards, "ANSWER_S", 0.1)
    with pytest.raises(BadDevice, match=r"the board did not answer 'c 0\.5' within 1\.1 s"):
        boards.measure(source, "light", 0.5, Progress())
    assert [answer.name for answer in boards.values_in_use(source)] == ["light"]
    board.mute, board.remark = (), ""
    with pytest.raises(Cancelled, match="the board keeps its values"):
        boards.measure(source, "light", 300.0, Progress(cancelled=lambda: "c 300" in board.asked))
    wait_until(lambda: board.asked[-1] == "c 0")
    monkeypatch.setattr(boards, "_CANCEL_S", 0.1)

    def falls_deaf():
        board.deaf = "c 300" in board.asked[asked:]
        return board.deaf

    asked = len(board.asked)
    with pytest.raises(Cancelled, match="the board did not confirm it: it may still use what it measures"):
        boards.measure(source, "light", 300.0, Progress(cancelled=falls_deaf))
    board.deaf = False

    def unplugged(_fraction, _text):
        if board.asked[-1] == "c 300":
            board.unplug()

    with pytest.raises(BadDevice, match="the board was disconnected before it answered"):
        boards.measure(source, "light", 300.0, Progress(unplugged))


@pytest.mark.slow
def test_a_cancelled_measurement_names_what_the_board_has_measured_already(connected, monkeypatch):
    """Also where the board says so only now, before it obeys."""
    board, source = connected(("light", "temp"))
    board.mute, waiting = ("temp",), []
    found, answers = board._found, board._answers
    monkeypatch.setattr(board, "_found", lambda *args: waiting.append(found(*args)) or "")
    monkeypatch.setattr(board, "_answers", lambda line: [*filter(None, waiting), *answers(line)])
    with pytest.raises(Cancelled, match=r"but the board already uses what it measured of light$"):
        boards.measure(source, None, 1.0, Progress(cancelled=lambda: board.uses("light") != 1.0))


def test_the_words_name_both_figures():
    here = noise_from_still(np.random.default_rng(1).normal(20.0, 0.0411, 2000))
    answer = replace(ANSWER, r=np.float32(here.r * 1.005), q=np.float32(1e-5))
    text = boards.measured_text(boards.Measurement(answer, here), "°C")
    assert "q = 1.000e-5 °C²; from 1\u202f997 samples, 3 spikes left out, 0 missing. σ = 0.04" in text
    assert text.endswith(" here: equal within 0.25 %.")
    text = boards.measured_text(boards.Measurement(replace(ANSWER, r=np.float32(1.0 / 12.0))), "")
    assert "The readings hardly change: this is their rounding. Its samples did not arrive here, so" in text
    refused = boards.measured_text(boards.Measurement(boards.NotCalibrated("light", "the level moves")), "")
    assert refused == "The board keeps its values: the level moves."
