"""Verdicts follow from intervals alone, claims from what the paper prints."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mottrack.eval.paired import MetricKey, PairedDifference, Ratio, draw, sample
from mottrack.formats.text_table import to_latex
from mottrack.paper.claims import Claim, Finding, claims, verdict_of
from mottrack.paper.plan import Study
from mottrack.paper.published import DOGMA, NONE, PILLARFLOW, TABLE_IV, TABLE_V, TABLES
from mottrack.paper.results import FailedScene, StudyResult, flow_times
from mottrack.paper.tables import claim_table, number_table, paper_table
from mottrack.runs.differences import Resamples

KEY = MetricKey("velocity", "unlabelled tracks (assumed static)", "mean", "m/s")
NAN = float("nan")


def claim(*, lower: bool = True, published: tuple[float, float] | None = (0.48, 0.839)) -> Claim:
    return Claim("IV", "Table IV", "velocity", "static", KEY, PILLARFLOW, NONE, lower, published)


def found(low: float, high: float, scenes: int = 9) -> PairedDifference:
    middle = 0.0 if low != low else (low + high) / 2
    return PairedDifference(KEY, 1.0, 1.0 + middle, low, high, scenes)


@pytest.mark.parametrize(
    ("low", "high", "lower", "verdict"),
    [
        (-0.6, -0.2, True, "reproduced"),
        (0.2, 0.6, True, "reversed"),
        (0.2, 0.6, False, "reproduced"),
        (-0.6, -0.2, False, "reversed"),
        (-0.5, 0.1, True, "undecided"),  # contains zero and the paper's -43 %
        (-0.1, 0.1, True, "not reproduced"),  # contains zero, excludes -43 %
        (NAN, NAN, True, "undecided"),
    ],
)
def test_every_verdict(low: float, high: float, lower: bool, verdict: str) -> None:
    assert verdict_of(claim(lower=lower), found(low, high)) == verdict


def test_a_claim_in_words_can_not_be_refuted_by_zero_and_a_missing_run_is_reported() -> None:
    assert verdict_of(claim(published=None), found(-0.01, 0.01)) == "undecided"
    assert verdict_of(claim(published=None), found(-0.03, -0.01)) == "reproduced"
    assert verdict_of(claim(), None) == "not measured"


def test_the_values_of_the_paper_reproduce_every_claim() -> None:
    listed = [c for c in claims() if c.published is not None]
    assert len(listed) > 50
    for one in listed:
        subject, rival = one.published
        gain = subject - rival
        ours = PairedDifference(one.key, rival, subject, *sorted((gain, gain / 2)), 9)
        assert verdict_of(one, ours) == "reproduced"
        swapped = PairedDifference(one.key, subject, rival, *sorted((-gain, -gain / 2)), 9)
        assert verdict_of(one, swapped) == "reversed"


def test_the_transcribed_values_are_those_of_the_paper(shared_data: Path) -> None:
    text = (shared_data.parent / "paper" / "pillarflow.tex").read_text()
    numbers = set(re.findall(r"\d+\.?\d*", text.partition(r"\begin{thebibliography}")[0]))
    for table in TABLES:
        percent = 100 if table.number == "III" else 1
        for row in table.values.values():
            for value in filter(None, row):
                printed = {f"{percent * value:.{k}f}" for k in range(4)}
                assert printed & numbers, (table.number, value)


def test_slow_objects_and_amotp_have_the_order_of_the_paper() -> None:
    by_text = {c.text: c for c in claims()}
    slow = by_text["slow (0, 3] m/s, mean: PillarFlow higher than no velocities"]
    assert slow.published == (0.666, 0.566)
    assert not slow.favours_pillarflow  # unlike most claims
    assert by_text["AMOTA: PillarFlow higher than Binary OGM"].favours_pillarflow
    assert "AMOTP (m): PillarFlow lower than no velocities" in by_text
    assert "mean (ms): PillarFlow lower than DOGMa" in by_text
    assert len(by_text) == len(claims())


def study(figures: dict[str, float], key: MetricKey, scenes: int = 6) -> StudyResult:
    rng = np.random.default_rng(0)
    weights = draw(scenes, 200)
    noise = rng.normal(0, 0.01, scenes)
    sampled = {
        variant: {key: sample(Ratio(level + noise, np.ones(scenes)), weights)}
        for variant, level in figures.items()
    }
    names = tuple(f"s{k}" for k in range(scenes))
    return StudyResult(Study("velocity", "world", "World", ()), Resamples(names, sampled), {}, {})


def test_a_table_shows_both_values_and_what_was_not_measured() -> None:
    result = study({NONE: 1.2, PILLARFLOW: 0.7}, KEY)
    shown = paper_table(TABLE_IV, result)
    first = dict(zip([c.name for c in shown.columns], shown.texts()[0], strict=True))
    assert re.fullmatch(r"1\.\d{3} ± 0\.\d{3} \(paper 0\.839\)", first["none"])
    assert first["DOGMa"] == "not measured (paper 0.848)"
    failed = replace(result, failed={FailedScene(DOGMA, "s1"): "out of memory"})
    assert "DOGMa: failed: out of memory." in paper_table(TABLE_IV, failed).note
    numbers = number_table(TABLE_IV, result)
    assert numbers.rows[0][:2] == ("none", "unlabelled tracks (assumed static), mean")
    assert numbers.rows[0][5] == 0.839
    text = to_latex(shown)
    assert r"$\pm$" in text
    assert r"worst 5 \%" in text


def test_claims_are_written_as_strict_json_and_latex() -> None:
    one = found(NAN, NAN, 1)
    findings = [
        Finding(claim(), "world", "undecided", one),
        Finding(claim(), "world", "not measured"),
    ]
    plain = [finding.as_dict() for finding in findings]
    assert json.loads(json.dumps(plain, allow_nan=False))[0]["low"] is None
    assert "difference" not in plain[1]
    text = to_latex(claim_table(findings, "world"))
    assert text.count(r"\\") == 3


def test_runtimes_exclude_warm_up_and_frames_without_flow() -> None:
    timed = {"flow": np.array([0.0, 9.0, 9.0, 9.0, 0.010, 0.030])}
    figures = {k.metric: v for k, v in flow_times([timed, timed], draw(2, 50)).items()}
    assert figures["mean"].value == pytest.approx(20.0)
    assert figures["variance"].value == pytest.approx(100.0)
    assert TABLE_V.columns[0].key in flow_times([timed], draw(1, 5))
