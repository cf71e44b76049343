"""The plain twin's blending of primitives and of differences of Gaussians against closed forms."""

import numpy as np
from mi_dogsplat import reference
from splat_scenes import logit, make_camera, make_splats, random_splats

# Compositing

def test_no_primitives_give_the_background():
    splats, camera = make_splats(np.zeros((0, 3))), make_camera()
    image, T, depth = reference.render(splats, camera, (0.1, 0.2, 0.3))
    np.testing.assert_array_equal(image, np.broadcast_to([0.1, 0.2, 0.3], (48, 64, 3)))
    assert (T == 1).all() and (depth == 0).all()
    assert [len(i) for i in reference.tiles(reference.project(splats, camera), 64, 48)] == [0] * 12


def test_the_background_is_seen_through_the_transmittance():
    splats, camera, background = random_splats(), make_camera(), np.array([0.3, -0.2, 2])
    black, T, _ = reference.render(splats, camera)
    image, _, _ = reference.render(splats, camera, background)
    np.testing.assert_allclose(image, black + T[..., None] * background)


def test_nearer_primitives_come_first_and_equal_depths_keep_their_order():
    means, colors = [[0, 0, 3], [0, 0, 2], [0, 0, 2], [0, 0, 1]], np.eye(4)[:, :3]
    p = reference.project(make_splats(means, 0.5, colors=colors), make_camera())
    np.testing.assert_array_equal(reference.depth_order(p), [3, 1, 2, 0])
    tied = reference.project(make_splats([[0, 0, 2 + i % 2] for i in range(100)]), make_camera())
    np.testing.assert_array_equal(reference.depth_order(tied), np.r_[0:100:2, 1:100:2])
    # Large enough that the kernel is 1 at the middle: each takes half of what is left.
    image, T, _ = reference.render(make_splats(means, 1e4, colors=colors), make_camera())
    np.testing.assert_allclose(image[24, 32], [1 / 16, 1 / 4, 1 / 8], rtol=1e-6)
    np.testing.assert_allclose(T[24, 32], 1 / 16, rtol=1e-6)


def test_the_walk_stops_before_the_primitive_that_would_take_T_below_the_limit():
    # .9 each: T = .1, .01, .001, .0001 up to rounding, then the next one goes under.
    means = np.column_stack([np.zeros((6, 2)), np.arange(1, 7)])
    opacities = np.array([0.9, 0.9, 0.9, 0.89, 0.9, 0.01])
    splats, camera = make_splats(means, 1e5, opacities, np.arange(1, 7)[:, None] / 10.0), make_camera()
    image, T, depth = reference.render(splats, camera, (1, 1, 1))
    left = np.concatenate([[1], np.cumprod(1 - opacities)])
    np.testing.assert_allclose(T, left[4], rtol=1e-5)  # the fifth is left out, and the faint sixth with it
    weights = (opacities * left[:-1])[:4]
    np.testing.assert_allclose(image[..., 0], weights @ [0.1, 0.2, 0.3, 0.4] + left[4], rtol=1e-6)
    np.testing.assert_allclose(depth, weights @ [1, 2, 3, 4], rtol=1e-6)
    np.testing.assert_allclose(reference.render(splats, camera, smooth=True)[1], left[6], rtol=1e-5)


def test_behind_two_saturated_primitives_the_walk_stops_as_it_does_in_float32():
    assert (1 - reference.MAX_ALPHA) ** 2 < reference.MIN_T
    assert (1 - np.float32(reference.MAX_ALPHA)) ** 2 < np.float32(reference.MIN_T)
    _, T, _ = reference.render(make_splats([[0, 0, 1], [0, 0, 2]], 1e5, 0.999), make_camera())
    np.testing.assert_allclose(T, 0.01, rtol=1e-5)


