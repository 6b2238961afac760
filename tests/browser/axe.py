"""What axe-core, the judge of accessibility inside most such tools, finds on a page."""

from __future__ import annotations

from axe_playwright_python.base import AXE_SCRIPT

NAMED = "() => new Promise((done) => setTimeout(done, 250))"
"""Until the page has named what is new: it does so by a timer of 200 ms, which was set before this one."""


def findings(page, rules=()):
    """Each violation on the page of these rules, () = all: the rule, the element, and what is wrong with it.

    The work is nearly the same for a part of the page as for all of it.
    """
    if not page.evaluate("() => !!window.axe"):
        page.evaluate(AXE_SCRIPT)
    page.evaluate(NAMED)
    violations = page.evaluate(
        "(rules) => axe.run({resultTypes: ['violations'], preload: false, ...(rules.length && {runOnly: rules})})"
        ".then((found) => found.violations)",
        list(rules),
    )
    return [
        f"{violation['id']}: {node['html'][:120]} {' '.join(check['message'] for check in node['any'])}"
        for violation in violations
        for node in violation["nodes"]
    ]
