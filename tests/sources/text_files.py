"""Hostile files: endless texts, numbers that are none, what is no ordinary file, and files that change."""

from __future__ import annotations

import os
import random
import socket
from collections.abc import Callable, Iterable
from itertools import repeat
from pathlib import Path

from tests.support.hostile_case import Case

MIB = 1 << 20
ROWS = [f"{i / 100:.2f},{20 + i % 7}.5,{i % 5}.25\n" for i in range(200)]
READ = r"read: 200 rows, 2 channels, "
READ_ALL = READ + "0 rejected"

Make = Callable[[Path, int], object]


def written(pieces: Callable[[int], Iterable[str]]) -> Make:
    """A file of these pieces."""

    def make(path: Path, size: int) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            file.writelines(pieces(size))

    return make


def line_of(run: str, *, alone: bool) -> Make:
    """One line of `size` characters; between rows, or alone and without an end."""
    block = run * max(1, 65536 // len(run))
    above, below = ([], []) if alone else (ROWS[:100], ["x\n", *ROWS[100:]])
    return written(lambda size: (*above, *repeat(block, max(1, size // 65536)), *below))


def text(content: str | bytes) -> Make:
    """This file."""

    def make(path: Path, _: int) -> None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))

    return make


def wide(name: Callable[[int], str]) -> Make:
    """A header and three rows of `size` columns."""
    return written(lambda size: (",".join(map(one, range(size))) + "\n" for one in (name, *["{}.5".format] * 3)))


def noise(letters: bytes) -> Make:
    """`size` random bytes of these."""

    def make(path: Path, size: int) -> None:
        draw = random.Random(7)
        with path.open("wb") as file:
            while size > 0:
                piece = draw.randbytes(min(size, MIB))
                file.write(piece.translate(bytes(letters[i % len(letters)] for i in range(256))))
                size -= len(piece)

    return make


def table(cells: Iterable[str], name: str = "x") -> bytes:
    """A table with plain rows around these cells of its last column."""
    rows = [f"{i},{i % 9}.5\n" for i in range(60)]
    odd = [f"{60 + i},{cell}\n" for i, cell in enumerate(cells)]
    return "".join((f"i,{name}\n", *rows, *odd, *(f"{100 + i},{i}.5\n" for i in range(60)))).encode()


def stamps(form: Callable[[int], str], odd: Iterable[str] = ()) -> bytes:
    """A table with these stamps: plain ones, then those of `odd`."""
    rows = [f"{form(i)},{i % 9}.5\n" for i in range(60)]
    return "".join(("time,x\n", *rows, *(f"{stamp},1.5\n" for stamp in odd))).encode()


PLAIN = "".join(ROWS)
NUMBERS = (
    "1e999", "-1e999", "nan(0x7ff)", "-nan", "NaN123", "infinity", "0x1p3", "1_000", "١٢", "１２", "½", "--1",
)  # fmt: skip
NUMBERS += ("1e", "+", "1e+", ".", "1e-999", "5e-324", "1.7976931348623157e308", "²", "1e0000000000000000005")
NUMBERS += ("9" * 5000, "1" + "0" * 400, "0." + "0" * 5000 + "1", "1e" + "9" * 5000, "0" * 5000 + "1")
DATES = ("0000-01-01 00:00:00", "99999-01-01 00:00:00", "2024-02-30 00:00:00", "2024-13-01 00:00:00")
DATES += ("2024-01-01 24:00:00", "2024-01-01 23:59:60", "2024-01-01 99:99:99", "2024-01-01T00:00:00+99:99")
DATES += ("-2024-01-01 00:00:00", "2024-00-00 00:00:00", "9999-12-31 23:59:59.9999999", "1e308", "nan")
DATES += ("0001-01-01 00:00:00",)
ZONES = ("9999-12-31T23:59:59-23:59", "0001-01-01T00:00:00+23:59")


def one_line(run: str, expected: str) -> Case:
    name = f"one line of `{run.strip() or 'blanks'}`"
    return Case(name, line_of(run, alone=True), expected, 3 * MIB // 2, 500 * MIB)


def between(run: str) -> Case:
    name = f"a line of `{run.strip() or 'blanks'}` between rows"
    return Case(name, line_of(run, alone=False), READ + "1 rejected", 5 * MIB // 4, 500 * MIB)


def endless(name: str, line: Callable[[int], str], expected: str, small: int, big: int, big_mib: int = 80) -> Case:
    return Case(
        name, written(lambda size: map(line, range(size))), expected, small, big, big_mib=big_mib, file="log.txt"
    )


def content(name: str, data: str | bytes, expected: str) -> Case:
    return Case(name, text(data), expected)


def with_name(size: int) -> Iterable[str]:
    """A table whose first column has a name of this length."""
    return ("n" * size + ",y\n", *(f"{i}.5,2\n" for i in range(50)))


def short(line: str) -> Case:
    """This line over and over; above 32 kB a file is read in blocks."""
    name = line.strip().replace("\n", " ") or " "
    few = max(4_000, (1 << 15) // len(line) + 1)
    return Case(
        f"lines of `{name}`", written(lambda size: repeat(line, size)), ".*", few, 500_000, mib=60, big_mib=200
    )


WIDE = "refused: log.csv must be a table of numbers, of at most 256 columns"
NO_TABLE = "refused: log.* must be a table of numbers, one sample per line"
NO_ROWS = "refused: log.csv must hold numbers below its header"
NO_LINES = "refused: log.* must hold lines of numbers"
NO_TEXT = "refused: log.csv must be a text file"
LETTERS = bytes(range(32, 127)) + b"\n\n\n"
MARKS = b"0123456789.,;:-+eE\t\n\n\n\n"
SHORT = (
    "a\n", "[]\n", "1x\n", "a:\n", "a=1x\n", '"\n', ">a:1\n", "$1*\n", "-\n", "1,2a\n1\n", "12:00\n", "\n", "#\n",
)  # fmt: skip
WIDTHS = "".join(("1,2\n" * 10, "1,2,3\n" * 10, "1,2,3,4,5\n" * 4, "1,2,3\n" * 10, "1,2\n" * 10))
TEXTS = (
    one_line("1", "refused: log.csv must hold at least one number"),
    one_line("1,", WIDE),
    one_line(" ", NO_LINES),
    one_line('"', NO_ROWS),
    one_line('"1",', WIDE),
    one_line("a:1 ", NO_ROWS),
    one_line("\0", NO_TEXT),
    one_line("[", NO_ROWS),
    *map(between, ("1", "1,", " ", '"', "a:1 ", "[")),
    Case("`# unit`, blanks", written(lambda n: ("# unit" + " " * n + "x\n", PLAIN)), READ_ALL, 60_000,
        MIB - 60_000),
    Case("many columns", wide("c{}".format), WIDE, 20_000, 100_000, then=NO_ROWS),
    Case("many columns of one name", wide("a".format), WIDE, 20_000, 1_000_000, then=NO_ROWS),
    Case("256 columns of one name", wide("a".format), "read: 3 rows, 256 channels, 0 rejected", 256, 256),
    Case("a long name", written(with_name), "read: 50 rows, 2 channels", MIB // 2, 10 * MIB, then=NO_ROWS),
    Case("an open quote", written(lambda size: (*ROWS[:50], '1,"2,3\n', *repeat(PLAIN, size))),
        "read: [0-9]+ rows, 3 channels, 0 rejected", 10, 20_000, big_mib=300),
    endless("a new label on each line", "a{0}:{0}\n".format, NO_TABLE, 7_000, 1_000_000),
    endless("a new name on each row", lambda i: f"{i},n{i},{i % 7}.5\n", "read: ", 10_000, 1_000_000),
    endless("a new width on each line", lambda i: ",".join(repeat("1", i % 2000)) + "\n", NO_TABLE, 400, 100_000),
    endless("headers without end", "a{},b,c\n".format, NO_TABLE, 10_000, 5_000_000),
    endless("comments without end", "# a{}\n".format, NO_LINES, 20_000, 5_000_000),
    endless("text without end", "the {} quick brown foxes\n".format, "read: ", 20_000, 5_000_000, 400),
    endless("an open quote on each line", '1,"{},3\n'.format, "read: ", 4_000, 1_000_000, 200),
    endless("quotes in quotes", lambda i: '"' * (i % 400) + f"{i},2\n", "read: ", 5000, 200_000),
    *map(short, SHORT),
    content("rows of three widths in turn", WIDTHS, "read: "),
    Case("random bytes", noise(bytes(range(256))), NO_TEXT, 2 * MIB, 100 * MIB),
    Case("random letters", noise(LETTERS), "re(fus|a)", MIB // 64, 20 * MIB, big_mib=200),
    Case("random marks of numbers", noise(MARKS), "re(fus|a)", MIB // 128, 4 * MIB, big_mib=200),
    content("UTF-16 of odd length", PLAIN.encode("utf-16") + b"1", READ + "1 rejected"),
    content("half a pair", b"\xff\xfe" + PLAIN.encode("utf-16-le") + b"\0\xd8,\x001\0\n\0", READ + "1 rejected"),
    content("UTF-16 under the mark of the other", b"\xfe\xff" + PLAIN.encode("utf-16-le"), NO_ROWS),
    content("the mark of UTF-16 alone", b"\xff\xfe", NO_LINES),
    content("UTF-32", PLAIN.encode("utf-32"), NO_TABLE),
    content("UTF-8 with half a pair", PLAIN + "\ud800,1,2\n", READ + "1 rejected"),
    content("the mark of UTF-8 on each line", "\ufeff" + PLAIN.replace("\n", "\n\ufeff"), "read: 200 rows"),
    content("numbers that are none", table(NUMBERS), "read: 146 rows, 2 channels, 0 rejected"),
    content("no dates", stamps("2024-03-01 00:00:{:02}".format, DATES), "read: 63 rows, 1 channels, 11 rejected"),
    content("stamps at the ends of the calendar", stamps("2024-03-01T00:00:{:02}Z".format, ZONES), "read: 62 rows"),
    content("years 0 and 99999", stamps("0000-00-{:02}".format) + stamps("99999-01-{:02}".format), "read: "),
    content("stamps at the ends of float64", stamps(lambda i: f"{(-1) ** i}.7e308"), "read: 60 rows"),
    content("samples at the ends of float64", table([f"{(-1) ** i}.7e308" for i in range(40)]), "read: 160 rows"),
    content("stamps as fine as numbers go", stamps("{}e-320".format), "read: 60 rows"),
)  # fmt: skip


ORDINARY = "refused: file must be an ordinary file"


def link_to(target: str) -> Callable[[Path, int], None]:
    return lambda path, _: path.symlink_to(target)


def listening(path: Path, _: int) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(os.path.relpath(path))  # a path of a socket has 107 letters at most


def rows(path: Path, size: int) -> None:
    path.write_text("".join(f"{i},{i % 7}.5\n" for i in range(size)))


def grow(path: Path) -> None:
    with path.open("a") as file:
        file.writelines(f"{i},{i % 7}.5\n" for i in range(1000))


def overwrite(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 4096)


def shrink(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def empty(path: Path) -> None:
    os.truncate(path, 0)


def changed(name: str, change: Callable[[Path], object], expected: str) -> Case:
    return Case(f"a file that {name}", rows, expected, 5000, 500_000, during=change)


SPECIAL = (
    Case("a pipe", lambda path, _: os.mkfifo(path), ORDINARY),
    Case("a socket", listening, ORDINARY),
    Case("/dev/zero", link_to("/dev/zero"), ORDINARY),
    Case("/dev/tty", link_to("/dev/tty"), ORDINARY),
    Case("a folder", lambda path, _: path.mkdir(), "refused: source must be a file"),
    Case("a link to itself", link_to("log.csv"), "refused: cannot read"),
    Case("a link to nothing", link_to("nothing"), "refused: file not found"),
    Case("an empty file", text(""), "refused: log.csv must hold lines of numbers"),
    Case("the memory of the process", link_to("/proc/self/mem"), "refused: "),
    changed("grows", grow, "read: [0-9]+ rows"),
    changed("shrinks", shrink, "read: [0-9]+ rows"),
    changed("is emptied", empty, "refused: log.csv must hold a whole line"),
    changed("vanishes", os.unlink, "refused: reading .* failed midway"),
    changed("becomes noise", overwrite, "refused: log.csv must hold a whole line"),
)  # fmt: skip
