"""The attack table against the real program, one row a case; and the tests that SECURITY.md promises exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.app.attack_table import ATTACKS, kalscope, seen_by


@pytest.fixture(scope="module")
def victim():
    with kalscope() as running:
        yield running


@pytest.mark.parametrize("number", ATTACKS)
def test_attack(victim, number):
    attack = ATTACKS[number]
    assert (attack.what, seen_by(attack, victim)) == (attack.what, attack.expected)


ROOT = Path(__file__).parents[3]
PROMISED = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", (ROOT / "SECURITY.md").read_text("utf-8"))


@pytest.mark.parametrize(("file", "name"), PROMISED)
def test_the_test_behind_a_promise_exists(file, name):
    assert f"def {name or 'test_'}" in (ROOT / file).read_text("utf-8")
