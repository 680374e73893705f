from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mottrack.core import ConfigError, DataError
from mottrack.experiment.experiment import compose, load_experiments
from mottrack.experiment.overrides import parse_override
from mottrack.formats.yaml_file import parse_yaml, read_yaml

HERE = Path("experiment.yaml")
TOY = {
    "dataset": {"kind": "toy_plugins:ToyDataset"},
    "tracker": {"kind": "toy_plugins:EchoTracker"},
}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\na: 2", "key 'a' twice, line 2"),
        ("a: !!python/object/apply:os.system ['true']", "could not determine a constructor"),
        ("[1, 2]", "a mapping of keys"),
        ("a: &x [1]\nb: [" + "*x, " * 60 + "]", "more than 50 aliases"),
        ("a: " + "[" * 30 + "]" * 30, "nested deeper"),
        ("a: [1", "expected"),
        ("1: a", "key 1 is not a string"),
        ("a: &x {b: *x}", "an alias inside its own anchor"),
    ],
)
def test_malicious_yaml_is_a_one_line_error(text: str, words: str) -> None:
    with pytest.raises(DataError, match=words) as caught:
        parse_yaml(text, HERE)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("experiment.yaml")


def test_a_huge_or_missing_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "big.yaml").write_bytes(b"#" * (1 << 21))
    for name, words in (("big.yaml", "size is 2097152 bytes"), ("none.yaml", "No such file")):
        with pytest.raises(DataError, match=words):
            read_yaml(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "key", "values"),
    [
        ("flow=icp", "flow", ["icp"]),
        ("flow=zero,icp", "flow", ["zero", "icp"]),
        ("tracker.gate=5,7.5", "tracker.gate", [5, 7.5]),
        ("a.b=1e-3", "a.b", [0.001]),
        ('scenes=["0000","0001"]', "scenes", [["0000", "0001"]]),
        ("a=off", "a", ["off"]),
        ("a=null", "a", [None]),
        ("root=/data/a=b", "root", ["/data/a=b"]),
    ],
)
def test_overrides_are_parsed_as_in_hydra(text: str, key: str, values: list[object]) -> None:
    assert parse_override(text) == (key, values)


@pytest.mark.parametrize("text", ["flow", "=icp", "a..b=1", "flow=icp,,zero"])
def test_a_malformed_override_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="override"):
        parse_override(text)


@given(st.text(max_size=60))
def test_parsers_raise_no_other_error_on_any_text(text: str) -> None:
    for parse in (parse_override, lambda t: parse_yaml(t, HERE)):
        try:
            parse(text)
        except (ConfigError, DataError):
            continue


def test_a_sweep_is_every_combination_and_the_command_line_wins() -> None:
    found = compose({**TOY, "flow": ["zero", "icp"]}, ["pair_s=0.1,0.2"], HERE)
    assert [e.variant for e in found] == [
        "zero+pair_s=0.1",
        "zero+pair_s=0.2",
        "icp+pair_s=0.1",
        "icp+pair_s=0.2",
    ]
    (only,) = compose({**TOY, "flow": ["zero", "icp"]}, ["flow=ground_truth"], HERE)
    assert (only.variant, only.flow.kind) == ("", "ground_truth")


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["flow=ipc"], r"unknown flow source 'ipc' \(did you mean 'icp'\?\); valid: .*zero"),
        (["tracker.gat=5", "tracker.kind=kalman"], r"tracker.gat is not a known key"),
        (["velocity.rul=mean"], r"velocity.rul is not a known key \(did you mean 'rule'\?\)"),
        (["trakcer=kalman"], r"trakcer is not a known key \(did you mean 'tracker'\?\)"),
        (["pair_s=fast"], "pair_s is 'fast', expected: input should be a valid number"),
        (["pair_s=-1"], "pair_s is -1, expected: input should be greater than 0"),
        (["flow=nowhere:Flow"], "can't be imported: No module named 'nowhere'"),
        (["flow=os:getcwd"], "is a builtin_function_or_method, expected a class"),
        (["dataset.kind.x=1"], "dataset.kind' has no key"),
        (["grid.cell_m=nan"], "grid.cell_m"),
        (["grid.cell_m=0.3"], r"grid is .*whole number of cells of 0.3 m"),
        (["grid.x_max_m=1e12"], "at most 4096 cells a side"),
        (["scenes=[]"], r"scenes is \[\]"),
        (["scenes=[a, a]"], "each of scenes once"),
        (["pair_s=0.2", "max_pair_s=0.1"], "pair_s at most max_pair_s, 0.1"),
        (["flow=builtins:dict"], "has no estimate, expected methods estimate, reset"),
        (["dataset.frame=3"], r"can't be constructed with \(frame=3\): got an unexpected"),
    ],
)
def test_a_wrong_setting_names_the_key_the_value_and_the_nearest(
    overrides: list[str], words: str
) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        compose(TOY, overrides, HERE)
    assert "\n" not in str(caught.value)


def test_all_problems_are_reported_at_once() -> None:
    with pytest.raises(ConfigError, match=r"pair_s is 'x'.*flow_sample_limit is 0"):
        compose(TOY, ["pair_s=x", "flow_sample_limit=0"], HERE)


def test_equal_settings_have_equal_hashes_and_others_do_not() -> None:
    (a,), (b,), (c,) = (
        compose(TOY, overrides, HERE) for overrides in ([], ["pair_s=0.1"], ["pair_s=0.2"])
    )
    assert a.hash == b.hash != c.hash


def test_a_group_file_beside_the_experiment_is_found(tmp_path: Path) -> None:
    (tmp_path / "flow").mkdir()
    (tmp_path / "flow" / "wide.yaml").write_text("kind: zero\nground:\n  max_height_m: 4\n")
    (tmp_path / "mine.yaml").write_text("dataset: {kind: 'toy_plugins:ToyDataset'}\nflow: wide\n")
    (found,) = load_experiments(str(tmp_path / "mine.yaml"))
    assert found.flow.resolved()["ground"]["max_height_m"] == 4


def test_a_shipped_config_is_found_by_name_and_an_unknown_one_lists_them() -> None:
    with pytest.raises(ConfigError, match=r"unknown config 'kitti_flow_source' .*did you mean"):
        load_experiments("kitti_flow_source")


def test_an_override_does_not_change_the_defaults() -> None:
    tree = {"dataset": TOY["dataset"]}
    (plain,) = compose(tree, [], HERE)
    (other,) = compose(tree, ["tracker.preset=pillarflow"], HERE)
    (again,) = compose(tree, [], HERE)
    assert plain.hash == again.hash != other.hash


def test_an_empty_sweep_is_refused() -> None:
    with pytest.raises(ConfigError, match="flow is an empty list"):
        compose({**TOY, "flow": []}, [], HERE)


def test_a_key_of_one_part_of_a_sweep_is_set_for_that_part_alone() -> None:
    found = load_experiments("demo", ["flow=zero,icp", "flow.starts=1,6"])
    assert [(e.title, e.flow.resolved().get("starts")) for e in found] == [
        ("zero", None),
        ("icp+starts=1", 1),
        ("icp+starts=6", 6),
    ]
    with pytest.raises(ConfigError, match=r"flow\.strts is not a known key"):
        load_experiments("demo", ["flow=zero,icp", "flow.strts=1"])
    with pytest.raises(ConfigError, match=r"flow\.starts is not a known key"):
        load_experiments("demo", ["flow=zero", "flow.starts=1"])
