"""The plan composes; page, tables and claims.json are complete whatever was measured."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from mottrack.core import ConfigError
from mottrack.eval.paired import PairedDifference, Ratio, draw, sample
from mottrack.eval.velocity_value import Value
from mottrack.experiment.experiment import load_experiments
from mottrack.paper.page import write_paper
from mottrack.paper.plan import STUDIES, Request, Study, config_file
from mottrack.paper.published import NONE, SCENE_FLOW, TABLES
from mottrack.paper.results import Results, StudyResult
from mottrack.paper.studies import spread, studies
from mottrack.runs.differences import Resamples
from mottrack.runs.velocity_bench import VELOCITY, FlowValue, metric_key

SCENES = 5


class Outline(HTMLParser):
    """Checks that every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, _attrs: object) -> None:
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def results() -> Results:
    """Return results as if every run but those of Table II had measured the paper's values."""
    rng = np.random.default_rng(3)
    weights = draw(SCENES, 100)
    figures: dict[str, dict] = {}
    for table in TABLES:
        if table.number == "II":
            continue
        # a table of ours has no value of the paper: half a metre each, as good as any
        of_ours = {variant: (0.5,) * len(table.columns) for variant in table.extra}
        for variant, values in (table.values or of_ours).items():
            for (_, key), value in zip(table.columns, values, strict=True):
                level = (value or 1.0) * (1 + 1e-4 * rng.normal(size=SCENES))
                of_study = figures.setdefault(table.study, {}).setdefault(variant, {})
                of_study[key] = sample(Ratio(level, np.ones(SCENES)), weights)
    scenes = tuple(f"s{k}" for k in range(SCENES))
    return Results(
        tuple(
            StudyResult(
                Study(name, "world", "<World>", tuple(load_experiments(str(config_file(name))))),
                Resamples(scenes, runs),
                {},
                {},
                worth() if name == "tracking_default" else (),
            )
            for name, runs in figures.items()
        )
    )


def worth() -> tuple[FlowValue, ...]:
    """Return a flow that saves 42 % of what the truth does, and costs standing objects."""
    share = Value("velocity error", 0.42, 0.2, 0.49)
    still = metric_key("velocity error", "stationary")
    rows = (
        PairedDifference(VELOCITY, 0.73, 0.53, -0.3, -0.1, SCENES),
        PairedDifference(still, 0.10, 0.13, 0.01, 0.06, SCENES),
    )
    return (FlowValue("pillarflow", "zero", False, rows, (share,), {}),)


def test_everything_is_written_and_consistent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mottrack.paper.plan.SHIPPED", tmp_path)  # no weights for Table II
    lines = list(write_paper(results(), Request(tmp_path, quick=True)))
    text = (tmp_path / "paper.html").read_text()
    assert Outline(text).open == []
    assert not re.search(r"(src|href)=\"(?!data:|#)", text)
    assert "&lt;World&gt;" in text
    stored = json.loads((tmp_path / "claims.json").read_text())
    counts, listed = stored["counts"]["world"], stored["claims"]
    assert sum(counts.values()) == len(listed) == text.count('<td class="verdict')
    assert counts["reproduced"] >= 50
    of_table_two = {claim["verdict"] for claim in listed if "Table II," in claim["source"]}
    assert of_table_two <= {"not measured"}
    assert "make train-equal NETWORKS=spynet" in text
    names = {path.name for path in (tmp_path / "tables").iterdir()}
    for table in TABLES:
        for suffix in ("csv", "tex"):
            assert f"table_{table.number}_world.{suffix}" in names
    tables = (tmp_path / "paper.md").read_text()
    assert tables.count("**Table ") == sum(bool(table.values) for table in TABLES)
    assert f"**{SCENE_FLOW.title}**" in tables
    assert "reproduced" in lines[0]
    told = (
        "failed: PillarFlow recovers half of the velocity error that the true flow saves (at least"
    )
    assert told in text
    assert any(told in line for line in lines)
    assert len(re.findall('class="criterion verdict not-met', text)) == 2  # and standing objects
    found = {c["claim"]: c["verdict"] for c in stored["criteria"]}
    assert found["standing objects are not worse"] == "failed"
    assert found["slow objects are not worse"] == "not measured"
    assert "flow_value_tracking_default_world.csv" in names


def test_the_plan_composes_and_no_run_uses_a_seed_of_training(tmp_path: Path) -> None:
    for quick in (False, True):
        found = studies(Request(tmp_path, quick))
        assert [study.name for study in found] == [*STUDIES, "ball", "runtime"]
        for study in found:
            titles = [run.variant for run in study.runs]
            assert len(set(titles)) == len(titles) > 1
            seeds = {run.dataset.config.seed for run in study.runs}
            assert not seeds & {1, 900_001, 4242, 77_000}
        for table in TABLES:
            runs = {r.variant for s in found if s.name == table.study for r in s.runs}
            assert table.number == "II" or runs >= set(table.variants)


def recorded(tmp_path: Path, name: str, root: Path, *settings: str) -> dict[str, Study]:
    found = studies(Request(tmp_path, True, {name: root}, settings))
    return {study.name: study for study in found if study.dataset == name}


def test_sweeps_without_detections_serve_all_but_registration_and_tracking(
    shared_data: Path, tmp_path: Path
) -> None:
    found = recorded(tmp_path, "argoverse2", shared_data / "argoverse2")
    for study in (found["flow"], found["velocity"]):
        assert {run.settings.scenes for run in study.runs} == {("pandaset-002",)}
        assert not any(run.flow.kind == "icp" for run in study.runs)
        assert {run.objects.kind for run in study.runs} == {"clusters"}
        assert len(study.left_out) == 1  # the log without sweeps is listed
    assert set(found["flow"].absent) == {"icp", "icp_one_start"}
    assert "argoverse2.detections=" in found["tracking"].reason


def test_detections_without_sweeps_serve_the_tracker_without_flow(
    shared_data: Path, tmp_path: Path
) -> None:
    root = shared_data / "nuscenes_mini"
    boxes = f"nuscenes.detections={root / 'detections' / 'centerpoint_scene-0103.json'}"
    found = recorded(tmp_path, "nuscenes", root, boxes)
    (run,) = found["tracking"].runs
    assert (run.variant, run.settings.scenes) == (NONE, ("scene-0103",))
    assert set(found["tracking"].absent.values()) == {
        "needs sweeps, which no scene with detections has"
    }
    for name in ("flow", "velocity"):
        assert found[name].reason == "no scene has a sweep in every frame"
    kitti = recorded(tmp_path, "kitti", shared_data / "kitti_tracking")
    assert [study.name for study in kitti.values() if study.runs] == [
        "tracking",
        "tracking_default",
    ]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("kitti.split=testing", r"needs the data set's folder: --kitti FOLDER"),
        (
            "waymo.split=testing",
            r"belongs to no data set, expected NAME\.key=value with NAME one of",
        ),
    ],
)
def test_a_setting_of_a_data_set_that_is_not_given_is_an_error(
    tmp_path: Path, setting: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        studies(Request(tmp_path, settings=(setting,)))


def test_a_data_set_without_usable_scenes_is_an_error(shared_data: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nuscenes: no scene can be used: neither detections nor"):
        recorded(tmp_path, "nuscenes", shared_data / "nuscenes_mini")


def test_scenes_are_spread_evenly() -> None:
    names = [f"{k:02d}" for k in range(21)]
    assert spread(names, 3) == ("00", "10", "20")
    assert spread(names[:2], 3) == ("00", "01")
