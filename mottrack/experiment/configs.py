"""Paths of experiment files and of the groups that they compose."""

from __future__ import annotations

from pathlib import Path

from mottrack.core.errors import ConfigError, no_such_file


def shipped_folder() -> Path:
    """Return the folder of configurations that come with the package."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "configs"  # in a wheel; in a checkout they lie beside the package
    return inside if inside.is_dir() else package.parent / "configs"


def find_config(name: str) -> Path:
    """Return the file at that path, or the shipped one of that name (with or without ``.yaml``).

    Raises:
        ConfigError: there is neither, or it is a folder.
    """
    path = Path(name)
    if path.is_file():
        return path
    if path.is_dir():
        raise ConfigError(f"{name} is a folder, expected a YAML file of an experiment")
    shipped = shipped_folder() / f"{path.stem}.yaml"
    if shipped.is_file() and path.parent.name in ("", "configs"):
        return shipped
    raise no_such_file("config", name, shipped_configs())


def shipped_configs() -> dict[str, Path]:
    """Return the experiment files that come with the package, by name."""
    return {path.stem: path for path in sorted(shipped_folder().glob("*.yaml"))}


def summary(path: Path) -> str:
    """Return the comment at the head of a file, up to the first line that ends a sentence."""
    said: list[str] = []
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith("# ") or (said and said[-1].endswith((".", "?"))):
            break
        said.append(line[2:])
    return " ".join(said)


def find_group(group: str, name: str, beside: Path) -> Path | None:
    """Return ``<group>/<name>.yaml`` beside the experiment's file, else the shipped one or None."""
    if not name.replace("_", "").replace("-", "").replace(".", "").isalnum() or ".." in name:
        return None  # module:Class of the user's own, never a path
    for folder in (beside, shipped_folder()):
        path = folder / group / f"{name}.yaml"
        if path.is_file():
            return path
    return None
