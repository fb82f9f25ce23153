"""The documentation site: `make docs`."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import FunctionType

import msgspec
import typer
from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.errors import PycodeError
from sphinx.pycode import ModuleAnalyzer
from typer.cli import get_docs_for_click

import markerseek
from markerseek.cli.app import app as commands
from markerseek.core import options_of

# A module beside this file.
sys.path.insert(0, str(Path(__file__).parent))
import settings_tables

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
    text = source[0]
    for name, made in MADE.get(page, {}).items():
        text = text.replace(f"<!-- table: {name} -->", made())
    source[0] = re.sub(r"^<!-- details: (markerseek[a-z.]*) -->$", _details, text, flags=re.MULTILINE)


def _details(found: re.Match[str]) -> str:
    return f"```{{eval-rst}}\n{_names(found[1])}\n```"


def _commands() -> str:
    """All commands with their options, in Markdown."""
    command = typer.main.get_command(commands)
    text = get_docs_for_click(obj=command, ctx=typer.Context(command, info_name="markerseek"), name="markerseek")
    return text.removeprefix("# `markerseek`")


MADE = {
    "reference/commands": {"commands": _commands},
    "reference/rig-file": {"bench rig": settings_tables.bench_rig, "simulated rig": settings_tables.simulated_rig},
    "reference/study-file": {"study": settings_tables.study},
}
"""What is put into pages in the place of which comments."""


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
            lines += [f".. py:data:: {package}.{name}", "", f"   {_meaning(package, name)}", ""]
    return "\n".join(lines)


def _options(kind: type) -> list[str]:
    """The fields of a class that are options, whose documentation stands in their annotations."""
    chosen = options_of(kind) if issubclass(kind, msgspec.Struct) else ()
    return [line for each in chosen for line in (f"   .. py:attribute:: {each.name}", "", f"      {each.help}", "")]


def _meaning(package: str, name: str) -> str:
    """The first sentence below a constant or an alias, wherever in the package it is defined."""
    for module in [each for each in sys.modules if each.startswith(package)]:
        with suppress(PycodeError):
            if ("", name) in (found := ModuleAnalyzer.for_module(module).find_attr_docs()):
                return " ".join(found["", name]).strip()
    return ""


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
