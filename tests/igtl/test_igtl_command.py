"""The command ``markerseek igtl`` with clients on three programs: our codec, pyigtl, and Debian's C++ library."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, suppress
from pathlib import Path

import msgspec
import numpy as np
import pyigtl
import pytest

from markerseek.records.exports import probe_to_probe_home
from markerseek.registration import point_pairs, register_pairs
from markerseek.wire import igtl
from tests.emulated import emulation
from tests.igtl.igtl_bridge import bridge, compiled_peer
from tests.igtl.igtl_client import LONGEST_S, IgtlClient

EXAMPLES = Path(__file__).parents[2] / "examples"
START = '<Command Name="StartSearch" Seed="3" Method="golden-section" Acquisitions="6" />'


def state(message: igtl.Message) -> str:
    return json.loads(message.content.text)["state"] if message.device == "SearchState" else ""


def over(message: igtl.Message) -> bool:
    return state(message) == "ended"


def searched(*options: str) -> dict[str, object]:
    """Answer of the ordinary command."""
    command = [sys.executable, "-m", "markerseek", "search", "--json", "--no-journal", "--seed", "3", *options]
    return json.loads(subprocess.run(command, capture_output=True, check=False, text=True).stdout)


def test_a_command_starts_a_search_whose_answer_is_that_of_the_ordinary_command() -> None:
    expected = searched()
    with bridge() as running, IgtlClient(running.port) as client, IgtlClient(running.port) as watcher:
        client.send(igtl.Command(number=5, name="StartSearch", text='<Command Seed="3" />'), device="test")
        reply = client.until(lambda message: message.content.kind == "RTS_COMMAND")[-1]
        assert reply.metadata["Status"] == "SUCCESS"
        refused = client.ask(START)
        assert 'Status="FAIL" Message="a search is running; stop it, or wait for its end"' in refused
        # The last message of a search is its state.
        messages = watcher.until(over)
        last = json.loads(messages[-1].content.text)
        assert running.stop() == 130
    assert last["result"]["angle_deg"] == expected["angle_deg"]
    assert last["acquisitions"] == expected["acquisitions"]
    turned = [each for each in messages if each.device == "ProbeToProbeHome"]
    assert turned[-1].content.matrix == pytest.approx(
        probe_to_probe_home(expected["confirmation"]["angle_deg"]), abs=1e-6
    )
    points = next(each for each in reversed(messages) if each.device == "PaMarker").content.points
    assert [point.group for point in points] == ["simulated"]
    assert points[0].position_mm == pytest.approx([1e3 * each for each in expected["marker_trus_m"]], rel=1e-6)
    position = next(each for each in reversed(messages) if each.device == "PaMarkerToProbeHome").content
    assert position.position_mm == pytest.approx(points[0].position_mm)
    # The brightest pixel of the last image is the marker, put into place by its matrix.
    image = [each for each in messages if each.device == "PA_ProbeHome"][-1].content
    _, row, column = np.unravel_index(image.pixels.argmax(), image.pixels.shape)
    assert (image.matrix @ (column, row, 0, 1))[:3] == pytest.approx(points[0].position_mm, abs=0.5)
    assert all(each.metadata["rig"] == "simulated" for each in messages if each.device == "PA_ProbeHome")
    # Each image belongs to the transform of its time.
    times = [(each.device, each.time_s) for each in messages if each.device in ("ProbeToProbeHome", "PA_ProbeHome")]
    images = [index for index, (device, _) in enumerate(times) if device == "PA_ProbeHome"]
    assert len(images) > 2
    assert all(times[index - 1] == ("ProbeToProbeHome", times[index][1]) for index in images)
    assert len({times[index][1] for index in images}) == len(images)


def test_nobody_keeps_the_marker_of_the_search_before() -> None:
    with bridge() as running, IgtlClient(running.port) as client:
        other = pyigtl.OpenIGTLinkClient("127.0.0.1", running.port)
        client.ask('<Command Name="StartSearch" Seed="3" />')
        first = client.until(over)
        assert [each.content for each in first if each.device == "PaMarker"][-1].points[0].name == "PaMarker"
        again = igtl.Text(text='<Command Name="StartSearch" Seed="3" Acquisitions="2" />')
        client.send(again, device="CMD_2")
        second = client.until(over)
        assert [each.content.points for each in second if each.device == "PaMarker"] == [()]
        assert [each.content.position_mm for each in second if each.device == "PaMarkerToProbeHome"] == [None]
        answer = json.loads(second[-1].content.text)["result"]["answer"]
        assert answer == "unsure"
        assert [each.content.name for each in second if each.device == "PaSearch"][-1] == "UNSURE"
        while '"answer":"unsure"' not in other.wait_for_message("SearchState", timeout=60).string:
            pass
        assert other.wait_for_message("PaMarker", timeout=60).positions == []
        with IgtlClient(running.port) as late:
            assert late.until(lambda each: each.device == "PaMarker")[-1].content.points == ()
        other.stop()


def test_a_search_is_stopped_by_a_command() -> None:
    with bridge("--pace", "0.5") as running, IgtlClient(running.port) as client:
        assert 'Status="FAIL" Message="no search is running"' in client.ask('<Command Name="StopSearch" />')
        client.ask(START, name="2")
        client.until(lambda message: message.device == "PA_ProbeHome")
        assert "SUCCESS" in client.ask('<Command Name="StopSearch" />', name="3")
        last = client.until(over)
        # SIGTERM follows where a busy computer leaves SIGINT unanswered for two seconds.
        assert json.loads(last[-1].content.text)["exit_code"] in (130, 143)
        status = [each.content for each in last if each.device == "PaSearch"][-1]
        assert (status.code, status.name) == (igtl.OK, "STOPPED")


def test_a_stop_is_heard_from_one_client_more_than_are_served() -> None:
    with bridge("--pace", "0.5") as running, ExitStack() as ends:
        starter = ends.enter_context(IgtlClient(running.port))
        starter.ask(START, name="2")
        for each in range(30):
            # Some send the beginning of a header.
            idle = ends.enter_context(socket.create_connection(("127.0.0.1", running.port), timeout=LONGEST_S))
            with suppress(OSError):
                idle.sendall(bytes(each % 3))
        with IgtlClient(running.port) as client:
            assert "SUCCESS" in client.ask('<Command Name="StopSearch" />', name="3")
        last = starter.until(over)
        assert json.loads(last[-1].content.text)["exit_code"] in (130, 143)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ("--host", "0"),
            "--host 0 is 0.0.0.0, which other computers reach, and OpenIGTLink has no passwords; name each",
        ),
        (("--host", "0", "--allow", "192.0.2.0/24"), "--allow '192.0.2.0/24' is no address of a computer"),
        (("--host", "nobody.invalid"), "nobody.invalid, port 18945: Name or service not known; name another"),
    ],
)
def test_a_bridge_for_other_computers_names_those_that_may(options: tuple[str, ...], said: str) -> None:
    command = [sys.executable, "-m", "markerseek", "igtl", *options]
    ended = subprocess.run(command, capture_output=True, check=False, text=True, timeout=60)
    assert ended.returncode == 2
    assert said in " ".join(ended.stderr.split())


@pytest.mark.long
def test_a_bridge_that_is_killed_in_mid_search_takes_the_search_with_it(tmp_path: Path) -> None:
    with bridge("--pace", "0.5") as running, IgtlClient(running.port) as client:
        client.ask(START)
        client.until(lambda message: message.device == "PA_ProbeHome")
        children = Path(f"/proc/{running.process.pid}/task/{running.process.pid}/children").read_text().split()
        watched = os.pidfd_open(int(children[0]))
        assert running.stop(signal.SIGKILL) == -signal.SIGKILL
    ready, _, _ = select.select([watched], [], [], 30)
    os.close(watched)
    assert ready


def test_a_bench_that_nobody_arms_is_not_armed_by_a_message(tmp_path: Path) -> None:
    with (
        emulation(tmp_path) as devices,
        bridge("--rig", str(devices.rig)) as running,
        IgtlClient(running.port) as client,
    ):
        assert "has no Arm" in client.ask('<Command Name="StartSearch" Arm="true" />')
        assert "there is no command 'Arm'" in client.ask('<Command Name="Arm" />', name="2")
        client.ask('<Command Name="StartSearch" />', name="3")
        messages = client.until(over)
    last = json.loads(messages[-1].content.text)
    assert last["exit_code"] == 4
    assert last["message"].startswith("not armed: nothing moved and nothing was fired")
    assert [each.content.name for each in messages if each.device == "PaSearch"][-1] == "NOT_ARMED"


def test_a_taken_port_ends_with_exit_code_2_and_a_sentence() -> None:
    with bridge() as running:
        command = [sys.executable, "-m", "markerseek", "igtl", "--port", str(running.port)]
        second = subprocess.run(command, capture_output=True, check=False, text=True, timeout=60)
    assert second.returncode == 2
    assert f"port {running.port} of 127.0.0.1 is taken by another program" in " ".join(second.stderr.split())


def test_the_client_of_pyigtl_gets_what_is_sent(tmp_path: Path) -> None:
    registered = register_pairs(point_pairs(EXAMPLES / "points.csv"))
    (tmp_path / "registration.json").write_bytes(msgspec.json.encode(registered))
    with bridge("--registration", str(tmp_path / "registration.json")) as running, IgtlClient(running.port) as asking:
        client = pyigtl.OpenIGTLinkClient("127.0.0.1", running.port)
        status = client.wait_for_message("SearchState", timeout=30)
        said = json.loads(status.string)
        assert (said["state"], said["registration"]["simulated"]) == ("idle", False)
        camera = client.wait_for_message("DaVinciToProbeHome", timeout=30)
        asking.ask(START)
        image = client.wait_for_message("PA_ProbeHome", timeout=60)
        turned = client.wait_for_message("ProbeToProbeHome", timeout=60)
        client.stop()
    assert image.image.dtype == np.uint8
    assert image.metadata["rig"] == "simulated"
    moved_mm = 1e3 * np.array(registered.davinci_to_trus)[:3, 3]
    assert camera.matrix[:3, 3] == pytest.approx(moved_mm, rel=1e-6)
    assert camera.metadata["registration"] == "measured"
    # The image's plane holds the axis of rotation, and turns with the probe.
    assert turned.matrix.shape == (4, 4)
    assert np.linalg.det(turned.matrix) == pytest.approx(1)


def test_a_client_on_the_library_of_debian_gets_every_type_and_starts_a_search(tmp_path: Path) -> None:
    program = compiled_peer(tmp_path)
    expected = searched()
    lines: list[str] = []
    later: list[str] = []
    with bridge("--header-version", "1") as running, IgtlClient(running.port) as witness:
        with subprocess.Popen(
            [program, str(running.port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as peer:
            # Whatever is not sent must not be waited for until the tests are ended.
            patience = threading.Timer(120.0, peer.kill)
            patience.start()
            peer.stdin.write('CMD_1 <Command Name="StartSearch" Seed="3" />\n')
            peer.stdin.flush()
            for line in peer.stdout:
                lines.append(line.strip())
                if line.startswith("STRING SearchState") and '"ended"' in line:
                    break
            peer.stdin.write('CMD_2 <Command Name="StartSearch" Seed="3" Acquisitions="2" />\n')
            peer.stdin.flush()
            for line in peer.stdout:
                later.append(line.strip())
                if line.startswith("STRING SearchState") and '"ended"' in line:
                    break
            peer.kill()
            patience.cancel()
        messages = witness.until(over)
    assert "STRING ACK_1" in " ".join(lines)
    assert {line.split()[0] for line in lines} == {"TRANSFORM", "IMAGE", "POINT", "POSITION", "STRING", "STATUS"}
    state = json.loads(lines[-1].removeprefix("STRING SearchState "))
    assert state["result"]["angle_deg"] == expected["angle_deg"]

    def last(start: str) -> list[str]:
        return next(line for line in reversed(lines) if line.startswith(start)).split()[2:]

    marker_mm = [1e3 * each for each in expected["marker_trus_m"]]
    name, group, *place = last("POINT PaMarker")
    assert (name, group) == ("PaMarker", "simulated")
    assert [float(each) for each in place] == pytest.approx(marker_mm, rel=1e-5)
    assert [float(each) for each in last("POSITION")] == pytest.approx([*marker_mm, 0, 0, 0, 1], rel=1e-5)
    turned = np.array([float(each) for each in last("TRANSFORM ProbeToProbeHome")]).reshape(3, 4)
    angle_deg = expected["confirmation"]["angle_deg"]
    assert turned == pytest.approx(probe_to_probe_home(angle_deg)[:3], abs=1e-5)
    # The library shows the size, the type, the sum of all pixels, the spacing, and where the middle of the image is.
    image = next(each for each in reversed(messages) if each.device == "PA_ProbeHome").content
    columns, rows, slices, scalar, total, *numbers = last("IMAGE PA_ProbeHome")
    assert (int(slices), int(rows), int(columns)) == image.pixels.shape
    assert (int(scalar), int(total)) == (3, int(image.pixels.sum()))
    spacing = np.linalg.norm(image.matrix[:3, :3], axis=0)
    assert [float(each) for each in numbers[:3]] == pytest.approx(spacing, rel=1e-4)
    middle = image.matrix @ ((int(columns) - 1) / 2, (int(rows) - 1) / 2, 0, 1)
    shown = np.array([float(each) for each in numbers[3:]]).reshape(3, 4)
    assert shown[:, :3] == pytest.approx(image.matrix[:3, :3] / spacing, abs=1e-4)
    assert shown[:, 3] == pytest.approx(middle[:3], abs=1e-3)
    assert last("STATUS PaSearch")[:2] == ["1", "FOUND"]
    # The second search ends unsure: nobody may take the marker of the first for its own.
    assert [line for line in later if line.startswith("POINT")] == ["POINT PaMarker none Unselected nan nan nan"]
    assert [line.split()[2:5] for line in later if line.startswith("POSITION")] == [["nan", "nan", "nan"]]
    assert [line.split()[3] for line in later if line.startswith("STATUS")][-1] == "UNSURE"
