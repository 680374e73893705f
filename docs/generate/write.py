"""Write the generated pages into docs/reference, where they are read in the repository too.

python docs/generate/write.py
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import command_line
import configuration
import python_reference

FOLDER = Path(__file__).resolve().parents[1] / "reference"


def pages() -> dict[str, str]:
    """Return file name in docs/reference to text."""
    return {
        "configuration.md": configuration.page(),
        "command_line.md": command_line.page(),
        **python_reference.pages(),
    }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
