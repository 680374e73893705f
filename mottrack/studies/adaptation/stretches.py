"""Stretches of logs: consecutive frames that train together or judge together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mottrack.core.errors import ConfigError
from mottrack.core.interfaces import Dataset, Scene
from mottrack.core.sweep import Sweep, has_jumped, seconds_between

STRETCHES = 20
"""Of all logs together: an interval needs some, and each is to hold more than one situation."""
SHORTEST = 3
"""Frames of a stretch: short logs have fewer stretches instead of shorter ones."""
LONGEST = 40
"""Frames of a stretch, 4 s at 10 Hz: in a longer one the same objects are not seen throughout."""
FEWEST_STRETCHES = 4
"""Two to train, two to judge: fewer have no interval."""
SLACK_S = 0.06
"""An earlier sweep is off its wanted age by up to half a revolution at 10 Hz."""


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames of one scene."""

    scene: str
    frames: range

    @property
    def name(self) -> str:
        """For file names and tables."""
        return f"{self.scene}-{self.frames.start:06d}"


@dataclass(frozen=True)
class Split:
    """Stretches to train on and others to judge by."""

    training: tuple[Stretch, ...]
    held_out: tuple[Stretch, ...]


def split_logs(dataset: Dataset, scenes: Sequence[str], held_out_share: float) -> Split:
    """Cut the scenes into stretches and hold some out, evenly spread.

    No frame is in two of them; the sweeps just before the first frame of a stretch, which belong to
    another one, serve as its past.

    Raises:
        ConfigError: a scene has no sweeps, or there are too few frames.
    """
    counts = {name: _count(dataset.scene(name)) for name in scenes}
    length = min(max(sum(counts.values()) // STRETCHES, SHORTEST), LONGEST)
    found = [
        Stretch(name, range(start, min(start + length, frames)))
        for name, frames in counts.items()
        for start in range(0, frames - SHORTEST + 1, length)
    ]
    if len(found) < FEWEST_STRETCHES:
        total = sum(counts.values())
        raise ConfigError(
            f"the logs have {total} frames with sweeps, expected at least "
            f"{FEWEST_STRETCHES * SHORTEST}: some train and some judge the result"
        )
    every = max(round(1 / held_out_share), 2)
    held_out = tuple(s for k, s in enumerate(found) if k % every == every - 1)
    if len(held_out) < 2:
        held_out = (*held_out, found[0])
    return Split(tuple(s for s in found if s not in held_out), held_out)


def _count(scene: Scene) -> int:
    if not scene.has_sweeps:
        raise ConfigError(f"scene {scene.name} has no sweeps, expected logs with sweeps and poses")
    return len(scene)


def earlier_sweep(scene: Scene, index: int, age_s: float) -> Sweep | None:
    """Return the sweep before a frame whose age is nearest to a wanted one; None if none is near.

    Args:
        scene: with sweeps.
        index: of the frame.
        age_s: wanted.
    """
    stamp_ns = scene.frame(index).stamp_ns
    best, off_s = -1, SLACK_S
    for other in range(index - 1, -1, -1):
        age = seconds_between(scene.frame(other).stamp_ns, stamp_ns)
        if abs(age - age_s) < off_s:
            best, off_s = other, abs(age - age_s)
        if age > age_s + SLACK_S:
            break
    if best < 0:
        return None
    earlier, current = scene.sweep(best), scene.sweep(index)
    usable = len(earlier) and len(current) and not has_jumped(earlier, current)
    return earlier if usable else None
