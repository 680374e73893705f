"""How much of a file is taken in: limits that keep a damaged one from filling the memory.

Each is far above what any sensor or data set makes, and each can be raised by a variable of the
environment that has its name.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from mottrack.core.errors import ConfigError


@dataclass(frozen=True)
class Limit:
    """A limit with its name in the environment.

    name: the variable that overrides it.
    default: the value where that is not set.
    """

    name: str
    default: int

    @property
    def value(self) -> int:
        """The limit that holds.

        Raises:
            ConfigError: the variable is set to something else than a positive integer.
        """
        text = os.environ.get(self.name, "")
        if not text:
            return self.default
        if not (text.isascii() and text.isdigit() and 0 < len(text) < 19 and int(text) > 0):
            raise ConfigError(f"{self.name} is {text}, expected a positive integer")
        return int(text)

    def expected(self, what: str) -> str:
        """Return the words for an error message, with the way to raise the limit."""
        return f"at most {self.value} {what} (raise it by {self.name}=...)"


MAX_POINTS = Limit("MOTTRACK_MAX_POINTS", 5_000_000)
"""Of a sweep: 128 beams at 5 Hz with three returns make 2.6 million."""
MAX_ROWS = Limit("MOTTRACK_MAX_ROWS", 20_000_000)
"""Of a table: detections of the whole Argoverse 2 validation split, 500 a frame, are 12 million."""
MAX_TEXT_BYTES = Limit("MOTTRACK_MAX_TEXT_BYTES", 1 << 30)
"""Of a text file that is read whole: 1 GiB, ten million labelled boxes."""
MAX_ARRAY_BYTES = Limit("MOTTRACK_MAX_ARRAY_BYTES", 1 << 30)
"""Of one array of an npy or npz file, unpacked: 1 GiB."""
MAX_NODES = Limit("MOTTRACK_MAX_NODES", 20_000)
"""Values of a YAML file with its aliases written out: settings have some hundreds."""
MAX_RECORD_BYTES = Limit("MOTTRACK_MAX_RECORD_BYTES", 1 << 28)
"""Of a block of a log, unpacked: 256 MiB; recorders make blocks of about one."""
