"""The joint system of all pixels against dense matrices put together by plain NumPy."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import owned
from evsdr.solve import grid as g
from evsdr.solve import triangles
from evsdr.solve.neighbours.priors import Form, Learnt, integrable, smooth_normals, smooth_reflectance
from evsdr.solve.neighbours.spectra import Spectra
from evsdr.solve.neighbours.student import FREEDOM
from evsdr.solve.neighbours.system import (
    JointSystem,
    _step,
    add_spectra,
    draw,
    make_system,
    right_side,
    solve,
)
from tests.support.stencil_matrix import MASK, matrix_of

N_BAND = 3
N = 2 + N_BAND


def arrays(values):
    return [owned(mi.Float, v) for v in values]


@pytest.fixture
def system(rng):
    """A linear system of 9 pixels, as arrays and as a dense matrix put together by plain NumPy."""
    n_pixel, links = MASK.sum(), g.make_grid(MASK, mi.UInt32).links
    theta = arrays(rng.normal(0, 0.7, (N, n_pixel)))
    root = rng.normal(size=(n_pixel, N, N))
    data = root @ np.swapaxes(root, 1, 2) + np.eye(N)
    rows, columns = np.tril_indices(N)
    scatter = {"normal": np.array([[0.3, 0.1], [0.1, 0.2]]), "integrable": np.array([[0.5]])}
    scatter["reflectance"] = np.cov(rng.normal(size=(N_BAND, 9)))
    weights = {}
    for part, stencils in (
        ("normal", (g.SECOND_X, g.SECOND_Y)),
        ("reflectance", (g.SECOND_X, g.SECOND_Y)),
        ("integrable", (g.SQUARE_MEAN,)),
    ):
        valid = [s.valid(links).numpy() for s in stencils]
        weights[part] = arrays([np.where(v, rng.uniform(0.5, 2, n_pixel), 0) for v in valid])
    dense = np.zeros((n_pixel, N, n_pixel, N))
    own = np.arange(n_pixel)
    dense[own, :, own, :] = data
    p, q = (t.numpy().astype(float) for t in theta[:2])
    length = np.sqrt(1 + p**2 + q**2)
    turn = np.array(
        [
            [p**2 / length**3 - 1 / length, p * q / length**3],
            [p * q / length**3, q**2 / length**3 - 1 / length],
        ]
    )
    for part in ("normal", "reflectance"):
        precision, first = np.linalg.inv(scatter[part]), 0 if part == "normal" else 2
        for stencil, weight in zip((g.SECOND_X, g.SECOND_Y), weights[part]):
            s = matrix_of(stencil)
            between = np.einsum("zx,z,zy->xy", s, weight.numpy(), s)
            block = np.einsum("xy,ij->xiyj", between, precision)
            if part == "normal":
                block = np.einsum("kix,xkyl,ljy->xiyj", turn, block, turn)
            last = first + len(precision)
            dense[:, first:last, :, first:last] += block
    steep = matrix_of(g.SQUARE_MEAN) @ (1 / length**2)
    around = np.stack([matrix_of(g.AROUND_P), matrix_of(g.AROUND_Q)], axis=-1) * steep[:, None, None]
    dense[:, :2, :, :2] += np.einsum(
        "zxi,z,zyj->xiyj", around, weights["integrable"][0].numpy() / 0.5, around
    )
    priors = {prior.name: prior for prior in (smooth_normals(), integrable(), smooth_reflectance(N_BAND))}
    forms = []
    for name, prior in priors.items():
        flat = [prior.factor(theta, links)] * len(weights[name])
        squared = [w * f * f for w, f in zip(weights[name], flat)]
        dr.eval(squared)
        learnt = Learnt.of(prior, scatter[name], mi.Float)
        forms.append(Form(learnt, squared, prior.jacobian(theta)))
    nothing = dr.zeros(mi.Float, n_pixel)
    dr.make_opaque(nothing)
    matrix, lower, pivot, _ = make_system(forms, arrays(data[:, rows, columns].T), nothing, links)
    return JointSystem(matrix, forms, lower, pivot), links, dense.reshape(n_pixel * N, n_pixel * N)


def test_the_joint_system_is_that_of_dense_matrices(system, rng):
    """Conjugate gradients on stencils give what a dense solver gives."""
    made, links, dense = system
    right = rng.normal(size=(len(MASK[MASK]), N))
    x = solve(made, arrays(right.T), links, 0.01)
    expected = np.linalg.solve(dense, right.ravel()).reshape(right.shape)
    np.testing.assert_allclose(
        np.array([v.numpy() for v in x]).T, expected, atol=0.02 * np.abs(expected).max()
    )


def test_a_step_of_conjugate_gradients_multiplies_once(system, rng, monkeypatch):
    """What is summed over the pixels has been evaluated with all else; a sum would evaluate it for itself."""
    joint, links, _ = system
    x, r, p = (arrays(rng.normal(size=(N, np.count_nonzero(MASK)))) for _ in range(3))
    total, summed = dr.sum, []

    def sum_of(values, *axis):
        if dr.width(values) > 1:
            summed.append(values.state)
        return total(values, *axis)

    monkeypatch.setattr(dr, "sum", sum_of)
    with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False):
        _step(joint, links, x, r, p, mi.Float(1.0))
    assert summed == [dr.VarState.Evaluated] * 2


def test_draws_scatter_as_the_inverse_of_the_matrix(system):
    made, links, dense = system
    rng, draws = np.random.default_rng(0), []
    for _ in range(600):
        x = solve(made, draw(rng, made, links), links, 0.01)
        draws.append(np.array([v.numpy() for v in x]).T.ravel())
    ratio = np.mean(np.square(draws), axis=0) / np.diagonal(np.linalg.inv(dense))
    assert ratio.mean() == pytest.approx(1, abs=0.03)
    assert ratio.min() > 0.75 and ratio.max() < 1.3


def test_the_right_side_holds_the_pull_of_the_priors(rng):
    """Its derivative along any change is minus that of the priors' cost, with the weights held."""
    links, prior = g.make_grid(MASK, mi.UInt32).links, smooth_reflectance(N_BAND)
    theta = rng.normal(0, 0.7, (N, MASK.sum()))
    spread = np.cov(rng.normal(size=(N_BAND, 9)))
    weights = [np.where(s.valid(links).numpy(), 1.5, 0) for s in (g.SECOND_X, g.SECOND_Y)]
    form = Form(Learnt.of(prior, spread, mi.Float), arrays(weights), None)

    def cost(theta):
        z = [matrix_of(s) @ theta[2:].T for s in (g.SECOND_X, g.SECOND_Y)]
        inverse = np.linalg.inv(spread)
        return sum(0.5 * np.sum(w * np.einsum("xi,ij,xj->x", v, inverse, v)) for w, v in zip(weights, z))

    gradient = arrays(np.zeros((N, MASK.sum())))
    found = np.array([v.numpy() for v in right_side([form], arrays(theta), gradient, links)])
    for _ in range(5):
        change = rng.normal(size=theta.shape)
        numeric = (cost(theta + 1e-4 * change) - cost(theta - 1e-4 * change)) / 2e-4
        assert np.sum(-found * change) == pytest.approx(numeric, rel=1e-3)


