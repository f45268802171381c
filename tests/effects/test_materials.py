import numpy as np

from evsdr.effects.materials import sort_materials


def test_materials_are_as_many_as_spectra(rng):
    spectra = rng.uniform(0.1, 0.8, (4, 8))
    for n in (1, 2, 3, 4):
        kind = rng.choice(n, 2000, p=np.arange(n, 0, -1) / sum(range(n + 1)))  # of different sizes
        noisy = spectra[kind] * rng.uniform(0.3, 1, (2000, 1)) * np.exp(0.03 * rng.normal(size=(2000, 8)))
        label = sort_materials(noisy)
        assert label.max() + 1 == n
        assert all(np.ptp(label[kind == k]) == 0 for k in range(n))
