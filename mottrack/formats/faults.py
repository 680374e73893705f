"""Kinds of faults in the files of a data set, so that a check can count them by kind."""

from __future__ import annotations

from typing import ClassVar

from mottrack.core.errors import DataError

DAMAGED = "damaged"


class FaultError(DataError):
    """A fault of a known kind."""

    kind: ClassVar[str]


class MissingError(FaultError):
    """A file or a record that should be there is not."""

    kind: ClassVar[str] = "missing"


class TruncatedError(FaultError):
    """A file ends before its content does."""

    kind: ClassVar[str] = "truncated"


class NonFiniteError(FaultError):
    """A number is NaN or infinite."""

    kind: ClassVar[str] = "non-finite"


class OutsideRootError(FaultError):
    """A name leads out of the data set's folder."""

    kind: ClassVar[str] = "outside the root"


class NotRigidError(FaultError):
    """A matrix or quaternion is not a rotation."""

    kind: ClassVar[str] = "not a rotation"


class OutOfOrderError(FaultError):
    """Time does not increase, or a time or a name is repeated."""

    kind: ClassVar[str] = "out of order"


def kind_of(error: DataError) -> str:
    """Return the kind of a fault; `DAMAGED` where the error names none."""
    return error.kind if isinstance(error, FaultError) else DAMAGED
