"""Damages of files: each knows whether the content gives it away.

A damage is made from the bytes of a whole file and a seeded generator. `told` says that a reader
can know: a number that is none, a row of another length, a record that others speak of. A flipped
bit in a mantissa, a text cut between two lines, can't be known.
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.feather

Rng = np.random.Generator


class Damaged(NamedTuple):
    """The content after a damage, and whether it gives the damage away."""

    data: bytes
    told: bool
    what: str


Damage = Callable[[bytes, Rng], Damaged]


def pick(rng: Rng, items: Any) -> Any:
    return items[int(rng.integers(len(items)))]


# --- any file ------------------------------------------------------------------------------------


def cut(whole_at: Callable[[bytes], bool]) -> Damage:
    """Cut the file; `whole_at` says that what is left looks whole."""

    def damage(data: bytes, rng: Rng) -> Damaged:
        rest = data[: int(rng.integers(len(data)))]
        return Damaged(rest, not whole_at(rest), f"cut at {len(rest)}")

    return damage


def flip(data: bytes, rng: Rng) -> Damaged:
    place, bit = int(rng.integers(len(data))), int(rng.integers(8))
    changed = bytearray(data)
    changed[place] ^= 1 << bit
    return Damaged(bytes(changed), told=False, what=f"bit {bit} of byte {place}")


def garbage(data: bytes, rng: Rng) -> Damaged:
    return Damaged(rng.bytes(min(len(data), 4096)), told=True, what="random bytes")


def empty(_data: bytes, _rng: Rng) -> Damaged:
    return Damaged(b"", told=True, what="empty")


def zeros(data: bytes, rng: Rng) -> Damaged:
    """A block that a full disk or a lost page has left: zeros over a tenth of the file."""
    length = max(len(data) // 10, 8)
    start = int(rng.integers(max(len(data) - length, 1)))
    changed = data[:start] + b"\0" * length + data[start + length :]
    return Damaged(changed, told=False, what=f"{length} zeros at {start}")


# --- text ----------------------------------------------------------------------------------------

NO_NUMBERS = (
    "abc", "nan", "-inf", "1e999", "1_0", "\uff11", "0x10", "9" * 5000, "--1", "1.2.3", "None",
    "1e",
)  # fmt: skip
"""None of these is a finite number in plain digits."""


@dataclass(frozen=True)
class TextRows:
    """How to damage rows of a text file.

    separator: between values; None: white space.
    numbers: columns that are read and hold finite numbers.
    bounded: those of them that a huge number does not fit.
    unique: whether a row that is there twice can't be meant.
    header: the first line is no row.
    """

    numbers: tuple[int, ...]
    separator: str | None = None
    bounded: tuple[int, ...] = ()
    unique: bool = True
    header: bool = False

    def damages(self) -> dict[str, Damage]:
        found = {
            "no number": self.no_number,
            "value gone": self.value_gone,
            "value more": self.value_more,
            "decimal comma": self.decimal_comma,
            "control character": self.control,
            "not UTF-8": self.not_utf8,
            "UTF-16": lambda data, _: Damaged(data.decode().encode("utf-16"), True, "UTF-16"),
            "NUL": lambda data, rng: self.inserted(data, rng, b"\0", "NUL"),
        }
        if self.bounded:
            found["huge number"] = self.huge
        if self.unique:
            found["row twice"] = self.twice
        if len(self.bounded) > 1:
            found["columns swapped"] = self.swapped
        if self.separator:
            found["empty value"] = self.empty_value
        return found

    def rows(self, data: bytes) -> list[str]:
        return data.decode().splitlines()

    def edited(self, data: bytes, rng: Rng, edit: Callable[[list[str]], str]) -> tuple[bytes, str]:
        rows = self.rows(data)
        number = int(rng.integers(int(self.header), len(rows)))
        fields = rows[number].split(self.separator)
        what = edit(fields)
        rows[number] = (self.separator or " ").join(fields)
        return ("\n".join(rows) + "\n").encode(), f"line {number + 1}: {what}"

    def put(self, data: bytes, rng: Rng, columns: tuple[int, ...], text: str) -> Damaged:
        column = pick(rng, columns)

        def edit(fields: list[str]) -> str:
            fields[column] = text
            return f"value {column} is {text[:20]!r}"

        return Damaged(*self.told(self.edited(data, rng, edit)))

    @staticmethod
    def told(edited: tuple[bytes, str]) -> tuple[bytes, bool, str]:
        return edited[0], True, edited[1]

    def no_number(self, data: bytes, rng: Rng) -> Damaged:
        return self.put(data, rng, self.numbers, pick(rng, NO_NUMBERS))

    def huge(self, data: bytes, rng: Rng) -> Damaged:
        return self.put(data, rng, self.bounded, pick(rng, ("1e300", "-1e300", "4e38")))

    def empty_value(self, data: bytes, rng: Rng) -> Damaged:
        return self.put(data, rng, self.numbers, "")

    def value_gone(self, data: bytes, rng: Rng) -> Damaged:
        edited = self.edited(data, rng, lambda f: str(f.pop(int(rng.integers(len(f))))))
        # in a file of one row nothing says how long rows are
        return Damaged(edited[0], len(self.rows(data)) > 1 + self.header, edited[1])

    def value_more(self, data: bytes, rng: Rng) -> Damaged:
        edited = self.edited(data, rng, lambda f: f.insert(int(rng.integers(len(f))), "7") or "7")
        return Damaged(edited[0], len(self.rows(data)) > 1 + self.header, edited[1])

    def decimal_comma(self, data: bytes, rng: Rng) -> Damaged:
        return self.put(data, rng, self.numbers, "1,5")

    def swapped(self, data: bytes, rng: Rng) -> Damaged:
        """Two columns in each other's place: their numbers may well be possible there."""
        one, other = rng.choice(self.bounded, 2, replace=False).tolist()
        rows = [row.split(self.separator) for row in self.rows(data)]
        for fields in rows[int(self.header) :]:
            fields[one], fields[other] = fields[other], fields[one]
        text = "\n".join((self.separator or " ").join(fields) for fields in rows) + "\n"
        return Damaged(text.encode(), told=False, what=f"columns {one} and {other} swapped")

    def twice(self, data: bytes, rng: Rng) -> Damaged:
        rows = self.rows(data)
        row = rows[int(rng.integers(int(self.header), len(rows)))]
        return Damaged(("\n".join([*rows, row]) + "\n").encode(), True, "a row twice")

    def inserted(self, data: bytes, rng: Rng, text: bytes, what: str) -> Damaged:
        place = int(rng.integers(len(data)))
        return Damaged(data[:place] + text + data[place:], True, f"{what} at {place}")

    def control(self, data: bytes, rng: Rng) -> Damaged:
        text = pick(rng, ("\x1b[2J", "\x07", "\x0b", "\x0c", "\x85", "\u2028"))
        return self.inserted(data, rng, text.encode(), repr(text))

    def not_utf8(self, data: bytes, rng: Rng) -> Damaged:
        return self.inserted(data, rng, pick(rng, (b"\xff", b"\xe4", b"\xc0\x80")), "no UTF-8")


