"""Priors as records: differences and their transpose against matrices."""

import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import columns, owned
from evsdr.solve.grid import make_grid
from evsdr.solve.neighbours.priors import (
    LEAST_LEFT,
    Learnt,
    edge_weights,
    integrable,
    smooth_normals,
    smooth_reflectance,
)
from evsdr.solve.neighbours.student import FREEDOM
from evsdr.solve.unknowns import to_normal
from tests.support.stencil_matrix import MASK, matrix_of

N_BAND = 3
N = 2 + N_BAND
PRIORS = [smooth_normals(), integrable(), smooth_reflectance(N_BAND)]
NAMES = [prior.name for prior in PRIORS]


def numpy(value):
    return value.numpy().astype(float)


@pytest.mark.parametrize("prior", PRIORS, ids=NAMES)
def test_differences_and_their_transpose(prior, rng):
    links, n = make_grid(MASK, mi.UInt32).links, prior.last - prior.first
    q = rng.normal(size=(n, MASK.sum()))
    z = prior.values([owned(mi.Float, v) for v in q], links)
    weights = []
    for direction, components in zip(prior.directions, z):
        weights.append([])
        for component, value in zip(direction, components):
            expected = sum(matrix_of(stencil) @ q[k] for k, stencil in component.items())
            np.testing.assert_allclose(value.numpy(), expected, atol=1e-5)
            where = np.abs(sum(np.abs(matrix_of(s)).sum(axis=1) for s in component.values())) > 0
            weights[-1].append(owned(mi.Float, np.where(where, rng.normal(size=MASK.sum()), 0)))
    back = np.array([numpy(v) for v in prior.adjoint(weights, links)])
    product = sum(numpy(w) @ numpy(v) for row, values in zip(weights, z) for w, v in zip(row, values))
    assert np.sum(back * q) == pytest.approx(product, rel=1e-4)


def test_normals_turn_as_their_jacobian_says(rng):
    theta, change = rng.normal(0, 0.7, (2, 8, 2))
    xx, xy, yy = (numpy(v) for v in smooth_normals().jacobian(columns(mi.Float, theta)))
    step = 1e-5
    numeric = (to_normal(theta + step * change) - to_normal(theta - step * change))[:, :2] / (2 * step)
    np.testing.assert_allclose(xx * change[:, 0] + xy * change[:, 1], numeric[:, 0], atol=1e-5)
    np.testing.assert_allclose(xy * change[:, 0] + yy * change[:, 1], numeric[:, 1], atol=1e-5)
    quantities = np.stack([q.numpy() for q in smooth_normals().quantities(columns(mi.Float, theta))], axis=-1)
    np.testing.assert_allclose(quantities, to_normal(theta)[:, :2], atol=1e-6)


@pytest.mark.parametrize("prior", PRIORS, ids=NAMES)
def test_edges_weigh_little(prior, rng):
    """Student's t by a plain loop, where single pixels are exactly known."""
    links = make_grid(MASK, mi.UInt32).links
    theta = rng.normal(0, 0.5, (N, MASK.sum()))
    theta[:, 4] += 5.0  # an edge
    arrays = [owned(mi.Float, v) for v in theta]
    root = rng.normal(size=(prior.size, prior.size))
    spread = root @ root.T + np.eye(prior.size)
    exact = [owned(mi.Float, np.zeros(MASK.sum())) for _ in range(N * (N + 1) // 2)]
    found = edge_weights(Learnt.of(prior, spread, mi.Float), arrays, exact, links, mi.Float(FREEDOM))
    q = theta[prior.first : prior.last]
    q = to_normal(theta.T)[:, :2].T if prior.of_normal else q
    flat = numpy(prior.factor(arrays, links)) if prior.flattened else 1.0
    for direction, valid, weight in zip(prior.directions, prior.valid(links), found):
        z = [flat * sum(matrix_of(s) @ q[k] for k, s in component.items()) for component in direction]
        distance = np.einsum("ix,ij,jx->x", z, np.linalg.inv(spread), z)
        expected = (FREEDOM + prior.size) / (FREEDOM + distance)
        expected *= flat**2 * np.clip(expected, LEAST_LEFT, 1) ** (prior.letting_go - 1)
        np.testing.assert_allclose(weight.numpy(), np.where(valid.numpy(), expected, 0), rtol=1e-3, atol=1e-6)


def test_noise_of_pixels_lowers_the_weights(rng):
    links, prior = make_grid(MASK, mi.UInt32).links, smooth_reflectance(N_BAND)
    theta = [owned(mi.Float, v) for v in np.zeros((N, MASK.sum()))]
    variance = np.zeros((N, N))
    variance[range(2, N), range(2, N)] = 0.1
    inverse = [owned(mi.Float, np.full(MASK.sum(), v)) for v in variance[np.tril_indices(N)]]
    learnt = Learnt.of(prior, np.eye(N_BAND), mi.Float)
    (weight, _) = edge_weights(learnt, theta, inverse, links, mi.Float(FREEDOM))
    there = prior.valid(links)[0].numpy()
    assert weight.numpy()[there] == pytest.approx((FREEDOM + 3) / (FREEDOM + 6 * 3 * 0.1), rel=1e-4)
    (weight, _) = edge_weights(learnt, theta, inverse, links, mi.Float(1e6))
    assert weight.numpy()[there] == pytest.approx(1, rel=1e-4)  # nothing is an edge
