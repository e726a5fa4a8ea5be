"""In-scattering: along the ray, blocked and restricted, against one froxel at a time."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import reference_lighting as reference
from hypothesis import assume, given
from hypothesis import settings as budget
from hypothesis import strategies as st

from froxel_ref import lighting
from froxel_ref.grid import Froxels, froxel_points, make_froxels
from froxel_ref.light_rays import slice_boxes
from froxel_ref.lighting import in_scattering
from froxel_ref.lights import light_at
from froxel_ref.media import VBuffer
from froxel_ref.records import InputError
from froxel_ref.scene import Camera, DirectionalLight, PointLight, SpotLight
from froxel_ref.settings import Grid, SecondLobe

SMALL = Grid(width=7, height=5, depth=6, near=0.5, far=32.0)
SHAPE = (6, 5, 7)
TILTED = Camera(position=(0.5, 1.5, 2.0), target=(-1.0, 0.5, -3.0), up=(0.2, 1.0, 0.0), width=7, height=5)
SUN = DirectionalLight(direction=(1.0, 2.0, -1.0), irradiance=(3.0, 2.0, 1.0))
LAMP = PointLight(position=(0.3, 1.2, -4.0), intensity=(5.0, 6.0, 7.0), radius=8.0)
SPOT = SpotLight(position=(-1.0, 3.0, -2.0), intensity=(9.0, 4.0, 2.0), radius=12.0,
                 direction=(0.1, -1.0, -0.5), inner_angle=15.0, outer_angle=50.0)
FAR = PointLight(position=(3.0, 1.0, -9.0), intensity=(1.0, 1.0, 1.0), falloff="inverse_square")
ALL = (SUN, LAMP, SPOT, FAR)


def fog(g: float | np.ndarray = 0.0, *, dtype: type = np.float64, full: bool = False,
        emission: tuple[float, float, float] = (0.0, 0.0, 0.0), lobes: tuple = ()) -> VBuffer:
    """A uniform medium, or one that varies along all axes."""
    scattering = np.array([0.1, 0.2, 0.3], dtype).reshape(3, 1, 1, 1)
    g = np.asarray(g, dtype).reshape(1, 1, 1) if np.ndim(g) == 0 else np.asarray(g, dtype)
    if full:
        scattering = scattering * np.random.default_rng(4).random(SHAPE).astype(dtype)
        g = np.broadcast_to(g, SHAPE)
    return VBuffer(scattering, scattering[0] * 2, np.array(emission, dtype).reshape(3, 1, 1, 1), g, lobes)


def grid(dtype: type = np.float64, camera: Camera = TILTED, size: Grid = SMALL) -> Froxels:
    return make_froxels(camera, size, dtype=dtype)


def conditioning(froxels: Froxels, lights, g: float) -> np.ndarray:
    """How much of the result an error of one ulp in positions moves, absolute, for σ_s = 1 and intensity 10.

    A position is known to an ulp of its distance t from the camera, so the distance d to the light to t/d
    ulp. p/d² then moves by (2 + 3|g|/(1−|g|)) times that, the window and the cone by 8 (1 + 1/(cos inner −
    cos outer)) times that of what there is without them.
    """
    x, y, z = (np.broadcast_to(c, SHAPE) for c in froxel_points(froxels))
    far = np.sqrt((x - froxels.rays.origin[0]) ** 2 + (y - froxels.rays.origin[1]) ** 2
                  + (z - froxels.rays.origin[2]) ** 2)
    total = np.full(SHAPE, 10.0)
    for source in lights:
        if not isinstance(source, DirectionalLight):
            d2 = sum((a - b) ** 2 for a, b in zip(source.position, (x, y, z), strict=True))
            cone = 12.0 if isinstance(source, SpotLight) else 8.0
            slope = 2.0 + cone + 3.0 * abs(g) / (1.0 - abs(g))
            total = total + 10.0 / d2 * (1.0 + (far + 10.0) / np.sqrt(d2)) * slope
    return total * (1.0 + abs(g)) / (4.0 * math.pi * (1.0 - abs(g)) ** 2)


def by_the_book(froxels: Froxels, vbuffer: VBuffer, lights, g: float, **options) -> np.ndarray:
    """The whole grid, one froxel at a time, in 40 digits."""
    result = np.empty((3, *SHAPE))
    scattering = np.broadcast_to(vbuffer.scattering, (3, *SHAPE))
    for index in np.ndindex(SHAPE):
        place = reference.sample(froxels, *index, number=reference.mp.mpf)
        value = reference.in_scattering(scattering[:, *index].tolist(), g, lights, froxels.rays.origin, place,
                                        number=reference.mp.mpf, **options)
        result[:, *index] = [float(v) for v in value]
    return result


# --- by hand and in closed form ---------------------------------------------------------------------


def test_one_lamp_on_the_axis_by_hand() -> None:
    """Looking at a lamp 4 m away, 2 m in front of it: p·I/d²·window·σ_s with window (1 − (4/16)²)²."""
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=1, height=1)
    froxels = make_froxels(camera, Grid(width=1, height=1, depth=1, near=1.0, far=3.0, distribution="linear"))
    lamp = PointLight(position=(0.0, 0.0, -4.0), intensity=(8.0, 16.0, 0.0), radius=4.0)
    result = in_scattering(fog(0.5), [lamp], froxels)
    phase = 0.75 / (4.0 * math.pi * 0.125)
    window = (1.0 - (4.0 / 16.0) ** 2) ** 2
    want = [0.1 * phase * 2.0 * window, 0.2 * phase * 4.0 * window, 0.0]
    np.testing.assert_allclose(result.ravel(), want, rtol=16 * np.finfo(float).eps)


@pytest.mark.parametrize("name", sorted(lighting.PHASE))
def test_ambient_light_scatters_alike_whatever_the_phase_function(name: str) -> None:
    result = in_scattering(fog(0.7, emission=(4.0, 5.0, 6.0)), [], grid(), ambient=(1.0, 2.0, 3.0),
                           phase_function=name)
    np.testing.assert_allclose(result.ravel(), [0.1 + 4.0, 0.4 + 5.0, 0.9 + 6.0], rtol=4e-16)


def test_switches() -> None:
    """D2, A7 and A12."""
    medium = fog(0.3, emission=(1.0, 2.0, 3.0))
    published = in_scattering(medium, [], grid(), emission="published")
    constant = in_scattering(
        fog(0.3), [], grid(), ambient=(9.0, 9.0, 9.0), ambient_term="constant", exposure=2.0)
    np.testing.assert_allclose(published.ravel(), [0.1, 0.4, 0.9], rtol=1e-15)
    want = np.array([0.2, 0.4, 0.6]) / math.pi / (4.0 * math.pi)
    np.testing.assert_allclose(constant.ravel(), want, rtol=1e-15)


@pytest.mark.parametrize("word", ["emission", "attenuation", "ambient_term", "phase_function"])
def test_unknown_words_are_refused(word: str) -> None:
    with pytest.raises(InputError, match="is 'henyey'"):
        in_scattering(fog(), [], grid(), **{word: "henyey"})


# --- axes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lights", "g", "shape"), [
    ((), 0.5, (3, 1, 1, 1)),
    ((SUN,), 0.5, (3, 1, 5, 7)),
    ((SUN,), 0.0, (3, 1, 1, 1)),
    ((SUN, LAMP), 0.5, (3, 6, 5, 7)),
    ((PointLight(position=(0.0, 0.0, 900.0), intensity=(1.0, 1.0, 1.0)),), 0.5, (3, 1, 1, 1)),
    ((SUN,), np.linspace(0.0, 0.9, 6).reshape(6, 1, 1), (3, 6, 5, 7)),
    ((), np.linspace(0.0, 0.9, 6).reshape(6, 1, 1), (3, 1, 1, 1)),
])
def test_axes_carry_only_what_varies(lights, g, shape: tuple[int, ...]) -> None:
    assert in_scattering(fog(g), lights, grid()).shape == shape


# --- against the textbook ---------------------------------------------------------------------------


@pytest.mark.parametrize("attenuation", ["min_distance", "inverse_radius"])
@pytest.mark.parametrize("g", [0.0, 0.5, -0.5, 0.8, -0.93])
def test_agrees_with_the_textbook(g: float, attenuation: str) -> None:
    froxels, medium = grid(), fog(g, full=True, emission=(0.1, 0.2, 0.3))
    result = in_scattering(medium, ALL, froxels, ambient=(0.5, 0.6, 0.7), attenuation=attenuation)
    want = by_the_book(froxels, medium, ALL, g, ambient=(0.5, 0.6, 0.7), emission=(0.1, 0.2, 0.3),
                       attenuation=attenuation)
    assert np.all(np.abs(result - want) <= 4 * np.finfo(float).eps * conditioning(froxels, ALL, g))


@pytest.mark.parametrize("g", [0.0, 0.55, -0.55, 0.61, 0.9, -0.99])
def test_single_precision_agrees_with_the_textbook(g: float) -> None:
    froxels, medium = grid(np.float32), fog(g, dtype=np.float32, full=True)
    result = in_scattering(medium, ALL, froxels)
    want = by_the_book(froxels, medium, ALL, float(medium.phase_anisotropy.flat[0]))
    assert result.dtype == np.float32
    assert np.all(np.abs(result - want) <= 4 * np.finfo(np.float32).eps * conditioning(froxels, ALL, g))


@pytest.mark.parametrize("name", sorted(lighting.PHASE))
@pytest.mark.parametrize("g", [0.4, -0.7])
def test_every_phase_function_along_rays(name: str, g: float) -> None:
    """The same phase function of cosines from dot products."""
    froxels, medium = grid(), fog(g)
    points = tuple(np.broadcast_to(c, SHAPE) for c in froxel_points(froxels))
    V = tuple(start - c for start, c in zip(froxels.rays.origin, points, strict=True))
    size = np.sqrt(V[0] ** 2 + V[1] ** 2 + V[2] ** 2)
    want = np.zeros((3, *SHAPE))
    for source in ALL:
        L, factor = light_at(source, points)
        cosine = -(V[0] * L[0] + V[1] * L[1] + V[2] * L[2]) / size
        colour = source.irradiance if source is SUN else source.intensity
        want += np.reshape(colour, (3, 1, 1, 1)) * (lighting.phase(name, cosine, g) * factor)
    result = in_scattering(medium, ALL, froxels, phase_function=name)
    error = np.abs(result - medium.scattering * want)
    assert np.all(error <= 4 * np.finfo(float).eps * conditioning(froxels, ALL, g))


def test_a_mixture_is_the_sum_of_its_media() -> None:
    froxels, one, other = grid(), fog(0.3, full=True), fog(-0.8)
    lobes = ((one.scattering, 0.3), (other.scattering, -0.8))
    both = one._replace(scattering=one.scattering + other.scattering, lobes=lobes)
    result = in_scattering(both, ALL, froxels, ambient=(1.0, 1.0, 1.0))
    want = sum(in_scattering(m, ALL, froxels, ambient=(1.0, 1.0, 1.0)) for m in (one, other))
    np.testing.assert_allclose(result, want, rtol=1e-14)


def test_two_lobes_are_a_weighted_sum() -> None:
    froxels = grid()
    medium = fog(0.3, emission=(1.0, 2.0, 3.0))
    result = in_scattering(medium, ALL, froxels, ambient=(1.0, 1.0, 1.0), emission="published",
                           phase_function="two_lobe_henyey_greenstein",
                           second_lobe=SecondLobe(phase_anisotropy=-0.8, weight=0.25))
    want = medium.scattering * medium.emission
    for g, share in ((0.3, 0.75), (-0.8, 0.25)):
        want = want + share * in_scattering(fog(g), ALL, froxels, ambient=(1.0, 1.0, 1.0))
    np.testing.assert_allclose(result, want, rtol=1e-14)


@pytest.mark.parametrize("g", [0.3, -0.3, 0.8])
def test_anisotropy_that_varies_equals_anisotropy_that_does_not(g: float) -> None:
    """One froxel of another g forces the path for varying g; all others must not notice."""
    values = np.full(SHAPE, g)
    values[2, 3, 4] = -0.1
    result = in_scattering(fog(values), ALL, grid())
    want = in_scattering(fog(g), ALL, grid())
    result[:, 2, 3, 4] = want[:, 2, 3, 4]
    np.testing.assert_allclose(result, want, rtol=1e-14)


# --- leaving out, cutting up ------------------------------------------------------------------------


CASES = [
    (fog(0.5, dtype=np.float32), "henyey_greenstein"),
    (fog(np.linspace(-0.9, 0.9, 210).reshape(SHAPE), full=True), "henyey_greenstein"),
    (fog(0.2), "isotropic"), (fog(0.4), "two_lobe_henyey_greenstein"), (fog(0.4), "schlick"),
]


@pytest.mark.parametrize(("medium", "name"), CASES)
@pytest.mark.parametrize("size", [1, 40, 10**6])
def test_blocks_and_threads_and_bounds_do_not_show(medium: VBuffer, name: str, size: int) -> None:
    """To the last bit, with lights that touch everything, little and nothing."""
    small = PointLight(position=(0.3, 1.2, -4.0), intensity=(1e3, 1.0, 0.0), radius=0.9, min_distance=0.5)
    unseen = PointLight(position=(0.0, 90.0, 0.0), intensity=(1.0, 1.0, 1.0))
    lights, froxels = [*ALL, small, unseen], grid(medium.scattering.dtype.type)
    options = {"phase_function": name, "ambient": (0.1, 0.2, 0.3)}
    whole = in_scattering(medium, lights, froxels, **options, threads=1, block_size=10**6, restrict=False)
    result = in_scattering(medium, lights, froxels, **options, threads=2, block_size=size)
    assert whole.tobytes() == result.tobytes()
    assert not np.signbit(whole).any()


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-1.0, 1.0)] * 3),
       st.floats(1.0, 85.0), st.floats(0.5, 9.0))
def test_bounds_of_cones_do_not_show(place, direction, angle: float, radius: float) -> None:
    """On a grid fine enough for a cone to leave columns out."""
    assume(max(map(abs, direction)) > 1e-3)
    froxels = grid(size=Grid(width=40, height=20, depth=12, near=0.5, far=16.0))
    position = (place[0] - 0.5, place[1] + 1.0, place[2] - 2.0)
    spot = SpotLight(position=position, intensity=(1.0, 2.0, 3.0), radius=radius, direction=direction,
                     inner_angle=0.5 * angle, outer_angle=angle)
    whole = in_scattering(fog(0.5), [spot], froxels, restrict=False)
    result = in_scattering(fog(0.5), [spot], froxels)
    assert np.array_equal(np.broadcast_to(result, whole.shape), whole)


@given(st.tuples(*[st.floats(-30.0, 30.0)] * 3), st.floats(1e-3, 60.0),
       st.sampled_from([np.float32, np.float64]))
@budget(max_examples=60)
def test_slice_boxes_hold_all_that_is_inside(center, radius: float, dtype: type) -> None:
    froxels = grid(dtype)
    points = [np.broadcast_to(c, SHAPE) for c in froxel_points(froxels)]
    inside = sum((p - c) ** 2 for p, c in zip(points, center, strict=True)) <= radius * radius
    held = np.zeros(SHAPE, bool)
    for k, (top, bottom, left, right) in enumerate(slice_boxes(froxels, [center], [radius])[0]):
        held[k, top:bottom, left:right] = True
    assert not (inside & ~held).any()


def test_visibility_sees_the_right_points() -> None:
    """A visibility of ½ halves; one that depends on place and light is applied at that place."""
    froxels, medium = grid(), fog(0.5)
    x = np.broadcast_to(froxel_points(froxels)[0], SHAPE)
    small = PointLight(position=(0.3, 1.2, -4.0), intensity=(1e3, 1.0, 0.0), radius=0.9)
    lights, factors = [SUN, LAMP, small], (1.0, 0.5, 0.25)
    shares = [(1.0 + x * x) * factor for factor in factors]
    result = in_scattering(medium, lights, froxels, block_size=9,
                           visibility={i: lambda points, f=f: (1.0 + points[0] * points[0]) * f
                                       for i, f in enumerate(factors)})
    want = sum(share * in_scattering(medium, [source], froxels)
               for share, source in zip(shares, lights, strict=True))
    np.testing.assert_allclose(result, want, rtol=1e-14)


def test_a_visibility_of_one_changes_no_bit() -> None:
    froxels, medium = grid(), fog(0.5)
    result = in_scattering(medium, ALL, froxels, visibility=dict.fromkeys(range(len(ALL)), lambda points: np.ones(
        np.broadcast_shapes(*(p.shape for p in points)))))
    assert result.tobytes() == in_scattering(medium, ALL, froxels).tobytes()


@given(st.floats(1e-6, 1e6), st.floats(-0.9, 0.9))
@budget(max_examples=20)
def test_scaling_all_lengths(scale: float, g: float) -> None:
    """Lengths × k and intensity × k² change nothing."""
    def scaled(k: float) -> np.ndarray:
        camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=7, height=5)
        lamp = PointLight(position=(0.3 * k, 0.2 * k, -4.0 * k), intensity=(5.0 * k * k,) * 3, radius=8.0 * k,
                          min_distance=0.01 * k)
        return in_scattering(fog(g), [lamp], grid(camera=camera, size=Grid(
            width=7, height=5, depth=6, near=0.5 * k, far=32.0 * k)))
    np.testing.assert_allclose(scaled(scale), scaled(1.0), rtol=1e-10, atol=1e-13)


# --- extremes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("g", [0.0, 0.5, -0.5, 1.0 - 2.0**-24, -1.0 + 2.0**-24])
@pytest.mark.parametrize("radius", [1e-9, 1e-3, 8.0, 1e9, 1e10])
@pytest.mark.parametrize("falloff", ["windowed", "inverse_square"])
@pytest.mark.parametrize("place", ["camera", "sample", "far"])
def test_extremes_stay_finite(dtype: type, g: float, radius: float, falloff: str, place: str) -> None:
    froxels = grid(dtype, Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=7, height=5))
    depth = float(froxels.depths[3, 0, 0])
    position = {"camera": (0.0, 0.0, 0.0), "sample": (0.0, 0.0, -depth), "far": (1e10, 1e10, -1e10)}[place]
    lamps = [PointLight(position=position, intensity=(0.0, 1.0, 1e18), radius=radius, falloff=falloff),
             SpotLight(position=position, intensity=(0.0, 1.0, 1e18), radius=radius, falloff=falloff)]
    result = in_scattering(fog(g, dtype=dtype), lamps, froxels)
    assert np.isfinite(result).all()
    assert (result >= 0.0).all()
    assert not result[0].any()


def test_at_the_light_itself_the_angle_is_a_right_one() -> None:
    froxels = grid(np.float64, Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=7, height=5))
    depth = float(froxels.depths[3, 0, 0])
    lamp = PointLight(position=(0.0, 0.0, -depth), intensity=(1.0, 1.0, 1.0), min_distance=0.5)
    result = in_scattering(fog(0.7), [lamp], froxels)[0, 3, 2, 3]
    assert result == pytest.approx(0.1 * 4.0 * reference.henyey_greenstein(0.0, 0.7), rel=1e-14)


def test_five_hundred_lights_add_up() -> None:
    froxels, medium = grid(), fog(0.5)
    rng = np.random.default_rng(7)
    lights = [PointLight(position=tuple(p), intensity=(1.0, 2.0, 3.0), radius=3.0)
              for p in (rng.random((512, 3)) * [16.0, 5.0, 30.0] - [8.0, 0.0, 30.0]).tolist()]
    halves = [in_scattering(medium, lights[k::2], froxels) for k in (0, 1)]
    np.testing.assert_allclose(in_scattering(medium, lights, froxels), halves[0] + halves[1], rtol=1e-13)


def test_near_a_light_in_line_with_it_no_digit_is_lost() -> None:
    """g = 0.99, where 1 − cos θ is 1e-10 or so: d + s as it stands would be all rounding."""
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=1, height=1)
    froxels = make_froxels(camera, Grid(width=1, height=1, depth=8, near=1.0, far=9.0, distribution="linear"))
    lamp = PointLight(position=(1e-4, 0.0, -9.0), intensity=(1.0, 1.0, 1.0), falloff="inverse_square")
    result = in_scattering(fog(0.99), [lamp], froxels)[0].ravel()
    for k, value in enumerate(result):
        place = reference.sample(froxels, k, 0, 0, number=reference.mp.mpf)
        want = reference.in_scattering(
            [0.1] * 3, 0.99, [lamp], (0.0, 0.0, 0.0), place, number=reference.mp.mpf)
        # 0.1, 1 − g and the distance (t/d up to 17 ulp, twice) are rounded: some 60 ulp, of 1e6 if lost.
        assert value == pytest.approx(float(want[0]), rel=60 * np.finfo(float).eps)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_huge_radius_is_no_window(dtype: type) -> None:
    """A window that ends 1e10 m away changes nothing 3 m from the light: its (d/r)² is below 1e-18."""
    froxels = grid(dtype)
    lamp = PointLight(position=(0.5, 2.0, -3.0), intensity=(4.0, 3.0, 2.0), radius=1e10)
    endless = dataclasses.replace(lamp, radius=16.0, falloff="inverse_square")
    # Different units of length inside, so some roundings differ.
    np.testing.assert_allclose(in_scattering(fog(0.6, dtype=dtype), [lamp], froxels),
                               in_scattering(fog(0.6, dtype=dtype), [endless], froxels),
                               rtol=200 * float(np.finfo(dtype).eps))


def test_sun_direction_of_any_length() -> None:
    froxels = grid()
    suns = [DirectionalLight(direction=(1e-90 * k, 2e-90 * k, -3e-90 * k), irradiance=(1.0, 1.0, 1.0))
            for k in (1.0, 2.0**300)]
    one, other = (in_scattering(fog(0.6), [sun], froxels) for sun in suns)
    # A power of two times a direction is the same direction, exactly.
    assert one.tobytes() == other.tobytes()
