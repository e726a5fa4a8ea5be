"""Places near centres: none is left out, few are handed out in vain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref import near_pairs
from froxel_ref.near_pairs import pairs_within


def within(places, centers, reach):
    """Every pair, tried one by one."""
    gap = places[:, :, np.newaxis] - centers[:, np.newaxis]
    inside = ((gap * gap).sum(axis=0) <= reach * reach) & (reach >= 0)
    return set(zip(*(part.tolist() for part in np.nonzero(inside)), strict=True))


@given(seed=st.integers(0, 2**32), axes=st.integers(1, 3), count=st.integers(1, 300), balls=st.integers(1, 8),
       flat=st.booleans())
def test_no_pair_is_left_out_and_none_comes_twice(seed, axes, count, balls, flat):
    rng = np.random.default_rng(seed)
    places, centers = rng.normal(size=(axes, count)), rng.normal(size=(axes, balls))
    if flat:  # all alike along an axis
        places[-1] = 0.25
    reach = rng.choice([-1.0, 0.0, 0.1, 1.0, 9.0], balls)
    centers[:, 0] = places[:, 0]  # a ball of radius 0 holds its own centre
    found = [pair for place, ball in pairs_within(places, centers, reach)
             for pair in zip(place.tolist(), ball.tolist(), strict=True)]
    assert len(found) == len(set(found))
    assert set(found) >= within(places, centers, reach)
    assert not {ball for _, ball in found} & set(np.flatnonzero(reach < 0).tolist())
    assert [ball for _, ball in found] == sorted(ball for _, ball in found)


def test_nothing_from_nothing():
    for places, centers in (((2, 0), (2, 3)), ((2, 3), (2, 0))):
        assert list(pairs_within(np.zeros(places), np.zeros(centers), np.ones(centers[1]))) == []


def test_small_balls_are_handed_few_places():
    places = np.stack(np.meshgrid(np.arange(256.0), np.arange(256.0))).reshape(2, -1)
    places = places[:, np.random.default_rng(1).permutation(65536)]
    centers = np.random.default_rng(2).uniform(20, 230, (2, 50))
    handed = sum(len(place) for place, _ in pairs_within(places, centers, np.full(50, 8.0)))
    assert handed < 3 * 50 * np.pi * 8.0**2  # measured: 2.0


@pytest.mark.parametrize(("boxes", "pairs"), [(1, 32), (1 << 20, 32), (7, 1 << 17)])
def test_pieces_make_no_difference(monkeypatch, boxes, pairs):
    rng = np.random.default_rng(3)
    places, centers, reach = rng.normal(size=(2, 500)), rng.normal(size=(2, 9)), rng.random(9)
    whole = [np.concatenate(part) for part in zip(*pairs_within(places, centers, reach), strict=True)]
    monkeypatch.setattr(near_pairs, "BOXES", boxes)
    monkeypatch.setattr(near_pairs, "PAIRS", pairs)
    pieces = list(pairs_within(places, centers, reach))
    assert len(pieces) > 1
    assert all(len(place) <= pairs for place, _ in pieces)
    for a, b in zip(whole, zip(*pieces, strict=True), strict=True):
        np.testing.assert_array_equal(a, np.concatenate(b))
