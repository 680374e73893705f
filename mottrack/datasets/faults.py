"""What can be wrong with a file of a data set, by kind, so that a check can count the kinds."""

from __future__ import annotations

from typing import ClassVar

from mottrack.core.errors import DataError


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
    """A rotation matrix or quaternion is none."""

    kind: ClassVar[str] = "not a rotation"


class OutOfOrderError(FaultError):
    """Time does not increase, or the same time or name comes twice."""

    kind: ClassVar[str] = "out of order"


DAMAGED = "damaged"


def kind_of(error: Exception) -> str:
    """Return the kind of a fault; every other one is damage."""
    return error.kind if isinstance(error, FaultError) else DAMAGED
