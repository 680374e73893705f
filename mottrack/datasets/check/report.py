"""The lines that a check prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from mottrack.datasets.check.findings import CheckResult

SHOWN = 5


def report_lines(result: CheckResult) -> Iterator[str]:
    """Yield what was looked at, then each kind of fault with its number and the first few."""
    counts = ", ".join(f"{count} {what}" for what, count in result.counts.items())
    yield f"{result.dataset}: {len(result.scenes)} scenes, {counts}"
    findings = result.findings
    if not findings:
        yield "no fault found"
        return
    for kind, count in Counter(finding.kind for finding in findings).most_common():
        scenes = len({f.scene for f in findings if f.kind == kind})
        yield f"{kind}: {count} in {scenes} scenes"
        of_kind = [f for f in findings if f.kind == kind]
        yield from (f"  {finding.scene}: {finding.text}" for finding in of_kind[:SHOWN])
        if count > SHOWN:
            yield f"  ... and {count - SHOWN} more"
