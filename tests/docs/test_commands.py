"""Every command in the documentation exists, with its options and shipped names."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path

import pytest
import typer
import yaml

from mottrack.cli import app
from mottrack.experiment.configs import find_config, shipped_folder
from mottrack.experiment.experiment import compose
from mottrack.studies.folds.plan import Plan

from .conftest import REPOSITORY, TEXTS, blocks, names

EXPERIMENTS = ("run", "compare", "train", "examples", "estimate-noise")


def lines(file: Path) -> list[str]:
    joined = (code.replace("\\\n", " ") for code in blocks(file, ""))
    return [line for code in joined for line in code.splitlines()]


def commands(file: Path, word: str) -> list[list[str]]:
    """Return the words after ``word`` of each line that begins with it, without comments."""
    starts = re.compile(rf"^(?:\$ )?(?:[A-Z]+=\S+ )?{word} (.*)$")
    found = [match[1] for line in lines(file) if (match := starts.match(line))]
    return [shlex.split(text, comments=True) for text in found]


@pytest.mark.parametrize("text", names(TEXTS))
def test_commands_of(text: str) -> None:
    for words in commands(REPOSITORY / text, "mottrack"):
        check_command(words)


@pytest.mark.usefixtures("page_makers")
def test_the_help_of_every_command_has_a_valid_example() -> None:
    for name, command in importlib.import_module("command_line").commands():
        example = re.search(rf"^Example: {name}(.*)$", command.help, re.MULTILINE)
        assert example, f"the help of {name} has no example"
        check_command(shlex.split(f"{name.removeprefix('mottrack ')} {example[1]}"))


def check_command(words: list[str]) -> None:
    """Check the command, options and shipped names of one command line, without `mottrack`."""
    command, rest = typer.main.get_command(app), list(words)
    while getattr(command, "commands", None):
        assert rest[0] in command.commands, f"no command {rest[0]} in: {' '.join(words)}"
        command = command.commands[rest.pop(0)]
    known = {o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
    unknown = {word for word in rest if word.startswith("--")} - known
    assert not unknown, f"{unknown} in: {' '.join(words)}"
    if words[0] in EXPERIMENTS and not rest[0].isupper() and rest[0] != "my.yaml":
        assert find_config(rest[0]).is_file()
    assert not [w for w in rest if unknown_name(w)], " ".join(words)


def unknown_name(word: str) -> bool:
    """Return whether ``flow=a,b`` names something that does not exist."""
    from mottrack.experiment.plugins import PARTS

    group, sign, values = word.partition("=")
    if not sign or group not in PARTS or values.startswith("{"):
        return False
    known = {*PARTS[group].table, *(f.stem for f in (shipped_folder() / group).glob("*.yaml"))}
    return any(v not in known and ":" not in v and v != "ipc" for v in values.split(","))


def test_an_unknown_name_is_detected() -> None:
    assert unknown_name("flow=zero,pillarflo")
    assert not unknown_name("flow=zero,icp,my_module:MyFlow")


def test_experiment_files_in_the_documentation_compose() -> None:
    shown = [(f, block) for f in TEXTS for block in blocks(f, "yaml")]
    assert len(shown) >= 2
    for file, block in shown:
        content = yaml.safe_load(block)
        assert Plan(**content) if "groups" in content else compose(content, [], file)


@pytest.mark.parametrize("text", names(TEXTS))
def test_make_targets_scripts_and_files_of(text: str) -> None:
    makefile = (REPOSITORY / "Makefile").read_text("utf-8")
    content = (REPOSITORY / text).read_text("utf-8")
    for target in re.findall(r"`make ([a-z]+)`|^make ([a-z]+)", content, re.MULTILINE):
        assert f"\n{''.join(target)}:" in makefile
    for script in re.findall(r"python ((?:benchmarks|examples)/\w+\.py)", content):
        assert (REPOSITORY / script).is_file(), script
