"""The shell in which commands run; in the long run, the check of types and shapes of the pure packages."""

from __future__ import annotations

import dataclasses
import functools
import gc
import importlib.util
import inspect
import os
import signal
import sys
import typing
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import jaxtyping
import pytest

from tests.notes import notes_collected, notes_refused
from tests.sizes import LONG, examples

PURE = ("core", "search", "signals", "acoustics", "calibration", "geometry", "vision")

# A program started with signals ignored (by nohup, or in the background) would hand that on to those that tests strike.
for each in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
    if signal.getsignal(each) is signal.SIG_IGN:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)

# No test is timed: a busy machine is no fault.
hypothesis.settings.register_profile("untimed", deadline=None, max_examples=examples(100))
hypothesis.settings.load_profile("untimed")


def pytest_collection_finish() -> None:
    """Collect garbage as rarely as a command does: what was imported is none, and a sixth of all time goes into it."""
    gc.freeze()
    gc.set_threshold(50_000)


def _pure_modules() -> list[str]:
    """Modules of the pure packages but for compiled kernels, which Numba must see undecorated.

    They are listed from their files, for the hook does not reach a module that is imported already.
    """
    (root,) = importlib.util.find_spec("markerseek").submodule_search_locations
    return [
        ".".join(file.relative_to(Path(root).parent).with_suffix("").parts)
        for package in PURE
        for file in sorted((Path(root) / package).rglob("*.py"))
        if file.stem != "__init__" and "@compiled" not in file.read_text(encoding="utf-8")
    ]


def _has_shape(hint: object) -> bool:
    """Whether an annotation names the shape of an array."""
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return any(map(_has_shape, typing.get_args(hint)))


def _in_context(function: Callable[..., object], checked: Callable[..., object]) -> Callable[..., object]:
    """The checked function, in which axes of one name must be of one length in all arguments and the result."""

    @functools.wraps(function)
    def call(*arguments: object, **named: object) -> object:
        if jaxtyping.config.jaxtyping_disable:
            return function(*arguments, **named)
        with _BINDINGS:
            return checked(*arguments, **named)

    return call


def _checked(decorated: object = None, *, typechecker: Callable[..., object]) -> object:
    """What `jaxtyping.jaxtyped` checks; that binds each call to its signature and checks its arguments twice."""
    if decorated is None:
        return functools.partial(_checked, typechecker=typechecker)
    if dataclasses.is_dataclass(decorated):
        decorated.__init__ = _checked(decorated.__init__, typechecker=typechecker)
        return decorated
    if inspect.isfunction(decorated):
        try:
            hints = typing.get_type_hints(decorated)
        except NameError:  # it names a class that is defined later
            return _jaxtyped(decorated, typechecker=typechecker)
        checked = typechecker(decorated)
        return _in_context(decorated, checked) if any(map(_has_shape, hints.values())) else checked
    return _jaxtyped(decorated, typechecker=typechecker)


_jaxtyped = jaxtyping.jaxtyped
# It holds nothing itself: each entry begins bindings of its own.
_BINDINGS = _jaxtyped("context")
if LONG:
    jaxtyping.jaxtyped = _checked
    # An int is a float, as for mypy (PEP 484).
    conf = "beartype.BeartypeConf(is_pep484_tower=True)"
    jaxtyping.install_import_hook(_pure_modules(), f"beartype.beartype(conf={conf})")


@pytest.fixture(autouse=True)
def _notes_refused() -> Iterator[None]:
    """What is logged as a warning fails a test that does not expect it (`tests.notes`)."""
    with notes_refused():
        yield


@pytest.fixture
def notes_allowed() -> Iterator[None]:
    """For tests to which it does not matter what is said."""
    with notes_collected():
        yield


@pytest.fixture
def unchecked_shapes() -> Iterator[None]:
    """For thousands of searches, of whose time the checks take a third; unit tests check the same functions."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs a command in this process; its exit code, standard output and standard error come back."""

    # Here, after the hook of the types.
    from markerseek import cli

    umask = os.umask(0)
    os.umask(umask)

    # Else messages name the command `python -m pytest.markerseek` where the tests are started so.
    monkeypatch.setattr(sys.modules["__main__"], "__package__", None)

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["markerseek", *map(str, words)])
        with pytest.raises(SystemExit) as ended, notes_collected():
            cli.main()
        # A command keeps what it writes for its owner; here that is the process of the tests.
        os.umask(umask)
        output = capsys.readouterr()
        assert "Traceback" not in output.err
        code = ended.value.code
        return (code if isinstance(code, int) else 0), output.out, output.err

    return run


@pytest.fixture(autouse=True)
def handlers_restored() -> Iterator[None]:
    """A command that was stopped ignores signals until its process ends; here that is the process of the tests."""
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for each, handler in before.items():
        if signal.getsignal(each) is not handler:
            signal.signal(each, handler)


@pytest.fixture(scope="module")
def no_child() -> Iterator[None]:
    """Files are read without being tried in a child before, which takes 0.4 s each; `faults` tests that."""
    with pytest.MonkeyPatch.context() as patched:
        for module in ("records.named_arrays", "records.banks.reading"):
            patched.setattr(f"markerseek.{module}.try_files", lambda *_: None)
        yield
