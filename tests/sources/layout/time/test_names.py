"""What the name of a column says about time."""

from each import each

from kalscope.sources.reading.columns import named_column
from kalscope.sources.reading.time_columns import time_name


@each(
    ("name", "strength", "unit"),
    [
        ("t", 2, ""),
        ("t [us]", 2, "us"),
        ("time_ms", 2, "ms"),
        ("timeMs", 2, "ms"),
        ("TimeUS", 2, "us"),
        ("time_boot_ms", 2, "ms"),
        ("Time (UTC)", 2, ""),
        ("Timestamp (ms)", 2, "ms"),
        ("Time in seconds", 2, "s"),
        ("Time in milliseconds", 2, "ms"),
        ("elapsed [min]", 2, "min"),
        ("Elapsed Time (s)", 2, "s"),
        ("seconds_elapsed", 2, "s"),
        ("Device Time", 2, ""),
        ("Date/Time", 2, ""),
        ("Timestamp (Formatted)", 2, ""),
        ("millis", 2, "ms"),
        ("Second", 2, "s"),
        ("T [s]", 2, "s"),
        ("T", 0, ""),
        ("T [K]", 0, ""),
        ("year", 1, "year"),
        ("Day", 1, "day"),
        ("reaction_time_ms", 1, "ms"),
        ("Trip Time(Since journey start)(s)", 1, "s"),
        ("h", 0, ""),
        ("hour", 0, ""),
        ("d", 0, ""),
        ("min", 0, ""),
        ("temp", 0, ""),
        ("temps", 0, ""),
        ("light", 0, ""),
        ("datasheet", 0, ""),
        ("", 0, ""),
    ],
)
def test_a_name_hints_at_a_time_and_its_unit(name, strength, unit):
    found = time_name(named_column(name))
    assert (found.strength, found.unit) == (strength, unit)
