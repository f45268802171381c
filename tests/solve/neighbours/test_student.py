import numpy as np
import pytest

from evsdr.solve.neighbours.spectra import learn_spectra, own_share
from evsdr.solve.neighbours.student import learn_scatter, update_scatter

N = 3000


@pytest.fixture
def noisy(rng):
    """Vectors of known covariance behind noise that differs from one to the next."""
    spread = np.array([[0.04, 0.03, 0.0], [0.03, 0.05, 0.0], [0.0, 0.0, 0.0004]])
    level = rng.uniform(0.05, 0.3, N)
    noise = level[:, None, None] ** 2 * np.eye(3)
    hidden = rng.multivariate_normal(np.zeros(3), spread, N)
    return hidden + level[:, None] * rng.normal(size=(N, 3)), noise, spread


def test_scatter_behind_noise_is_found(noisy):
    z, noise, spread = noisy
    mean, found = learn_scatter(z + [1, 2, 3], noise, 1e-6 * np.eye(3), about_zero=False)
    np.testing.assert_allclose(mean, [1, 2, 3], atol=0.02)
    ratio = np.trace(found[:2, :2]) / np.trace(spread[:2, :2])  # Student's t takes Gaussians for narrower
    assert 0.6 < ratio < 1.1
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(0.67, abs=0.08)
    assert found[2, 2] < 0.1 * np.median(noise[:, 2, 2])


def test_outliers_count_little(noisy, rng):
    z, noise, _ = noisy
    _, clean = learn_scatter(z, noise, 1e-6 * np.eye(3), about_zero=True)
    z[::20] = 10 * rng.normal(size=z[::20].shape)
    _, spoilt = learn_scatter(z, noise, 1e-6 * np.eye(3), about_zero=True)
    assert np.trace(spoilt) < 1.5 * np.trace(clean)


def test_the_floor_holds():
    floor = np.diag([0.01, 0.02])
    _, found = learn_scatter(np.zeros((50, 2)), np.tile(1e-4 * np.eye(2), (50, 1, 1)), floor, about_zero=True)
    assert np.linalg.eigvalsh(found - floor).min() > -1e-9
    updated = update_scatter(np.zeros((50, 2)), np.zeros((50, 2, 2)), found, floor)
    np.testing.assert_allclose(updated, floor, rtol=0.01)


def test_update_is_a_step_of_expectation_maximisation(rng):
    """With nothing left open it is the scatter of the values, which outliers hardly move."""
    z = rng.standard_t(3, size=(20_000, 1)) * 0.2
    spread = np.array([[1.0]])
    for _ in range(20):
        spread = update_scatter(z, np.zeros((len(z), 1, 1)), spread, np.array([[1e-9]]))
    assert np.sqrt(spread[0, 0]) == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("rank", [1, 3])
def test_the_rank_of_spectra_is_found(rank, rng):
    base = rng.uniform(0.2, 0.8, (rank, 8))
    weight = rng.uniform(0, 1, (N, rank)) / rank
    noise = np.tile(0.01**2 * np.eye(8), (N, 1, 1))
    spectra = learn_spectra(weight @ base + 0.01 * rng.normal(size=(N, 8)), noise, np.full((N, 8), np.nan))
    assert spectra.rank == rank
    off = base[0] / np.linalg.norm(base[0])
    inside, across = off, np.linalg.svd(base)[2][-1]
    assert across @ spectra.precision @ across > 20 * (inside @ spectra.precision @ inside)


def test_unknown_pixels_teach_nothing(rng):
    r = rng.uniform(0, 1, (N, 8))
    assert learn_spectra(r, np.tile(0.2**2 * np.eye(8), (N, 1, 1)), r) is None


def markov_field(correlation: float, n: int, rng) -> np.ndarray:
    """Draw colours (n, n, 8) whose neighbours are correlated along both axes, of variance 1."""
    field = rng.normal(size=(n, n, 8))
    for axis in (0, 1):
        field = np.moveaxis(field, axis, 0)
        for k in range(1, n):
            field[k] = correlation * field[k - 1] + np.sqrt(1 - correlation**2) * field[k]
        field = np.moveaxis(field, 0, axis)
    return field


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_a_pixel_is_as_much_of_a_draw_as_its_neighbours_do_not_tell(correlation, rng):
    """Beside what is left of a pixel's variance when a field of 9 x 9 around it is known, by brute force."""
    n = 9
    along = correlation ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    left = 1 / np.linalg.inv(np.kron(along, along))[n * n // 2, n * n // 2]
    r = 1 + 0.02 * markov_field(correlation, 100, rng)
    mean, precision = np.ones(8), np.eye(8) / 0.02**2
    share = own_share(r[:, :-1].reshape(-1, 8), r[:, 1:].reshape(-1, 8), mean, precision)
    assert share == pytest.approx(left, abs=0.08)  # robust weights see the correlation a little low


def test_spectra_of_patches_count_little(rng):
    """Each pixel of 16 colours in patches of 10 x 10 pixels; alone each would be a draw."""
    patch = 0.5 + 0.1 * rng.normal(size=(4, 4, 8))
    r = np.repeat(np.repeat(patch, 10, axis=0), 10, axis=1) + 0.01 * rng.normal(size=(40, 40, 8))
    beside = np.concatenate([r[:, 1:], np.full((40, 1, 8), np.nan)], axis=1)
    noise = np.tile(0.01**2 * np.eye(8), (1600, 1, 1))
    assert learn_spectra(r.reshape(-1, 8), noise, beside.reshape(-1, 8)).share < 0.05
    assert learn_spectra(r.reshape(-1, 8), noise, np.full((1600, 8), np.nan)).share == 1
