"""The configuration reference, generated from the pydantic models."""

from __future__ import annotations

from importlib import import_module

from fields import rows
from pieces import code, paragraphs, table
from pydantic import BaseModel

from mottrack.core.interfaces import TableEntry
from mottrack.experiment.configs import shipped_folder, summary
from mottrack.experiment.plugins import PARTS
from mottrack.experiment.settings import Settings
from mottrack.flow.pillarflow.training.config import TrainConfig

HEAD = ("key", "value", "default", "")
INTRODUCTION = """# Configuration

An experiment is a YAML file of these keys. On the command line `key=value` overrides one, a comma
makes a sweep (`flow=zero,icp`), and a wrong key or value is an error that names the valid ones.
`NAME` of a part is one of those below, a file `<group>/NAME.yaml` beside the experiment or shipped,
or `module:Class` of your own. This page is generated from the models that check every run.
"""


def page() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION, _shipped(), "## The experiment\n", _table(Settings, "")]
    for group, kind in PARTS.items():
        parts.append(f"## {group}\n\nSet by `{group}=NAME`, or `{group}: {{kind: NAME, ...}}`.\n")
        parts += [_part(group, name, entry) for name, entry in kind.table.items()]
    parts.append("## Training\n\nOf `mottrack train`: a file of its own.\n")
    parts.append(_table(TrainConfig, ""))
    return "\n".join(parts)


def _part(group: str, name: str, entry: TableEntry) -> str:
    summary, table_ = paragraphs(entry.summary), _table(model_of(entry), f"{group}.")
    return f'<a id="{group}-{name}"></a>\n\n### {group}={name}\n\n{summary}\n{table_}'


def model_of(entry: TableEntry) -> type[BaseModel]:
    """Return the settings of a class."""
    module, _, name = entry.target.partition(":")
    model: type[BaseModel] = getattr(import_module(module), name).Config
    return model


def _table(model: type[BaseModel], prefix: str) -> str:
    cells = [
        (code(r.key), f"{r.type}, {r.range}".strip(", "), code(r.default), r.description)
        for r in rows(model, prefix)
    ]
    return table(HEAD, cells) if cells else "It has no settings.\n"


def _shipped() -> str:
    folder = shipped_folder()
    of_groups = [file for group in PARTS for file in sorted((folder / group).glob("*.yaml"))]
    lines = []
    for file in (*sorted(folder.glob("*.yaml")), *of_groups):
        name = str(file.relative_to(folder).with_suffix(""))
        lines.append((code(name.replace("/", "=")), summary(file)))
    return "## Shipped files\n\n" + table(("name", ""), lines)