# --- JSON ----------------------------------------------------------------------------------------


def deep(_data: bytes, _rng: Rng) -> Damaged:
    return Damaged(b"[" * 100_000, told=True, what="100,000 brackets")


BAD: dict[str, tuple[Any, ...]] = {
    "token": ("x", None, 5, "", "t\u0000", "\ud800", ["a"], True),
    "file": (None, 5, "\ud800", ["a"], {}, "../../x", "a" * 5000, "a\u0000"),
    "identity": (None, 1.5, ["a"], True),
    "reference": (None, 5, "\ud800", ["a"], {}),
    "count": (-1, 2**64 - 1, 2**63, 1e300, None, "3", [1], 10**30),
    "time": (-1, 2**64 - 1, 2**62, 1e300, None, "3", [1], 1.5),
    "flag": (7, None, "true", -1, [True]),
    "place": ([1e300, 0, 0], ["1", "2", "3"], [1, 2], None, "x", [None, 1, 1], [[1, 2, 3]]),
    "size": ([-1, 1, 1], [0, 1, 1], [1e300, 1, 1], [1, 1], None, ["1", "1", "1"]),
    "rotation": ([0, 0, 0, 0], [2, 0, 0, 0], [0, 1, 0, 0], [1, 0, 0], None, [None] * 4),
    "speed": (["a", 1], [1], "x", [1, 2, 3], {}, 5),
    "score": (None, "x", [1], 1e999, {}),
    "class": ("tank", None, 5, "\x1b[2J", ""),
}
"""Values that a field of that kind can't have."""


