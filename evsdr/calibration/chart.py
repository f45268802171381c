"""Reference reflectance from spectra, and the absolute scale from one patch of a chart.

EventSpecPS, supplement: "one patch is reserved for reflectance-scale calibration, and the remaining 12
patches are used for quantitative evaluation"; the spectra are projected on the LED bands into a table of 12
x 8.
"""

import csv
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.metrics import angular_error_deg
from evsdr.model.quadrature import WAVELENGTH_NM, integrate

BUILT_IN = {"babel": "BabelColor Average", "ohta": "ColorChecker N Ohta"}
OUTSIDE = (0.001, 0.05)  # share of a band beyond the measured wavelengths: a warning, an error
SMOOTH = 5  # samples of the parabola that tells noise from spectrum
LARGEST = 1.5  # reflectance that a table may hold
INNER = 0.6  # of a patch's width and height that counts


@dataclass(frozen=True)
class PatchSpectra:
    """Measured spectra.

    Attributes
    ----------
    name : list of str, (n_patch)
    wavelength_nm : (n_wavelength,) float
        Growing [nm].
    value : (n_patch, n_wavelength) float
    """

    name: list[str]
    wavelength_nm: np.ndarray
    value: np.ndarray


@dataclass(frozen=True)
class PatchTable:
    """Reflectance of patches in the bands.

    Attributes
    ----------
    name : list of str, (n_patch)
    number : (n_patch,) int
        Places on the chart, 1 is the top left, row by row.
    band_nm : (n_band,) float
    value, sigma : (n_patch, n_band) float
    """

    name: list[str]
    number: np.ndarray
    band_nm: np.ndarray
    value: np.ndarray
    sigma: np.ndarray


def read_spectra(source: str) -> PatchSpectra:
    """Read a CSV of spectra, wavelength [nm] in the first column, or take a chart of colour-science.

    Parameters
    ----------
    source : str
        `babel` (average of 30 ColorCheckers), `ohta`, or a file. A line of names comes first.

    Raises
    ------
    InputError
        The file can't be used.
    """
    if source in BUILT_IN:
        chart = _colour().SDS_COLOURCHECKERS[BUILT_IN[source]]
        wavelength = next(iter(chart.values())).wavelengths
        return PatchSpectra(list(chart), wavelength, np.array([sd.values for sd in chart.values()]))
    header, rows = _read_csv(Path(source), 0)
    if len(header) < 2 or len(rows) < 4:
        raise InputError(f"{source}: write a column of wavelengths and one per spectrum, four lines or more.")
    if not any(word in header[0].lower() for word in ("wave", "nm", "lambda")):
        raise InputError(
            f"{source}: the first column is named {header[0]!r}, not wavelength_nm; put the wavelengths "
            "there."
        )
    wavelength = rows[:, 0]
    if (np.diff(wavelength) <= 0).any() or wavelength[0] < 100 or wavelength[-1] > 4000:
        raise InputError(f"{source}: wavelengths must grow line by line, in nm; sort or convert them.")
    return PatchSpectra(header[1:], wavelength, rows[:, 1:].T)


def _colour():
    with np.printoptions(), warnings.catch_warnings():  # the import sets both, and warns of absent extras
        warnings.simplefilter("ignore")
        import colour  # late: takes a second
    return colour


