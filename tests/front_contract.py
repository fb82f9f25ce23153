"""Import contract: a package is imported through its front, its ``__init__``, and not file by file."""

from __future__ import annotations

import re

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output

_FROM = re.compile(r"from (markerseek[\w.]*) import")


class FrontContract(Contract):
    """No file imports from a file of another package below ``markerseek``.

    Names of `public_modules` are exempt: each is a protocol or a vendor of its own, and is used as a namespace.
    """

    type_name = "front"

    public_modules = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        passed = []
        for importer in sorted(graph.modules):
            for imported in sorted(graph.find_modules_directly_imported_by(importer)):
                for detail in graph.get_import_details(importer=importer, imported=imported):
                    named = _FROM.search(detail["line_contents"])
                    if named and self._passes_the_front(importer, named[1], graph):
                        passed.append(f"{importer}:{detail['line_number']}: {detail['line_contents']}")
        return ContractCheck(kept=not passed, metadata={"passed": passed})

    def _passes_the_front(self, importer: str, module: str, graph: ImportGraph) -> bool:
        """Whether a module is a file of another package than the importer's."""
        levels = module.split(".")
        is_file = module in graph.modules and not graph.find_children(module)
        return is_file and len(levels) > 2 and importer.split(".")[1] != levels[1] and module not in self.public_modules

    def render_broken_contract(self, check: ContractCheck) -> None:
        for line in check.metadata["passed"]:
            output.print_error(line, bold=False)
        output.print("Export the name in the package's __init__, and import it from there.")
