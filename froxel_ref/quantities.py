"""Every result of a frame by name: its axes, its unit, and a sentence."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from froxel_ref.scene import Camera
from froxel_ref.settings import Grid, Settings

__all__ = ["AVERAGED", "FINAL", "QUANTITIES", "Quantity", "final_result", "raster_size", "stored_grid"]

FINAL = "apply/radiance"
AVERAGED = "taa/radiance"


@dataclass(frozen=True)
class Quantity:
    """What a result is: its full axes (channel first, as computed), its unit, and a sentence.

    ``raster`` says what its rows and columns are, unless it is a volume: of the image, of the "grid", or of "half" the
    image's resolution.
    """

    axes: str
    unit: str
    about: str
    raster: str = "image"

    @property
    def gpu_axes(self) -> str:
        """The axes as exported: channel last."""
        return self.axes.replace("c", "") + "c" * self.axes.count("c")


RADIANCE, PER_METRE = "W m^-2 sr^-1", "W m^-3 sr^-1"
QUANTITIES: dict[str, Quantity] = {
    "grid/slice_depth": Quantity("z", "m", "view depth of each slice's far boundary"),
    "shadow/directional_light": Quantity("m", "1", "index of each directional light that has shadow maps"),
    "shadow/directional_depth": Quantity("mfpq", "m", "depth of the first surface in each texel of each cascade"),
    "shadow/directional_matrix": Quantity("mfij", "1", "from the world to texels and depth"),
    "shadow/directional_exponential": Quantity("mfpq", "1", "the filtered exponential maps of the cascades"),
    "shadow/directional_span": Quantity("mfe", "m", "depths between which the exponential maps measure"),
    "shadow/spot_light": Quantity("m", "1", "index of each spot light that has a shadow map"),
    "shadow/spot_depth": Quantity("mfpq", "m", "depth of the first surface in each texel"),
    "shadow/spot_matrix": Quantity("mfij", "1", "from the world to texels times depth, and depth"),
    "shadow/spot_exponential": Quantity("mfpq", "1", "the filtered exponential maps"),
    "shadow/spot_span": Quantity("mfe", "m", "depths between which the exponential maps measure"),
    "shadow/point_light": Quantity("m", "1", "index of each point light that has a shadow map"),
    "shadow/point_depth": Quantity("mfpq", "m", "depth of the first surface in each texel of each face"),
    "shadow/point_matrix": Quantity("mfij", "1", "from the world to texels times depth, and depth, of each face"),
    "shadow/point_exponential": Quantity("mfpq", "1", "the filtered exponential maps of the faces"),
    "shadow/point_span": Quantity("mfe", "m", "depths between which the exponential maps measure"),
    "fom/light": Quantity("m", "1", "index of each point and spot light that has a tile"),
    "fom/tile": Quantity("mfa", "1", "row, column and size of its tile in the atlas"),
    "fom/range": Quantity("mfe", "m", "distances from the light that its map covers"),
    "fom/matrix": Quantity("mfij", "1", "of spot lights from the world to texels times depth, and depth"),
    "fom/coefficients": Quantity("cpq", "1", "the atlas: a_0, b_0, a_1, b_1, … of extinction along the texels' rays, "
                                             "or another technique's numbers"),
    "fom/resolved": Quantity("cpq", "1", "what each texel of the atlas is read by without ringing; reconstruction "
                                         "resolved only"),
    "fom/directional_light": Quantity("m", "1", "index of each directional light that has maps"),
    "fom/directional_range": Quantity("mfepq", "m", "nearest and farthest medium on the rays of each cascade's texels"),
    "fom/directional_matrix": Quantity("mfij", "1", "from the world to texels and depth"),
    "fom/directional_coefficients": Quantity("mfcpq", "1", "a_0, b_0, a_1, b_1, … along the rays of each cascade, "
                                                            "or another technique's numbers"),
    "fom/directional_resolved": Quantity("mfcpq", "1", "the same of each cascade's texels"),
    "surface/depth": Quantity("yx", "m", "view depth of the nearest surface, infinite where there is none"),
    "surface/normal": Quantity("cyx", "1", "unit normal of that surface in world space, towards the camera"),
    "surface/albedo": Quantity("cyx", "1", "Lambert reflectance of that surface"),
    "surface/radiance": Quantity("cyx", RADIANCE, "radiance that leaves the surface, or the background"),
    "culling/light_order": Quantity("n", "1", "windowed lights by the view depth of their nearest point"),
    "culling/light_bins": Quantity("eb", "1", "first and last place in that order that overlaps the depth bin"),
    "culling/light_tiles": Quantity("wvu", "1", "bit i mod 32 of word i // 32: the i-th light reaches the tile"),
    "culling/medium_order": Quantity("n", "1", "local media by the view depth of their nearest point"),
    "culling/medium_bins": Quantity("eb", "1", "first and last place in that order that overlaps the depth bin"),
    "culling/medium_tiles": Quantity("wvu", "1", "bit i mod 32 of word i // 32: the i-th medium meets the tile"),
    "media/scattering": Quantity("czyx", "1/m", "scattering coefficient at the froxel's sample"),
    "media/albedo": Quantity("czyx", "1", "scattering over extinction (switch albedo_at_zero where both are 0)"),
    "media/extinction": Quantity("zyx", "1/m", "extinction coefficient at the froxel's sample"),
    "media/emission": Quantity("czyx", PER_METRE, "emission at the froxel's sample"),
    "media/phase_anisotropy": Quantity("zyx", "1", "phase anisotropy g at the froxel's sample"),
    "media/lobe_scattering": Quantity("lczyx", "1/m", "scattering coefficient of each lobe of a mixture"),
    "media/lobe_anisotropy": Quantity("l", "1", "phase anisotropy g of each lobe of a mixture"),
    "material/scattering": Quantity("czyx", "1/m", "scattering coefficient filtered over frames; temporal.filter media "
                                                   "only, as all of this stage"),
    "material/extinction": Quantity("zyx", "1/m", "extinction coefficient filtered over frames, holes filled"),
    "material/emission": Quantity("czyx", PER_METRE, "emission filtered over frames"),
    "material/phase_anisotropy": Quantity("zyx", "1", "phase anisotropy g, the mean over frames by what scattered"),
    "material/lobe_scattering": Quantity("lczyx", "1/m", "scattering coefficient of each lobe, filtered over frames"),
    "material/lobe_anisotropy": Quantity("l", "1", "phase anisotropy g of each lobe"),
    "material/sun_light": Quantity("m", "1", "index of the directional light whose visibility is filtered"),
    "material/sun_visibility": Quantity("zyx", "1", "share of that light that arrives, filtered over frames"),
    "material/valid": Quantity("zyx", "1", "1 where the froxel was in view a frame ago, 0 where history begins"),
    "lighting/in_scattering": Quantity("czyx", PER_METRE, "radiance scattered towards the camera per metre"),
    "lighting/phase_ratio": Quantity("czyx", "1", "in-scattering over that of an isotropic medium, at froxels' middles "
                                                  "and with no light hidden; temporal.filter unphased only"),
    "material/guessed": Quantity("zyx", "1", "share that holes took from neighbours, and no frame has computed yet"),
    "temporal/in_scattering": Quantity("czyx", PER_METRE, "in-scattering filtered over frames, holes filled"),
    "temporal/extinction": Quantity("zyx", "1/m", "extinction filtered over frames, holes filled"),
    "temporal/unphased": Quantity("czyx", PER_METRE, "filtered in-scattering over the phase ratio"),
    "temporal/valid": Quantity("zyx", "1", "1 where the froxel was in view a frame ago, 0 where history begins"),
    "temporal/guessed": Quantity("zyx", "1", "share that holes took from neighbours, and no frame has computed yet"),
    "integrate/radiance": Quantity("czyx", RADIANCE, "fog's radiance up to the slice's far boundary"),
    "integrate/transmittance": Quantity("zyx", "1", "transmittance up to the slice's far boundary"),
    "integrate/front_radiance": Quantity("cyx", RADIANCE, "fog's radiance up to the near boundary", "grid"),
    "integrate/front_transmittance": Quantity("yx", "1", "transmittance up to the near boundary", "grid"),
    "long_range/depth": Quantity("yx", "m", "view depth of the nearest or farthest of two by two pixels, in turn",
                                 "half"),
    "long_range/radiance": Quantity("cyx", RADIANCE, "light from behind the froxels, as it arrives at their far end",
                                    "half"),
    "long_range/transmittance": Quantity("yx", "1", "transmittance from the froxels' far end to the surface", "half"),
    "particles/radiance": Quantity("cyx", RADIANCE, "light of particles and transparent surfaces, fogged at their own "
                                                    "depth, times opacity"),
    "particles/transmittance": Quantity("yx", "1", "share of what lies behind these that passes"),
    "apply/fog_radiance": Quantity("cyx", RADIANCE, "fog's radiance in front of each pixel's surface, long range too"),
    "apply/fog_transmittance": Quantity("yx", "1", "transmittance in front of each pixel's surface"),
    FINAL: Quantity("cyx", RADIANCE, "this frame's image: surface times transmittance, plus fog, under particles"),
    AVERAGED: Quantity("cyx", RADIANCE, "the images up to this frame, averaged"),
}


def final_result(settings: Settings) -> str:
    """The name of the result that is the final image.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    str
        Averaged over frames, where temporal anti-aliasing is on.

    Examples
    --------
    >>> final_result(Settings())
    'apply/radiance'
    """
    return AVERAGED if settings.taa.on else FINAL


def raster_size(quantity: Quantity, camera: Camera, grid: Grid) -> tuple[int, int]:
    """Rows and columns of a result's raster.

    Parameters
    ----------
    quantity : Quantity
        With the axes y and x.
    camera : Camera
    grid : Grid

    Returns
    -------
    rows, columns : int

    Examples
    --------
    >>> from froxel_ref.scene import Camera
    >>> raster_size(QUANTITIES["long_range/depth"], Camera(width=5, height=4), Grid())
    (2, 3)
    """
    if "z" in quantity.axes or quantity.raster == "grid":
        return grid.height, grid.width
    share = 2 if quantity.raster == "half" else 1
    return -(-camera.height // share), -(-camera.width // share)


def stored_grid(name: str, settings: Settings) -> Grid:
    """The grid as the volumes of a result have it.

    Parameters
    ----------
    name : str
        Of the result.
    settings : Settings

    Returns
    -------
    Grid
        With half the slices for what a checkerboard computes (`froxel_ref.checkerboard.pack`).

    Examples
    --------
    >>> how = Settings(grid=Grid(depth=9), checkerboard=True)
    >>> stored_grid("media/extinction", how).depth, stored_grid("integrate/radiance", how).depth
    (5, 9)
    """
    if settings.checkerboard and name.startswith(("media/", "lighting/")):
        return dataclasses.replace(settings.grid, depth=-(-settings.grid.depth // 2))
    return settings.grid
