"""Roots of real-rooted polynomials: against the roots that they were made of, in rational numbers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.real_roots import real_roots
from froxel_ref.records import InputError


def made_of(roots):
    """Coefficients of the polynomial with these roots, the exact ones rounded once."""
    coefficients = [Fraction(1)]
    for root in roots:
        coefficients = [a - Fraction(float(root)) * b for a, b in zip([*coefficients, Fraction(0)],
                                                                    [Fraction(0), *coefficients], strict=True)]
    return [float(c) for c in coefficients]


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5, 7])
def test_roots_apart_come_back(degree):
    """Bound: the change that rounding coefficients alone makes, by their condition, with a factor of 100."""
    rng = np.random.default_rng(degree)
    for _ in range(60):
        roots = np.sort(rng.uniform(-1, 1, degree)) + np.linspace(-0.1, 0.1, degree) * degree
        slopes = [np.prod([abs(r - s) for s in np.delete(roots, i)]) for i, r in enumerate(roots)]
        coefficients = np.array(made_of(roots))
        got = np.sort(real_roots(3.0 * coefficients))
        size = np.abs(coefficients) @ np.array([np.abs(roots) ** (degree - k) for k in range(degree + 1)])
        bound = 100 * np.finfo(float).eps * size / np.array(slopes) * (1 if degree < 5 else 10)
        assert (np.abs(got - roots) <= bound).all()


@given(st.lists(st.sampled_from([-3.0, -1.0, -0.5, 0.0, 0.5, 2.0]), min_size=1, max_size=4))
def test_roots_that_meet_are_real_and_near(roots):
    """An n-fold root is known to the n-th root of rounding only."""
    got = np.sort(real_roots(np.array(made_of(roots))))
    assert np.isfinite(got).all()
    np.testing.assert_allclose(got, sorted(roots), rtol=0, atol=3e-3)


def test_wide_spreads_keep_digits():
    """As near and far points of a distribution have: of 1000 quartics all but a few to 10 digits."""
    rng = np.random.default_rng(9)
    errors = []
    for _ in range(1000):
        roots = np.sort(rng.choice([-1, 1], 4) * 10.0 ** rng.uniform(-0.4, 4, 4))
        errors.append(np.max(np.abs(np.sort(real_roots(np.array(made_of(roots)))) / roots - 1)))
    assert np.quantile(errors, 0.99) < 1e-10
    assert np.quantile(errors, 0.5) < 1e-14


def test_many_at_once_and_float32():
    rng = np.random.default_rng(5)
    roots = np.sort(rng.uniform(-2, 2, (3, 4, 5)), axis=0) + np.array([-1.0, 0.0, 1.0])[:, None, None]
    coefficients = np.array([[made_of(roots[:, i, j]) for j in range(5)] for i in range(4)])
    got = real_roots(np.moveaxis(coefficients, -1, 0))
    assert got.shape == (3, 4, 5)
    np.testing.assert_allclose(np.sort(got, axis=0), roots, atol=1e-12)
    narrow = real_roots(np.moveaxis(coefficients, -1, 0).astype(np.float32))
    assert narrow.dtype == np.float32
    np.testing.assert_allclose(np.sort(narrow, axis=0), roots, atol=1e-4)


def test_a_constant_is_refused():
    with pytest.raises(InputError, match="coefficients: has no power above 0"):
        real_roots(np.ones((1, 3)))
