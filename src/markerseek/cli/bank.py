"""``markerseek bank``: scan, describe, import and export banks (scans of many angles)."""

from __future__ import annotations

import typer

from markerseek.cli import bank_export, bank_import, bank_info, bank_scan, bank_verify

app = typer.Typer(
    name="bank",
    help="Make, look at and convert banks: scans of many angles.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
_COMMANDS = {
    "scan": bank_scan,
    "info": bank_info,
    "verify": bank_verify,
    "import": bank_import,
    "export": bank_export,
}
for name, module in _COMMANDS.items():
    app.command(name=name, epilog=module.EXAMPLES)(module.command)
