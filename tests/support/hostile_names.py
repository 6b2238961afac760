"""Names and texts that mean harm to whatever shows, writes, compiles or runs them: one table for all tests."""

from __future__ import annotations

CODE = (
    "*/ #define x", "*/\n#define PWN 1\n/*", "*/int pwn;/*", "//\\", "// \\\n#define PWN 1", "??/", "//??/",
    "??=define PWN 1", "\"'`", "'''", '"""', '"); system("x', "---", "...", "%", "%{", "%}", "%s%n", "{0}{x!r}",
    "#{", "\\", "\\u000a", "ends in a backslash \\", "; rm -rf /",
    "$(touch pwned) `touch pwned`; touch pwned #", "${sysenv.HOME}", "$(env HOME)", "${{x}}", "{{ x }}",
    "{about}", "%(q)s", "coding: utf-7", "!!python/object:os.system", "- a: b", "a: b", "&a *a", "[x]",
    "x = 1 # y", "on", "no", "null", "1e5", "1_000",
)  # fmt: skip
"""For compilers, interpreters, readers of data and shells."""
WORDS = (
    "for", "__proto__", "constructor", "1abc", "KALSCOPE_A_Q", "CON", "..", "../../etc/passwd", "C:\\x", "-rf",
    "", " ",
)  # fmt: skip
"""Words of languages, of file systems and of the project itself."""
MARKUP = (
    "<script>", "</script><script>alert(1)</script>", "</title><script>alert(1)</script>", "<!--", "]]>",
    "<img src=x onerror=alert(1)>", "<iframe srcdoc='<script>alert(1)</script>'>",
    "![x](http://evil.example/x.png)", "[x](javascript:alert(1))", "`code` **bold** # head", "a|b", "&lt;b&gt;",
)  # fmt: skip
"""For pages, reports and markdown."""
FORMULAS = (
    "=cmd|' /C calc'!A0", "+1+cmd", "-1+cmd", "@SUM(A1)", "\t=1+1", "\r=1+1", '"=1+1', "a,=1+1", 'a",=1+1,"',
    "=1;2",
)  # fmt: skip
"""For spreadsheets."""
TERMINAL = (
    "\x1b]52;c;ZXZpbA==\x07", "\x1b]0;title\x1b\\", "\x1b[2J\x1b[31m", "\x9b31m\x90x\x9c", "\x00\x08\x0c\x7f",
    "line\nline", "line\r\x0b\x0c\x85\u2028\u2029line", "a\u202eb\u2066c\u2069",
)  # fmt: skip
"""For terminals and logs: the clipboard, the title, colours, the cursor, the direction, line ends."""
LETTERS = (
    "température ² 温度 😀", "x" * 300, "\ud800", "\ufeffa", "e\u0301\u0301\u0301", "\u00a0\u202f",
)  # fmt: skip
"""Letters beyond ASCII, too many, and half of one."""
NAMES = (*CODE, *WORDS, *MARKUP, *FORMULAS, *TERMINAL, *LETTERS)
