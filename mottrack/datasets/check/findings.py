"""What a check found."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from mottrack.core import DataError
from mottrack.datasets.faults import kind_of


@dataclass(frozen=True)
class Finding:
    """One fault: its kind, the scene, and a line with file, field and value."""

    kind: str
    scene: str
    text: str


@dataclass
class SceneCheck:
    """What was looked at in a scene, and what is wrong with it."""

    name: str
    counts: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)

    def add(self, kind: str, text: str) -> None:
        """Note a fault."""
        self.findings.append(Finding(kind, self.name, text))

    def add_error(self, error: Exception) -> None:
        """Note a fault that a reader raised."""
        kind = kind_of(error) if isinstance(error, DataError) else "refused"
        self.add(kind, str(error))


@dataclass(frozen=True)
class CheckResult:
    """All scenes of a check."""

    dataset: str
    scenes: tuple[SceneCheck, ...]

    @property
    def findings(self) -> list[Finding]:
        """Every fault, scene by scene."""
        return [finding for scene in self.scenes for finding in scene.findings]

    @property
    def counts(self) -> Counter[str]:
        """What was looked at, over all scenes."""
        total: Counter[str] = Counter()
        for scene in self.scenes:
            total.update(scene.counts)
        return total