def test_spectra_tell_the_colour_and_not_the_scale(rng):
    """What they add is the cost of the nearest multiple of a spectrum: a change of scale costs nothing."""
    n_pixel, root = 4, rng.normal(size=(N_BAND, N_BAND))
    spectra = Spectra(rng.uniform(0.2, 0.6, N_BAND), root @ root.T + np.eye(N_BAND), 1, 0.3)
    theta = rng.normal(-1, 0.3, (N, n_pixel))
    nothing = [arrays(np.zeros((k, n_pixel))) for k in (N, N * (N + 1) // 2)]
    exact = arrays(np.zeros((N * (N + 1) // 2, n_pixel)))
    gradient, matrix = add_spectra(spectra.arrays(mi.Float), arrays(theta), *nothing, exact)
    gradient = np.array([v.numpy() for v in gradient])
    np.testing.assert_allclose(gradient[2:].sum(axis=0), 0, atol=1e-4)
    assert not gradient[:2].any()

    def cost(log_r):
        r = np.exp(log_r)
        k = r @ spectra.precision @ spectra.mean / (r @ spectra.precision @ r)
        off = k * r - spectra.mean
        return off @ spectra.precision @ off

    for i in range(n_pixel):
        weight = 0.3 * (FREEDOM + N_BAND) / (FREEDOM + cost(theta[2:, i]))
        for j in range(N_BAND):
            step = 1e-4 * np.eye(N_BAND)[j]
            numeric = (cost(theta[2:, i] + step) - cost(theta[2:, i] - step)) / 2e-4
            assert gradient[2 + j, i] == pytest.approx(0.5 * weight * numeric, rel=1e-2, abs=1e-3)


@pytest.fixture
def spoilt(system):
    """The system and its links, in which one pixel's own matrix is as if nothing were known, but for an error below 0."""
    made, links, _ = system
    entry = triangles.place(2, 2)
    values = made.matrix[entry].numpy()
    values[4] = -1e3
    matrix = [owned(mi.Float, values) if i == entry else m for i, m in enumerate(made.matrix)]
    return replace(made, matrix=matrix), links


def test_a_matrix_that_rounding_spoilt_gives_a_finite_step(spoilt):
    made, links = spoilt
    for value in solve(made, arrays(np.ones((N, MASK.sum()))), links, 0.01):
        assert np.isfinite(value.numpy()).all()


def test_a_matrix_that_rounding_spoilt_leaves_draws_finite(spoilt):
    """One pixel without a root made all draws NaN, and so no pixel of a recording known."""
    made, links = spoilt
    for value in draw(np.random.default_rng(0), made, links):
        assert np.isfinite(value.numpy()).all()
