"""How a value becomes a colour, in every picture: tone mapping for radiance, ramps for the rest.

- *radiance*: times the exposure, then the extended Reinhard curve on luma with white at 4, then the sRGB
  transfer function. Except for the final image, what this would leave black is exposed further, by a
  power of two that its label names;
- *reflectance* (albedo): the sRGB transfer function alone;
- *stretched* (albedo of media, which is much alike): as reflectance, of its share of the range;
- *colour* (RGB scattering, emission, extinction): linear from 0 to the largest value, then sRGB;
- *unit* (transmittance): grey, linear from 0 to 1 in display values, so that ½ looks half as bright;
- *normal*: ½ + ½n;
- *depth*: a colour ramp over the logarithm; grey where a ray hits nothing;
- *span* (depth in a directional light's cascade): the ramp over all but the outermost fiftieths;
- *signed* (Fourier coefficients): orange above 0, blue below, brightness by the root of the size;
- *scalar*: the colour ramp from 0 (or the smallest value, if negative) to the largest.

The ramp is a cubehelix [Green 2011]: brightness grows steadily along it, so that it survives a grey
print and any colour vision. NaN is magenta everywhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.quantities import AVERAGED, FINAL

__all__ = [
    "Bytes", "Display", "display_for", "grey", "ramp", "ramp_colours", "srgb_transfer", "to_srgb8",
    "tone_map",
]

Bytes = NDArray[np.uint8]

NOT_A_NUMBER, NOTHING = (255, 0, 255), (58, 60, 66)
WHITE_LEVEL = 4.0
_KINDS = {"depth": "depth", "slice_depth": "depth", "spot_depth": "depth", "point_depth": "depth",
          "directional_depth": "span", "normal": "normal", "albedo": "reflectance",
          "transmittance": "unit", "front_transmittance": "unit", "fog_transmittance": "unit",
          "radiance": "radiance", "front_radiance": "radiance", "fog_radiance": "radiance",
          "in_scattering": "radiance", "coefficients": "signed", "directional_coefficients": "signed"}
ABOVE, BELOW = (1.0, 0.68, 0.3), (0.35, 0.65, 1.0)


# --- colours ----------------------------------------------------------------------------------------


def tone_map(radiance: Field, *, white: float = WHITE_LEVEL) -> Field:
    """Compress radiance so that luma ``white`` and nothing below it becomes 1.

    Parameters
    ----------
    radiance : array, shape (3, ...)
        Linear RGB, already exposed.
    white : float
        The luma that maps to 1.

    Returns
    -------
    array, shape (3, ...)
        c·(1 + Y/white²)/(1 + Y) with Y the luma; saturated colours may exceed 1.

    Notes
    -----
    Extended Reinhard curve [Reinhard 2002, eq. 4] on Rec. 709 luma: hue is kept, mid-tones are nearly
    linear. It is for looking only; spec'd tone maps of the pipeline are not this one.

    Examples
    --------
    >>> tone_map(np.full((3, 1), 4.0)).ravel().round(12).tolist()
    [1.0, 1.0, 1.0]
    """
    luma = _luma(radiance)
    return radiance * ((1.0 + luma / white**2) / (1.0 + luma))


def srgb_transfer(linear: Field) -> Field:
    """The sRGB transfer function of values cut to [0, 1].

    Parameters
    ----------
    linear : array, any shape
        Linear light [1].

    Returns
    -------
    array, same shape
        Display values in [0, 1]; NaN stays NaN.

    Notes
    -----
    12.92x up to 0.0031308, 1.055·x^(1/2.4) − 0.055 above [IEC 61966-2-1].

    Examples
    --------
    >>> srgb_transfer(np.array([0.0, 0.0031308, 0.214041, 1.0])).round(4).tolist()
    [0.0, 0.0404, 0.5, 1.0]
    """
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(x, 1.0 / 2.4) - 0.055)


def to_srgb8(radiance: Field, exposure: float = 1.0) -> Bytes:
    """An 8-bit display image of linear radiance.

    Parameters
    ----------
    radiance : array, shape (3, height, width) [W m⁻² sr⁻¹]
    exposure : float
        Factor before the tone map.

    Returns
    -------
    array of uint8, shape (height, width, 3)
        Exposed, tone-mapped (`tone_map`), sRGB-encoded; NaN is magenta, +inf is white.

    Examples
    --------
    >>> to_srgb8(np.zeros((3, 1, 2))).tolist()
    [[[0, 0, 0], [0, 0, 0]]]
    """
    # The cut keeps infinity from becoming inf·0; 1e6 is far above white whatever the hue.
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        exposed = np.clip(np.asarray(radiance) * exposure, 0.0, 1e6)
        return _quantise(srgb_transfer(tone_map(exposed)))


def ramp(values: Field) -> Field:
    """Colours of a cubehelix for values in [0, 1], from black to white.

    Parameters
    ----------
    values : array, any shape

    Returns
    -------
    array, shape (3, ...)
        Display (sRGB-encoded) values in [0, 1].

    Notes
    -----
    [Green 2011, eq. 2] with start 0.3, −0.8 turns, hue 1.4 and gamma 1: black, blue, green, sand, white.

    Examples
    --------
    >>> brightness = [0.30, 0.59, 0.11] @ ramp(np.linspace(0, 1, 9))
    >>> bool((np.diff(brightness) > 0.1).all())
    True
    """
    x = np.clip(values, 0.0, 1.0)
    angle = 2.0 * math.pi * (0.3 / 3.0 + 1.0 - 0.8 * x)
    amplitude = 1.4 * x * (1.0 - x) / 2.0
    weights = ((-0.14861, 1.78277), (-0.29227, -0.90649), (1.97294, 0.0))
    cos, sin = np.cos(angle), np.sin(angle)
    result: Field = np.clip(np.stack([x + amplitude * (a * cos + b * sin) for a, b in weights]), 0.0, 1.0)
    return result


def ramp_colours(values: Field) -> Bytes:
    """The ramp's colours as bytes.

    Parameters
    ----------
    values : array, any shape
        Places on the `ramp`, cut to [0, 1]; NaN is magenta.

    Returns
    -------
    array of uint8, shape (..., 3)
        sRGB.

    Examples
    --------
    >>> ramp_colours(np.array([0.0, 1.0, np.nan])).tolist()
    [[0, 0, 0], [255, 255, 255], [255, 0, 255]]
    """
    return _quantise(ramp(values))


def grey(values: Field) -> Bytes:
    """Display greys, or display RGB, as bytes.

    Parameters
    ----------
    values : array, shape (1, ...) or (3, ...)
        Display values, cut to [0, 1]; NaN is magenta.

    Returns
    -------
    array of uint8, shape (..., 3)
        In steps of 1/255, to the nearest.

    Examples
    --------
    >>> grey(np.array([[0.0, 0.5, 2.0]])).tolist()
    [[0, 0, 0], [128, 128, 128], [255, 255, 255]]
    """
    return _quantise(np.broadcast_to(np.clip(values, 0.0, 1.0), (3, *values.shape[1:])))


def _luma(rgb: Field) -> Field:
    red, green, blue = rgb
    result: Field = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return result


def _quantise(display: Field) -> Bytes:
    """Channel-first display values in [0, 1] to (..., 3) bytes; NaN to magenta."""
    rounded = np.nan_to_num(display, nan=0.0) * 255.0 + 0.5
    result = np.moveaxis(rounded.astype(np.uint8), 0, -1).copy()
    bad = np.isnan(display).any(axis=0)
    if bad.any():
        result[bad] = NOT_A_NUMBER
    return result


# --- from values to colours -------------------------------------------------------------------------


class Display(NamedTuple):
    """How the values of one array become colours.

    Attributes
    ----------
    kind : str
        One of the kinds that this module's text lists.
    low, high : float
        The range of the finite values, in their own unit.
    exposure : float
        For radiance, a factor before the tone map.
    """

    kind: str
    low: float
    high: float
    exposure: float

    def paint(self, block: Field) -> Bytes:
        """Colours of a block of values.

        Parameters
        ----------
        block : array, shape (1, ...) or (3, ...)
            Values, channel first.

        Returns
        -------
        array of uint8, shape (..., 3)
            sRGB.

        Examples
        --------
        >>> Display("scalar", 0.0, 2.0, 1.0).paint(np.array([[0.0, 2.0]])).tolist()
        [[0, 0, 0], [255, 255, 255]]
        """
        values = np.asarray(block, np.float64)
        with np.errstate(all="ignore"):
            if self.kind == "radiance":
                return to_srgb8(np.broadcast_to(values, (3, *values.shape[1:])), self.exposure)
            if self.kind == "normal":
                return _quantise(np.clip(0.5 + 0.5 * values, 0.0, 1.0))
            if self.kind == "stretched":
                return _quantise(srgb_transfer((values - self.low) / (self.high - self.low)))
            if self.kind == "reflectance" or (self.kind != "unit" and values.shape[0] == 3):
                scale = 1.0 if self.kind == "reflectance" else 1.0 / max(self.high, 1e-300)
                return _quantise(srgb_transfer(np.broadcast_to(values * scale, (3, *values.shape[1:]))))
            if self.kind == "unit":
                return grey(values)
            return self._signed(values[0]) if self.kind == "signed" else self._ramped(values[0])

    def _signed(self, values: Field) -> Bytes:
        largest = max(-self.low, self.high, 1e-300)
        size = np.sqrt(np.minimum(np.abs(values) / largest, 1.0))
        result = _quantise(np.stack([np.where(values < 0.0, b, a) * size for a, b in zip(ABOVE, BELOW, strict=True)]))
        result[np.isposinf(values)] = NOTHING
        return result

    def _ramped(self, values: Field) -> Bytes:
        low, high, x = self.low, self.high, values
        if self.kind == "depth":
            low, high, x = math.log(self.low), math.log(self.high), np.log(values)
        if math.isinf(high - low):  # the range alone passes the largest float
            low, high, x = 0.25 * low, 0.25 * high, 0.25 * x
        position = (x - low) / (high - low) if high > low else np.where(np.isnan(x), x, 0.5)
        result = ramp_colours(position)
        result[np.isposinf(values)] = NOTHING
        return result

    def label(self) -> str:
        """The range in words.

        Returns
        -------
        str
            One line.

        Examples
        --------
        >>> Display("depth", 0.5, 64.0, 1.0).label()
        '0.5 to 64 and beyond, logarithmic'
        """
        span = f"{self.low:.4g} to {self.high:.4g}"
        if self.kind == "radiance":
            return f"peak {self.high:.4g}, exposure x{self.exposure:.4g}, tone-mapped"
        if self.kind == "stretched":
            return f"{self.low:.4g} (black) to {self.high:.4g} (white) in each channel"
        if self.kind in ("colour", "reflectance"):
            return f"{span} in each channel"
        if self.kind in ("normal", "unit", "signed"):
            return span
        if self.kind == "span":
            return f"{span} and beyond"
        return f"{span} and beyond, logarithmic" if self.kind == "depth" else f"{span} on the scale"


def display_for(name: str, values: Field, exposure: float = 1.0) -> Display:
    """Choose how an array is shown, from its name and its values.

    Parameters
    ----------
    name : str
        ``stage/quantity``.
    values : array, shape (C, ...)
        Channel first, C 1 or 3.
    exposure : float
        Exposure of the display, for radiance.

    Returns
    -------
    Display
        With the range of the finite values.

    Examples
    --------
    >>> display_for("media/extinction", np.array([[0.25, 0.5]]))
    Display(kind='scalar', low=0.0, high=0.5, exposure=1.0)
    """
    fallback = "colour" if values.shape[0] == 3 else "scalar"
    kind = _KINDS.get(name.rpartition("/")[2], fallback)
    values = values if values.dtype.kind == "f" else values.astype(np.float64)
    finite = np.isfinite(values)
    low, high = (float(np.min(values, where=finite, initial=np.inf)),
                 float(np.max(values, where=finite, initial=-np.inf))) if finite.any() else (0.0, 0.0)
    if kind == "radiance":
        # The final image alone must look like a backend's own output.
        return Display(kind, low, high, exposure if name in (FINAL, AVERAGED) else _exposed(values, exposure))
    if kind == "depth":
        # A floor that runs to the horizon would take the scale from everything near.
        near = float(np.quantile(values[finite], 0.9)) if finite.any() else high
        return Display(kind, max(low, 1e-6), max(min(high, 2.0 * near), 1e-6), 1.0)
    if name == "media/albedo" and low < high:
        return Display("stretched", low, high, 1.0)
    if kind in ("unit", "signed"):
        return Display(kind, low, high, 1.0)
    if kind == "span" and finite.any():
        # Surfaces that a light grazes run far in both directions.
        low, high = (float(v) for v in np.quantile(values[finite], (0.02, 0.98)))
    return Display(kind, min(low, 0.0) if kind in ("scalar", "colour") else low, high, 1.0)


def _exposed(values: Field, exposure: float) -> float:
    """The exposure, raised by powers of two until the brightest hundredth of the lit texels shows."""
    channel = values.max(axis=0).ravel()
    lit = channel[(channel > 0.0) & np.isfinite(channel)]
    bright = float(np.quantile(lit[:: max(1, lit.size // 65536)], 0.99)) if lit.size else 1.0
    if not (0.0 < bright < math.inf and 0.0 < exposure < math.inf):
        return exposure
    # A sum of logarithms: the product may be beyond the floats, at either end.
    steps = max(0, math.ceil(-2.0 - (math.log2(bright) + math.log2(exposure))))
    raised: float = exposure * 2.0 ** min(steps, 60)
    return raised
