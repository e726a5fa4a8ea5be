"""How a frame is computed: the froxel grid, the switches between the sources and what is right, precision."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from froxel_ref.kinds import choice, flag, integer, nested, number
from froxel_ref.records import InputError, Record
from froxel_ref.scene import LONGEST, SHORTEST, SIZE

DISTRIBUTIONS = ("exponential", "linear")
# Numbers of an opacity map's texel unless given: with half floats sixteen bytes, or fourteen.
NUMBERS = {"slices": 8, "cosine": 8, "power": 7, "trigonometric": 7}
MOMENTS = {"power": "4, 6 or 8 power moments", "trigonometric": "2, 3 or 4 trigonometric ones, two numbers each"}
PHASE_FUNCTIONS = ("henyey_greenstein", "isotropic", "rayleigh", "schlick", "cornette_shanks",
                   "two_lobe_henyey_greenstein")


@dataclass(frozen=True, kw_only=True)
class Grid(Record):
    """The froxel grid: texels on the screen times slices in depth [Dörries 2020, §3.2.2; Wronski 2014]."""

    width: int = integer(160, "froxels across", at_least=1, at_most=65536)
    height: int = integer(90, "froxels down", at_least=1, at_most=65536)
    depth: int = integer(64, "slices", at_least=1, at_most=65536)
    near: float = number(0.5, "view depth of the first boundary", **SIZE)
    far: float = number(64.0, "view depth of the last boundary", **SIZE)
    distribution: str = choice(*DISTRIBUTIONS, default="exponential", about="how slices share the depth")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Slices, rows and columns."""
        return self.depth, self.height, self.width

    def check_together(self) -> None:
        if not self.near < self.far:
            raise InputError("near", f"is {self.near:g} m, must be below far ({self.far:g} m)")


# What each switch may be, as (corrected, published, author, then further choices). The corrected value
# is the default; "author" is the thesis's own program where it differs from the text (CONVENTIONS.md).
SWITCHES: dict[str, tuple[str, ...]] = {
    "albedo_at_zero": ("zero", "zero", "zero", "divide"),                       # D1
    "emission": ("per_metre", "published", "published", "absorption"),          # D2
    "integrator": ("analytic", "published", "published", "simple", "half_step", "linear", "gauss"),  # D3
    "accumulation": ("compensated", "plain", "plain"),                          # S2
    "lookup": ("boundary", "centre", "centre"),                                 # D4
    "near_surface": ("fog", "first_slice", "first_slice"),                      # A11
    "surface_term": ("outside", "outside", "outside", "inside"),                # D5
    "integrate_from": ("camera", "near", "near"),                               # D6
    "phase_mixing": ("weighted", "mean", "mean", "mixture"),                    # D12
    "density_addressing": ("wrap", "wrap", "clamp"),                            # A5
    "attenuation": ("min_distance", "min_distance", "inverse_radius"),          # A6
    "light_power": ("solid_angle", "solid_angle", "author"),                    # A6
    "ambient": ("scene", "scene", "constant"),                                  # A7
    "exposure": ("display", "display", "lighting"),                             # A12
    "beyond_cascades": ("lit", "lit", "dark"),                                  # A4
    "fom_samples": ("segments", "front", "dithered", "middle"),                 # D7, A8
    "fom_opacity": ("exact", "clamped", "clamped"),                             # D8
    "fom_range": ("bounded", "radius", "fixed"),                                # A8
    "fom_tiles": ("by_extent", "by_extent", "small"),                           # A8
    "fom_lookup": ("per_texel", "filtered", "filtered"),                        # S3
    "fom_sun": ("product", "product", "min"),                                   # D16
    "fom_spot": ("upright", "upright", "mirrored"),                             # A3
    "fom_octahedron": ("from_light", "from_light", "to_light"),                 # A9
    "fom_particles": ("hit", "hit", "centre"),                                  # A9
    "jitter": ("centred", "published", "author", "off"),                        # D10, A2
    "checkerboard_parity": ("even", "even", "odd"),                             # A1
    "checkerboard_fill": ("existing", "zero", "zero"),                          # D11
    "filled_holes": ("replaced", "kept", "kept"),                               # S7
    "inverse_tone_map": ("carried", "luma", "bounded"),                         # D9
    "half_depth": ("nearest", "nearest", "farthest"),                           # A11
    "long_density": ("mean", "sampled", "sampled"),                             # S5
    "long_judged": ("texel", "tap", "tap"),                                     # S6
    "taa_points": ("centred", "published", "published", "off"),                 # D10
    "taa_space": ("ycocg", "rgb", "rgb"),                                       # A10
    "taa_border": ("inside", "repeat", "zero"),                                 # A10
    "taa_box": ("measured", "least", "padded"),                                 # A10
    "taa_weight": ("constant", "constant", "author"),                           # A10
}
FIDELITIES = ("corrected", "published", "author")


