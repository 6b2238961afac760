"""Words in calendar stamps: months and weekdays in English, German, French and Spanish, and names of time zones."""

from __future__ import annotations

_NAMES = (
    "jan january januar jän jänner janv janvier ene enero",
    "feb february februar fév févr fevr février feber febrero",
    "mar march mär märz mrz maerz mars marzo",
    "apr april avr avril abr abril",
    "may mai mayo",
    "jun june juni juin junio",
    "jul july juli juil juillet julio",
    "aug august août aout ago agosto",
    "sep sept september septembre septiembre",
    "oct october okt oktober octobre octubre",
    "nov november novembre noviembre",
    "dec december dez dezember déc décembre dic diciembre",
)

MONTHS = {name: number for number, names in enumerate(_NAMES, 1) for name in names.split()}
"""Number of the month of a name, lower case, 1 … 12."""

WEEKDAYS = frozenset("mo tu we th fr sa su di mi do so lu ma me je ve".split())  # noqa: SIM905
"""The first two letters of the weekdays, lower case."""

ZONES_H = {
    **dict.fromkeys(("Z", "UTC", "GMT", "UT", "WET", "LST"), 0.0),  # LST: local standard time, no zone is known
    **dict.fromkeys(("CET", "MEZ", "BST", "WEST"), 1.0),
    **dict.fromkeys(("CEST", "MESZ", "EET"), 2.0),
    **dict.fromkeys(("EEST", "MSK"), 3.0),
    **dict.fromkeys(("SGT", "HKT", "AWST"), 8.0),
    **dict.fromkeys(("JST", "KST"), 9.0),
    **dict.fromkeys(("AEST",), 10.0),
    **dict.fromkeys(("AEDT",), 11.0),
    **dict.fromkeys(("NZST",), 12.0),
    **dict.fromkeys(("NZDT",), 13.0),
    **dict.fromkeys(("IST",), 5.5),
    **dict.fromkeys(("EDT",), -4.0),
    **dict.fromkeys(("EST", "CDT"), -5.0),
    **dict.fromkeys(("CST", "MDT"), -6.0),
    **dict.fromkeys(("MST", "PDT"), -7.0),
    **dict.fromkeys(("PST", "AKDT"), -8.0),
    **dict.fromkeys(("AKST",), -9.0),
    **dict.fromkeys(("HST",), -10.0),
}
"""Hours that a zone is ahead of UTC. Where a name is used twice (CST, IST), the changes of one log still come out
right: winter and summer time differ by an hour."""
