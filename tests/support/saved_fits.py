"""Files of a fit, without one."""

from dataclasses import asdict

import numpy as np

from evsdr.files.results import write_results
from evsdr.shape.traced import surface_files


def save(folder, fit, unit="cm"):
    """Write the files of a `PageFit` as `Fit.save` does; gives the folder."""
    camera = asdict(fit.depth.camera) | {"to_world": np.eye(4)}
    summary = fit.summary | {"unit": unit, "camera": camera}
    write_results(folder, fit.maps, summary, surface_files(fit.depth, fit.maps, np.eye(4)))
    return folder