def _switch(name: str, about: str) -> Any:
    return choice(*dict.fromkeys(SWITCHES[name]), default=None, optional=True, about=about)


@dataclass(frozen=True, kw_only=True)
class Switches(Record):
    """One choice for each departure of the sources; None follows the fidelity."""

    albedo_at_zero: str | None = _switch(
        "albedo_at_zero", "D1: albedo of nothing: 0, or 0/0 as listing 3.1 has it")
    emission: str | None = _switch(
        "emission", "D2: authored per metre, or σ_a·L_e, or σ_s·L_e as listing 3.2 has it")
    integrator: str | None = _switch("integrator", "D3: slice integral [Dörries 2020, listings 3.3, 3.4]")
    accumulation: str | None = _switch(
        "accumulation", "S2: running sums in twice the digits, with the integrator 'analytic' only, or as they round")
    lookup: str | None = _switch("lookup", "D4: stored values belong to slice boundaries, or to centres")
    near_surface: str | None = _switch(
        "near_surface", "A11: surfaces in the first slice have the fog in front of them, or all of the slice's")
    surface_term: str | None = _switch(
        "surface_term", "D5: the surface's light times the transmittance, or inside the integral as eq. 2.9 has it")
    integrate_from: str | None = _switch(
        "integrate_from", "D6: fog begins at the camera, or at the near boundary")
    phase_mixing: str | None = _switch(
        "phase_mixing", "D12: g weighted by scattering, plain mean, or the exact mixture")
    density_addressing: str | None = _switch(
        "density_addressing", "A5: density textures wrap, or clamp after frac()")
    attenuation: str | None = _switch("attenuation", "A6: d² bounded below by min_distance², or by 1/radius²")
    light_power: str | None = _switch(
        "light_power", "A6: a light's power spreads over its own solid angle, or a spot light's over π")
    ambient: str | None = _switch("ambient", "A7: the scene's ambient radiance, or the constant (1/π)/(4π)")
    exposure: str | None = _switch(
        "exposure", "A12: exposure on display only, or multiplied into the lighting")
    beyond_cascades: str | None = _switch(
        "beyond_cascades", "A4: whether a sun lights froxels that no cascade of its shadow map reaches")
    fom_samples: str | None = _switch(
        "fom_samples", "D7, A8: what a march adds: stretches of constant extinction, or points at a step's front, its "
                       "middle, or dithered and half a step further on")
    fom_opacity: str | None = _switch("fom_opacity", "D8: optical depths of samples as they are, or at most 11.5")
    fom_range: str | None = _switch(
        "fom_range", "A8: depths that a map covers: what lies on its rays; a lamp's radius; that, and 300 m for suns")
    fom_tiles: str | None = _switch(
        "fom_tiles", "A8: a lamp's tile by its extent on the screen, or always the small one")
    fom_lookup: str | None = _switch(
        "fom_lookup", "S3: a sun's four texels each with its own range, or coefficients and ranges filtered first")
    fom_sun: str | None = _switch(
        "fom_sun", "D16: a sun's visibility: product of opaque and volumetric, or the smaller")
    fom_spot: str | None = _switch("fom_spot", "A3: a spot light's rows as they are looked up, or the other way round")
    fom_octahedron: str | None = _switch(
        "fom_octahedron", "A9: octahedral maps hold directions from the light, or to it")
    fom_particles: str | None = _switch(
        "fom_particles", "A9: particles where rays hit them, or at their centre's distance and of twice the size")
    jitter: str | None = _switch(
        "jitter", "D10, A2, S4: with a temporal filter, where in its froxel a frame's sample lies: Halton points whose "
                  "mean is ½, as they are, or every second one; or always the centre")
    checkerboard_parity: str | None = _switch(
        "checkerboard_parity", "A1: froxels are computed whose column, row, slice and frame add up to an even number, "
                               "or an odd one")
    checkerboard_fill: str | None = _switch(
        "checkerboard_fill", "D11: holes without a history take the mean of the neighbours that exist, or neighbours "
                             "outside count as 0")
    filled_holes: str | None = _switch(
        "filled_holes", "S7: what holes took from their neighbours is replaced by what is computed there first, or "
                        "counts as history")
    inverse_tone_map: str | None = _switch(
        "inverse_tone_map", "D9: averages of tone-mapped colours come back by weights that are carried along, stored "
                            "ones by a luma that their format holds; or by their luma, up to 1, or to 1 − 1e-6")
    half_depth: str | None = _switch(
        "half_depth", "A11: of two by two pixels, what texels of even column plus row take for the long range")
    long_density: str | None = _switch(
        "long_density", "S5: densities of the long range: means over a step, or as at its sample")
    long_judged: str | None = _switch(
        "long_judged", "S6: upsampling of the long range: each texel judged by its own depth, or four by the tap's")
    taa_points: str | None = _switch(
        "taa_points", "D10: where in its pixel a frame's sample lies: Halton points whose mean is the centre, or as "
                      "they are; or always the centre")
    taa_space: str | None = _switch("taa_space", "A10: colours that history is clipped in")
    taa_border: str | None = _switch(
        "taa_border", "A10: pixels beyond the image are not there, those at its edge once more, or black")
    taa_box: str | None = _switch(
        "taa_box", "A10: the box that history is clipped to: as measured; of a variance of at least 1e-7; that, and "
                   "padded by 1e-5")
    taa_weight: str | None = _switch(
        "taa_weight", "A10: weight of the current frame: taa.alpha, or as the thesis's program varies it")


