"""Numbers of a report as they are shown: three digits, units, shares, ticks of axes; as text that does not break."""

from __future__ import annotations

import math

__all__ = ["megabytes", "milliseconds", "number", "percent", "tick"]

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None) -> str:
    """Three significant digits, as text that does not break.

    Parameters
    ----------
    value : float or None

    Returns
    -------
    str

    Examples
    --------
    >>> number(0.0123456), number(1.5e-7), number(-2), number(12345.0), number(0.0), number(float("nan")), number(None)
    ('0.0123', '1.50×10⁻⁷', '−2.00', '12\u202f300', '0', 'NaN', '–')
    """
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞" if value > 0.0 else "−∞"
    if value == 0.0:
        return "0"
    mantissa, _, exponent = f"{abs(value):.2e}".partition("e")
    power = int(exponent)
    if -4 <= power <= 5:
        rounded = float(f"{mantissa}e{power}")
        text = f"{rounded:,.{max(0, 2 - power)}f}".replace(",", "\u202f")
    else:
        text = f"{mantissa}×10{str(power).translate(_RAISED)}"
    return f"−{text}" if value < 0.0 else text


def milliseconds(seconds: float | None) -> str:
    """Seconds as a number of milliseconds, without the unit.

    Parameters
    ----------
    seconds : float or None [s]

    Returns
    -------
    str

    Examples
    --------
    >>> milliseconds(0.0167), milliseconds(1.5)
    ('16.7', '1\u202f500')
    """
    return number(None if seconds is None else 1e3 * seconds)


def megabytes(size: float | None) -> str:
    """Bytes as a number of megabytes (10⁶ bytes), without the unit.

    Parameters
    ----------
    size : float or None [bytes]

    Returns
    -------
    str

    Examples
    --------
    >>> megabytes(58_200_000)
    '58.2'
    """
    return number(None if size is None else size / 1e6)


def percent(share: float | None) -> str:
    """A share in percent, two digits of it.

    Parameters
    ----------
    share : float or None [1]

    Returns
    -------
    str

    Examples
    --------
    >>> percent(0.413), percent(-0.0312), percent(0.00042), percent(0.0)
    ('41\u202f%', '−3.1\u202f%', '0.042\u202f%', '0\u202f%')
    """
    if share is None or not math.isfinite(share):
        return number(share)
    size = 100.0 * abs(share)
    if size < 1e-3:
        return f"{number(100.0 * share)}\u202f%"
    digits = max(0, 1 - math.floor(math.log10(float(f"{size:.1e}"))))
    return f"{'−' if share < 0.0 else ''}{size:,.{digits}f}\u202f%".replace(",", "\u202f")


def tick(value: float) -> str:
    """A tick of a logarithmic axis, as short as it is.

    Parameters
    ----------
    value : float
        Positive, of one digit, or 1.5 times a power of ten.

    Returns
    -------
    str

    Examples
    --------
    >>> tick(0.05), tick(1.5), tick(20.0), tick(1e-7), tick(3e5)
    ('0.05', '1.5', '20', '10⁻⁷', '3×10⁵')
    """
    power = math.floor(math.log10(value) + 1e-9)
    if -4 <= power <= 4:
        more = 0 if abs(value / 10.0**power % 1.0 - 0.5) > 0.1 else 1  # 1.5
        return f"{value:,.{max(0, more - power)}f}".replace(",", "\u202f")
    times = f"{value / 10.0**power:.2g}"
    return ("" if times == "1" else f"{times}×") + f"10{str(power).translate(_RAISED)}"
