"""Long ("tidy") tables: one value per row, beside the name of what was measured, as databases export them.

Home Assistant writes `entity_id,state,last_changed`, InfluxDB `_time,_value,_field,_measurement` and tags, others
time, name, value and perhaps the unit.
"""

from __future__ import annotations

from dataclasses import replace

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.grammar.units import words
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.rows.kinds import Cells

MAX_SERIES = 256
"""Distinct names that are read from one long table."""

UNIT_NAMES = words("unit units unit_of_measurement uom")
"""Names of a column that holds the unit of each value, lower case."""

_NAMES = words(
    """
    name entity entity_id sensor sensor_id sensor_name sensorname field _field _measurement measurement key variable
    parameter channel signal metric tag topic series quantity attribute point
    """
)
_VALUES = words("value _value state reading val sensor_value measured_value")
_NO_TAGS = words("result table _start _stop")
_MIN_ROWS = 4


def mark_series(
    columns: list[Column], rows: list[Cells], time: TimeColumn | None, decimal: str
) -> tuple[list[Column], tuple[str, ...]]:
    """The columns of a long table with the role "series" for those that name the value, and a note about it.

    Any other table is returned unchanged. Few tables are long, so the rule is strict: a column named as such holds
    repeated texts, one named as such holds the values, and no other column but the time holds numbers.
    """
    bases = ["_".join(column.name.lower().split()) for column in columns]
    times = time.indices if time is not None else ()
    values = [i for i, base in enumerate(bases) if base in _VALUES and i not in times]
    by_field = "_field" in bases and "_value" in bases  # InfluxDB: its other texts are tags
    texts = [i for i, column in enumerate(columns) if column.role == "text" and i not in times]
    names = [i for i in texts if bases[i] in _NAMES and i not in values]
    numbers = [i for i, column in enumerate(columns) if column.role == "channel" and i not in (*times, *values)]
    if len(values) != 1 or not names or (numbers and not by_field) or len(rows) < _MIN_ROWS:
        return columns, ()
    series = [i for i in texts if by_field and bases[i] not in _NO_TAGS] or names
    series = sorted({*series, *(i for i in texts if bases[i] in UNIT_NAMES)} - {*values})
    distinct = {tuple(row[i] for i in series) for row in rows}
    if len(distinct) > len(rows) / 2 or not any(is_number(row[values[0]], decimal) for row in rows):
        return columns, ()
    marked = [
        replace(column, role="series" if i in series else "channel" if i in values else column.role)
        for i, column in enumerate(columns)
    ]
    marked = [replace(column, role="text") if i in numbers else column for i, column in enumerate(marked)]
    said = ", ".join(f'"{columns[i].name}"' for i in series)
    return marked, (f"each row holds one value, named by {said}",)
