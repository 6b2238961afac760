"""The attack table against the real program, one row a case; and the table in the docs says the same."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from attack_table import ATTACKS, kalscope, seen_by

DOCS = Path(__file__).parents[3] / "docs" / "project" / "security.md"


@pytest.fixture(scope="module")
def victim():
    with kalscope() as running:
        yield running


@pytest.mark.parametrize("number", ATTACKS)
def test_attack(victim, number):
    attack = ATTACKS[number]
    assert (attack.what, seen_by(attack, victim)) == (attack.what, attack.expected)


def test_the_docs_have_this_table():
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in DOCS.read_text("utf-8").splitlines()
        if line.startswith("| ")
    ]
    told = {row[0]: (row[1], row[3], row[4]) for row in rows if row[0] in ATTACKS}
    assert told == {number: (row.what, row.expected, row.expected) for number, row in ATTACKS.items()}


ROOT = Path(__file__).parents[3]
PROMISED = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", (ROOT / "SECURITY.md").read_text("utf-8"))


def test_every_promise_names_a_test():
    rows = [line for line in (ROOT / "SECURITY.md").read_text("utf-8").splitlines() if line.startswith("| ")]
    assert len(rows) > 10
    assert [row for row in rows[1:] if "`tests/" not in row] == []


@pytest.mark.parametrize(("file", "name"), PROMISED)
def test_the_test_behind_a_promise_exists(file, name):
    assert f"def {name or 'test_'}" in (ROOT / file).read_text("utf-8")
