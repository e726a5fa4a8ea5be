"""What benchmarks/undersampling.py and benchmarks/ghosting.py print, on small grids: noise, trails, samples' worth."""

from __future__ import annotations

import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from froxel_ref.settings import Grid
from froxel_ref.temporal import blend

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
ALPHAS = (1.0, 0.5, 0.2, 0.1, 0.05)


@pytest.fixture(scope="module")
def undersampling() -> dict[str, Any]:
    return runpy.run_path(str(BENCHMARKS / "undersampling.py"))


@pytest.fixture(scope="module")
def shaft(undersampling: dict[str, Any]) -> tuple[Any, np.ndarray]:
    """The sampler of a coarse grid, and each froxel's mean over 1000 points."""
    sample = undersampling["shaft_sampler"](16, 9, 10)
    return sample, undersampling["mean_over"](sample, undersampling["strata"](10, 1))


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_samples_that_an_average_is_worth(undersampling: dict[str, Any], alpha: float) -> None:
    """The filter's answer to one frame among none: its squares' sum is 1/n, as is the share of variance left."""
    answer, field = [], np.zeros((1, 1, 1))
    for n in range(400):
        field = blend(np.full((1, 1, 1), float(n == 0)), field, True, alpha=alpha)
        answer.append(field[0, 0, 0])
    assert np.sum(np.square(answer)) == pytest.approx(1.0 / undersampling["effective_samples"](alpha), rel=1e-12)


def test_random_points_gain_the_root_of_the_samples(
        undersampling: dict[str, Any], shaft: tuple[Any, np.ndarray]) -> None:
    """Within 3.5 standard errors, derived from the scatter of ten independent sequences, all below 6 %.

    So the prediction is a check of the whole chain: the samples' places, the average, and the truth it is held to.
    """
    sample, truth = shaft
    squares = undersampling["random_squares"](sample, truth, sequences=10, frames=80, seed=3)
    for k, alpha in enumerate(ALPHAS[1:], 1):
        found = undersampling["factor"](squares, k)
        want = math.sqrt((2.0 - alpha) / alpha)
        assert found.error < 0.06 * want
        assert abs(found.value - want) < 3.5 * found.error, alpha


def test_halton_points_gain_more(undersampling: dict[str, Any], shaft: tuple[Any, np.ndarray]) -> None:
    """But no more than the mean of their cycle; and one jittered frame is worse than one at the middle."""
    sample, truth = shaft
    errors = undersampling["halton_errors"](sample, truth)
    gains = errors[0] / errors
    roots = np.sqrt([(2.0 - alpha) / alpha for alpha in ALPHAS])
    assert (gains[2:] > 1.1 * roots[2:]).all()  # measured 1.2 to 1.5
    cycle = undersampling["mean_over"](sample, [undersampling["froxel_jitter"](n) for n in range(32)])
    assert gains[-1] < errors[0] / math.sqrt(np.mean((cycle - truth) ** 2))
    middle = math.sqrt(np.mean((sample((0.5, 0.5, 0.5)) - truth) ** 2))
    assert 0.4 * errors[0] < middle < 0.9 * errors[0]
    assert errors[-1] < 0.35 * middle


@pytest.fixture(scope="module")
def rows() -> dict[str, Any]:
    """Some rows of the table of remedies."""
    ghosting = runpy.run_path(str(BENCHMARKS / "ghosting.py"))
    small = ["shadow_maps.point_size=64", "shadow_maps.directional_size=256", "shadow_maps.cascades=1"]
    stand = ghosting["make_stand"](Grid(width=32, height=18, depth=20), points=4, frames=84, rest=32, pixels=1,
                                   overrides=small)
    names = ("scattering, alpha 0.05 (published)", "scattering, alpha 0.2", "media, alpha 0.05")
    words = ghosting["REMEDIES"]
    return {name: ghosting["measure"](stand, ghosting["temporal_of"](words[name]), warm=32) for name in names}


def test_a_trail_is_as_long_as_the_average(rows: dict[str, Any]) -> None:
    """ln 0.05/ln(1 − α) frames after a light that went out, 58 and 13; one that moves away adds some. Noise pays."""
    slow, fast = rows["scattering, alpha 0.05 (published)"], rows["scattering, alpha 0.2"]
    assert 58 <= slow.frames <= 75  # measured 63 on 64x36x40 froxels
    assert 13 <= fast.frames <= 25  # 19
    assert slow.metres == pytest.approx(0.1 * slow.frames)
    assert fast.moving < 0.8 * slow.moving
    assert fast.noise > 2.0 * slow.noise  # of independent samples √(39/9) = 2.1; Halton's gain more, 3.7


def test_no_lamp_leaves_a_trail_where_media_are_filtered(rows: dict[str, Any]) -> None:
    """Nothing of it, and hardly more noise; but a lamp's light keeps the error of one sample."""
    published, media = rows["scattering, alpha 0.05 (published)"], rows["media, alpha 0.05"]
    assert media.frames == 0.0
    assert abs(media.behind) < 0.05
    assert media.moving < 0.75 * published.moving
    assert media.noise < 1.3 * published.noise
    assert media.error > 3.0 * published.error
