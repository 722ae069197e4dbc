"""How Sphinx builds the documentation site: ``make docs``.

The source of the site is the root of the repository, not this folder.  README, CONTRIBUTING, the change log, examples
and results of benchmarks are pages of it where they lie, and a link between two of them works on the site as it does
in the repository.
"""

from __future__ import annotations

import sys
from pathlib import Path

import grainmotion

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "grainmotion"
author = copyright = "the grainmotion developers"
release = version = grainmotion.__version__

root_doc = "docs/index"
include_patterns = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "SECURITY.md",
    "release/**.md",
    "docs/**.md",
    "examples/**.md",
    "examples/notebooks/*.ipynb",
    "validation/**.md",
]
exclude_patterns = [".*", "src", "tests", "docs/_*", "**/results/*/**", "**/.ipynb_checkpoints"]

extensions = [
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "myst_nb",
    "sphinx_copybutton",
    "sphinx_design",
    "settings_fields",
    "documented_constants",
    "literal_names",
    "folder_toctrees",
    "api_tables",
    "mathml",
]
templates_path = ["_templates"]

folder_toctrees = {
    "docs/decisions/README": "[0-9]*",
    "examples/savu/README": "data/README",
    "validation/benchmarks/README": "results/*",
}

# Pages
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "fieldlist", "smartquotes"]
myst_heading_anchors = 4  # as on the web pages of repositories: `#a-slice` for the heading "A slice"
myst_dmath_double_inline = True
suppress_warnings = ["myst.header"]  # pages that are made start at the level of the page that includes them
nitpicky = True
highlight_language = "none"  # a fence without a language is text or a file

# Notebooks are run once; later builds take their outputs from the cache unless their code changes
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "notebooks")
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True

# API
autosummary_generate = False  # pages of tasks hold the descriptions themselves
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "none"  # numpydoc's sections tell the types in words, with shapes and units
numpydoc_show_class_members = False  # the page of a class describes its methods themselves
default_role = "name"

toc_object_entries_show_parents = "hide"

# Look
html_theme = "furo"
html_title = f"grainmotion {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_search_scorer = str(HERE / "_static" / "search_scores.js")  # part of the search itself
html_additional_pages = {"index": "to_docs.html"}  # the root of the site leads to docs/index.html
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1b5e8c", "color-brand-content": "#1b5e8c"},
    "dark_css_variables": {"color-brand-primary": "#7cc4f0", "color-brand-content": "#7cc4f0"},
    "sidebar_hide_name": False,
}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
