"""Techniques side by side: one signature, bounds, sizes, and errors that are known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from froxel_ref.absorbers import Absorbers, as_points, joined
from froxel_ref.deep_shadow import direct_depth
from froxel_ref.records import InputError
from froxel_ref.techniques import KINDS, stored_bytes, technique

ALL = [("deep", {}), ("slices", {}), ("slices", {"slices": 8, "sampling": "linear", "storage": "unorm8"}),
       ("slices", {"holds": "depth", "storage": "float16"}), ("cosine", {}), ("cosine", {"storage": "float16"}),
       ("fourier", {}), ("fourier", {"storage": "float16"}), ("fourier", {"harmonics": 5, "lanczos": True}),
       *[("power", {"count": c, "storage": s}) for c in (4, 6, 8) for s in (None, "float32", "float16", "unorm16")],
       ("power", {"ratio": 10.0}),
       *[("trigonometric", {"count": c, "storage": s}) for c in (2, 3, 4) for s in (None, "float16", "unorm16")]]
EACH = pytest.mark.parametrize(("kind", "options"), ALL, ids=lambda v: "-".join(map(str, v.values())) if v and
                               isinstance(v, dict) else str(v))


def media(rays=(4, 3), dtype=np.float64):
    rng = np.random.default_rng(1)
    start, stop = np.sort(rng.random((2, 6, *rays)), axis=0)
    tau = rng.exponential(0.3, (6, *rays))
    slabs = Absorbers(start, stop, tau, tau * rng.uniform(-1, 1, tau.shape))
    whole = joined(slabs, as_points(rng.random((3, *rays)), rng.exponential(0.3, (3, *rays))))
    return Absorbers(*(row.astype(dtype) for row in whole))


@EACH
def test_one_signature(kind, options):
    way = technique(kind, **options)
    absorbers = media()
    encoded = way.encode(absorbers)
    assert encoded.shape[1:] == (4, 3)
    assert way.numbers in (None, len(encoded))
    d = np.linspace(0, 1, 17)[:, None, None]
    passed = way.decode(encoded, d)
    assert passed.shape == (17, 4, 3)
    assert np.isfinite(passed).all()
    assert passed.min() >= 0.0
    assert passed.max() <= 1.0
    exact = np.exp(-direct_depth(absorbers, d))
    assert np.abs(passed - exact).mean() < 0.08
    one = way.decode(way.encode(Absorbers(*(row[:, 1, 2] for row in absorbers))), d[:, 0, 0])
    np.testing.assert_allclose(one, passed[:, 1, 2], atol=2e-3 if options.get("storage") == "float16" else 2e-4)
    if way.uncut is not None:
        layer = way.encode(as_points(np.array([0.5]), np.array([4.0])))
        assert way.uncut(layer, np.linspace(0, 1, 101)).max() > 1.01
        np.testing.assert_array_equal(np.minimum(way.uncut(encoded, d), 1.0), passed)


@EACH
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("tau", [0.0, 1e6, 1e8])
def test_nothing_and_everything(kind, options, tau):
    way = technique(kind, **options)
    encoded = way.encode(as_points(np.full((1, 2), 0.5), np.full((1, 2), tau)))
    passed = way.decode(encoded, np.linspace(0, 1, 9)[:, None])
    assert np.isfinite(passed).all()
    assert passed.min() >= 0.0
    assert passed.max() <= 1.0
    if tau == 0.0:
        assert passed.min() == 1.0


@EACH
def test_float32_stays(kind, options):
    way = technique(kind, **options)
    encoded = way.encode(media(dtype=np.float32))
    assert encoded.dtype == np.float32
    assert way.decode(encoded, np.zeros((1, 1, 1), np.float32)).dtype == np.float32


@pytest.mark.parametrize(("kind", "options", "size"), [
    ("fourier", {}, 32), ("fourier", {"storage": "float16"}, 16), ("cosine", {"storage": "float16"}, 16),
    ("slices", {"storage": "unorm8"}, 32), ("power", {}, 20), ("power", {"count": 8, "storage": "unorm16"}, 20),
    ("trigonometric", {"count": 4, "storage": "float16"}, 18), ("deep", {}, 4 * 4 * 2 * 9)])
def test_sizes(kind, options, size):
    way = technique(kind, **options)
    assert stored_bytes(way, way.encode(media())) == size


def test_the_known_failure():
    """A thin layer of optical depth 4 at ½: three harmonics overshoot to 1.450, moments place it."""
    layer = as_points(np.array([0.5]), np.array([4.0]))
    d = np.linspace(0, 1, 1001)
    fourier, power = technique("fourier"), technique("power")
    assert fourier.uncut is not None
    assert round(float(fourier.uncut(fourier.encode(layer), d).max()), 3) == 1.450
    exact = np.exp(-direct_depth(layer, d))
    errors = [np.abs(way.decode(way.encode(layer), d) - exact).mean() for way in (fourier, power)]
    assert errors[0] > 0.06
    assert errors[1] < 2e-3


def test_storage_shows():
    absorbers, d = media((50,)), np.linspace(0, 1, 33)[:, None]
    for kind, formats in (("fourier", ("float32", "float16")), ("power", ("float32", "float16")),
                          ("slices", ("float32", "float16", "unorm8"))):
        plain = technique(kind)
        want = plain.decode(plain.encode(absorbers), d)
        errors = []
        for storage in formats:
            way = technique(kind, storage=storage)
            errors.append(np.abs(way.decode(way.encode(absorbers), d) - want).mean())
        assert (np.diff([0.0, *errors]) > 0.0).all()
        assert errors[-1] < 0.05


def test_bad_input_is_named():
    assert set(KINDS) >= {"deep", "slices", "cosine", "fourier", "power", "trigonometric"}
    with pytest.raises(InputError, match="kind: is 'furier'"):
        technique("furier")
    with pytest.raises(InputError, match="storage: is 'unorm8'"):
        technique("power", storage="unorm8")
    with pytest.raises(InputError, match="storage: is 'unorm8'"):  # a series has a sign
        technique("fourier", storage="unorm8")
    with pytest.raises(InputError, match="storage: is 'r11g11b10f'"):
        technique("fourier", storage="r11g11b10f")
