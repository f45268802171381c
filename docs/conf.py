"""How Sphinx builds the documentation: `make docs`."""

import sys
import warnings
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

from pictures.conventions import draw

from evsdr import __version__

project, author, copyright = "evsdr", "the evsdr authors", "2026, the evsdr authors"
release = version = __version__
warnings.formatwarning = lambda message, *_: f"warning: {message}\n"  # in scripts, as the commands have it
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "beside",
    "mathml",
]
exclude_patterns = ["gallery"]
default_role = "code"

myst_enable_extensions = ["dollarmath", "attrs_block"]
myst_heading_anchors = 3
numpydoc_show_class_members = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "none"  # numpydoc's sections tell them, with shapes

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "made/gallery",
    "capture_repr": (),
    "filename_pattern": "/plot_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "min_reported_time": 1,
}

html_theme = "furo"
html_title = "evsdr"
html_static_path = ["static"]
html_css_files = ["evsdr.css"]
html_theme_options = {"footer_icons": [], "top_of_page_buttons": []}
html_copy_source = False
html_show_sphinx = False


def setup(app):
    """Draw what pages show."""
    app.connect("builder-inited", lambda _: draw(HERE / "made"))
