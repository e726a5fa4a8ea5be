"""Trigonometric sums: their least values, where they are negative, and positive parts with given coefficients."""

from __future__ import annotations

import numpy as np
import pytest

from froxel_ref.fom import optical_depth
from froxel_ref.fom_nonnegative import NOWHERE, basis, least_energy, lowest, negative_arcs, nodes
from froxel_ref.fom_resolved import resolve, resolved_depth


def between_nodes(harmonics: int, depth: float) -> np.ndarray:
    """One wave whose minimum lies halfway between two nodes and is −depth: a row in the order of `basis`."""
    low = 0.5 * (nodes(harmonics)[5] + nodes(harmonics)[6])
    row = np.zeros(2 * harmonics + 1)
    row[0] = 1.0
    row[1], row[harmonics + 1] = -(1.0 + depth) * np.array([np.cos(2 * np.pi * low), np.sin(2 * np.pi * low)])
    return row[None]


@pytest.mark.parametrize("harmonics", [1, 2, 3, 5])
@pytest.mark.parametrize("depth", [1e-3, 1e-5, 1e-9])
def test_a_sum_that_is_negative_between_two_nodes_alone(harmonics: int, depth: float) -> None:
    sums = between_nodes(harmonics, depth)
    if (1 + depth) * np.cos(np.pi / len(nodes(harmonics))) < 1:
        assert (sums @ basis(nodes(harmonics), harmonics)).min() > 0  # the nodes do not show it
        np.testing.assert_allclose(lowest(sums), -depth, rtol=1e-6)
    start, stop = negative_arcs(sums)
    low = 0.5 * (nodes(harmonics)[5] + nodes(harmonics)[6])
    half = np.arccos(1 / (1 + depth)) / (2 * np.pi)
    np.testing.assert_allclose([start[0, 0], stop[0, 0]], [low - half, low + half], atol=1e-9)
    assert (start[1:] == NOWHERE).all()


@pytest.mark.parametrize("harmonics", [1, 2, 3, 5])
@pytest.mark.parametrize("depth", [1e-3, 1e-5])
def test_what_is_negative_between_nodes_does_not_fall_either(harmonics: int, depth: float) -> None:
    """The series falls by up to 1e-5 there."""
    row = between_nodes(harmonics, depth)[0]
    made = np.zeros((2, harmonics + 1, 1))
    made[0, 0], made[:, 1:, 0] = 2.0, row[1:].reshape(2, harmonics)
    x = np.linspace(0, 1, 20001)
    assert np.diff(optical_depth(made, x)).min() < -1e-10
    assert np.diff(resolved_depth(resolve(made), x[:, None])[:, 0]).min() >= -4e-16


@pytest.mark.parametrize("harmonics", [1, 2, 3, 6])
def test_arcs_are_where_a_fine_grid_is_negative(harmonics: int) -> None:
    rng = np.random.default_rng(harmonics)
    sums = rng.normal(size=(400, 2 * harmonics + 1))
    x = (np.arange(20000) + 0.5) / 20000
    values = sums @ basis(x, harmonics)
    start, stop = negative_arcs(sums)
    inside = ((x > start[..., None]) & (x < stop[..., None])).any(axis=0)
    assert not (~inside & (values < -1e-9)).any()
    # What rises above 0 between two nodes alone is not seen: it is lost, not negative.
    below = sums @ basis(nodes(harmonics), harmonics) < 0
    around = (below & np.roll(below, -1, axis=1))[:, (x * below.shape[1]).astype(int)]
    assert around[inside & (values > 1e-9)].all()
    np.testing.assert_allclose(np.minimum(lowest(sums), 0.0), np.minimum(values.min(axis=1), 0.0),
                               atol=0.05 * np.abs(sums).sum(axis=1).max())
    assert (np.diff(start, axis=0) >= 0).all()
    assert (stop >= start).all()


def test_the_positive_part_has_the_coefficients_and_the_least_energy() -> None:
    """Against media with the same coefficients: sums of them and what has none up to K."""
    rng = np.random.default_rng(2)
    x = (np.arange(4096) + 0.5) / 4096
    places = rng.random((100, 4, 1))
    media = np.exp(-0.5 * (((x - places + 0.5) % 1.0 - 0.5) / rng.uniform(0.06, 0.12, (100, 4, 1))) ** 2).sum(axis=1)
    media /= media.mean(axis=1)[:, None]
    functions = basis(x, 3)
    series = media @ functions.T / x.size * np.array([1, *[2] * 6])
    found = np.maximum(least_energy(series) @ functions, 0.0)
    again = found @ functions.T / x.size * np.array([1, *[2] * 6])
    left = np.abs(again - series).max(axis=1)
    # Measured: 2e-3 from the 16 K + 16 nodes, at the ends of narrow arcs.
    assert np.quantile(left, 0.9) < 2e-3
    assert left.max() < 2e-2
    close = left < 1e-3
    assert ((found**2).mean(axis=1) <= (media**2).mean(axis=1) * (1 + 1e-2))[close].all()
    assert close.mean() > 0.5


def test_a_series_that_is_not_negative_is_left_alone() -> None:
    series = np.array([[1.0, 0.3, -0.2, 0.1, 0.2, 0.1, -0.1]])
    assert lowest(series)[0] > 0
    assert np.array_equal(least_energy(series), series)
