"""What the pages name exists: links, commands with their options, targets of make, keys of files."""

from __future__ import annotations

import re
import runpy
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

from markerseek import SearchPlan, find_marker, replayed
from markerseek.bridges.follow_feed import SENT_S
from markerseek.bridges.request import OPTIONS
from markerseek.cli.app import all_commands
from markerseek.registration.steps import Begun, RecordedStep
from markerseek.show import flat_result

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
SOURCES = [
    path
    for name in ("benchmarks", "changelog.d", "firmware", "references", "requirements", "tests")
    for path in sorted((ROOT / name).rglob("*.md"))
]
"""Pages beside the code that they describe."""
PAGES = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md")), *SOURCES]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as forges and the site make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.replace("`", "").lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    # The files of changelog.d are joined into the changelog above them.
    folder = ROOT if page.parent.name == "changelog.d" else page.parent
    # A text in brackets may be broken over two lines, an address may not.
    for address in re.findall(r"\]\(([^()\s]+)\)", prose(page)):
        if re.match(r"[a-z]+:", address):
            continue
        path, _, anchor = address.partition("#")
        target = (folder / path).resolve() if path else page
        assert target.exists(), address
        # The site has no other pages than those of docs, and the README in the place of its index.
        on_site = DOCS in target.parents or target.suffix != ".md" or page.name == "index.md"
        assert on_site or DOCS not in page.parents, f"{address}: name this file without a link"
        assert not anchor or anchor in anchors(target), address


def test_the_files_that_the_map_names_exist() -> None:
    text = (DOCS / "developers" / "map.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_0-9]+(?:/[a-z_0-9]+)+(?:\.py|\.toml|\.csv)?)`", text))
    assert len(named) > 40
    # Of itself, beside the code, or in the folder of the pages; `a/b.py` stands for any.
    pattern = re.compile(r"(^|/)a/(test_)?b\.py$")
    for name in sorted(each for each in named if not pattern.search(each)):
        assert any((place / name).exists() for place in (ROOT, ROOT / "src" / "markerseek")), name


def test_the_map_names_every_package() -> None:
    text = (DOCS / "developers" / "map.md").read_text(encoding="utf-8")
    source = ROOT / "src" / "markerseek"
    packages = [front.parent.relative_to(source).as_posix() for front in sorted(source.glob("*/**/__init__.py"))]
    assert len(packages) > 25
    assert [name for name in packages if not re.search(rf"`{name}[/`]|markerseek/{name}/", text)] == []


def inline_commands() -> Iterator[str]:
    """Commands within the text of the pages."""
    for page in PAGES:
        for code in re.findall(r"`(markerseek [^`]+)`", prose(page)):
            command = " ".join(code.replace("\\|", "|").split())
            if not re.search(r"[|…]|^markerseek [A-Z0-9]", command):
                yield command


@pytest.mark.parametrize("line", sorted(set(inline_commands())))
def test_a_command_in_the_text_is_understood(line: str) -> None:
    """The command exists, and so do its options; values that it would require may be missing in a sentence."""
    command: Any = all_commands()
    words = shlex.split(line)[1:]
    # Typer has a Click of its own, so that isinstance would not know a group.
    while hasattr(command, "commands") and words and not words[0].startswith("--"):
        name = words.pop(0)
        assert name in command.commands, f"{name} is no command"
        command = command.commands[name]
    options = {name for each in command.params for name in each.opts} | {"--help", "--version"}
    assert {word for word in words if word.startswith("--")} <= options


def all_options(command: Any) -> Iterator[str]:
    """Options of a command and of all below it."""
    for each in command.params:
        yield from each.opts
    for below in getattr(command, "commands", {}).values():
        yield from all_options(below)


OTHERS = {"--no-deps", "--network", "--group", "--ros-args", "--folder", "--first"}
"""Options of other programs that the text names: pip, podman, the campaign of faults, ROS 2, benchmarks."""