@dataclass(frozen=True)
class Records:
    """How to damage records of a JSON table.

    fields: name to kind of each field that is read: token, int, number, vector, text.
    lost: whether a record that is gone, or is there twice, is missed.
    """

    fields: dict[str, str]
    lost: bool = True

    def damages(self) -> dict[str, Damage]:
        found: dict[str, Damage] = {
            "bad value": self.bad_value,
            "field gone": self.field_gone,
            "field renamed": self.field_renamed,
            "brackets": deep,
        }
        if self.lost:
            found |= {"record gone": self.gone, "record twice": self.again}
        return found

    def records(self, content: Any) -> list[dict[str, Any]]:
        return content

    def edited(self, data: bytes, rng: Rng, edit: Callable[[dict[str, Any]], str]) -> Damaged:
        content = json.loads(data)
        record = pick(rng, self.records(content))
        what = edit(record)
        return Damaged(json.dumps(content).encode(), True, what)

    def bad_value(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, list(self.fields))
        value = pick(rng, BAD[self.fields[name]])
        return self.edited(data, rng, lambda r: r.update({name: value}) or f"{name} = {value!r}")

    def field_gone(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, list(self.fields))
        return self.edited(data, rng, lambda r: f"{name} gone {bool(r.pop(name))}")

    def field_renamed(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, list(self.fields))

        def edit(record: dict[str, Any]) -> str:
            record[f"{name}_"] = record.pop(name)
            return f"{name} renamed"

        return self.edited(data, rng, edit)

    def gone(self, data: bytes, rng: Rng) -> Damaged:
        content = json.loads(data)
        rows = self.records(content)
        rows.pop(int(rng.integers(len(rows))))
        return Damaged(json.dumps(content).encode(), True, "a record gone")

    def again(self, data: bytes, rng: Rng) -> Damaged:
        content = json.loads(data)
        rows = self.records(content)
        rows.append(pick(rng, rows))
        return Damaged(json.dumps(content).encode(), True, "a record twice")


class Results(Records):
    """The same for detections or a submission: {"results": {token: [box, ...]}}."""

    def records(self, content: Any) -> list[dict[str, Any]]:
        return [box for boxes in content["results"].values() for box in boxes]

    def damages(self) -> dict[str, Damage]:
        found = super().damages()
        for name in ("record gone", "record twice"):
            found.pop(name, None)
        return found | {"sample gone": self.sample_gone, "box twice": self.box_twice}

    def sample_gone(self, data: bytes, rng: Rng) -> Damaged:
        content = json.loads(data)
        content["results"].pop(pick(rng, list(content["results"])))
        return Damaged(json.dumps(content).encode(), True, "a sample gone")

    def box_twice(self, data: bytes, rng: Rng) -> Damaged:
        content = json.loads(data)
        boxes = pick(rng, [boxes for boxes in content["results"].values() if boxes])
        boxes.append(pick(rng, boxes))
        return Damaged(json.dumps(content).encode(), True, "a box twice")


