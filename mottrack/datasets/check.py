"""Check every scene of a data set for what is missing, damaged or out of order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from mottrack.core import ConfigError, DataError, Dataset, Frame, MottrackError, Scene, Sweep
from mottrack.core.concerns import Concern, SceneConcern, summaries
from mottrack.core.processes import end_with_parent
from mottrack.core.sweep import seconds_between
from mottrack.datasets.plausibility.motion import MAX_SPEED_MPS
from mottrack.datasets.plausibility.watch import SceneWatch
from mottrack.formats.faults import MissingError, kind_of

LAYOUTS = {
    "t4": tuple(f"{below}annotation/sample_data.json" for below in ("", "*/", "*/*/")),
    "truckscenes": ("samples/LIDAR_LEFT",),
    "nuscenes": ("v1.0-*",),
    "kitti": ("*/label_02",),
    "argoverse2": ("*/*/city_SE3_egovehicle.feather",),
    "folder": ("*/poses.csv",),
    "py123d": tuple(f"{below}sync.arrow" for below in ("*/", "*/*/")),
    "ros": ("*.mcap", "*.bag", "*.db3", "metadata.yaml", "*/metadata.yaml"),
}
"""Names that only a data set of this kind has."""
MIN_POINTS = 100
"""Fewer than one beam of any LiDAR returns in a revolution."""
SHOWN = 5
"""Faults of a kind that a report shows in full."""


@dataclass(frozen=True)
class Finding:
    """One fault: its kind, the scene, and a line with file, field and value."""

    kind: str
    scene: str
    text: str


@dataclass
class SceneCheck:
    """What was read of a scene, and what is wrong with it."""

    name: str
    counts: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)
    concerns: list[Concern] = field(default_factory=list)
    missing_sweeps: list[str] = field(default_factory=list)

    def add(self, kind: str, text: str) -> None:
        """Note a fault; one that comes back with every frame, as of a whole file, once."""
        finding = Finding(kind, self.name, text)
        if finding not in self.findings[-SHOWN:]:
            self.findings.append(finding)

    def add_error(self, error: MottrackError) -> None:
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
    def concerns(self) -> list[SceneConcern]:
        """Every warning with its scene."""
        return [
            SceneConcern(scene.name, concern) for scene in self.scenes for concern in scene.concerns
        ]

    def lines(self) -> Iterator[str]:
        """Yield what was read, then each kind of fault with its number and the first few."""
        total: Counter[str] = Counter()
        for scene in self.scenes:
            total.update(scene.counts)
        counts = [f"{count} {what}" for what, count in total.items()]
        yield f"{self.dataset}: " + ", ".join([f"{len(self.scenes)} scenes", *counts])
        findings = self.findings
        if not findings:
            yield "no fault found"
        for kind, count in Counter(finding.kind for finding in findings).most_common():
            of_kind = [f for f in findings if f.kind == kind]
            yield f"{kind}: {count} in {len({f.scene for f in of_kind})} scenes"
            yield from (f"  {finding.scene}: {finding.text}" for finding in of_kind[:SHOWN])
            if count > SHOWN:
                yield f"  ... and {count - SHOWN} more"
        yield from (f"warning: {text}" for text in summaries(self.concerns))


def kind_of_folder(root: Path) -> str:
    """Return the kind of data set that a folder holds, by its layout.

    Raises:
        ConfigError: it has the layout of none, or is not there.
    """
    if not root.is_dir():
        found = "is a file" if root.exists() else "does not exist"
        raise ConfigError(f"{root} {found}, expected the folder of a data set")
    for kind, patterns in LAYOUTS.items():
        if any(next(root.glob(pattern), None) is not None for pattern in patterns):
            return kind
    raise ConfigError(
        f"{root} looks like no known data set: name its --format ({', '.join(LAYOUTS)})"
    )


def check_dataset(dataset: Dataset, *, every: int = 1, workers: int = 1) -> CheckResult:
    """Check every scene; a fault that all scenes share, as in a table, is reported once.

    Args:
        dataset: the data set.
        every: read only every so many-th sweep of a scene.
        workers: number of processes.
    """
    names = dataset.scene_names
    shared = _shared_fault(dataset, names)
    if shared is not None:
        return CheckResult(dataset.name, (shared,))
    workers = min(workers, len(names))
    run = partial(_check_named, dataset, every)
    if workers == 1:
        return CheckResult(dataset.name, tuple(map(run, names)))
    with ProcessPoolExecutor(workers, get_context("spawn"), end_with_parent) as pool:
        return CheckResult(dataset.name, tuple(pool.map(run, names)))


def _shared_fault(dataset: Dataset, names: tuple[str, ...]) -> SceneCheck | None:
    """Return the fault that keeps the first two scenes from opening, if it is one and the same."""
    faults: list[MottrackError] = []
    for name in names[:2]:
        try:
            dataset.scene(name)
        except MottrackError as error:
            faults.append(error)
    if len(faults) < 2 or str(faults[0]) != str(faults[1]):
        return None
    check = SceneCheck("every scene")
    check.add_error(faults[0])
    return check


def _check_named(dataset: Dataset, every: int, name: str) -> SceneCheck:
    check = SceneCheck(name)
    try:
        _check_scene(check, dataset.scene(name), every)
    except MottrackError as error:
        check.add_error(error)
    return check


def _check_scene(check: SceneCheck, scene: Scene, every: int) -> None:
    """Check every frame, and every `every`-th sweep."""
    check.counts["frames"] = len(scene)
    previous: Frame | None = None
    watch = SceneWatch(scene)
    for index in range(len(scene)):
        frame = _frame(check, scene, index)
        if frame is not None:
            _check_frame(check, frame)
            if previous is not None:
                _check_step(check, previous, frame)
            previous = frame
        sweep = _sweep(check, scene, index, frame) if index % every == 0 else None
        if frame is not None:
            watch.add(frame, sweep)
    if check.missing_sweeps:
        count = len(check.missing_sweeps)
        more = f" ({count} sweeps of the scene, this is the first)" if count > 1 else ""
        check.add("missing", check.missing_sweeps[0] + more)
    # jumps are faults, and listed one by one
    check.concerns = [c for c in watch.concerns() if not c.kind.startswith("jumps")]


def _frame(check: SceneCheck, scene: Scene, index: int) -> Frame | None:
    try:
        return scene.frame(index)
    except MottrackError as error:
        check.add_error(error)
        return None


def _check_frame(check: SceneCheck, frame: Frame) -> None:
    check.counts["key frames"] += frame.is_key
    for name, boxes in (("true boxes", frame.truth), ("detections", frame.detections)):
        if boxes is not None:
            check.counts[name] += len(boxes)
    if frame.truth is not None and len(np.unique(frame.truth.id)) != len(frame.truth):
        check.add("out of order", f"frame {frame.stamp_ns}: an identity twice in the truth")


def _check_step(check: SceneCheck, previous: Frame, frame: Frame) -> None:
    elapsed_s = seconds_between(previous.stamp_ns, frame.stamp_ns)
    if elapsed_s <= 0.0:
        check.add("out of order", f"frame {frame.stamp_ns} comes after {previous.stamp_ns}")
        return
    moved = frame.world_T_ego.translation_m - previous.world_T_ego.translation_m
    speed = float(np.linalg.norm(moved)) / elapsed_s
    if speed > MAX_SPEED_MPS:
        check.add("jump", f"frame {frame.stamp_ns}: the vehicle moves at {speed:.0f} m/s")
    if frame.truth is not None:
        fast = np.hypot(*frame.truth.velocity_mps.T) > MAX_SPEED_MPS
        for identity in frame.truth.id[fast].tolist():
            check.add("jump", f"frame {frame.stamp_ns}: object {identity} jumps")


def _sweep(check: SceneCheck, scene: Scene, index: int, frame: Frame | None) -> Sweep | None:
    try:
        sweep = scene.sweep(index)
    except MissingError as error:
        check.missing_sweeps.append(str(error))
        return None
    except MottrackError as error:
        check.add_error(error)
        return None
    check.counts["sweeps read"] += 1
    check.counts["points"] += len(sweep)
    if 0 < len(sweep) < MIN_POINTS:  # one without points was lost, and is counted by the watch
        check.add("truncated", f"sweep {sweep.stamp_ns}: {len(sweep)} points")
    if frame is not None and frame.stamp_ns != sweep.stamp_ns:
        check.add("out of order", f"sweep {sweep.stamp_ns} at frame {frame.stamp_ns}")
    return sweep