def test_an_option_in_the_text_is_one_of_some_command() -> None:
    known = {*all_options(all_commands()), "--help", "--version", *OTHERS}
    named = {(page.name, option) for page in PAGES for option in re.findall(r"`(--[a-z][a-z0-9-]*)[ `]", prose(page))}
    assert len(named) > 50
    assert [each for each in sorted(named) if each[1] not in known] == []


def test_the_targets_of_make_on_the_pages_exist() -> None:
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for page in PAGES:
        named = re.findall(r"(?:^|`)make ([a-z0-9-]+)", page.read_text(encoding="utf-8"), re.MULTILINE)
        assert set(named) <= targets, page.name


def test_the_tables_of_keys_have_the_keys_of_the_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS)
    import settings_tables

    made = {"bench": settings_tables.bench_rig(), "simulated": settings_tables.simulated_rig()}
    for path in sorted((ROOT / "examples" / "rigs").glob("*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        for key in keys(table):
            assert f"| `{key}` |" in made[table["kind"]] or key in ("kind", "driver"), f"{path.name}: {key}"
    assert "| `zero_deg` | number | **required** | ° | in [-360, 360] deg |" in made["bench"]
    assert "| `peak_snr_db` | number | `40` | dB | in [-20, 100] dB |" in made["simulated"]
    assert "| `trials` | whole number | `100` |  | between 1 and 1,000,000,000 |" in settings_tables.study()


def test_the_page_of_python_has_the_names_that_the_packages_offer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS)
    import public_names

    text = public_names.PAGE.read_text(encoding="utf-8")
    assert text.count("`") > 500
    assert text.endswith(public_names.markdown()), "python docs/public_names.py"


def test_what_a_page_takes_from_code_or_data_is_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS)
    import made

    texts = {page: page.read_text(encoding="utf-8") for page in made.pages()}
    marked = [page for page, text in texts.items() if made.MARKED.search(text) or made.SHOWN.search(text)]
    assert len(marked) > 8
    assert sum(len(made.SHOWN.findall(text)) for text in texts.values()) > 12
    for page in marked:
        text = page.read_text(encoding="utf-8")
        assert made.filled(text) == text, f"{page.name}: python docs/made.py"


def test_no_line_begins_with_the_comment_of_a_made_value() -> None:
    """Markdown takes such a line as HTML: it ends the paragraph, and links on it are shown as they are typed."""
    for page in PAGES:
        assert not re.search(r"^ *<!-- made: .*::.*-->", page.read_text(encoding="utf-8"), re.MULTILINE), page.name


