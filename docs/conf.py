"""The documentation site: `make docs`."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from pathlib import Path
from types import FunctionType

import msgspec
from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import markerseek
from markerseek.core import options_of

# A module beside this file.
sys.path.insert(0, str(Path(__file__).parent))
from public_names import meaning_of

project = "markerseek"
author = "the markerseek authors"
version = release = markerseek.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
# Tables that programs have written.
exclude_patterns = ["_build", "data"]
# The theme is named here alone.
html_theme = "furo"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_title = f"markerseek {version}"
html_show_sourcelink = False
html_show_copyright = False
nitpicky = True
# `--seed` is no dash.
smartquotes = False

myst_heading_anchors = 4

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
# Shapes of arrays are names for people.
nitpick_ignore_regex = [("py:class", r".*_AnyArray|np\.ndarray|'[a-z ]+'")]


def _filled_in(_app: Sphinx, page: str, source: list[str]) -> None:
    """Put what the code says in the place of comments, which a forge does not show."""
    text = _with_readme(source[0]) if page == "index" else source[0]
    source[0] = re.sub(r"^<!-- details: (markerseek[a-z.]*) -->$", _details, text, flags=re.MULTILINE)


def _details(found: re.Match[str]) -> str:
    return f"```{{eval-rst}}\n{_names(found[1])}\n```"


def _with_readme(front: str) -> str:
    """The front page: the README, whose links begin at the folder above, in the place of what a forge shows."""
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    readme = re.sub(r"\]\((?![a-z]+:|#)", "](../", readme).replace("](../docs/", "](")
    # A page that stands beside the README is not on the site.
    readme = re.sub(r"\[(\w+)\]\(\.\./(\w+\.md)\)", r"\1 (`\2`)", readme)
    return readme + front.partition("<!-- readme -->")[2]


def _names(package: str) -> str:
    """What a package offers; each name has one page, the first that offers it."""
    front = import_module(package)
    lines = [f".. py:module:: {package}", ""]
    for name in front.__all__:
        if package != "markerseek" and name in markerseek.__all__:
            continue
        public = getattr(front, name)
        if isinstance(public, type):
            lines += [f".. autoclass:: {package}.{name}", "   :members:", "", *_options(public)]
        elif isinstance(public, FunctionType):
            lines += [f".. autofunction:: {package}.{name}", ""]
        else:
            lines += [f".. py:data:: {package}.{name}", "", f"   {meaning_of(package, name)}", ""]
    return "\n".join(lines)


def _options(kind: type) -> list[str]:
    """The fields of a class that are options, whose documentation stands in their annotations."""
    chosen = options_of(kind) if issubclass(kind, msgspec.Struct) else ()
    return [line for each in chosen for line in (f"   .. py:attribute:: {each.name}", "", f"      {each.help}", "")]


def _by_public_name(
    app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, shown: nodes.TextElement
) -> nodes.Node | None:
    """Resolve a name to where its package's front documents it, which is not where it is defined."""
    python = env.domains.python_domain
    last = node.get("reftarget", "").rpartition(".")[2]
    for name, entry in python.objects.items():
        if name.rpartition(".")[2] == last and not entry.aliased:
            return python.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, shown)
    return None


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _filled_in)
    app.connect("missing-reference", _by_public_name)