# --- feather -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Arrow:
    """How to damage a feather file.

    numbers: columns of finite numbers that are read.
    bounded: those that a huge number does not fit.
    whole: columns of integers. texts: columns of text.
    unique: whether a row that is there twice can't be meant.
    """

    numbers: tuple[str, ...]
    bounded: tuple[str, ...]
    whole: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    unique: bool = True

    def damages(self) -> dict[str, Damage]:
        found = {
            "not finite": self.not_finite,
            "huge number": self.huge,
            "null": self.null,
            "column gone": self.column_gone,
            "column renamed": self.column_renamed,
            "column of text": self.retyped,
            "columns swapped": self.swapped,
        }
        if self.whole:
            found["float64 integers"] = self.floats
        if self.texts:
            found["control character"] = self.control
        if self.unique:
            found["row twice"] = self.twice
        return found

    def changed(self, data: bytes, rng: Rng, names: tuple[str, ...], value: Any) -> Damaged:
        table = pa.feather.read_table(pa.BufferReader(data))
        name = pick(rng, names)
        values = table[name].to_pylist()
        row = int(rng.integers(len(values)))
        values[row] = value
        column = pa.array(values, type=table[name].type)
        return self.stored(self.put(table, name, column), f"{name} of row {row} = {value!r}")

    @staticmethod
    def put(table: pa.Table, name: str, column: pa.Array) -> pa.Table:
        return table.set_column(table.column_names.index(name), name, column)

    @staticmethod
    def stored(table: pa.Table, what: str) -> Damaged:
        out = io.BytesIO()
        pa.feather.write_feather(table, out)
        return Damaged(out.getvalue(), told=True, what=what)

    def not_finite(self, data: bytes, rng: Rng) -> Damaged:
        return self.changed(data, rng, self.numbers, pick(rng, (float("nan"), float("-inf"))))

    def huge(self, data: bytes, rng: Rng) -> Damaged:
        return self.changed(data, rng, self.bounded, pick(rng, (1e30, -1e30)))

    def null(self, data: bytes, rng: Rng) -> Damaged:
        return self.changed(data, rng, (*self.numbers, *self.whole, *self.texts), None)

    def control(self, data: bytes, rng: Rng) -> Damaged:
        return self.changed(data, rng, self.texts, pick(rng, ("\x1b[31m", "a\nb", "\0")))

    def column_gone(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, (*self.numbers, *self.whole, *self.texts))
        table = pa.feather.read_table(pa.BufferReader(data))
        return self.stored(table.drop_columns([name]), f"{name} gone")

    def column_renamed(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, (*self.numbers, *self.whole, *self.texts))
        table = pa.feather.read_table(pa.BufferReader(data))
        names = [f"{n}_" if n == name else n for n in table.column_names]
        return self.stored(table.rename_columns(names), f"{name} renamed")

    def retyped(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, (*self.numbers, *self.whole))
        table = pa.feather.read_table(pa.BufferReader(data))
        texts = pa.array([str(value) for value in table[name].to_pylist()])
        return self.stored(self.put(table, name, texts), f"{name} as text")

    def swapped(self, data: bytes, rng: Rng) -> Damaged:
        one, other = rng.choice(self.bounded, 2, replace=False).tolist()
        table = pa.feather.read_table(pa.BufferReader(data))
        names = [{one: other, other: one}.get(name, name) for name in table.column_names]
        stored = self.stored(table.rename_columns(names), f"{one} and {other} swapped")
        return stored._replace(told=False)

    def floats(self, data: bytes, rng: Rng) -> Damaged:
        name = pick(rng, self.whole)
        table = pa.feather.read_table(pa.BufferReader(data))
        return self.stored(self.put(table, name, table[name].cast(pa.float64())), f"{name} float")

    def twice(self, data: bytes, rng: Rng) -> Damaged:
        table = pa.feather.read_table(pa.BufferReader(data))
        row = int(rng.integers(table.num_rows))
        return self.stored(pa.concat_tables([table, table.slice(row, 1)]), f"row {row} twice")


