"""Print, for kinds of faults that once passed silently or ended in a traceback, what is said now.

    python -m tests.fuzz.faults_table > docs/faults.md

Every line is printed by the code itself, on small files that are written and damaged for it.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.faults import (
    section_a,
    section_b,
    section_c,
    section_d,
    section_e,
    section_f,
)
from tests.fuzz.faults.printed import Faults
from tests.fuzz.targets import write_all

SECTIONS: dict[str, Faults] = {
    "A. Once wrong and silent": section_a.FAULTS,
    "B. Once a lost step or run": section_b.FAULTS,
    "C. Once a traceback": section_c.FAULTS,
    "D. Hostile input": section_d.FAULTS,
    "E. Once a message that named too little": section_e.FAULTS,
    "F. Studies, settings and parts of your own": section_f.FAULTS,
}
MOST = 420
"""Characters of a text: a few lines of a page; lists of scenes and samples may be longer."""
HEAD = """# What is printed for faults

Kinds of damage that once passed silently, lost a run, ended in a traceback or filled the memory,
and what is printed for each now; `accepted` stands for what is read or done rightly. Made by
`python -m tests.fuzz.faults_table`; paths are cut, and `; ` stands between lines. The usual ones
are explained under [usual mistakes](mistakes.md)."""


def table(root: Path) -> Iterator[str]:
    yield HEAD
    for title, faults in SECTIONS.items():
        yield f"\n## {title}\n| input | what is printed |\n|---|---|"
        yield from (row(name, printed(root)) for name, printed in faults.items())


def row(name: str, text: str) -> str:
    """A row of the table."""
    one_line = text.strip().replace("|", "\\|").replace("\n", "; ").replace("`", "'")
    short = one_line if len(one_line) <= MOST else f"{one_line[:MOST]} ..."
    return f"| {name} | `{short}` |"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MOTTRACK_CACHE"] = f"{folder}/cache"
        with contextlib.redirect_stdout(sys.stderr):  # what libraries say while files are written
            write_all(Path(folder))
            lines = list(table(Path(folder)))
        sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
