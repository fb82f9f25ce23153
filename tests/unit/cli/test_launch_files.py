"""The launch files of ROS 2 start commands that there are, with options that these have."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from markerseek.cli.app import all_commands

FILES = sorted((Path(__file__).parents[3] / "examples" / "ros2").glob("*.launch.xml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_each_command_is_one_of_ours_and_each_variable_is_declared(path: Path) -> None:
    root = ET.parse(path).getroot()
    declared = {each.get("name") for each in root.findall("arg")}
    commands = root.findall("executable")
    assert commands
    for executable in commands:
        used = {name for value in executable.attrib.values() for name in re.findall(r"\$\(var (\w+)\)", value)}
        assert used <= declared
        words = shlex.split(executable.attrib["cmd"].replace("$(var options)", ""))
        assert words[:2] == ["markerseek", "ros2"]
        command = all_commands().commands["ros2"].commands[words[2]]
        known = {name for each in command.params for name in each.opts}
        assert {word for word in words if word.startswith("--")} <= known
        # Nothing is armed from a launch file, and nothing is declared there in somebody's name.
        assert not {"--arm", "--still-valid"} & set(words)
        # A question needs a terminal.
        assert (
            "--simulate" in words or "$(var rig)" not in executable.attrib["cmd"]
        ) or "launch-prefix" in executable.attrib


def test_there_is_a_file_for_a_search_and_one_for_following() -> None:
    assert [path.name for path in FILES] == ["follow.launch.xml", "search.launch.xml"]
