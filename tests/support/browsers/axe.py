"""What axe-core, the judge of accessibility inside most such tools, finds on a page."""

from __future__ import annotations

from axe_playwright_python.base import AXE_SCRIPT

NAMED = "() => new Promise((done) => setTimeout(done, 250))"
"""Until the page has named what is new: it does so by a timer of 200 ms, which was set before this one."""


def findings(page, part="html", rules=()):
    """Each violation in a part of the page, a CSS selector: the rule, the element, and what is wrong with it.

    Only these rules are asked; () = all.
    """
    if not page.evaluate("() => !!window.axe"):
        page.evaluate(AXE_SCRIPT)
    page.evaluate(NAMED)
    violations = page.evaluate(
        "([part, rules]) => axe.run(part, {resultTypes: ['violations'], ...(rules.length && {runOnly: rules})})"
        ".then((found) => found.violations)",
        [part, list(rules)],
    )
    return [
        f"{violation['id']}: {node['html'][:120]} {' '.join(check['message'] for check in node['any'])}"
        for violation in violations
        for node in violation["nodes"]
    ]
