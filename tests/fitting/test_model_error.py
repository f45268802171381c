"""Sigmas of a fit beside its errors, where the model lacks something that neighbours share."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import evsdr
from evsdr.solve.unknowns import normal_sigma_deg

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def test_sigmas_count_light_that_neighbours_lack_alike():
    """Some LEDs are told a tenth weaker than they are, and powers are taken as told."""
    ring = evsdr.load_scene(SCENES / "sphere.xml", size=24)
    recording, truth = evsdr.simulate(ring, seed=0)
    trim = np.where(np.arange(24) % 5 == 0, 0.9, 1.0)
    told = replace(recording, schedule=replace(recording.schedule, trim=trim))
    fit = evsdr.fit(ring, told, evsdr.Settings(preset="fast", shared=(), shadows="off"))
    at, theta = fit.maps.mask, fit.solution.theta.astype(float)
    error = evsdr.angular_error_deg(fit.maps.normal, truth.normal)
    noise = np.zeros(at.shape)
    noise[at] = normal_sigma_deg(*theta[:, :2].T, fit.solution.covariance[:, :2, :2])[: np.count_nonzero(at)]
    held, without = ((error < 2 * sigma)[at].mean() for sigma in (fit.maps.normal_sigma_deg, noise))
    assert held > without + 0.2
    assert held > 0.75
    assert "what neighbouring pixels have in common" in fit.summary["misfit"]
