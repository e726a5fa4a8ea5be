"""A row of the stability table: what became of one form of a kernel in one precision, and the verdict."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["FAULTS", "SOUND_ULP", "WELL", "Measure"]

WELL = 4.0  # condition numbers below count as well-conditioned
SOUND_ULP = 8.0  # the largest error of what is sound, there [ulp]

# What no result may be, by field, and how it is said.
FAULTS = {"not_a_number": "NaN", "infinite": "infinite", "negative": "negative", "above": "above the bound",
          "rising": "rising"}


class Measure(NamedTuple):
    """What became of one form of a kernel in one precision; errors in ulp over the finite results.

    Attributes
    ----------
    kernel, group, form, precision : str
        Which.
    cases : int
        Inputs tried: random, hand-picked, and the map's.
    beyond : int
        Of these, with an exact value beyond the type's largest number; they are not in the errors.
    not_a_number, infinite, negative, above : int
        Results that must not be: NaN; infinity for a finite value; below 0; above the kernel's bound.
    rising : int
        Steps at which a falling output grew.
    worst, mean : float
        Largest and mean error [ulp].
    worst_relative : float
        Largest relative error where the exact value is a normal number [1].
    condition : float
        Condition number at the worst error.
    worst_well : float
        Largest error where the condition number is below 4 [ulp].
    worst_per_condition : float
        Largest error over 1 + condition number [ulp].
    place : tuple of float
        The inputs of the worst error.
    """

    kernel: str
    group: str
    form: str
    precision: str
    cases: int
    beyond: int
    not_a_number: int
    infinite: int
    negative: int
    above: int
    rising: int
    worst: float
    mean: float
    worst_relative: float
    condition: float
    worst_well: float
    worst_per_condition: float
    place: tuple[float, ...]

    @property
    def verdict(self) -> str:
        """``fails`` if anything came out that must not be, ``inexact`` if the digits are lost, or ``sound``.

        Digits are lost where more than 8 ulp are, of inputs whose condition number is below 4, or, for each
        unit of 1 + condition number, of any.
        """
        if any(getattr(self, name) for name in FAULTS):
            return "fails"
        return "inexact" if max(self.worst_well, self.worst_per_condition) > SOUND_ULP else "sound"

    @property
    def reason(self) -> str:
        """Why it is not sound: which invalid results and how many, or the size of the error; else empty."""
        counts = [f"{count} {words}" for name, words in FAULTS.items() if (count := getattr(self, name))]
        if counts or self.sound:
            return ", ".join(counts)
        if self.worst_well > SOUND_ULP:
            return f"{self.worst_well:.3g} ulp at a condition number below {WELL:g}"
        return f"{self.worst_per_condition:.3g} ulp per 1 + condition number"

    @property
    def sound(self) -> bool:
        """Whether nothing came out that must not be, and to digits that the inputs' conditions allow."""
        return self.verdict == "sound"
