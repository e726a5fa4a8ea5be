"""Arithmetic with many digits, from mpmath, which the extra ``stability`` brings."""

from __future__ import annotations

from typing import Any

from froxel_ref.records import InputError

__all__ = ["digits"]


def digits(count: int = 40) -> Any:
    """An mpmath context of its own with so many decimal digits; nobody else's precision is changed.

    Parameters
    ----------
    count : int
        Decimal digits.

    Returns
    -------
    mpmath context

    Raises
    ------
    InputError
        mpmath is not installed.

    Examples
    --------
    >>> str(digits(20).pi)
    '3.1415926535897932385'
    """
    try:
        import mpmath
    except ImportError:
        need = "needs mpmath: python -m pip install 'froxel-ref[stability]'"
        raise InputError("stability", need) from None
    context = mpmath.mp.clone()
    context.dps = count
    return context