@dataclass(frozen=True, kw_only=True)
class SecondLobe(Record):
    """The second lobe of the two-lobe Henyey–Greenstein phase function."""

    phase_anisotropy: float = number(-0.3, "its g; the first lobe has the medium's", above=-1.0, below=1.0)
    weight: float = number(0.3, "its share", at_least=0.0, at_most=1.0)


@dataclass(frozen=True, kw_only=True)
class ShadowMaps(Record):
    """Opaque shadow maps: their sizes, and how they are looked up."""

    cascades: int = integer(4, "maps of each directional light, one behind the other", at_least=1, at_most=16)
    split: float = number(0.5, "share of the exponential distribution in where cascades end [Zhang 2006]",
                          at_least=0.0, at_most=1.0)
    reach: float | None = number(None, "view depth up to which cascades serve; the froxels' far end unless given",
                                 optional=True, **SIZE)
    directional_size: int = integer(1024, "each cascade, across", unit="texels", at_least=16, at_most=16384)
    spot_size: int = integer(512, "a spot light's map, across", unit="texels", at_least=16, at_most=16384)
    point_size: int = integer(256, "each face of a point light's cube, or its octahedral map, across", unit="texels",
                              at_least=16, at_most=16384)
    point_map: str = choice("cube", "octahedral", default="cube", about="how a point light's directions are laid out")
    technique: str = choice("compare", "exponential", default="compare",
                            about="depths compared, or exponential shadow maps [Wronski 2014]")
    kernel: int = integer(1, "comparisons averaged: 0 the nearest texel's, n the n·n neighbouring bilinear ones",
                          at_least=0, at_most=15)
    constant_bias: float = number(0.0, "how much nearer to the light a point is taken", unit="m", at_least=0.0,
                                  within=(0.0, LONGEST))
    slope_bias: float = number(0.0, "the same on surfaces, in what the depth changes by per texel", at_least=0.0,
                               within=(0.0, LONGEST))
    normal_bias: float = number(1.0, "how far a surface is lifted, 1 being what a plane needs", at_least=0.0,
                                within=(0.0, LONGEST))
    corner_bias: float = number(2.0, "how much nearer to the light a surface is taken, in diagonals of a texel there",
                                at_least=0.0, within=(0.0, LONGEST))
    border: int | None = integer(None, "texels around each face for filters to reach into; as many as they need unless "
                                       "given", optional=True, at_least=0, at_most=4096)
    exponent: float = number(80.0, "exponential maps: over the light's range [Annen 2008]", above=0.0,
                             within=(SHORTEST, 85.0))
    downsample: int = integer(4, "exponential maps: texels averaged along each axis", at_least=1, at_most=64)
    blur: int = integer(2, "exponential maps: radius of the Gaussian blur, its σ half of that, downsampled",
                        unit="texels", at_least=0, at_most=64)

    def check_together(self) -> None:
        for name in ("directional_size", "spot_size", "point_size"):
            size = getattr(self, name)
            if size % (2 * self.downsample if self.technique == "exponential" else 2):
                raise InputError(name, f"is {size}, must be a multiple of "
                                       f"{2 * self.downsample if self.technique == 'exponential' else 2}")
            if name == "point_size" and self.point_map == "octahedral" and size < 3 * self.edge:
                raise InputError(name, f"is {size}, must be at least {3 * self.edge}: the gutter of an octahedral map, "
                                       f"{self.edge} texels, repeats what is inside it")
            if size <= 2 * self.edge + 8:
                raise InputError(name, f"is {size}, must be above {2 * self.edge + 8}: there is a border of "
                                       f"{self.edge} texels")

    @property
    def edge(self) -> int:
        """Texels of the border: as given, or as many as filters reach into."""
        if self.border is not None:
            return self.border
        if self.technique == "exponential":
            return self.downsample * (self.blur + 1)
        # A kernel reaches ½(kernel + 1) texels, and lifts a surface's points by up to √2 times as many.
        return -(-5 * (self.kernel + 1) // 4)


@dataclass(frozen=True, kw_only=True)
class OpacityMaps(Record):
    """Opacity maps: what they hold, their sizes, how they are made, and how transmittance is read from them."""

    technique: str = choice(
        "fourier", "slices", "cosine", "power", "trigonometric", default="fourier",
        about="what a texel holds: Fourier coefficients of extinction [Jansen 2010]; optical depth at even depths "
              "[Kim 2001]; cosine coefficients [Gautron 2011]; power or trigonometric moments [Münstermann 2018]")
    numbers: int | None = integer(
        None, "how many numbers a texel holds, unless they are Fourier coefficients, of which harmonics says it: by "
              "default 8 slices, 8 cosines, 7 of 6 power moments, or 7 of 3 trigonometric ones",
        optional=True, at_least=1, at_most=256)
    overestimation: float = number(
        0.25, "moments: how far from the lower bound of optical depth to the upper one it is taken [Münstermann 2018]",
        at_least=0.0, at_most=1.0)
    harmonics: int = integer(
        3, "K, two coefficients each and two more [Jansen 2010]; 0: the whole optical depth, linear over the range",
        at_least=0, at_most=32)
    reconstruction: str = choice(
        "fourier", "lanczos", "resolved", default="fourier",
        about="the series; with σ-factors, which rings less and is less sharp; or as a non-negative extinction")
    small: int = integer(128, "a lamp's tile, across", unit="texels", at_least=8, at_most=4096)
    large: int = integer(256, "a lamp's tile, across, if its extent on the screen is large", unit="texels",
                         at_least=8, at_most=4096)
    large_extent: float = number(0.5, "share of the image's height from which on a lamp's sphere is large",
                                 at_least=0.0, within=(0.0, LONGEST))
    atlas: int = integer(2048, "the square that lamps' tiles lie in, across", unit="texels", at_least=64,
                         at_most=16384)
    smallest: int = integer(64, "the smallest tile that a lamp is given where there is no room, across",
                            unit="texels", at_least=8, at_most=4096)
    gutter: int = integer(1, "texels around a tile that repeat its neighbours, for lookups across its edge",
                          at_least=0, at_most=8)
    directional_size: int = integer(256, "each cascade of a directional light, across", unit="texels", at_least=16,
                                    at_most=4096)
    step: float = number(0.05, "longest step of a march, unless there are too many", **SIZE)
    most_steps: int = integer(64, "steps of a march at most", at_least=1, at_most=65536)
    storage: str = choice("full", "float16", default="full",
                          about="numbers as computed, or as the thesis's RGBA16F textures hold them")

    @property
    def channels(self) -> int:
        """Numbers of a texel."""
        return 2 * self.harmonics + 2 if self.technique == "fourier" else self.numbers or NUMBERS[self.technique]

    def check_together(self) -> None:
        if self.technique == "fourier" and self.numbers is not None:
            raise InputError("numbers", f"is {self.numbers} with technique=fourier, must be left out: harmonics says "
                                        "how many")
        if self.technique in MOMENTS and self.channels not in (5, 7, 9):
            raise InputError("numbers", f"is {self.numbers} with technique={self.technique}, must be 5, 7 or 9: the "
                                        f"whole, and {MOMENTS[self.technique]}")
        if self.technique != "fourier" and self.reconstruction != "fourier":
            raise InputError("reconstruction", f"is {self.reconstruction} with technique={self.technique}, must be "
                                               "left out: it is of Fourier coefficients")
        for name in ("small", "large", "atlas", "smallest"):
            value = getattr(self, name)
            if value & (value - 1):
                raise InputError(name, f"is {value}, must be a power of two")
        for less, more in (("smallest", "small"), ("small", "large"), ("large", "atlas")):
            if getattr(self, less) > getattr(self, more):
                raise InputError(less, f"is {getattr(self, less)}, must be at most {more} ({getattr(self, more)})")
        if 3 * self.gutter > self.smallest:
            raise InputError("gutter", f"is {self.gutter}, must be at most a third of smallest ({self.smallest})")


@dataclass(frozen=True, kw_only=True)
class Culling(Record):
    """The lists of lights and local media: tiles of the screen by bins of view depth [Dörries 2020, §3.2.4]."""

    tile: int = integer(8, "edge of a tile", unit="pixels", at_least=1, at_most=16384)
    bins: int = integer(256, "bins of equal size between the grid's near and far", at_least=1, at_most=65536)


@dataclass(frozen=True, kw_only=True)
class Temporal(Record):
    """The filter of froxels over frames: jittered samples, an exponential moving average [Dörries 2020, §3.2.3]."""

    filter: str = choice(
        "off", "scattering", "unphased", "media", default="off",
        about="what the history holds: nothing; in-scattering and extinction as published; the same without the "
              "phase function, which each frame multiplies by anew [Lagarde 2018]; or the V-Buffer and a sun's "
              "visibility, of which each frame's light is made anew [Bauer 2019]")
    alpha: float = number(0.05, "weight of the current frame; 0.2 with temporal anti-aliasing", above=0.0, at_most=1.0)
    start: str = choice("first", "mean", default="first",
                        about="the first frames: eq. 3.2, the first one whole; or their mean while that weighs more")
    clamp: str = choice("off", "range", "deviation", default="off",
                        about="history as it is; cut to the neighbourhood's least and greatest; or to its deviation")
    gamma: float = number(1.0, "clamp by deviation: how many", at_least=0.0, within=(0.0, LONGEST))
    alpha_most: float | None = number(
        None, "weight of the current frame where it departs from its history; alpha unless given", optional=True,
        above=0.0, at_most=1.0)

    def check_together(self) -> None:
        if self.alpha_most is not None and self.alpha_most < self.alpha:
            raise InputError("alpha_most", f"is {self.alpha_most:g}, must be at least alpha ({self.alpha:g})")


@dataclass(frozen=True, kw_only=True)
class FogLookup(Record):
    """How the fog is looked up for what a pixel shows [Dörries 2020, §3.2.7, §3.2.10]."""

    method: str = choice(
        "trilinear", "biquadratic", "noisy", default="trilinear",
        about="one trilinear fetch; one of a quadratic B-spline across; or several taps about the place, by blue noise")
    bias: float | None = number(
        None, "how much nearer to the camera; unless given none, of noisy taps 1.5 if stored values stand at centres, "
              "as published, and 1 if at boundaries, which is the same place",
        unit="slices", optional=True, at_least=0.0, within=(0.0, LONGEST))
    taps: int = integer(4, "of a noisy lookup", at_least=1, at_most=4)
    reach: float = number(1.5, "largest offset of a noisy tap along x and y", unit="froxels", at_least=0.0,
                          within=(0.0, LONGEST))
    depth_share: float = number(0.5, "share of that along z", at_least=0.0, within=(0.0, LONGEST))
    stored: str = choice("linear", "tone_mapped", default="linear",
                         about="radiance as it is, or as c/(1 + luma(c)), which is undone after the mean of all taps")
    storage: str = choice("full", "float16", default="full",
                          about="radiance and transmittance as computed, or as RGBA16F textures hold them")


@dataclass(frozen=True, kw_only=True)
class LongRange(Record):
    """Light and transmittance behind the froxels' far end: a march at half the resolution [Dörries 2020, §3.2.8]."""

    march: bool = flag(False, "march from the far end to the surface")
    steps: int = integer(16, "of equal length along each ray", at_least=1, at_most=65536)
    farthest: float = number(10_000.0, "view depth at which rays end that meet no surface", **SIZE)
    noise: bool = flag(True, "samples and upsampling taps by blue noise, other ones each frame; or middles and one tap")
    sun_steps: int = integer(
        0, "steps towards each sun, for the shadows of global media; none, and the fog's own, unless given",
        at_least=0, at_most=65536)
    sun_distance: float = number(1_000.0, "length of that march", **SIZE)


@dataclass(frozen=True, kw_only=True)
class AntiAliasing(Record):
    """Temporal anti-aliasing of the image: jittered pixels, a clipped history [Dörries 2020, §3.2.6]."""

    on: bool = flag(False, "average the image over frames")
    alpha: float = number(0.1, "weight of the current frame; the thesis gives none", above=0.0, at_most=1.0)
    clip: str = choice("line", "clamp", "off", default="line",
                       about="history outside the neighbourhood's box: moved to it, cut channel by channel, or kept")
    gamma: float = number(1.0, "the box reaches that many standard deviations", at_least=0.0, within=(0.0, LONGEST))
    kernel: str = choice("five_tap", "bicubic", "bilinear", default="five_tap",
                         about="how history is fetched between pixels: Catmull–Rom without corners, whole, or linearly")
    tone_mapping: bool = flag(True, "average colours weighted by 1/(1 + luma), or as they are")
    storage: str = choice("full", "float16", default="full",
                          about="the image as computed, or as an RGBA16F texture holds it")


@dataclass(frozen=True, kw_only=True)
class Settings(Record):
    """How a frame is computed."""

    grid: Grid = nested(Grid, default=Grid(), about="the froxels")
    fidelity: str = choice(*FIDELITIES, default="corrected",
                           about="which column of the switches is the default")
    switches: Switches = nested(Switches, default=Switches(), about="single switches, before the fidelity")
    phase_function: str = choice(*PHASE_FUNCTIONS, default="henyey_greenstein",
                                 about="how scattered light spreads over directions")
    second_lobe: SecondLobe = nested(
        SecondLobe, default=SecondLobe(), about="for the two-lobe phase function")
    shadows: str = choice("maps", "exact", "off", default="maps",
                          about="opaque shadows: by shadow maps, by a ray from every point, or none")
    shadow_maps: ShadowMaps = nested(ShadowMaps, default=ShadowMaps(), about="for shadows by maps")
    volumetric_shadows: str = choice(
        "maps", "exact", "off", default="off",
        about="shadows of media and particles: by opacity maps, along a ray from every point, or none")
    opacity_maps: OpacityMaps = nested(OpacityMaps, default=OpacityMaps(), about="for volumetric shadows by maps")
    particles_lit_at: str = choice(
        "pixel", "centre", default="pixel",
        about="where particles are lit: at every point that a pixel shows, or at their centre")
    temporal: Temporal = nested(Temporal, default=Temporal(), about="the filter of froxels over frames")
    checkerboard: bool = flag(False, "compute every second froxel of a frame only")
    fog_lookup: FogLookup = nested(FogLookup, default=FogLookup(), about="how the fog is looked up for a pixel")
    long_range: LongRange = nested(LongRange, default=LongRange(), about="what lies behind the froxels' far end")
    taa: AntiAliasing = nested(AntiAliasing, default=AntiAliasing(), about="temporal anti-aliasing of the image")
    merged: bool = flag(False, "media and lighting in one, slab by slab, without a V-Buffer as a whole")
    culling: Culling = nested(Culling, default=Culling(), about="the lists of lights and local media")
    precision: str = choice("float64", "float32", default="float64", about="type of the arithmetic")
    time: float = number(0.0, "scene time, moves scrolling textures", unit="s",
                         within=(-LONGEST, LONGEST))

    def check_together(self) -> None:
        if self.checkerboard and self.grid.width * self.grid.height * self.grid.depth == 1:
            raise InputError("checkerboard", "is on for a grid of one froxel, must be off: there is no other half")
        if self.long_range.march and self.long_range.farthest < self.grid.far:
            raise InputError("long_range.farthest", f"is {self.long_range.farthest:g} m, must be at least grid.far "
                                                    f"({self.grid.far:g} m)")
        reach = self.shadow_maps.reach
        if reach is not None and not reach > self.grid.near:
            raise InputError("shadow_maps.reach", f"is {reach:g} m, must be above grid.near ({self.grid.near:g} m)")
        if self.merged and self.temporal.filter == "media":
            raise InputError("merged", "is on with the temporal filter 'media', must be off: there is no V-Buffer to "
                                       "filter")

    def __getattr__(self, name: str) -> str:
        """The value of a switch, by its own name: the single switch if set, else what the fidelity says."""
        if name not in SWITCHES:
            raise AttributeError(f"Settings has no field or switch {name!r}")
        single: str | None = getattr(self.switches, name)
        return single if single is not None else SWITCHES[name][FIDELITIES.index(self.fidelity)]


def replace(settings: Settings, **changes: Any) -> Settings:
    """The settings with some of them changed; a switch goes by its own name.

    Examples
    --------
    >>> replace(Settings(), emission="published").emission
    'published'
    """
    single = {name: changes.pop(name) for name in list(changes) if name in SWITCHES}
    switches = dataclasses.replace(changes.pop("switches", settings.switches), **single)
    return dataclasses.replace(settings, switches=switches, **changes)
