"""`python -m kalscope.cli`: the headless commands without the dashboard."""

from __future__ import annotations

import sys

from kalscope.common.stopping import ended_by_signals


def main() -> None:
    """Entry point."""
    with ended_by_signals():
        from kalscope.cli.app import run

        status = run()
    sys.exit(status)


if __name__ == "__main__":
    main()
