"""Every study that is asked for: on the embedded world, and on recorded data sets."""

from __future__ import annotations

from mottrack.core.errors import ConfigError
from mottrack.experiment.experiment import compose
from mottrack.experiment.yaml_file import read_yaml
from mottrack.paper.ablations import ablation_runs
from mottrack.paper.plan import STUDIES, WORLD, Plan, Request, Study, config_file, read_plan
from mottrack.paper.recorded import recorded_studies


def studies(request: Request) -> list[Study]:
    """Every study that is asked for.

    Raises:
        ConfigError: a setting is wrong, or a data set has no scene that can be used.
        DataError: a data set is not where it is said to be.
    """
    plan, roots = read_plan(), request.roots or {}
    for setting in request.settings:
        name = setting.partition(".")[0]
        if name not in plan.recorded:
            expected = f"NAME.key=value with NAME one of {sorted(plan.recorded)}"
            raise ConfigError(f"setting '{setting}' is of no data set, expected {expected}")
        if name not in roots:
            raise ConfigError(f"setting '{setting}' needs the data set's folder: --{name} FOLDER")
    found = [_world(name, plan, request) for name in (*STUDIES, "ball", "runtime")]
    for name in roots:
        found += recorded_studies(name, plan.recorded[name], request)
    return found


def _world(name: str, plan: Plan, request: Request) -> Study:
    overrides = plan.quick.get(name, []) if request.quick else []
    tree = read_yaml(config_file(name))
    runs = compose(tree, overrides, config_file(name))
    if name == "flow":
        runs += ablation_runs(tree, overrides, request.ablation)
    return Study(name, WORLD, "Embedded world", tuple(runs))
