"""Builds these pages as a site: make docs. They can be read on GitHub as they are, too."""

project = "landerd"
author = "the authors of landerd"
extensions = ["myst_parser"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = "landerd"
html_extra_path = ["report.html"]
exclude_patterns = ["_build"]
