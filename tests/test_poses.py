import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation, Slerp

from p2l import poses


def quats(seed, n=5):
    return poses.quat(Rotation.random(n, np.random.default_rng(seed)))


@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_between_is_scipys_slerp(seed, fraction):
    start, end = quats(seed), -quats(seed + 1)
    mine = poses.rotation(poses.between(start, end, np.full(5, fraction)))
    for row in range(5):
        pair = poses.rotation(np.stack([start[row], end[row]]))
        theirs = Slerp([0.0, 1.0], pair)(fraction)
        assert (mine[row].inv() * theirs).magnitude() < 1e-6


def test_between_equal_poses_stays():
    start = quats(0)
    np.testing.assert_allclose(poses.between(start, start, np.full(5, 0.3)), start, atol=1e-12)
    np.testing.assert_allclose(np.abs(poses.between(start, -start, np.full(5, 0.3))), np.abs(start), atol=1e-9)


def test_frame_has_the_axes_given():
    x, z = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    made = poses.rotation(poses.frame(x, z))
    np.testing.assert_allclose(made.apply([1.0, 0.0, 0.0]), x, atol=1e-12)
    np.testing.assert_allclose(made.apply([0.0, 0.0, 1.0]), z, atol=1e-12)


def test_about_turns_by_the_right_hand():
    turned = poses.about([0.0, 0.0, 1.0], np.array([np.pi / 2, -np.pi / 2])).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(turned, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], atol=1e-12)


@given(st.integers(0, 10_000), st.floats(1e-9, 3.0))
def test_the_angle_between_is_scipys_to_the_bit(seed, apart):
    first = quats(seed)
    second = poses.quat(poses.rotation(first) * poses.about(quats(seed + 1)[:, 1:], apart))
    scipys = (
        Rotation.from_quat(first, scalar_first=True).inv() * Rotation.from_quat(second, scalar_first=True)
    ).magnitude()
    assert_array_equal(poses.angle(first, second), scipys)
    assert_array_equal(poses.angle(first, -first), 0.0)


@given(st.integers(0, 10_000))
def test_rotate_is_scipys_apply_and_a_row_alone_is_the_row_among_others(seed):
    rng = np.random.default_rng(seed)
    turns, vectors = poses.rotation(quats(seed, 7)), rng.normal(size=(7, 3))
    turned = poses.rotate(turns, vectors)
    np.testing.assert_allclose(turned, turns.apply(vectors), atol=1e-14)
    np.testing.assert_allclose(poses.rotate(turns, [0.0, 1.0, 0.0]), turns.apply([0.0, 1.0, 0.0]), atol=1e-15)
    np.testing.assert_allclose(poses.rotate(turns[2], vectors), turns[2].apply(vectors), atol=1e-14)
    for size in (1, 2, 4):
        assert_array_equal(poses.rotate(turns[:size], vectors[:size]), turned[:size])


@given(st.integers(0, 10_000))
def test_plain_quaternions_are_scipys_rotations_and_a_row_alone_is_the_row_among_others(seed):
    rng = np.random.default_rng(seed)
    first, second, vectors = rng.normal(size=(7, 4)), rng.normal(size=(7, 4)), rng.normal(size=(7, 3))
    one, other = poses.rotation(first), poses.rotation(second)
    left, right = poses.unit(first), poses.unit(second)
    for mine, scipys in (
        (poses.canonical(left), poses.quat(one)),
        (poses.canonical(poses.inverse(left)), poses.quat(one.inv())),
        (poses.canonical(poses.product(left, right)), poses.quat(one * other)),
        (poses.canonical(poses.product(left, right[:1])), poses.quat(one * other[0])),
        (poses.image(left, vectors), poses.rotate(one, vectors)),
        (poses.image(left, [0.0, 1.0, 0.0]), poses.rotate(one, [0.0, 1.0, 0.0])),
    ):
        np.testing.assert_allclose(mine, scipys, atol=1e-14)
    for size in (1, 2, 4):
        assert_array_equal(poses.product(left[:size], right[:size]), poses.product(left, right)[:size])
        assert_array_equal(poses.image(left[:size], vectors[:size]), poses.image(left, vectors)[:size])
        assert_array_equal(poses.unit(first[:size]), left[:size])


def test_a_half_turn_has_one_sign():
    half_turns = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, -1.0], [-1.0, 0.0, 0.0, 0.0]])
    assert_array_equal(poses.canonical(half_turns), -half_turns)
    assert_array_equal(poses.canonical(half_turns), poses.quat(poses.rotation(half_turns)))
