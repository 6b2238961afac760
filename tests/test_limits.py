"""Each figure of limits.md is the constant that is named beside it."""

import re
from importlib import import_module
from pathlib import Path

import pytest

PAGE = Path(__file__).with_name("limits.md")
SIZES = {"KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}
ROW = re.compile(r"\| ([^|]+) \| ([^|]+) \| ([^|]+) \| `([\w.]+)\.(\w+)` \|")
FIGURE = re.compile(r"([0-9][0-9,.]*) ?(KiB|MiB|GiB)?")
LIMITS = PAGE.read_text("utf-8")
ROWS = ROW.findall(LIMITS)


def figure(text):
    """The first figure of a cell."""
    found = FIGURE.search(text)
    return found and float(found[1].replace(",", "")) * SIZES.get(found[2], 1)


@pytest.mark.parametrize(("of", "most", "beyond", "module", "name"), ROWS, ids=[row[0] for row in ROWS])
def test_the_page_states_the_limit_that_holds(of, most, beyond, module, name):
    value = getattr(import_module(module), name)
    assert value in (figure(most), figure(beyond)), (of, value)


def test_each_row_of_the_page_is_compared():
    rows = [line for line in LIMITS.splitlines() if line.startswith("| ")]
    assert len(ROWS) == len(rows) - 2 > 40  # without the headings
