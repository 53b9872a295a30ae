"""Settings of Sphinx; `docs/make_site.py` runs it on the staged pages."""

import itertools
from importlib.metadata import version as installed_version

project = "medialis"
author = "The medialis developers"
copyright = "The medialis developers"
version = release = installed_version("medialis")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "index"
source_suffix = {".md": "markdown"}
exclude_patterns = ["files", "extra", "**/README.md"]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
highlight_language = "text"

# Backticks in docstrings are code; what a module is called stays out of the way.
default_role = "code"
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
# Types in docstrings are prose: Sphinx takes the count of "(count, 3)" for one of two attributes.
suppress_warnings = ["ref.python"]
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "furo"
html_title = "medialis"
html_static_path = ["static"]
html_extra_path = ["extra"]  # pages in three dimensions, as they are
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False


def _keep_bars(app, what, name, thing, options, lines):
    """Write |x| in docstrings as it stands: to Sphinx it would be a substitution."""
    for row, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = line.split("`")
            lines[row] = "`".join(
                p if i % 2 else p.replace("|", r"\|") for i, p in enumerate(parts)
            )


def _part_groups(app, what, name, thing, options, lines):
    """Give each of several attributes with one description a line of its own, before napoleon."""
    begin = lines.index("Attributes") if "Attributes" in lines else len(lines)
    for row in range(len(lines) - 1, begin, -1):
        names, colon, kind = lines[row].partition(" : ")
        if colon and ", " in names and not lines[row].startswith(" "):
            about = list(itertools.takewhile(_is_about, lines[row + 1 :]))
            lines[row : row + 1 + len(about)] = [
                line for one in names.split(", ") for line in (f"{one} : {kind}", *about)
            ]


def _is_about(line):
    return line.startswith(" ")


def setup(app):
    """Register the hooks."""
    app.connect("autodoc-process-docstring", _part_groups, priority=400)
    app.connect("autodoc-process-docstring", _keep_bars)
