"""Rotations and rigid motions (`grainmotion.rotations`): exponential, logarithm, composition, change of centre."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from grainmotion.rotations import apply_motion, recenter, rotation_matrix, rotation_vector, skew_matrix

numbers = st.floats(-50, 50)
vectors = arrays(float, 3, elements=numbers)
rotation_vectors = arrays(float, 3, elements=st.floats(-1.75, 1.75))  # shorter than π
motions = st.tuples(rotation_vectors.map(rotation_matrix), vectors)


def compose(second, first):
    """Matrix and translation of ``first``, then ``second``, about one centre."""
    return second[0] @ first[0], second[0] @ first[1] + second[1]


def inverse(motion):
    return motion[0].T, -motion[0].T @ motion[1]


def assert_close(a, b, atol=1e-10):
    np.testing.assert_allclose(a, b, rtol=0, atol=atol)


class TestRotations:
    @given(arrays(float, 3, elements=st.floats(-20, 20)))
    def test_exp_is_a_rotation(self, w):
        r = rotation_matrix(w)
        assert_close(r @ r.T, np.eye(3))
        assert np.linalg.det(r) == pytest.approx(1)
        assert_close(r @ w, w)  # the axis is fixed

    @given(rotation_vectors)
    def test_log_undoes_exp(self, w):
        assert_close(rotation_vector(rotation_matrix(w)), w, 1e-9)

    @given(arrays(float, 3, elements=st.floats(-20, 20)))
    def test_exp_undoes_log_for_any_rotation(self, w):
        r = rotation_matrix(w)
        assert np.linalg.norm(rotation_vector(r)) <= np.pi + 1e-12
        assert_close(rotation_matrix(rotation_vector(r)), r, 1e-7)

    @pytest.mark.parametrize(
        ("axis", "start", "end"), [("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y")], ids=["x", "y", "z"]
    )
    def test_right_hand_rule(self, axis, start, end):
        unit = dict(zip("xyz", np.eye(3)))
        assert_close(rotation_matrix(np.pi / 2 * unit[axis]) @ unit[start], unit[end])

    @given(rotation_vectors, vectors)
    def test_rodrigues(self, w, x):
        angle = np.linalg.norm(w)
        if angle < 1e-3:
            return
        k = w / angle
        by_hand = x * np.cos(angle) + np.cross(k, x) * np.sin(angle) + k * (k @ x) * (1 - np.cos(angle))
        assert_close(rotation_matrix(w) @ x, by_hand)

    @given(vectors, vectors)
    def test_skew_is_the_cross_product(self, v, w):
        assert_close(skew_matrix(v) @ w, np.cross(v, w))

    @given(rotation_vectors)
    def test_skew_generates_exp(self, w):
        small = 1e-5 * w
        assert_close(
            rotation_matrix(small), np.eye(3) + skew_matrix(small) + skew_matrix(small) @ skew_matrix(small) / 2
        )

    def test_stacks_of_any_shape(self):
        w = np.random.default_rng(0).normal(size=(2, 4, 3))
        r = rotation_matrix(w)
        assert r.shape == (2, 4, 3, 3)
        assert_close(r[1, 2], rotation_matrix(w[1, 2]))
        assert_close(rotation_vector(r), w)
        assert rotation_matrix(np.zeros((0, 3))).shape == (0, 3, 3)
        assert rotation_vector(np.zeros((0, 3, 3))).shape == (0, 3)

    def test_nan_rotations_stay_nan_and_affect_no_others(self):
        w = np.array([[0.1, 0.2, 0.3], [np.nan] * 3, [-1.0, 0.0, 0.5]])
        r = rotation_matrix(w)
        assert np.isnan(r[1]).all()
        vectors_again = rotation_vector(r)
        assert np.isnan(vectors_again[1]).all()
        assert_close(vectors_again[[0, 2]], w[[0, 2]])


class TestGroup:
    @given(motions, motions, vectors, vectors)
    def test_composition_acts_one_after_the_other(self, first, second, center, point):
        both = compose(second, first)
        one_by_one = apply_motion(*second, center, apply_motion(*first, center, point))
        assert_close(apply_motion(*both, center, point), one_by_one, 1e-9)

    @given(motions, vectors, vectors)
    def test_inverse(self, a, center, point):
        moved = apply_motion(*a, center, point)
        assert_close(apply_motion(*inverse(a), center, moved), point, 1e-9)

    @given(motions, vectors, vectors, vectors)
    def test_recentred_motion_is_the_same_motion(self, a, old, new, point):
        matrix, translation = a
        moved = recenter(matrix, translation, old, new)
        assert_close(apply_motion(matrix, moved, new, point), apply_motion(matrix, translation, old, point), 1e-9)
        assert_close(recenter(matrix, moved, new, old), translation, 1e-9)

    @given(motions, vectors)
    def test_the_centre_moves_by_the_translation(self, a, center):
        assert_close(apply_motion(*a, center, center) - center, a[1])

    @given(motions, vectors, vectors, vectors)
    def test_distances_are_kept(self, a, center, p, q):
        moved = apply_motion(*a, center, p) - apply_motion(*a, center, q)
        assert np.linalg.norm(moved) == pytest.approx(np.linalg.norm(p - q), abs=1e-9)

    def test_stacks(self):
        rng = np.random.default_rng(1)
        w, u, c, p = rng.normal(size=(4, 5, 3))
        r = rotation_matrix(w)
        moved = apply_motion(r, u, c, p)
        for k in range(5):
            assert_close(moved[k], r[k] @ (p[k] - c[k]) + u[k] + c[k])
