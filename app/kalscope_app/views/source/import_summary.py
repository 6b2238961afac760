"""How a recording was read, as short markdown; every piece from the file is escaped."""

from __future__ import annotations

from kalscope.analysis.channel_kinds import channel_kinds
from kalscope.common.text import count
from kalscope.recording import Recording
from kalscope.sources.readers.account import summary, warnings
from kalscope_app.views.markdown import escape_markdown
from kalscope_app.views.source.reading_form import in_words_of_form

MAX_ISSUES = 4
MAX_KINDS = 6


def import_summary(recording: Recording) -> str:
    """One line, warnings where much was lost, then what was decided and what could not be read."""
    report = recording.report
    head = [f"{escape_markdown(in_words_of_form(summary(recording)), 200)}."]
    head += [f"**{escape_markdown(in_words_of_form(sentence), 300)}.**" for sentence in warnings(recording)]
    counts = {
        "steps back in time": report.clipped_times,
        "comment lines": report.comments,
        "blank lines": report.blank,
    }
    lines = [f"{what}: {count(number)}" for what, number in counts.items() if number]
    if recording.sha256:  # it is finished and from a file
        lines += _about_channels(recording)
    lines += [escape_markdown(in_words_of_form(note), 160) for note in report.notes]
    for issue in report.issues[:MAX_ISSUES]:
        where = f"line {issue.line}" + (f", {escape_markdown(issue.column, 30)}" if issue.column else "")
        lines.append(f"{where}: {escape_markdown(issue.reason, 80)}, “{escape_markdown(issue.text, 40)}”")
    if len(report.issues) > MAX_ISSUES:
        lines.append(f"and {count(report.rejected + report.bad_cells - MAX_ISSUES)} more")
    return "\n\n".join([*head, "\n".join(f"- {line}" for line in lines)])


def _about_channels(recording: Recording) -> list[str]:
    """Which channels measure nothing, where some other does: those are not shown first."""
    kinds = channel_kinds(recording)
    beside = [f"{escape_markdown(name, 30)} ({kind})" for name, kind in kinds.items() if kind]
    if not beside or len(beside) == len(kinds):
        return []
    more = f" and {len(beside) - MAX_KINDS} more" if len(beside) > MAX_KINDS else ""
    return [f"not shown first: {', '.join(beside[:MAX_KINDS])}{more}"]