# --- raw floats, npy, npz ------------------------------------------------------------------------


@dataclass(frozen=True)
class Floats:
    """How to damage a file of float32 rows of which all columns are read."""

    columns: int

    def damages(self) -> dict[str, Damage]:
        return {"bad float": self.bad}

    def bad(self, data: bytes, rng: Rng) -> Damaged:
        values = np.frombuffer(data, "<f4").copy()
        value = pick(rng, (np.nan, np.inf, -1e30, 1e30))
        place = int(rng.integers(len(values)))
        values[place] = value
        return Damaged(values.tobytes(), True, f"float {place} = {value}")


def npz_damages() -> dict[str, Damage]:
    return {
        "npy": lambda data, _: Damaged(_npy(_arrays(data)["xyz_m"]), True, "an npy file"),
        "encrypted": lambda data, _: Damaged(_zip_flags(data), True, "encrypted"),
        "other packing": lambda data, _: Damaged(_zip_method(data), True, "method 99"),
        "array changed": _npz_changed,
    }


def npy_damages() -> dict[str, Damage]:
    return {
        "huge shape": lambda _, rng: Damaged(_huge(rng), True, "a huge shape"),
        "objects": lambda *_: Damaged(_npy(np.array([{}], object)), True, "objects"),
        "text": lambda *_: Damaged(_npy(np.full((3, 3), "a")), True, "text"),
        "infinite": lambda data, rng: Damaged(_infinite(data, rng), True, "infinite"),
        "other shape": lambda data, _: Damaged(
            _npy(np.load(io.BytesIO(data)).ravel()), True, "1-D"
        ),
    }


def _npz_changed(data: bytes, rng: Rng) -> Damaged:
    arrays = _arrays(data)
    name = pick(rng, ("xyz_m", "reflectance"))
    change = pick(rng, ("gone", "short", "text", "nan", "huge", "objects", "shape"))
    array = arrays[name]
    members: dict[str, bytes] = {key: _npy(value) for key, value in arrays.items()}
    match change:
        case "gone":
            members.pop(name)
        case "short":
            members[name] = _npy(array[:-1])
        case "text":
            members[name] = _npy(array.astype("U8"))
        case "nan":
            changed = array.astype(np.float64)
            changed[int(rng.integers(len(array)))] = np.nan
            members[name] = _npy(changed)
        case "huge":
            members[name] = _npy(np.full_like(array, 1e30))
        case "objects":
            members[name] = _npy(array.astype(object))
        case _:
            members[name] = _huge(rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for key, content in members.items():
            archive.writestr(f"{key}.npy", content)
    return Damaged(out.getvalue(), True, f"{name} {change}")


def _arrays(data: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(data)) as file:
        return {name: file[name] for name in file.files}


def _npy(array: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=True)
    return out.getvalue()


def _infinite(data: bytes, rng: Rng) -> bytes:
    array = np.load(io.BytesIO(data))
    array.flat[int(rng.integers(array.size))] = np.inf
    return _npy(array)


def _huge(rng: Rng) -> bytes:
    shape = pick(rng, ("(1000000000000, 3)", "(-1, 3)", "(9223372036854775807, 9)"))
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117)
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) + 1) + header + b"\n" + b"\0" * 80


def _zip_flags(data: bytes) -> bytes:
    """Set the bit that says encrypted in the local and central headers."""
    changed = bytearray(data)
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        for place in _places(data, mark):
            changed[place + offset] |= 1
    return bytes(changed)


def _zip_method(data: bytes) -> bytes:
    changed = bytearray(data)
    for mark, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        for place in _places(data, mark):
            changed[place + offset : place + offset + 2] = b"\x63\x00"
    return bytes(changed)


def _places(data: bytes, mark: bytes) -> list[int]:
    found, at = [], data.find(mark)
    while at >= 0:
        found.append(at)
        at = data.find(mark, at + 1)
    return found
