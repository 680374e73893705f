"""Flow fields that are kept between runs, so that another tracker need not wait for them again.

An entry holds the fields of one scene: a zip archive, whose members carry checksums, in a file
named by what made them. Each field carries a digest of everything that the source was given from
the first field on: data that have changed are never answered from old ones.
"""

from __future__ import annotations

import os
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mottrack.core.digest import digest_of
from mottrack.core.frame import Frame
from mottrack.core.interfaces import FlowSource, FrameObserver
from mottrack.core.motion import FlowField
from mottrack.core.storage import UNFINISHED
from mottrack.core.sweep import Sweep
from mottrack.core.timing import charge, collect_timings
from mottrack.pipeline.stored_flow import StoredFlow, packed, unpacked

SUFFIX = ".flow"
LAYOUT = "1"
"""Of an entry: raise it when the arrays that are stored change."""
FASTEST = 1
"""Level of deflate: fields shrink to a third at 100 MB/s; higher levels gain a tenth more."""


class StaleEntryError(Exception):
    """The data have changed since an entry was stored, or the entry is damaged."""


@dataclass(frozen=True)
class FlowCache:
    """A folder of entries and its greatest size."""

    folder: Path
    most_bytes: int

    @property
    def entries(self) -> list[Path]:
        """The entries, that used longest ago first."""
        found = [(path.stat().st_mtime_ns, path) for path in self.folder.glob(f"*{SUFFIX}")]
        return [path for _, path in sorted(found)]

    @property
    def size_bytes(self) -> int:
        """Size of all entries."""
        return sum(path.stat().st_size for path in self.entries)

    def clear(self) -> None:
        """Remove every entry, and what killed writers have left."""
        for path in [*self.entries, *self.folder.glob(f".*{UNFINISHED}")]:
            path.unlink(missing_ok=True)

    def trim(self) -> None:
        """Remove the entries used longest ago until the rest is small enough."""
        entries, excess = self.entries, self.size_bytes - self.most_bytes
        while excess > 0 and entries:
            path = entries.pop(0)
            excess -= path.stat().st_size
            path.unlink(missing_ok=True)


@dataclass
class CachedFlow:
    """A flow source of one scene that takes stored fields, or stores those that it measures."""

    source: FlowSource
    made_with: str
    """Settings, code and weights of the source."""
    cache: FlowCache
    fresh: bool = False
    """Whether to measure and store even where an entry is there."""
    _digest: bytes = b""
    _count: int = 0
    _entry: Path | None = None
    _reads: zipfile.ZipFile | None = None
    _writes: zipfile.ZipFile | None = None
    _part: Path | None = None

    def __post_init__(self) -> None:
        self.needs_sweeps, self.stateful = self.source.needs_sweeps, self.source.stateful
        self.error_model, self.past_sweeps = self.source.error_model, self.source.past_sweeps
        self._digest = digest_of(LAYOUT, self.made_with)
        if isinstance(self.source, FrameObserver):
            self.observe: Callable[[Frame], None] = self._observe

    def reset(self) -> None:
        """Reset the source."""
        self._digest = digest_of(self._digest, "reset")
        self.source.reset()

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the stored field for these sweeps, or the source's.

        Raises:
            StaleEntryError: the entry is of other data from here on; a source that filters can't
                start in the middle of a scene.
        """
        self._digest = digest_of(self._digest, *past, current)
        if not self._count:
            self._open()
        self._count += 1
        if self._reads is not None:
            return self._stored(self._reads)
        return self._measured(past, current)

    def keep(self) -> None:
        """End the scene; make what was stored an entry."""
        if self._writes is not None and self._part is not None and self._entry is not None:
            self._writes.close()
            self._part.replace(self._entry)
            self.cache.trim()
        self.discard()

    def discard(self) -> None:
        """End the scene without an entry."""
        for archive in (self._reads, self._writes):
            if archive is not None:
                archive.close()
        if self._part is not None:
            self._part.unlink(missing_ok=True)

    def _observe(self, frame: Frame) -> None:
        self._digest = digest_of(self._digest, frame)
        if isinstance(self.source, FrameObserver):
            self.source.observe(frame)

    def _open(self) -> None:
        """Open the entry that the first pair names, to read, or a new one, to write."""
        self._entry = self.cache.folder / f"{self._digest.hex()[:40]}{SUFFIX}"
        if self._entry.exists() and not self.fresh:
            try:
                self._reads = zipfile.ZipFile(self._entry)
            except (OSError, zipfile.BadZipFile) as error:
                raise StaleEntryError(str(error)) from error
            self._entry.touch()
            return
        self.cache.folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=self.cache.folder, prefix=".flow.", suffix=UNFINISHED)
        self._part = Path(name)
        os.close(handle)
        self._writes = zipfile.ZipFile(self._part, "w", zipfile.ZIP_DEFLATED, compresslevel=FASTEST)

    def _stored(self, archive: zipfile.ZipFile) -> FlowField:
        try:
            found = unpacked(archive.read(str(self._count)))
        except (KeyError, ValueError, OSError, zipfile.BadZipFile, zlib.error) as error:
            raise StaleEntryError(f"{self._entry}: {error}") from error
        if found.digest != self._digest:
            raise StaleEntryError(f"{self._entry}: field {self._count} is of other data")
        charge(found.seconds, found.parts)
        return found.flow

    def _measured(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        parts: dict[str, float] = {}
        start = time.perf_counter()
        with collect_timings(lambda name, s: parts.update({name: parts.get(name, 0.0) + s})):
            flow = self.source.estimate(past, current)
        seconds = time.perf_counter() - start
        charge(0.0, parts)
        if self._writes is not None:
            self._writes.writestr(
                str(self._count), packed(StoredFlow(self._digest, flow, seconds, parts))
            )
        return flow