@pytest.mark.parametrize("page", [ROOT / "README.md", DOCS / "gallery.md"], ids=lambda page: page.name)
def test_a_front_page_states_no_measured_number_of_its_own(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is measured there is printed by a command that is tested, or comes from a table."""
    monkeypatch.syspath_prepend(DOCS)
    import made

    text = made.MARKED.sub("", prose(page))
    assert set(re.findall(r"\d+\.\d+", text)) <= {"3.11"}


def test_a_page_hides_nothing_of_the_site_in_braces() -> None:
    """A forge shows directives of Sphinx as they are; what the site adds stands in comments."""
    for page in PAGES:
        directives = re.findall(r"^```\{(\w+)\}", page.read_text(encoding="utf-8"), re.MULTILINE)
        assert set(directives) <= ({"toctree"} if page.name == "index.md" else set()), page.name


def test_the_messages_that_the_questions_quote_are_those_of_the_program() -> None:
    text = (DOCS / "how-to" / "questions.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "src" / "markerseek").rglob("*.py"))]
    # Strings over several lines are one, and what stands in braces may be anything.
    said = re.sub(r"\{[^{}]*\}", "…", re.sub(r'"\s*\n\s*f?"', "", "\n".join(sources)))
    tables = re.findall(r"^\| what you see \|.*\n\|---\|---\|\n((?:\|.*\n)+)", text, re.MULTILINE)
    quoted = [row.split("|")[1].strip().replace("`", "") for table in tables for row in table.splitlines()]
    assert len(quoted) > 15
    for message in quoted:
        if message in ("nothing of this", "FAULT") or "exit code" in message:
            continue
        words = [part.split() for part in re.split(r"…|\d[\d.]*(?: ± \d+)?(?: m?s\b)?", message)]
        parts = [part for part in words if len(part) > 1]
        assert parts, message
        for part in parts:
            assert any(" ".join(some) in said for some in (part, part[-4:], part[:4])), f"{message}: {part}"


def test_the_page_of_the_journal_names_the_steps_of_a_session() -> None:
    text = (DOCS / "reference" / "journal-format.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"`type` is its kind: (.*?)\. Sessions", text, re.DOTALL)
    tags = [kind.__struct_config__.tag for kind in get_args(RecordedStep) if kind is not Begun]
    assert re.findall(r"`([a-z-]+)`", listed) == tags


def test_the_pages_say_how_often_the_transform_is_sent_while_the_probe_follows() -> None:
    assert int(1 / SENT_S) == 12
    pages = ("reference/commands.md", "how-to/watch-a-search-in-slicer.md", "how-to/use-it-with-ros-2.md")
    for page in pages:
        text = " ".join((DOCS / page).read_text(encoding="utf-8").split())
        assert "twelve times a second" in text, page


def test_the_page_of_slicer_names_the_options_of_a_command() -> None:
    text = (DOCS / "how-to" / "watch-a-search-in-slicer.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"for `--tolerance-mm`: (.*?)\. `StopSearch`", text, re.DOTALL)
    assert re.findall(r"`(\w+)`", listed) == [name.title().replace("_", "") for name in OPTIONS]


def test_the_page_of_results_names_the_keys_of_a_search() -> None:
    text = (DOCS / "reference" / "results.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"`(\w+)`", text.partition("## JSON of a search")[2].partition("## A result in Python")[0]))
    recorded = replayed(ROOT / "examples" / "simulated_scan.csv")
    assert set(flat_result(find_marker(recorded, SearchPlan(method="weighted-average")))) - listed == set()


PRINTED = re.compile(
    r"± ?\d|\d (deg|mm|px|frames|acquisitions|pulses|searches|angles)\b"
    r"|^(answer|registered|not registered|truth|tip found|picture:|recording:|written:|summary:|scan:|states) ?"
    r"|^ *(ok|broken) +\w|check-\d|https?://\d|SIMULATED|FOREIGN|[┏┃┗]|^posterior on",
    re.MULTILINE,
)
"""What lines that markerseek prints have, and lines that people type have not."""


def test_what_a_command_prints_stands_in_blocks_that_are_tested() -> None:
    """Blocks of console run in `test_examples`; a plain block shows what is typed, or the text of a file."""
    printed = 0
    for page in PAGES:
        if DOCS not in page.parents and page.name != "README.md":
            continue
        text = re.sub(r"<!-- made: .*?<!-- end -->", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for language, block in re.findall(r"^ *```(\w*)\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL):
            if language == "console":
                outputs = re.split(r"^\$ .*\n", block, flags=re.MULTILINE)[1:]
                shown = [each for each in outputs if len(each.strip()) > len("...")]
                printed += sum(bool(PRINTED.search(each)) for each in shown)
                continue
            if language in ("", "text"):
                typed = re.sub(r" +#.*$", "", block, flags=re.MULTILINE)
                assert not PRINTED.search(typed), f"{page.name}: this is printed, so test it as console:\n{block}"
                # After a prompt comes what is typed: then a line without one is printed.
                lines = typed.replace("\\\n", " ").splitlines()
                prompts = [line.startswith("$ ") for line in lines if line.strip()]
                assert all(prompts) or not any(prompts), (
                    f"{page.name}: this is printed, so test it as console:\n{block}"
                )
    # The pattern knows what is printed where it is tested.
    assert printed > 15


def keys(table: dict[str, Any]) -> Iterator[str]:
    """Keys of a table and of those in it that hold a value."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from keys(value)
        else:
            yield key


def test_the_map_has_a_line_for_each_package_of_the_import_contract() -> None:
    drawn = runpy.run_path(str(DOCS / "developers" / "draw_map.py"))
    assert sorted(drawn["SHORT"]) == sorted(package for layer in drawn["layers"]() for package in layer)
