"""Decimal numbers of text, exactly as `float` reads them: most with one division, the others by Eisel and Lemire.

Source: W. D. Clinger, How to read floating point numbers accurately (1990); D. Lemire, Number parsing at a gigabyte
per second (2021), https://arxiv.org/abs/2101.11408; N. Mushtak and D. Lemire, Fast number parsing without fallback
(2023), by which the product of 128 bits never has to be checked.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Bytes = NDArray[np.uint8]

EXACT, ROUNDED, BAD = 0, 1, 2
"""What `read_number` found: the number; the number within a few roundings, which `float` must read again; none."""

MAX_DIGITS = 18
"""Digits that always fit an int64."""
_MANY_DIGITS = 100
MAX_TENS = 60
"""Largest power of ten, up or down, of a number that is read here: far from the ends of float64."""
_MAX_PLAIN = 1 << 53
"""Up to here a whole number is a float64, and one division by an exact power of ten is rounded correctly."""
_MAX_PLAIN_TENS = 22
TENS = np.array([10.0**i for i in range(_MAX_PLAIN_TENS + 1)])

_U = np.uint64
_LOW, _HALF, _TOP = _U(0xFFFFFFFF), _U(32), _U(1) << _U(63)
_ONE, _THREE, _NINE, _SPARE = _U(1), _U(3), _U(9), _U(0x1FF)


def _fives() -> NDArray[np.uint64]:
    """The first 128 bits of 5 to the power −MAX_TENS … MAX_TENS, as pairs of the upper and the lower 64."""
    rows: list[tuple[int, int]] = []
    for power in range(-MAX_TENS, MAX_TENS + 1):
        five = 5 ** abs(power)
        if power < 0:  # rounded up as far as -27, as the proof assumes
            five = (1 << (five.bit_length() + 127)) // five + (power >= -27)
        bits = five.bit_length()
        five = five << (128 - bits) if bits <= 128 else five >> (bits - 128)
        rows.append((five >> 64, five & (1 << 64) - 1))
    return np.array(rows, dtype=np.uint64)


_FIVES = _fives()


@compiled()
def _product(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """The upper and the lower 64 bits of a product."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    low = a_low * b_low
    middle = a_high * b_low + (low >> _HALF)
    other = a_low * b_high + (middle & _LOW)
    return a_high * b_high + (middle >> _HALF) + (other >> _HALF), (other << _HALF) | (low & _LOW)


@compiled(error_model="numpy")
def scaled(digits: int, tens: int) -> float:
    """A number of at most MAX_DIGITS digits times a power of ten of at most MAX_TENS, up or down, rounded once."""
    if digits <= _MAX_PLAIN and -_MAX_PLAIN_TENS <= tens <= _MAX_PLAIN_TENS:
        return digits / TENS[-tens] if tens < 0 else digits * TENS[tens]
    if digits == 0:
        return 0.0
    zeros = 64 - math.frexp(float(digits))[1]
    word = _U(digits) << _U(zeros)
    if not word & _TOP:  # float() had rounded it up to the next power of two
        word <<= _ONE
        zeros += 1
    high, low = _product(word, _FIVES[tens + MAX_TENS, 0])
    if high & _SPARE == _SPARE:
        carry = _product(word, _FIVES[tens + MAX_TENS, 1])[0]
        low += carry
        if low < carry:
            high += _ONE
    upper = high >> _U(63)
    shift = upper + _NINE
    found = high >> shift
    if low <= _ONE and -4 <= tens <= 23 and found & _THREE == _ONE and found << shift == high:
        found &= ~_ONE  # exactly between two: to the even one
    found = (found + (found & _ONE)) >> _ONE
    return math.ldexp(float(found), ((217706 * tens) >> 16) + 63 + int(upper) - zeros - 52)


@compiled()
def _roughly(data: Bytes, at: int, end: int) -> float:
    """The digits between two places as one whole number, with a rounding each."""
    rough = 0.0
    for i in range(at, end):
        if 48 <= data[i] <= 57:
            rough = 10.0 * rough + (data[i] - 48)
    return rough


@compiled()
def _exponent(data: Bytes, at: int) -> tuple[int, int]:
    """The power of ten after an e, and its end; 1000 where it is that large or missing."""
    down = data[at] == 45
    at += down or data[at] == 43
    start, power = at, 0
    while 48 <= data[at] <= 57:
        power = min(10 * power + (data[at] - 48), 1000)
        at += 1
    if at == start:
        return 1000, at
    return (-power if down else power), at


@compiled()
def read_number(data: Bytes, at: int, decimal: int) -> tuple[float, int, int]:
    """The number, or nan, that begins at `at`; where it ends; and EXACT, ROUNDED or BAD.

    The bytes must end with a newline. Its grammar is that of `grammar.cells.parse_number`: no hexadecimal, no
    infinity, and a digit after a decimal comma.
    """
    byte = data[at]
    negative = byte == 45
    if negative or byte == 43:
        at += 1
        byte = data[at]
    first, digits, tens = at, 0, 0
    while 48 <= byte <= 57:
        digits = 10 * digits + (byte - 48)
        at += 1
        byte = data[at]
    count = at - first
    if byte == decimal:
        at += 1
        byte = data[at]
        while 48 <= byte <= 57:
            digits = 10 * digits + (byte - 48)
            at += 1
            byte = data[at]
        tens = count + 1 + first - at
        count -= tens
        if decimal == 44 and tens == 0:
            return 0.0, at, BAD
    end = at
    if count == 0 or count > _MANY_DIGITS:
        is_nan = end == first and byte | 32 == 110 and data[at + 1] | 32 == 97 and data[at + 2] | 32 == 110
        return (math.nan, at + 3, EXACT) if is_nan else (0.0, at, BAD)
    if byte | 32 == 101:  # e
        power, at = _exponent(data, at + 1)
        tens += power
    if not -MAX_TENS <= tens <= MAX_TENS:
        return 0.0, at, BAD
    is_long = count > MAX_DIGITS
    value = _roughly(data, first, end) * 10.0**tens if is_long else scaled(digits, tens)
    return (-value if negative else value), at, ROUNDED if is_long else EXACT
