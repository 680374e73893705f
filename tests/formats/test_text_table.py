import csv
import io
import re
from pathlib import Path

import pytest

from mottrack.formats.text_table import (
    Column,
    TextTable,
    aligned,
    latex,
    to_csv,
    to_latex,
    to_markdown,
    write_tables,
)

TABLE = TextTable(
    "speed_error",
    "Error & more: 5 %",
    (Column("run_name"), Column("x|y"), Column("change", digits=2, signed=True), Column("n")),
    (("a_b & c", 1.23456, 0.5, 3), ("100 % {x}", float("nan"), None, 4)),
    note="note ± 1",
)


def test_csv_keeps_every_digit_and_leaves_out_what_does_not_exist() -> None:
    rows = list(csv.reader(io.StringIO(to_csv(TABLE))))
    assert rows[0] == ["run_name", "x|y", "change", "n"]
    assert rows[1] == ["a_b & c", "1.23456", "0.5", "3"]
    assert rows[2] == ["100 % {x}", "", "", "4"]


def test_latex_escapes_what_it_would_take_for_a_command() -> None:
    text = to_latex(TABLE)
    assert r"a\_b \& c & 1.235 & +0.50 & 3 \\" in text
    assert r"100 \% \{x\} & -- & -- & 4 \\" in text
    assert r"\begin{tabular}{lrrr}" in text
    assert r"\label{tab:speed-error}" in text
    assert text.count(r"\toprule") == text.count(r"\midrule") == text.count(r"\bottomrule") == 1
    assert text.isascii()
    bare = re.sub(r"\\[&%_{}#$]|\\[a-z]+(\[[^]]*\])?|\\\\", "", text)
    assert not set("%#_^~") & set(bare)


@pytest.mark.parametrize("character", list("\\&%$#_{}~^"))
def test_no_special_character_stays_bare(character: str) -> None:
    assert latex(character) != character
    assert latex(character).startswith("\\")


def test_markdown_is_a_table_even_with_bars_in_its_cells() -> None:
    lines = [line for line in to_markdown(TABLE).splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {5}
    assert lines[1] == "| :-- | --: | --: | --: |"


def test_three_files_a_table(tmp_path: Path) -> None:
    write_tables([TABLE], tmp_path / "tables")
    names = sorted(path.name for path in (tmp_path / "tables").iterdir())
    assert names == ["speed_error.csv", "speed_error.md", "speed_error.tex"]


def test_lines_for_a_terminal_end_in_columns() -> None:
    text = aligned([["class", "mota"], ["car", "0.5"], ["pedestrian", "-1.25"]])
    assert text.splitlines() == ["class        mota", "car           0.5", "pedestrian  -1.25"]
