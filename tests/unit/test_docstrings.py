"""Docstrings name the parameters that there are."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "markerseek"
SECTION = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.MULTILINE | re.DOTALL)


def documented(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    """Names under "Parameters" of a docstring."""
    section = SECTION.search(ast.get_docstring(node) or "")
    lines = section.group(1).splitlines() if section else []
    return {name.strip().lstrip("*") for line in lines if line[:1].strip() for name in line.split(",")}


def parameters(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    """Names that a function, or a class when it is made, takes."""
    if isinstance(node, ast.FunctionDef):
        return {each.arg for each in ast.walk(node.args) if isinstance(each, ast.arg)}
    fields = {
        each.target.id for each in node.body if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
    }
    made = (each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__init__")
    return fields.union(*(parameters(each) for each in made))


def misnamed(text: str) -> Iterator[str]:
    """Each parameter that a docstring names and the code does not have."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield from (f"{node.name}: {name}" for name in sorted(documented(node) - parameters(node)))


@pytest.mark.parametrize(
    "package", sorted(path.name for path in SOURCE.iterdir() if path.is_dir() and any(path.glob("*.py")))
)
def test_documented_parameters_exist(package):
    """In every file of a package."""
    found = {str(path): list(misnamed(path.read_text())) for path in (SOURCE / package).rglob("*.py")}
    assert {path: names for path, names in found.items() if names} == {}