def _read_csv(path: Path, n_text: int) -> tuple[list[str], np.ndarray]:
    """Read names and numbers of a CSV; its first `n_text` columns are text, left out of the numbers."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            lines = [
                [cell.strip() for cell in row]
                for row in csv.reader(file)
                if row and not row[0].startswith("#")
            ]
        header, body = lines[0], lines[1:]
        rows = np.array([[float(cell) for cell in row[n_text:]] for row in body])
    except (OSError, UnicodeDecodeError, csv.Error, IndexError, ValueError) as error:
        raise InputError(
            f"{path}: not a readable table ({error}); write a CSV with a line of names, then numbers."
        ) from error
    if rows.ndim != 2 or rows.shape[1] != len(header) - n_text or not np.isfinite(rows).all():
        raise InputError(f"{path}: its lines differ in length or hold no finite numbers; fill every cell.")
    return header, rows


def over_white(spectra: PatchSpectra, white: str, white_reflectance: float) -> PatchSpectra:
    """Divide measured intensities by that of a white patch under the same light.

    Raises
    ------
    InputError
        There is no such column, or it is dark somewhere.
    """
    if white not in spectra.name:
        raise InputError(f"--white {white}: no column has that name; there are {', '.join(spectra.name)}.")
    w = spectra.name.index(white)
    reference = spectra.value[w]
    if reference.min() <= 0:
        raise InputError(
            f"--white {white}: its intensity is not above 0 everywhere; cut those wavelengths off."
        )
    kept = [k for k in range(len(spectra.name)) if k != w]
    value = white_reflectance * spectra.value[kept] / reference
    return PatchSpectra([spectra.name[k] for k in kept], spectra.wavelength_nm, value)


def project(spectra: PatchSpectra, band_spectrum: np.ndarray) -> PatchTable:
    """Project reflectance spectra on the bands, R_b = INT D E_b R / INT D E_b.

    Interpolated as CIE 167:2005 recommends, constant beyond the measured wavelengths. Sigma is the noise of
    neighbouring samples, carried through the integral.

    Parameters
    ----------
    spectra : PatchSpectra
        Reflectance.
    band_spectrum : (n_band, n_wavelength) float
        D E_b over `spectral.WAVELENGTH_NM`.

    Raises
    ------
    InputError
        A reflectance makes no sense, or a band lies outside of the measured wavelengths.

    Warns
    -----
    InputWarning
        A band lies partly outside of them.
    """
    if spectra.value.min() < -0.05 or spectra.value.max() > LARGEST:
        raise InputError(
            f"reflectances go from {spectra.value.min():g} to {spectra.value.max():g}; give shares of 1, "
            "or name "
            "the white patch by --white where the columns are intensities."
        )
    weight = band_spectrum / integrate(band_spectrum)[:, None]
    low, high = spectra.wavelength_nm[[0, -1]]
    outside = integrate(weight * ((WAVELENGTH_NM < low) | (WAVELENGTH_NM > high)))
    band_nm = integrate(weight * WAVELENGTH_NM)
    worst = int(outside.argmax())
    if outside[worst] > OUTSIDE[0]:
        said = (
            f"{outside[worst]:.1%} of the band at {band_nm[worst]:.0f} nm lies outside of the measured "
            f"{low:g} to {high:g} nm"
        )
        if outside[worst] > OUTSIDE[1]:
            raise InputError(f"{said}; measure the spectra further.")
        warnings.warn(InputWarning(f"{said}, where they are taken as constant."))
    colour = _colour()
    shape = colour.SpectralShape(WAVELENGTH_NM[0], WAVELENGTH_NM[-1], 0.5)
    fine = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # colour tells of steps that are not even
        for values in spectra.value:
            sd = colour.SpectralDistribution(values, spectra.wavelength_nm)
            fine.append(sd.align(shape).values)
    value = integrate(np.array(fine)[:, None] * weight)
    at = np.array([np.interp(spectra.wavelength_nm, WAVELENGTH_NM, w) for w in weight])
    at *= np.gradient(spectra.wavelength_nm)
    sigma = _sample_noise(spectra.value)[:, None] * np.linalg.norm(at, axis=1)
    return PatchTable(spectra.name, np.arange(1, len(value) + 1), band_nm, value, np.maximum(sigma, 1e-6))


def _sample_noise(value: np.ndarray) -> np.ndarray:
    """Estimate the noise of each spectrum from its third differences (n_patch,)."""
    if value.shape[1] < SMOOTH:
        return np.zeros(len(value))
    return 1.4826 * np.median(np.abs(np.diff(value, 3)), axis=1) / np.sqrt(20)  # 1 + 9 + 9 + 1


def choose(table: PatchTable, names: list[str]) -> PatchTable:
    """Keep the patches of some names, or numbers on the chart from 1, in that order.

    Raises
    ------
    InputError
        There is no such patch.
    """
    rows = []
    for name in names:
        row = [k for k, (n, i) in enumerate(zip(table.name, table.number)) if name in (n, str(i))]
        if not row:
            raise InputError(f"no patch is called {name}; there are {', '.join(table.name)}.")
        rows.append(row[0])
    part = [table.name[k] for k in rows]
    return PatchTable(part, table.number[rows], table.band_nm, table.value[rows], table.sigma[rows])


def write_patches(path: Path, table: PatchTable) -> None:
    """Write a CSV: number, name, one column per band [nm], one per sigma."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        bands = [f"{nm:.1f}" for nm in table.band_nm]
        writer.writerow(["name", "number", *bands, *(f"sigma_{nm}" for nm in bands)])
        for name, number, value, sigma in zip(table.name, table.number, table.value, table.sigma):
            writer.writerow([name, number, *(f"{v:.6f}" for v in value), *(f"{s:.2g}" for s in sigma)])


