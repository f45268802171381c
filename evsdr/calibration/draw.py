"""Residual pictures of calibrations."""

from pathlib import Path

import numpy as np

INK, NOMINAL, FOUND = "0.25", "0.6", "tab:blue"


def _figure(width: float, height: float):
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _save(figure, path: Path) -> None:
    figure.savefig(path, dpi=120)


def _map(figure, axis, image: np.ndarray, title: str, label: str, cmap: str, low: float, high: float) -> None:
    shown = axis.imshow(image, cmap=cmap, vmin=low, vmax=high)
    axis.set_title(title)
    axis.axis("off")
    figure.colorbar(shown, ax=axis, label=label, shrink=0.8)


def _histogram(axis, residual: np.ndarray, noise: float, label: str) -> None:
    axis.hist(residual, bins=np.linspace(-5 * noise, 5 * noise, 80), color=FOUND)
    axis.set(title=f"standard deviation {noise:.3g}", xlabel=label, ylabel="number", yticks=[])


def pixel_mean(value: np.ndarray, pixel: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Average values over their pixels (H, W); not a number where there are none."""
    n = np.bincount(pixel, minlength=shape[0] * shape[1]).astype(float)
    total = np.bincount(pixel, value, shape[0] * shape[1])
    return np.divide(total, n, out=np.full(len(n), np.nan), where=n > 0).reshape(shape)


def draw_directions(
    path: Path,
    nominal: np.ndarray,
    found: np.ndarray,
    sigma_deg: np.ndarray,
    image: np.ndarray,
    residual,
    noise,
) -> None:
    """Draw LED directions on the sky above the ball, and the residuals of the events.

    Parameters
    ----------
    nominal, found : (n_led, 3) float
        Unit vectors, camera frame.
    image : (H, W) float
        Residuals of a matt ball, or events on a mirror ball.
    residual : (n_pair,) float or None
        None for a mirror ball.
    """
    figure = _figure(13.5 if residual is not None else 9.5, 4.2)
    axes = figure.subplots(1, 3 if residual is not None else 2)
    for v, colour, marker, label in ((nominal, NOMINAL, "o", "scene file"), (found, FOUND, "+", "found")):
        axes[0].plot(v[:, 0], v[:, 1], marker, color=colour, label=label, markersize=8)
    for j, v in enumerate(found):
        axes[0].annotate(f"{j}", v[:2], textcoords="offset points", xytext=(4, 4), fontsize=7, color=INK)
    axes[0].set(
        title=f"LEDs from above, sigma {np.median(sigma_deg):.2g} deg",
        xlim=(-1, 1),
        ylim=(-1, 1),
        aspect="equal",
    )
    axes[0].set(xlabel="x, right", ylabel="y, up", xticks=[-1, -0.5, 0, 0.5, 1])
    axes[0].legend(loc="center")
    if residual is None:
        _map(figure, axes[1], image, "events on the ball", "number", "magma", 0, max(np.nanmax(image), 1))
    else:
        _map(figure, axes[1], image, "mean residual", "thresholds", "RdBu", -3 * noise, 3 * noise)
        _histogram(axes[2], residual, noise, "residual of a pair [thresholds]")
    _save(figure, path)


def draw_powers(
    path: Path, nominal, power, sigma, patch: np.ndarray, residual: np.ndarray, noise: float
) -> None:
    """Draw powers with their sigma, and the residuals of each tilt; `patch` (n_pair,) numbers it."""
    figure = _figure(11, 4)
    left, right = figure.subplots(1, 2)
    _powers(left, nominal, power, sigma)
    groups = [residual[patch == k] for k in range(patch.max() + 1)]
    right.boxplot(groups, whis=(5, 95), showfliers=False, tick_labels=[str(k) for k in range(len(groups))])
    right.axhline(0, color=INK, linewidth=0.8)
    right.set(title=f"residuals, noise {noise:.3g}", xlabel="tilt", ylabel="residual of a pair [thresholds]")
    _save(figure, path)


def _powers(axis, nominal: np.ndarray, power: np.ndarray, sigma: np.ndarray) -> None:
    axis.bar(range(len(power)), power, yerr=3 * sigma, color=FOUND, label="found, 3 sigma")
    axis.plot(range(len(nominal)), nominal, "o", color=NOMINAL, label="scene file")
    axis.set(title="powers of the LEDs", xlabel="LED")
    axis.legend(loc="lower right")


def draw_found(path: Path, nominal, power, sigma, turn_deg, turn_sigma_deg) -> None:
    """Draw powers and turns of the LEDs (n_led,) as a fit found them."""
    figure = _figure(11, 4)
    left, right = figure.subplots(1, 2)
    _powers(left, nominal, power, sigma)
    right.bar(range(len(turn_deg)), turn_deg, yerr=3 * turn_sigma_deg, color=FOUND)
    right.set(title="directions of the LEDs", xlabel="LED", ylabel="turned from the scene file [deg]")
    _save(figure, path)


def draw_thresholds(path: Path, polarities: dict) -> None:
    """Draw thresholds and their sigma as maps; `polarities` maps a name to its Thresholds."""
    figure = _figure(9.5, 7)
    for row, (name, found) in zip(figure.subplots(2, 2), polarities.items()):
        low, high = np.percentile(found.value, [1, 99])
        _map(
            figure,
            row[0],
            found.value,
            f"C_{name}",
            "change of log intensity",
            "viridis",
            low,
            max(high, low + 1e-6),
        )
        share = found.sigma / found.value
        _map(
            figure,
            row[1],
            share,
            f"sigma of C_{name}",
            "relative",
            "magma",
            0,
            float(np.percentile(share, 99)),
        )
    _save(figure, path)


def draw_reference(path: Path, spectra, table, band_spectrum: np.ndarray, wavelength_nm: np.ndarray) -> None:
    """Draw measured spectra, what the bands make of them, and the bands."""
    figure = _figure(9, 5)
    axis = figure.subplots()
    for band in band_spectrum:
        axis.fill_between(wavelength_nm, 0.25 * band / band.max(), color="0.9")
    for k, name in enumerate(table.name):
        (line,) = axis.plot(spectra.wavelength_nm, spectra.value[spectra.name.index(name)], linewidth=0.9)
        axis.errorbar(
            table.band_nm, table.value[k], 3 * table.sigma[k], fmt="o", markersize=4, color=line.get_color()
        )
        axis.annotate(
            name,
            (table.band_nm[-1], table.value[k, -1]),
            fontsize=7,
            textcoords="offset points",
            xytext=(6, 0),
        )
    low, high = wavelength_nm[np.flatnonzero(band_spectrum.max(axis=0) > 1e-3 * band_spectrum.max())[[0, -1]]]
    axis.set(xlim=(low - 10, high + 60), ylim=(0, None), xlabel="wavelength [nm]", ylabel="reflectance")
    axis.set_title("spectra, their projection on the bands, and the bands (grey)")
    _save(figure, path)


def draw_scale(path: Path, scale, reference) -> None:
    """Draw each evaluated patch, found and reference, band by band."""
    n = len(reference.name)
    columns = min(n, 4)
    figure = _figure(3 * columns, 2.2 * -(-n // columns))
    at = np.arange(len(reference.band_nm))
    axes = figure.subplots(-(-n // columns), columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axis in axes[n:]:
        axis.axis("off")
    for k, axis in zip(range(n), axes):
        axis.bar(at - 0.2, reference.value[k], 0.4, color=NOMINAL, label="reference")
        axis.bar(
            at + 0.2, scale.measured.value[k], 0.4, yerr=scale.measured.sigma[k], color=FOUND, label="found"
        )
        axis.set_title(
            f"{reference.name[k]}\nRMSE {scale.rmse[k]:.3f}, {scale.sam_deg[k]:.1f} deg", fontsize=8
        )
        axis.set_xticks(at, [f"{nm:.0f}" for nm in reference.band_nm], rotation=90, fontsize=7)
    axes[0].legend(fontsize=7)
    _save(figure, path)


def draw_pose(path: Path, image: np.ndarray, pose, point_pixel: np.ndarray, point_seen: np.ndarray) -> None:
    """Draw the true normals with the mask's outline, the mesh's contour and the points."""
    figure = _figure(11, 5)
    left, right = figure.subplots(1, 2)
    left.imshow(image, extent=(0, image.shape[1], image.shape[0], 0))
    if len(pose.outline):
        left.plot(*pose.outline.T, ".", color="white", markersize=2, label="mask")
        left.plot(*pose.contour.T, ".", color="black", markersize=1, label="mesh")
    if len(point_pixel):
        left.plot(*point_pixel.T, "o", color="white", markerfacecolor="none", label="points")
        left.plot(*point_seen.T, "x", color="black", label="points of the mesh")
    left.set_title("normals of the posed mesh")
    left.legend(loc="upper right", fontsize=7)
    residual = pose.outline_residual if len(pose.outline) else pose.point_residual
    right.hist(residual, bins=40, color=FOUND)
    name = "mask to contour" if len(pose.outline) else "points"
    right.set(
        title=f"rms {np.sqrt(np.mean(residual**2)):.2f} pixels", xlabel=f"{name} [pixels]", ylabel="number"
    )
    _save(figure, path)
