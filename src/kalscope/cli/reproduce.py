"""`kalscope reproduce`: the source documents' figures and tables as one page, and its numbers as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.console import CHECK_FAILED, progress_line, say, write_output

if TYPE_CHECKING:
    from kalscope.papers.reproduction import Reproduction


def reproduce_command(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder to write into.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON, not as a table.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer random draws, the same tolerances.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Reproduce the results of the three source documents.

    Writes their tables and figures to index.html and results.json in DIR.

    Exit status 1 if a reproduced number is outside its tolerance.
    """
    from kalscope.common.files import check_new, make_folder, write_atomic
    from kalscope.papers.reproduction import reproduce

    page, numbers = output / "index.html", output / "results.json"
    check_new(page, numbers, force=force)
    make_folder(output)  # before the work, so that a failure is immediate
    with progress_line() as progress:
        done = reproduce(quick, progress=progress)
    write_atomic(numbers, done.json.encode())
    write_atomic(page, done.html.encode())
    write_output(iter([done.json if as_json else summary(done, output)]), None)
    if done.failed:
        names = "; ".join(map(str, done.failed))
        say(f"{len(done.failed)} of {len(done.checks)} numbers are outside their tolerance: {names}")
        raise typer.Exit(CHECK_FAILED)


def summary(done: Reproduction, folder: Path) -> str:
    """Table 1 and the path of the page, as text."""
    from kalscope.common.text import one_line

    lines = [f"{'R':>6} {'Q':>6} {'printed':>10} {'simulated':>10} {'theory':>10}"]
    for row in done.results["noise_reducer"]["table_1"]:
        numbers = " ".join(f"{row[key]:10.4f}" for key in ("printed", "simulated", "theoretical"))
        lines.append(f"{row['r']:6g} {row['q']:6g} {numbers}")
    within = len(done.checks) - len(done.failed)
    lines.append(f"{within} of {len(done.checks)} reproduced numbers are within their tolerance.")
    lines.append(f"Page: {one_line(str(folder / 'index.html'))}")
    return "\n".join(lines) + "\n"
