"""Surface normals and absolute spectral reflectance from an event camera and a ring of LEDs."""

from pathlib import Path

__version__ = "0.1.0"

# In a checkout `integrators/` and `scenes/` lie beside the package; a wheel carries them inside it.
_checkout = Path(__file__).resolve().parent.parent
if (_checkout / "pyproject.toml").is_file():
    __path__.append(str(_checkout))
