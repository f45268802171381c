"""What `evsdr.calibrate` prints: rows of names and figures, of what calibration.json holds."""

import numpy as np


def rows_of(name: str, result: dict) -> list[tuple[str, str]]:
    """Give the rows of a calibration by its name."""
    return {
        "directions": _directions,
        "powers": _powers,
        "thresholds": _thresholds,
        "reference": _reference,
        "scale": _scale,
        "pose": _pose,
        "from-fit": _from_fit,
    }[name](result)


def _column(entries: list[dict], name: str) -> np.ndarray:
    return np.array([entry[name] for entry in entries])


def _directions(result: dict) -> list[tuple[str, str]]:
    leds = result["leds"]
    sigma = _column(leds, "sigma_deg")
    rows = [
        ("LEDs", f"{len(leds)}"),
        ("sigma, median [deg]", f"{np.median(sigma):.3f}"),
        ("sigma, largest [deg]", f"{sigma.max():.3f}"),
        ("moved from the scene file, median [deg]", f"{np.median(_column(leds, 'change_deg')):.3f}"),
    ]
    if "position_sigma" in leds[0]:
        rows.append(("sigma of positions, median", f"{np.median(_column(leds, 'position_sigma')):.4f}"))
    return rows


def _powers(result: dict) -> list[tuple[str, str]]:
    light, power = result["constant_light"], _column(result["leds"], "power")
    share, relative = light["sigma"] / light["value"], _column(result["leds"], "sigma") / power
    return [
        ("C_w", f"{light['value']:.5g} +- {light['sigma']:.2g} ({share:.2%})"),
        ("sigma of the powers, median", f"{np.median(relative):.2%}"),
        ("powers, least and most", f"{power.min():.4g}, {power.max():.4g}"),
        ("tilts moved by at most [deg]", f"{_column(result['tilts'], 'change_deg').max():.3f}"),
    ]


def _thresholds(result: dict) -> list[tuple[str, str]]:
    rows = []
    for name in ("on", "off"):
        one = result[f"contrast_threshold_{name}"]
        rows += [
            (f"C_{name}, median", f"{one['median']:.4f}"),
            (f"C_{name}, spread between pixels", f"{one['spread_between_pixels']:.4f}"),
            (f"C_{name}, sigma of a pixel", f"{one['relative_sigma_of_a_pixel_median']:.2%}"),
            (f"C_{name}, pixels known", f"{one['pixels_known']:,} of {one['pixels']:,}"),
        ]
    return rows


def _reference(result: dict) -> list[tuple[str, str]]:
    patches = result["patches"]
    return [
        ("table", f"{len(patches)} patches x {len(result['band_nm'])} bands"),
        ("sigma, largest", f"{_column(patches, 'sigma').max():.2g}"),
    ]


def _scale(result: dict) -> list[tuple[str, str]]:
    scale, patches = result["scale"], result["patches"]
    rows = [("scale", f"{scale['value']:.4f} +- {scale['sigma']:.2g}")]
    rows += [
        (f"{one['name']}: RMSE, spectral angle [deg]", f"{one['rmse']:.4f}, {one['sam_deg']:.2f}")
        for one in patches
    ]
    rows.append((f"mean of {len(patches)} patches", f"{result['rmse']:.4f}, {result['sam_deg']:.2f}"))
    if "constant_light" in result:
        light = result["constant_light"]
        rows.append(("C_w", f"{light['value']:.5g} +- {light['sigma']:.2g}"))
    return rows


def _pose(result: dict) -> list[tuple[str, str]]:
    rows = [
        ("sigma of the rotation [deg]", f"{np.linalg.norm(result['rotation_sigma_deg']):.3f}"),
        ("sigma of the place [scene units]", f"{np.linalg.norm(result['translation_sigma']):.2g}"),
    ]
    for name in ("points", "outline"):
        if f"{name}_rms_pixels" in result:
            rows.append((f"{name}, rms [pixels]", f"{result[f'{name}_rms_pixels']:.3f}"))
    if "mean_angle_to_maps_deg" in result:
        rows.append(("mean angle to the fitted normals [deg]", f"{result['mean_angle_to_maps_deg']:.3f}"))
    return rows


def _from_fit(result: dict) -> list[tuple[str, str]]:
    leds = result["leds"]
    change = _column(leds, "power") / _column(leds, "scene_file") - 1
    return [
        ("taken over", " and ".join(result["taken"])),
        ("powers, largest change", f"{change[np.argmax(np.abs(change))]:+.2%}"),
        ("directions, largest turn [deg]", f"{_column(leds, 'turned_deg').max():.3f}"),
    ]
