"""`python -m kalscope.cli`: the headless commands without the dashboard."""

from __future__ import annotations

import sys

from kalscope.cli.app import run

if __name__ == "__main__":
    sys.exit(run())
