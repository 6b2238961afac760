"""The attack table against the real program, one row a case; and the table in the docs says the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from attack_table import ATTACKS, kalscope, seen_by

DOCS = Path(__file__).parents[2] / "docs" / "security.md"


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
