"""Store the truths again, after a change that was meant to change them: `python tests/truth/store.py [SET …]`.

It prints what differs from the stored cases; read that before the commit. Where shared/data is not beside the
repository, the cases of its recordings stay as they are.
"""

from __future__ import annotations

import json
import sys
from itertools import chain
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.truth.truth_cases import HERE, ROOTS, SETS, changes, groups_of, stored


def store(name: str) -> None:
    """Write one set."""
    old, new = stored(name), {}
    for group, make in groups_of(name).items():
        cases = list(make())
        new[group] = {case["id"]: case for case in cases}
        assert len(new[group]) == len(cases), f"two cases of {group} have one id"
    if not ROOTS["shared"].is_dir():
        new |= {group: cases for group, cases in old.items() if group.startswith("shared/")}
    for group in sorted({*old, *new}):
        for line in chain(*changes(old.get(group, {}), new.get(group, {}))):
            print(line)
    cases = (case for group in sorted(new) for case in new[group].values())
    lines = (json.dumps(case, ensure_ascii=False, allow_nan=False) + "\n" for case in cases)
    (HERE / f"{name}.jsonl").write_text("".join(lines), "utf-8")


if __name__ == "__main__":
    for one in sys.argv[1:] or SETS:
        store(one)
