"""Label-free scores of a run: some of its fields are judged by geometry while the scene goes by."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from mottrack.config import StrictModel
from mottrack.core.frame import Frame
from mottrack.core.interfaces import FlowSource, FrameObserver, Tracker
from mottrack.core.sweep import Sweep, has_jumped, seconds_between
from mottrack.eval.label_free import LabelFreeSums
from mottrack.experiment.experiment import Experiment
from mottrack.experiment.plugins import Part
from mottrack.experiment.settings import LabelFree
from mottrack.flow.stages import Stages, StagesConfig, VisibilityStage
from mottrack.flow.sweep_pair import SweepPair
from mottrack.pipeline.label_free import CHECK_GRID, CHECK_S, Evidence, Reversal
from mottrack.pipeline.mirrored import mirrored_frame, mirrored_sweep
from mottrack.pipeline.once import Once
from mottrack.pipeline.stream import Pair, Step
from mottrack.trackers.kalman.association import Innovations

MOST_FRAMES = 40
"""Key frames of a scene that are judged, evenly spread: neighbours say nearly the same, and a
reversed pair costs another measurement."""
_SHORTEST_S, _LONGEST_S = 0.2, 0.5
"""Age of the earlier sweep: below, slow objects leave no trace; above, what turns or brakes no
longer fits its velocity."""
_COORDINATES = 2
"""Of a position, whose innovation a tracker states: the expectation of its square."""


@runtime_checkable
class StatesInnovations(Protocol):
    """A tracker that keeps the normalised innovations squared of its last step."""

    innovations: Innovations | None


class Evidences:
    """Geometric evidence of the current sweep of a scene, found once for all of its runs."""

    def __init__(self) -> None:
        config = StagesConfig(visibility=VisibilityStage(enabled=False))
        self._stages = Stages(config, CHECK_GRID)
        self.of: Once[Evidence] = Once(self._find)
        self.prepared: Once[SweepPair] = Once(self._prepare)

    def _find(self, earlier: Sweep, current: Sweep) -> Evidence:
        return Evidence.of(self._prepare(earlier, current))

    def _prepare(self, earlier: Sweep, current: Sweep) -> SweepPair:
        return self._stages.before((earlier,), current)


@dataclass
class LabelFreeSampler:
    """Judges one run over a scene."""

    evidences: Evidences
    make_source: Callable[[], FlowSource]
    """Makes another source of the run's kind, for reversed pairs."""
    wanted: LabelFree
    stride: int
    """Of so many frames one is judged."""
    _sweeps: deque[Sweep] = field(default_factory=deque)
    _frames: deque[Frame] = field(default_factory=deque)
    _due: int = 0
    _backwards: FlowSource | None = None
    _sums: LabelFreeSums = field(default_factory=LabelFreeSums)

    def collect(self, frame: Frame, step: Step, index: int) -> None:
        """Judge the field of a key frame whose turn it is; remember the sweep of every frame.

        Args:
            frame: the current frame.
            step: the pipeline's results for it.
            index: of the frame in the scene.
        """
        if self.wanted == "never" or step.pair is None:
            return
        self._remember(frame, step.pair)
        unlabelled = frame.truth is None or self.wanted == "always"
        if step.field is None or not frame.is_key or not unlabelled or index < self._due:
            return
        earlier = self._earlier(step.pair.current)
        if earlier is None:
            return
        self._due = (index // self.stride + 1) * self.stride
        evidence = self.evidences.of(earlier, step.pair.current)
        self._sums += evidence.judge(step.field)
        reversal = self._reversed(step.pair)
        if reversal is not None:
            self._sums += reversal.agreement(evidence, step.field)

    def innovations(self, frame: Frame, tracker: Tracker) -> None:
        """Add the innovations of a step of a tracker that states them."""
        unlabelled = frame.truth is None or self.wanted == "always"
        if self.wanted == "never" or not unlabelled or not isinstance(tracker, StatesInnovations):
            return
        if tracker.innovations is not None:
            nis = tracker.innovations.xy / _COORDINATES
            self._sums += LabelFreeSums(nis=float(nis.sum()), innovations=float(len(nis)))

    def sums(self) -> LabelFreeSums | None:
        """Return the sums of the scene; None where nothing was judged."""
        return self._sums if self._sums.frames else None

    def _remember(self, frame: Frame, pair: Pair) -> None:
        if self._sweeps and has_jumped(self._sweeps[-1], pair.current):
            self._sweeps.clear()
            self._frames.clear()
        for sweep in (*pair.past, pair.current):
            if not any(sweep is known for known in self._sweeps):
                self._sweeps.append(sweep)
        self._frames.append(frame)
        for kept in (self._sweeps, self._frames):
            while seconds_between(kept[0].stamp_ns, frame.stamp_ns) > _LONGEST_S:
                kept.popleft()

    def _earlier(self, current: Sweep) -> Sweep | None:
        ages = [(seconds_between(s.stamp_ns, current.stamp_ns), s) for s in self._sweeps]
        usable = [(abs(age - CHECK_S), s) for age, s in ages if age >= _SHORTEST_S]
        return min(usable, key=lambda one: one[0])[1] if usable else None

    def _reversed(self, pair: Pair) -> Reversal | None:
        """Measure the pair backwards; None where the source filters over time."""
        source = self._backwards or self.make_source()
        self._backwards = source
        if source.stateful:
            return None
        about_ns = pair.current.stamp_ns
        source.reset()
        past, current = (mirrored_sweep(s, about_ns) for s in (pair.current, pair.previous))
        if isinstance(source, FrameObserver):
            known = {frame.stamp_ns: frame for frame in self._frames}
            for sweep in (pair.current, pair.previous):
                if sweep.stamp_ns in known:
                    source.observe(mirrored_frame(known[sweep.stamp_ns], about_ns))
        prepared = self.evidences.prepared(pair.previous, pair.current)
        return Reversal(source.estimate((past,), current), prepared)


def stride_of(frames: int) -> int:
    """Return the number of frames of which one is judged, for a scene of so many."""
    return max(frames // MOST_FRAMES, 1)


def stating_innovations(experiment: Experiment) -> Part:
    """Return the tracker's part with the key `diagnose` set, if it has one: tracks are the same."""
    part = experiment.tracker
    config = part.config
    if isinstance(config, StrictModel) and "diagnose" in type(config).model_fields:
        return Part(part.kind, part.cls, config.model_copy(update={"diagnose": True}))
    return part
