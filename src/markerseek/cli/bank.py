"""``markerseek bank``: scan, describe, import and export banks (scans of many angles)."""

from __future__ import annotations

import typer

from markerseek.cli import bank_export, bank_import, bank_info, bank_scan, bank_verify

NAME = "bank"

app = typer.Typer(
    name=NAME,
    help="Make, look at and convert banks: scans of many angles.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
for command in (bank_scan, bank_info, bank_verify, bank_import, bank_export):
    app.command(name=command.NAME, epilog=command.EXAMPLES)(command.command)
