"""What every tracker requires of a step, checked before anything of it is used."""

from __future__ import annotations

from mottrack.core.checks import as_stamp, require_instance
from mottrack.core.errors import InputError
from mottrack.core.objects import Objects
from mottrack.core.sweep import SECOND_NS, seconds_between

LONGEST_GAP_S = 60.0
"""After a minute without a step nothing is where it was predicted: the tracks are begun anew."""
LONGEST_STEP_NS = 100 * 366 * 86_400 * SECOND_NS
"""A century: a stamp farther away is of another clock, and differences of stamps need 64 bits."""


def checked_stamp(last_ns: int | None, stamp_ns: object, objects: Objects) -> int:
    """Return the stamp of a step; `last_ns` is that of the last one, None before the first.

    Raises:
        InputError: it is no integer, not later than the last one or a century later, or the objects
            are none, of another stamp or not in the world frame.
    """
    require_instance("objects", objects, Objects)
    if objects.frame != "world":
        raise InputError("frame of objects", repr(objects.frame), "'world'")
    stamp = as_stamp("stamp_ns", stamp_ns)
    if last_ns is not None and stamp <= last_ns:
        raise InputError("stamp_ns", stamp, f"later than the last step, {last_ns}")
    if last_ns is not None and stamp - last_ns > LONGEST_STEP_NS:
        raise InputError("stamp_ns", stamp, f"within a century of the last step, {last_ns}")
    if objects.stamp_ns != stamp:
        raise InputError("stamp_ns of objects", objects.stamp_ns, f"that of the step, {stamp}")
    return stamp


def is_gap(last_ns: int | None, stamp_ns: int) -> bool:
    """Return whether a step is too long for any track to be continued."""
    return last_ns is not None and seconds_between(last_ns, stamp_ns) > LONGEST_GAP_S
