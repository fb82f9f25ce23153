"""Commands of OpenIGTLink clients, in the two forms in use, and their answers.

STRING ``CMD_7`` with ``<Command Name="StartSearch" />`` is answered by STRING ``ACK_7``, as PLUS does; COMMAND by
RTS_COMMAND with the same number.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

from markerseek.bridges.request import OPTIONS, SearchRequest
from markerseek.core import ConfigError
from markerseek.wire import igtl

# No XML parser: the text comes from the network, and needs neither entities of its own nor a document type.
_ATTRIBUTE = r"""\s+([A-Za-z]\w*)\s*=\s*("[^"<]*"|'[^'<]*')"""
_ELEMENT = re.compile(rf"\s*<Command(?P<attributes>(?:{_ATTRIBUTE})*)\s*(?:/>|>\s*</Command>)\s*", re.ASCII)
_PREFIX = "CMD_"


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A command: its name, its values by name, and the address of the client that sent it."""

    name: str
    values: Mapping[str, str]
    client: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswer:
    """Whether a command is carried out, and a sentence."""

    done: bool
    sentence: str


def is_command(message: igtl.Message) -> bool:
    """Return whether a message is a command in either form."""
    if isinstance(message.content, igtl.Text):
        return message.device.startswith(_PREFIX)
    return isinstance(message.content, igtl.Command) and not isinstance(message.content, igtl.Reply)


def read_request(message: igtl.Message, *, client: str) -> Request:
    """Return the command in a message of a client."""
    content = message.content
    named = content.name if isinstance(content, igtl.Command) else ""
    text = content.text if isinstance(content, igtl.Text | igtl.Command) else ""
    values: dict[str, str] = {}
    if text.strip() or not named:
        element = _ELEMENT.fullmatch(text)
        if element is None:
            raise ConfigError(f'the command {text[:80]!r} cannot be read; send <Command Name="StartSearch" />')
        for name, value in re.findall(_ATTRIBUTE, element["attributes"], re.ASCII):
            if name in values:
                raise ConfigError(f"the command has {name} twice; send it once")
            values[name] = html.unescape(value[1:-1])
    name = values.pop("Name", named)
    if named and name != named:
        raise ConfigError(f"the command is named {named!r} and {name!r}; send one name")
    if not name:
        raise ConfigError('the command has no name; send <Command Name="StartSearch" />')
    return Request(name=name, values=values, client=client)


def answer_message(asked: igtl.Message, answer: CommandAnswer, *, time_s: float) -> igtl.Message:
    """Return the answer to a command, in the command's own form and header version."""
    status = "SUCCESS" if answer.done else "FAIL"
    # The sentence may repeat what was sent, and the protocol limits the length.
    sentence = answer.sentence[:1000]
    text = f"<CommandReply Status={quoteattr(status)} Message={quoteattr(sentence)} />"
    metadata = {"Status": status, "Message" if answer.done else "Error": sentence}
    if isinstance(asked.content, igtl.Command):
        content: igtl.Content = igtl.Reply(number=asked.content.number, name=asked.content.name, text=text)
        device = asked.device
    else:
        content = igtl.Text(text=text)
        device = f"ACK_{asked.device.removeprefix(_PREFIX)}"
    return igtl.Message(device=device, content=content, time_s=time_s, metadata=metadata, version=asked.version)


def search_request(values: Mapping[str, str]) -> SearchRequest:
    """Return the search that is asked for."""
    asked: dict[str, Any] = {}
    for name, text in values.items():
        if name not in _NAMES:
            raise ConfigError(
                f"StartSearch has no {name}; it has {', '.join(_NAMES)}. A rig is named, and armed, where the "
                "bridge runs"
            )
        asked[_NAMES[name]] = OPTIONS[_NAMES[name]].read(text)
    return SearchRequest().changed(**asked)


_NAMES = {name.title().replace("_", ""): name for name in OPTIONS}
"""Names of the options by their names in a command: ``ToleranceMm``."""