def test_features_take_the_place_of_the_colours():
    splats, camera = random_splats(), make_camera()
    p = reference.project(splats, camera)
    lists = reference.tiles(p, 64, 48)
    features = np.column_stack([p.depths, np.ones(len(p.depths))])
    image, T, depth = reference.composite(p, lists, 64, 48, (0, 1), features=features)
    np.testing.assert_allclose(image[..., 0], depth)
    np.testing.assert_allclose(image[..., 1], 1)  # alpha T sums to 1 - T, negative alphas included


# Difference of Gaussians

def dog_profile(**dog):
    """alpha at 0, 1, 2, ... px from the centre of a DoG of sigma 200 px, where the low-pass is nothing."""
    camera = make_camera(1200, 1, f=400, cx=0.5, cy=0.5)
    image, _, _ = reference.render(make_splats([0, 0, 2], 1.0, 0.8, dog=[0], **dog), camera, smooth=True)
    return image[0, :, 0] / 0.8


def test_a_dog_at_its_start_has_half_the_peak_a_zero_at_1_51_and_its_minimum_at_2_32_sigma():
    profile, r = dog_profile(f_a=0.5, F=1.6), np.arange(1200) / 200
    np.testing.assert_allclose(profile[0], 0.5, atol=1e-6)
    zero = np.sqrt(2 * np.log(2) / (1 - 1 / 1.6**2))  # 1.508
    crossing = np.flatnonzero(np.diff(np.sign(profile)))[0]
    assert r[crossing] <= zero + 1e-4 and zero - 1e-4 <= r[crossing + 1]
    lowest = np.sqrt(2 * np.log(2 * 1.6**2) / (1 - 1 / 1.6**2))  # 2.315
    assert abs(r[profile.argmin()] - lowest) <= 1 / 200
    np.testing.assert_allclose(profile.min(), -0.107, atol=5e-4)


def test_a_dog_integrates_to_1_minus_f_a_F_squared():
    camera = make_camera(200, 200, f=40)
    splats = make_splats([0, 0, 2], 0.5, 0.1, dog=[0], F=(1.6, 1.6, 1.6))
    integral = reference.render(splats, camera, smooth=True)[0][..., 0].sum()
    det, wide = (10**2 + 0.3) * (11**2 + 0.3), (16**2 + 0.3) * (17.6**2 + 0.3)
    np.testing.assert_allclose(integral, 0.1 * 2 * np.pi * (np.sqrt(det) - 0.5 * np.sqrt(wide)), rtol=1e-6)
    np.testing.assert_allclose(integral / (0.1 * 2 * np.pi * 10 * 11), 1 - 0.5 * 1.6**2, rtol=1e-2)


def test_the_ring_raises_T_above_one_unless_negative_transmittance_is_off():
    splats, camera = make_splats([0, 0, 2], 0.2, 0.9, dog=[0]), make_camera()
    image, T, _ = reference.render(splats, camera)
    alpha = image[..., 0]
    assert T.max() > 1.05
    np.testing.assert_allclose(T, 1 - alpha)
    off, T_off, _ = reference.render(splats, camera, negative_transmittance=False)
    np.testing.assert_array_equal(off, image)
    np.testing.assert_allclose(T_off, 1 - np.maximum(alpha, 0))


def test_both_kernels_of_a_dog_are_limited_to_99_percent_each():
    splats = make_splats([0, 0, 2], 1e5, 0.9999, dog=[0], f_a=0.995)
    assert (reference.render(splats, make_camera(), smooth=True)[0] == 0).all()
    splats.dog_logit_opacities = logit([0.5])
    image = reference.render(splats, make_camera(), smooth=True)[0]
    np.testing.assert_allclose(image, 0.99 - 0.9999 / 2, rtol=1e-5)


def test_a_dog_with_a_vanishing_pseudo_gaussian_is_the_plain_gaussian():
    camera = make_camera()
    plain = reference.render(make_splats([0.1, 0, 2], [0.1, 0.2, 0.3]), camera)
    dog = reference.render(make_splats([0.1, 0, 2], [0.1, 0.2, 0.3], dog=[0], f_a=1e-300), camera)
    for ours, theirs in zip(dog, plain, strict=True):
        np.testing.assert_array_equal(ours, theirs)
