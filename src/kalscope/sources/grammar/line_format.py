"""How one line of a source may be written, and how it is split: tables, labels, equalities, JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import islice
from string import hexdigits
from typing import Any, Literal, NamedTuple, cast

from kalscope.sources.grammar.cells import MISSING, is_measure, is_number, split_measure

# JSON as pairs of a name and a text: one object per line, as boards and MQTT loggers write it.


MAX_VALUES = 256
"""Values of one object; one with more is not a row of samples."""


def load_json(text: str) -> Any:
    """The value that a JSON text holds, its numbers left as they are written.

    Raises:
        ValueError: it is not JSON, or nested too deep.
    """
    try:
        return json.loads(text, parse_float=str, parse_int=str, parse_constant=str)
    except RecursionError:
        raise ValueError("JSON nested too deep") from None


def find_object(line: str) -> list[tuple[str, str]] | None:
    """The values of an object with their full names; None for any other line.

    `{"t": 1, "imu": {"acc": [0.1, 9.8]}}` holds t, imu.acc[0] and imu.acc[1]; `{'t': 1}` is how Python prints one.
    """
    if line.lstrip().startswith("{'"):
        for word, of_json in (("'", '"'), (" None", " null"), (" True", " true"), (" False", " false")):
            line = line.replace(word, of_json)
    try:
        value = load_json(line)
    except ValueError:
        return None
    return flattened(value) if isinstance(value, dict) else None


def flattened(value: Any) -> list[tuple[str, str]] | None:
    """(full name, text) of each value of an object; None where it holds none, or more than MAX_VALUES."""
    try:
        pairs = list(islice(_values("", value), MAX_VALUES + 1))
    except RecursionError:
        return None
    return pairs if 0 < len(pairs) <= MAX_VALUES else None


def _values(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, part in cast("dict[str, Any]", value).items():
            yield from _values(f"{name}.{key}" if name else key, part)
    elif isinstance(value, list):
        for i, part in enumerate(cast("list[Any]", value)):
            yield from _values(f"{name}[{i}]", part)
    else:
        yield name, _text(value)


def _text(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else " ".join(str(value).split())


# The pairs of a line that names its values: labels, equalities, JSON, and numbers followed by their units.
#
# Pure functions on one line of text.


Pairs = list[tuple[str, str]]

MAX_PARTS = 2048
"""Commas, semicolons and tabs of a line."""

_AFTER_LIST = re.compile(r"(, ?[-+0-9.]{1,20}) (?=[A-Za-z_]{1,30}[:=])")
_WORD = re.compile(r'(?:[^\s"]|"[^"]*")++')
_LEVEL = re.compile(r"(?:[0-9a-f]{2} ){5,16}(?=\w=)|\[?(?:TRACE|DEBUG|INFO|NOTICE|WARN|WARNING|ERROR)\]?:?[ \t]+")
"""What a logger writes before its text, and bytes before the value that they hold: `4b 46 7f ff 0e t=23125`."""
_ESPHOME = re.compile(
    r"(?:\[[^\]\s]{0,40}\]){0,3}:?[ ]?'([^']{1,60})'(?:: Sending state| >>) (\S{1,24}(?: [^\s0-9]{1,8})?)"
    r"(?: with [0-9]{1,2} decimals of accuracy)?"
)
"""`[D][sensor:094]: 'Barn': Sending state 20.5 °C with 1 decimals of accuracy`, `'Barn' >> 20.5 °C`: ESPHome."""
_CHANGED = re.compile(
    r"(?:[A-Z][a-z]{1,20} )?'([^']{1,60})' (?:changed from .{1,40} to|received (?:update|command)|updated to)"
    r" ([^\s0-9]?[0-9]\S{0,20}(?: [^\s0-9]{1,8})?)(?: \(.{1,60}\))?"
)
"""`Item 'Barn' changed from 20.0 °C to 20.5 °C`, `Item 'Barn' received update 20.5`: openHAB."""
_LINE_PROTOCOL = re.compile(
    r"((?:\\.|[^\s=\",\\]){1,200}(?:,(?:\\.|[^\s\"\\]){1,400})?) ([^\s=,]+=[^\s=,]+(?:,[^\s=,]+=[^\s=,]+){0,63})"
    r" ([0-9]{10,19})"
)
"""`weather,loc=us temp=21.5,hum=40i 1709630000000000000`: InfluxDB."""
SERIES_KEY = "series key"
"""The label of its measurement and tags, which say of which sensor the fields are."""
_TOPIC = re.compile(r"([A-Za-z$][^\s,;:=\"{/]{0,99}/[^\s,;:=\"{]{0,200}) (\S{1,40})")
"""`home/barn/temperature 21.5`: what mosquitto_sub -v writes."""
_REMARK = re.compile(r"[ \t]\([a-z0-9][^()]{1,80}\)(?:[ \t]{1,4}[a-z]{1,20} = [a-z ]{1,20})?$")
"""`Core 0: +42.0°C  (high = +80.0°C, crit = +100.0°C)`: lm-sensors."""
_DEVICE = re.compile(r"(?:[A-Za-z]{1,20} )?(?:[0-9]{2}-)?(?=[A-Fa-f]{0,8}[0-9])[0-9A-Fa-f]{12,16} (?=\S)")
"""`Device 28FF641E8D3C0C7A Temp C: 21.0 Temp F: 69.8`: all values of the line are of this device."""
_OF = re.compile(r"(?<![/0-9.])([0-9.]{1,12}) ?/([0-9.]{1,12})(?![/0-9.])")
"""A value and what it is compared with: `T:20.9 /210.0` of Marlin, `Quality=43/70`."""
_CELL = re.compile(r'[,;](?! )|"')
"""What shows that the text before an object is a cell of a table, not what a logger writes."""


def find_pairs(line: str) -> Pairs | None:
    """(label, value text) pairs of `a:1,b:2`, `a: 1 b: 2`, `Sensor Value: 155, Volts: 0.76`, `a=1 b=2`, `{"a":1}`.

    None if anything else is on the line, such as a number that has no label, or a label is a number (`12:30:05`).
    """
    is_endless = len(line) > MAX_PARTS and sum(map(line.count, ",;\t")) > MAX_PARTS
    if is_endless or not any(mark in line for mark in (":", "=", "/", ">>", "' ")):
        return None
    if line[:1].isdecimal() and line.isascii() and line.lower() == line.upper():
        return None  # a number and no letter, as in a table with a clock
    text = _LEVEL.sub("", line.strip().lstrip("!*>").lstrip(), count=1)
    if text.startswith("{"):
        return find_object(text.removesuffix(","))
    found = _logged(text)
    text = text.replace(" *C", " C").replace(" *F", " F")  # boards that lack a degree sign
    text = _REMARK.sub("", text[1:-1] if text[0] + text[-1] == "<>" else text)
    for mark in ("=", ":") if text.count('"') % 2 == 0 else ():
        found = found or _labelled(text, mark)
    return found


def _labelled(text: str, mark: str) -> Pairs | None:
    """The pairs of a text, this mark between label and value; the commas of `T=20,5;H=40,1` are decimal ones."""
    is_decimal = text.count(mark) > 1 and len(re.findall(r"[0-9],[0-9]", text)) == text.count(",")
    is_decimal = is_decimal and not re.search(r"[0-9]\.[0-9]", text)
    pairs, size = Pairs(), 0
    text = _AFTER_LIST.sub(r"\1,", _OF.sub(r"\1 /\2", text))
    for part in re.split(r"[;&|\t]" if is_decimal else r"[,;&|\t]", text):
        found = _pairs(part, mark) if part.strip() else []
        if found is None and not pairs and part.isalpha():
            continue  # `Idle|MPos:0,0,0` of Grbl
        if found is None and pairs and _is_list(pairs[-1 - size], part.strip()):
            pairs.append((f"{pairs[-1 - size][0]} {size + 2}", part.strip()))  # `acc: 0.1, 0.2, 9.8`
            size += 1
            continue
        if found is None or len(pairs) > MAX_VALUES:
            return None
        pairs, size = pairs + found, 0
    return _with_axes(pairs) if pairs else None


def _is_list(first: tuple[str, str], more: str) -> bool:
    """Whether a value without a label goes on with those of the label before, which is no clock."""
    label, value = first
    return _is_value(more) and _is_value(value) and label[0].isalpha() and not is_number(label.split()[-1])


def _pairs(text: str, mark: str) -> Pairs | None:
    """The pairs that blanks separate: `ax=0.1 ay=-2.0`, `Temp: 21.5 C Rel Hum: 40 %`; of a single one any text."""
    groups: list[list[str]] = [[]]  # the words between the marks: a value, then the next label
    for word in (match[0] for match in _WORD.finditer(text)):
        before, found, after = word.partition(mark)
        is_whole = before.isdecimal() and mark in after
        if not found or (
            mark == ":" and len(groups) > 1 and (is_whole or (not groups[-1] and word[0].isdecimal()))
        ):
            groups[-1].append(word)
            continue
        if is_whole:  # `ets Jun  8 2016 00:22:57` of an ESP32: a clock, not a label
            return None
        groups[-1] += [before] if before else []
        groups.append([after] if after else [])
        if len(groups) > MAX_VALUES + 1:
            return None
    label, pairs = " ".join(groups[0]), list[tuple[str, str]]()
    for k, words in enumerate(groups[1:], 2):
        body, begin = (words, []) if k == len(groups) else (words[:-1], words[-1:])
        values, rest = _leading_values(body) if len(groups) > 2 else ([" ".join(body)], [])
        if not values and (not body or " " not in label):  # nothing, or a text
            values, rest = [" ".join(body[:1])], body[1:]
        unread = bool(rest) and (k == len(groups) or any(map(is_number, rest)))
        if not 0 < len(label) <= 60 or is_number(label) or not values or unread or values[0][:1] == "=":
            return None
        pairs += [(label if n == 1 else f"{label} {n}", value.strip('"')) for n, value in enumerate(values, 1)]
        label = " ".join(rest + begin)
    device = pairs and _DEVICE.match(pairs[0][0])
    if device:
        pairs = [pairs[0], *((device[0] + label, value) for label, value in pairs[1:])]
    return _with_sections(pairs) if len(dict(pairs)) < len(pairs) else pairs or None


def _with_sections(pairs: Pairs) -> Pairs:
    """`bed: temp=60 pwm=0.2 nozzle: temp=210 pwm=0.3` names the bed's pwm and the nozzle's."""
    section, named = "", Pairs()
    for label, value in pairs:
        before, colon, name = label.rpartition(": ")
        section = before + colon or section
        named.append((section + name, value))
    return named


def _leading_values(words: list[str]) -> tuple[list[str], list[str]]:
    """The values that words begin with, and the rest: `21.0°C 70°F Heat index` holds two, both with units."""
    values: list[str] = []
    while words and (_is_value(words[0]) or (values and words[0][0] == "/" and is_number(words[0][1:]))):
        if words[0][0] == "/":
            values.append(words[0][1:])
            words = words[1:]
            continue
        unit = next((n for n in (2, 1) if is_measure("".join(words[1 : 1 + n]))), 0)
        if values and not unit and split_measure(words[0]) is None:
            break
        values.append(" ".join((words[0], "".join(words[1 : 1 + unit]))).strip())
        words = words[1 + unit :]
    return values, words


def _is_value(word: str) -> bool:
    return is_number(word) or word.lower() in MISSING or split_measure(word) is not None


def _logged(text: str) -> Pairs | None:
    """The pairs of a line of ESPHome or MQTT: a quoted name and its state, a topic and its value or object."""
    if "'" in text and (match := _ESPHOME.fullmatch(text) or _CHANGED.fullmatch(text)):
        return [(match[1], match[2])]
    if "=" in text and (match := _LINE_PROTOCOL.fullmatch(text)) is not None:
        fields = (part.partition("=") for part in match[2].split(","))
        key = " ".join(part.rpartition("=")[2] for part in match[1].replace("\\", "").split(","))
        values = [(name, value.removesuffix("i")) for name, _, value in fields]
        return [(SERIES_KEY, key), ("time", match[3]), *values]
    start = text.find("{", 0, 240)  # of `tele/barn/SENSOR = {"Temperature": 21.5}`
    if start > 0 and text.endswith(("}", "}'")):
        before = text[:start]
        inside = text[start:].removesuffix("'")
        found = None if _CELL.search(before) else find_object(inside) or _labelled(inside[1:-1], ":")
        words = before.rstrip(" =:\t'").split()
        topic = words[-1] + "." if words and "/" in words[-1] else ""
        return found and [(topic + name, value) for name, value in found]
    return _topic(text)


def _topic(text: str) -> Pairs | None:
    """The topic and the value of `home/barn/temperature 21.5`; None for `m/s 3`."""
    match = _TOPIC.fullmatch(text) if "/" in text else None
    is_topic = match and not is_measure(match[1]) and match[1].lower() not in MISSING and _is_value(match[2])
    return [(match[1], match[2])] if match and is_topic else None


def _with_axes(pairs: Pairs) -> Pairs:
    """`Rotation X: 1, Y: 2, Z: 3` names Rotation Y and Rotation Z."""
    words, _, axis = pairs[0][0].rpartition(" ")
    rest = "".join(label for label, _ in pairs[1:])
    if not words or axis + rest not in ("XY", "XYZ", "xy", "xyz"):
        return pairs
    return [pairs[0], *((f"{words} {label}", value) for label, value in pairs[1:])]


# How one line of a source may be written, and how it is split: tables, labels, Teleplot, stamps, checksums.
#
# Pure functions on one line of text. `columns` and `timestamps` decide what the cells mean.


ESCAPE = "\x1b["
_ESCAPES = re.compile(r"\x1b\[[0-?]{0,24}[ -/]{0,4}[@-~]")
_STAMP = (
    r"((?:[0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4}[T _])?"
    r"[0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:[.,][0-9]{1,9}(?:,[0-9]{3})?)?)"
)
# The Arduino IDE writes "->", PlatformIO's monitor ">", screen and grabserial " - ", others brackets or ": ".
_AFTER_STAMP = r"(?:[ \t]{0,4}-?>|:(?=[ \t])|[ \t][-|](?=[ \t]|$))"
_AFTER_BRACKET = r"[ \t]?(?:->|[>:]|-(?=[ \t]))?"
_LINE_STAMP = re.compile(
    rf"(?:[0-9]{{2}}> |[ \t]{{0,8}})\[?{_STAMP}(?:{_AFTER_STAMP}|\]{_AFTER_BRACKET})[ \t]?(.*)", re.DOTALL
)
_ZONE = r"(?:Z|[+-][0-9]{2}:?[0-9]{2})?"
_BARE_STAMP = re.compile(
    rf"[ \t]{{0,8}}({_STAMP[1:-1]}{_ZONE}|[0-9]{{1,14}}(?:\.[0-9]{{1,9}})?(?:[mµu]?s|[ ][mµu]?s(?=:))?)(?::|[ ]-)?"
    r"[ \t]+([A-Za-z].*)",
    re.DOTALL,
)
"""A stamp followed by nothing but blanks, before a label."""
_COUNTED = re.compile(
    r"(?:\[ *[0-9]{1,3}\] +([0-9.]{1,12})- *[0-9.]{1,12} +sec"
    r"|[\[(][ ]{0,12}([0-9]{1,14}(?:\.[0-9]{1,9})?(?:[mµu]?s)?)[\])]|[EWIDV] \(([0-9]{1,14})\) [^\s:]{1,40}:"
    r"|Stats ([0-9]{1,14}\.[0-9]{1,3}):)[ \t]{1,12}(.*)",
    re.DOTALL,
)
"""What a kernel, an ESP32, Klipper and iperf write before a line: `[   12.345]`, `I (12345) sensor:`,
`Stats 812.4:`, `[  3]  0.0- 1.0 sec`."""
_SYSLOG = re.compile(
    r"(?:[A-Z][a-z]{2} [ 0-9]?[0-9]|[0-9]{2}-[0-9]{2}) ([0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?)"
    r"(?: {1,8}[^\s:]{1,64}){2,4} {0,24}: (.*)",
    re.DOTALL,
)
"""What syslog, journalctl and Android write before a line: `May 17 09:30:00 host sensor[612]: `,
`05-17 09:30:00.123  612  640 D Sensor: `; the date has no year."""
_LOG4J = re.compile(rf"({_STAMP[1:-1]}{_ZONE}) \[[A-Z]{{4,5}} ?\] \[[^\]]{{1,80}}\] - (.*)", re.DOTALL)
"""What Java writes before a line: `2024-05-17 09:30:00.123 [INFO ] [openhab.event.Changed   ] - `."""
_RFC5424 = re.compile(
    rf"<[0-9]{{1,3}}>1 ({_STAMP[1:-1]}{_ZONE})(?: [^\s]{{1,255}}){{4}} (?:-|\[[^\]]{{0,400}}\]) (.*)", re.DOTALL
)
"""What syslog writes before a line in the form of RFC 5424: `<134>1 2024-05-17T09:30:00Z host app 412 - - `."""
_TELEPLOT = re.compile(r"\s*>([^:>|§]{1,200}):([^|§]*)(?:§([^|]*))?(?:\|(.*))?\s*", re.DOTALL)


@dataclass(frozen=True)
class LineFormat:
    """How the data lines of one source are written."""

    kind: Literal["table", "labels", "teleplot"] = "table"
    """"table": values in fixed places; "labels": pairs of a name and a value; "teleplot": `>name:ms:value§unit`.
    A new kind needs a split in `reading/table.py` for the head, in `reading/line_reader.py` for each line."""
    delimiter: str = ","
    """Delimiter of the cells of a table: one of `, ; TAB |`, or a space for any run of blanks."""
    decimal: str = "."
    """Decimal mark, "." or ","; equal to the delimiter only where numbers are quoted."""
    labels: tuple[str, ...] = ()
    """Labels in column order; () for a table."""
    complete: bool = False
    """True where nearly every line holds all the labels: one that lacks some was damaged."""
    stamped: bool = False
    """True where each line begins with the `12:00:00.023 -> ` of a serial monitor; that stamp is cell 0."""
    checksum: bool = False
    """True where each line ends with a checksum: one without it was cut."""


class Teleplot(NamedTuple):
    """One line of Teleplot: a variable and its samples."""

    name: str
    """Name of the variable."""
    samples: tuple[tuple[str, str], ...]
    """(stamp in ms or "", value) of each sample, as text."""
    unit: str = ""
    """What follows the §; "" where nothing does."""

    @property
    def only_names(self) -> bool:
        """True for `>name:`, which declares a variable and holds no sample."""
        return self.samples == (("", ""),)


def without_escapes(line: str) -> str:
    """A line without the escape sequences that colour it on a terminal or move the cursor: `ESC[0;32m`."""
    return _ESCAPES.sub("", line) if ESCAPE in line else line


def split_teleplot(line: str) -> Teleplot | None:
    """The parts of `>name:value`, `>name:ms:value§unit`, `>name:1000:1;2000:2`; None for any other line.

    Points of a plane (`|xy`) and shapes (`>3D|…`) are not samples; a text (`|t`) has none.
    """
    match = _TELEPLOT.fullmatch(line)
    flags = {flag.strip() for flag in (match[4] or "").split(",")} if match else set[str]()
    if match is None or "xy" in flags or match[2].count(";") > 1024:
        return None
    if "t" in flags:
        return Teleplot(match[1].strip(), ())
    samples: list[tuple[str, str]] = []
    for part in match[2].split(";"):
        stamp, colon, value = part.rpartition(":")
        if ":" in stamp or (colon and not is_number(stamp.strip())):
            return None
        samples.append((stamp.strip(), value.strip()))
    return Teleplot(match[1].strip(), tuple(samples), (match[3] or "").strip())


def split_stamp(line: str) -> tuple[str, str] | None:
    """(`12:00:00.023`, rest) of a line before which a serial monitor wrote its stamp; None for any other line."""
    match = line.startswith(("[", "(", "I (", "D (", "W (", "E (", "V (", "Stats ")) and _COUNTED.fullmatch(line)
    match = match or (line[:1] == "<" and _RFC5424.fullmatch(line))
    match = match or (":" in line[:24] and _LINE_STAMP.fullmatch(line))
    match = match or (" " in line[3:6:2] and _SYSLOG.fullmatch(line))
    match = match or ("] - " in line and _LOG4J.fullmatch(line))
    if match:
        stamp, rest = (group for group in match.groups() if group is not None)
        return stamp.replace(",", "") if "." in stamp else stamp, rest  # Zephyr writes 00:00:01.234,567
    match = _BARE_STAMP.fullmatch(line) if line[:1] in set("0123456789 \t") else None
    if match is None:
        return None
    if not (":" in match[2] or "=" in match[2]):
        return (match[1], match[2]) if _topic(match[2]) else None
    # The 24 of `24 Apr 2016 17:03:07` is not a stamp before the label 17.
    label = match[2].replace("=", ":").partition(":")[0].split()
    return None if not label or is_number(label[-1]) else (match[1], match[2])


def split_checksum(line: str) -> tuple[str, int, int] | None:
    """(payload, checksum written, checksum of the payload) of `1,2,3*02`; None where none is written.

    As in NMEA 0183: two hexadecimal digits, the XOR of all bytes between a leading `$`, if any, and the `*`.
    """
    text = line.strip()
    mark, digits = text[-3:-2], text[-2:]
    if mark != "*" or not set(digits) <= set(hexdigits):
        return None
    payload = text[:-3].removeprefix("$")
    return payload, int(digits, 16), reduce(int.__xor__, payload.encode(), 0)