def read_patches(path: Path) -> PatchTable:
    """Read what `write_patches` wrote; columns of sigma may be missing.

    Raises
    ------
    InputError
        The file can't be used.
    """
    header, rows = _read_csv(path, 1)
    bands = [k for k, name in enumerate(header[2:]) if not name.startswith("sigma")]
    try:
        band_nm = np.array([float(header[2 + k]) for k in bands])
    except ValueError as error:
        raise InputError(
            f"{path}: columns after name and number must be bands in nm; name them so."
        ) from error
    if header[:2] != ["name", "number"] or not bands or not len(rows):
        raise InputError(f"{path}: write the columns name, number, and one per band named by its nm.")
    with open(path, newline="", encoding="utf-8-sig") as file:
        names = [row[0].strip() for row in csv.reader(file) if row and not row[0].startswith("#")][1:]
    value = rows[:, 1:][:, bands]
    sigma = rows[:, 1 + len(bands) :] if rows.shape[1] == 1 + 2 * len(bands) else np.zeros_like(value)
    return PatchTable(names, rows[:, 0].astype(int), band_nm, value, sigma)


def chart_labels(
    corner: np.ndarray, shape: tuple[int, int], n_row: int = 4, n_column: int = 6, gap: float = 0.0
) -> np.ndarray:
    """Number the pixels of a chart's patches.

    Parameters
    ----------
    corner : (4, 2) float
        Columns and rows [pixels] of the chart's corners: of the first patch, then clockwise.
    shape : (int, int)
        Height and width of the image.
    gap : float
        Border between two patches, and around all, in widths of a patch.

    Returns
    -------
    (height, width) int
        1 .. n_row * n_column in the inner part of the patches, 0 elsewhere.

    Raises
    ------
    InputError
        The corners are no quadrilateral.
    """
    target = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    rows, right = [], []
    for (x, y), (u, v) in zip(corner, target):  # homography with h_33 = 1
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        right += [u, v]
    edges = np.roll(corner, -1, axis=0) - corner
    after = np.roll(edges, -1, axis=0)
    turn = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    if not ((turn > 1e-6).all() or (turn < -1e-6).all()):
        raise InputError(
            f"--corners {corner.tolist()}: they are not the corners of a chart; go around it once."
        )
    h = np.append(np.linalg.solve(np.array(rows), np.array(right)), 1).reshape(3, 3)
    row, column = np.indices(shape)
    at = np.stack([column + 0.5, row + 0.5, np.ones(shape)], axis=-1) @ h.T
    u, v = at[..., 0] / at[..., 2], at[..., 1] / at[..., 2]
    label = np.zeros(shape, int)
    inside = (at[..., 2] > 0) & (u > 0) & (u < 1) & (v > 0) & (v < 1)
    place = []
    for share, n in ((u, n_column), (v, n_row)):
        cell = (share * (n * (1 + gap) + gap) - gap / 2) / (1 + gap)
        k = np.floor(cell)
        inside &= (np.abs(cell - k - 0.5) * (1 + gap) < 0.5 * INNER) & (k >= 0) & (k < n)
        place.append(k)
    label[inside] = (1 + place[1] * n_column + place[0])[inside]
    return label


