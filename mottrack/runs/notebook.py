"""A comparison as notebooks show it."""

from __future__ import annotations

import html

from mottrack.runs.comparison import Comparison
from mottrack.runs.conclusion import conclusion
from mottrack.runs.summary_tables import summary_tables


class NotebookComparison(Comparison):
    """A comparison that shows its main tables."""

    @classmethod
    def of(cls, comparison: Comparison) -> NotebookComparison:
        """Return the same comparison."""
        return cls(comparison.runs, comparison.out, comparison.differences)

    def _repr_html_(self) -> str:
        """Return the main tables and what was found."""
        tables = "".join(table._repr_html_() for table in summary_tables(self))
        return f"{tables}<p>{html.escape(conclusion(self))}</p>"
