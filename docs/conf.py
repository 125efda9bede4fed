"""Configuration of the documentation site: `make docs` builds it into build/site, offline."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS / "_ext"), str(DOCS.parent)]

import matplotlib  # noqa: E402

from rans.base.files import package_version  # noqa: E402

matplotlib.use("agg")

project = "RANS"
author = "The RANS developers"
copyright = "the RANS developers, BSD-3-Clause"
release = package_version("rans")
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    # in docs/_ext
    "repository_links",
    "mathml",
    "captions",
    "tables_of_names",
    "reference",
    "live_pages",
    "search_words",
    "self_contained",
]
root_doc = "index"
exclude_patterns = [
    "tutorials",  # sources of `learn`
    "_ext",
    "_extra",
    "validation",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
default_role = "py:obj"  # `name` in a docstring is a link where the name is documented
nitpicky = False
smartquotes_action = "qe"  # quotes and ellipses: dashes of options such as --full stay two
highlight_language = "text"
suppress_warnings = ["config.cache"]

# Markdown
myst_enable_extensions = ["colon_fence", "dollarmath", "attrs_inline", "deflist"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
myst_linkify_fuzzy_links = False

# Docstrings
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_custom_sections = [("Returns", "params_style")]
add_module_names = False

# Tutorials: scripts that are run, with their notebooks
sphinx_gallery_conf = {
    "examples_dirs": ["tutorials"],
    "gallery_dirs": ["learn"],
    "filename_pattern": r"/\d_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
    "show_memory": False,
    "write_computation_times": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "default_thumb_file": str(DOCS / "_static" / "mark.svg"),
    "nested_sections": False,
}
warnings.filterwarnings("ignore", message=".*FigureCanvasAgg is non-interactive.*")

# Pages
html_theme = "pydata_sphinx_theme"
templates_path = ["_templates"]
html_title = "RANS"
html_static_path = ["_static"]
html_extra_path = ["_extra"]  # written by docs/_ext/live_pages.py
(DOCS / "_extra").mkdir(exist_ok=True)
html_css_files = ["rans.css"]
html_logo = "_static/mark.svg"
html_favicon = "_static/mark.svg"
html_copy_source = False
html_show_sourcelink = False
html_last_updated_fmt = None
html_context = {"default_mode": "auto"}  # without it the theme writes an error into the console
html_theme_options = {
    "logo": {"text": "RANS", "alt_text": "RANS"},
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button-field"],
    "secondary_sidebar_items": ["page-toc", "sg_download_links"],
    "footer_start": ["copyright", "cite"],
    "footer_end": [],
    "show_prev_next": True,
    "show_toc_level": 2,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars = {
    "index": [],
    "install": [],
}
