"""A gate's verdict as text, as Markdown for a pull request, and as JUnit XML for a CI's list of tests."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

from pcdbench.leaderboard.gate import Finding, Kind, Verdict
from pcdbench.leaderboard.render import escaped_markdown

_TITLES: dict[Kind, str] = {
    "changed": "Measured otherwise",
    "failed": "Failed",
    "worse": "Worse",
    "slower": "Slower",
    "better": "Better",
    "repaired": "Repaired",
    "faster": "Faster",
    "note": "Note",
}
# XML 1.0 has no way to write the others (2.2, "Characters"), and errors come with the colours of a terminal.
_NO_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")


def verdict_line(verdict: Verdict) -> str:
    """The verdict in one line."""
    count = sum(finding.is_regression for finding in verdict.findings)
    compared = f"{len(verdict.compared)} pairs of completer and task over {verdict.cases} cases"
    if verdict.holds:
        return f"{verdict.board} holds: nothing got worse, slower or failed ({compared})"
    return f"{verdict.board} does not hold: {count} regression{'' if count == 1 else 's'} ({compared})"


def verdict_text(verdict: Verdict) -> str:
    """The verdict for a terminal: a line a finding, regressions first."""
    lines = [f"{_TITLES[finding.kind].lower()}: {finding.told}" for finding in verdict.findings]
    return "\n".join([*lines, verdict_line(verdict)]) + "\n"


def verdict_markdown(verdict: Verdict) -> str:
    """The verdict as a comment on a pull request."""
    parts = [f"### Leaderboard {'✅' if verdict.holds else '❌'}\n\n{escaped_markdown(verdict_line(verdict))}\n"]
    for kind, title in _TITLES.items():
        its = [finding for finding in verdict.findings if finding.kind == kind]
        if its:
            parts.append(f"**{title}**\n\n" + "".join(f"- {escaped_markdown(finding.told)}\n" for finding in its))
    return "\n".join(parts)


def verdict_junit(verdict: Verdict) -> str:
    """The verdict as JUnit XML: a test case for each completer on each task, and one for its time.

    Findings that concern no single completer are test cases of their own. Characters that XML forbids are left out.
    """
    known = list(verdict.compared)
    known += [(completer, "time") for completer in dict.fromkeys(completer for completer, _ in known)]
    of: dict[tuple[str, str], list[Finding]] = {key: [] for key in known}
    for finding in verdict.findings:
        if finding.is_regression:
            task = "time" if finding.kind == "slower" else finding.task or "data"
            of.setdefault((finding.completer or verdict.board, task), []).append(finding)
    suite = ElementTree.Element(
        "testsuite",
        name=f"leaderboard {verdict.board}",
        tests=str(len(of)),
        failures=str(sum(bool(its) for its in of.values())),
    )
    for (completer, task), its in of.items():
        case = ElementTree.SubElement(suite, "testcase", classname=f"{verdict.board}.{completer}", name=task)
        if its:
            _add_failure(case, its)
    text = _NO_XML.sub("", ElementTree.tostring(suite, encoding="unicode"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _add_failure(case: ElementTree.Element, findings: Sequence[Finding]) -> None:
    failure = ElementTree.SubElement(case, "failure", type=findings[0].kind, message=findings[0].told)
    failure.text = "\n".join(finding.told for finding in findings)