@dataclass(frozen=True)
class ChartScale:
    """The absolute scale, and how far the other patches then are from their reference.

    Attributes
    ----------
    scale, sigma : float
        Factor on the reflectances.
    reserved : PatchTable
        Of the reserved patch, measured, before scaling.
    measured : PatchTable
        Of the other patches, scaled.
    rmse, sam_deg : (n_patch,) float
        Per patch.
    """

    scale: float
    sigma: float
    reserved: PatchTable
    measured: PatchTable
    rmse: np.ndarray
    sam_deg: np.ndarray


def patch_means(maps, label: np.ndarray, reference: PatchTable) -> PatchTable:
    """Average the fitted reflectance over the patches of a reference.

    Parameters
    ----------
    maps : records.Maps
    label : (height, width) int
        Number of the patch at each pixel, 0 for none.

    Raises
    ------
    InputError
        Bands differ, or a patch has no known pixel.
    """
    if len(reference.band_nm) != maps.reflectance.shape[-1] or (
        np.abs(reference.band_nm - maps.band_wavelength_nm).max() > 2
    ):
        raise InputError(
            f"the reference has bands at {np.round(reference.band_nm).tolist()} nm, the maps at "
            f"{np.round(maps.band_wavelength_nm.astype(float)).tolist()} nm; project it on the bands of "
            "this ring."
        )
    value, sigma = [], []
    for name, number in zip(reference.name, reference.number):
        here = (label == number) & maps.mask
        n = np.count_nonzero(here)
        if n < 4:
            raise InputError(
                f"patch {number} ({name}) has {n} known pixels; give the chart's corners or labels."
            )
        pixels = maps.reflectance[here].astype(float)
        value.append(np.mean(pixels, axis=0))
        sigma.append(np.std(pixels, axis=0, ddof=1) / np.sqrt(n))
    return PatchTable(reference.name, reference.number, reference.band_nm, np.array(value), np.array(sigma))


def find_scale(maps, label: np.ndarray, reserved: PatchTable, reference: PatchTable) -> ChartScale:
    """Find the one factor on all bands that brings a reserved patch to its reference; judge the others.

    Weighted least squares over the bands; sigma from the larger of stated and seen scatter.
    """
    seen = patch_means(maps, label, reserved)
    m, r = seen.value[0], reserved.value[0]
    variance = np.maximum(seen.sigma[0] ** 2 + reserved.sigma[0] ** 2, 1e-12)
    information = np.sum(m * m / variance)
    if not information > 0 or r.max() <= 0:
        raise InputError(f"the reserved patch {reserved.name[0]} is black; reserve a bright one.")
    scale = float(np.sum(m * r / variance) / information)
    chi2 = np.sum((scale * m - r) ** 2 / variance) / max(len(m) - 1, 1)
    sigma = float(np.sqrt(max(chi2, 1.0) / information))
    others = patch_means(maps, label, reference)
    value = scale * others.value
    spread = np.hypot(scale * others.sigma, sigma * others.value)
    return ChartScale(
        scale,
        sigma,
        seen,
        PatchTable(others.name, others.number, others.band_nm, value, spread),
        np.sqrt(np.mean((value - reference.value) ** 2, axis=1)),
        angular_error_deg(value, reference.value),
    )
