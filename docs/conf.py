"""Sphinx configuration: `python -m sphinx -W --keep-going -b html docs docs/_build/html`.

No request leaves the page when it is viewed: fonts are the system's, formulas are MathML in the
page itself.
"""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

project = "recal"
author = "the recal project"
copyright = "2026, the recal project"
extensions = ["myst_parser", "mathml", "generated_pages", "site_links"]
default_role = "literal"
highlight_language = "none"
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "_ext"]
root_doc = "index"

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
smartquotes_action = "qe"  # no dashes: --commit is to be copied as it stands
suppress_warnings = ["myst.header"]  # pages made by a study may begin at a lower level

html_theme = "furo"
html_title = "recal"
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b5394", "color-brand-content": "#0b5394"},
    "dark_css_variables": {"color-brand-primary": "#7ab8f5", "color-brand-content": "#7ab8f5"},
}
html_static_path = ["_static"]
html_css_files = ["recal.css"]
