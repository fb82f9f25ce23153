"""The energy of a pulse in the fields of a PLUS server's images."""

from __future__ import annotations

import pytest

from markerseek.core import AcquisitionError
from markerseek.drivers import (
    LaserBoxSettings,
    PlusReceiver,
    PlusSettings,
    SystemClock,
    connect_plus,
    metered,
)
from tests.emulated_lines import permit
from tests.unit.drivers.openigtlink_server import ImpoliteServer

DEVICE = "RfVideo_Reference"


@pytest.mark.real_time
@pytest.mark.parametrize("highest", [2, 1])
def test_the_energy_in_the_fields_of_images_comes_with_version_2(highest: int) -> None:
    keys = LaserBoxSettings(port="", energy_from="metadata", energy_field="PulseEnergy", usual_energy=2.0)
    settings = PlusSettings(device=DEVICE, quiet_s=0.05, timeout_s=2.0)
    with ImpoliteServer(highest=highest, streams=False) as server:
        connection = connect_plus("127.0.0.1", server.port, within_s=5.0)
        plain = PlusReceiver(connection=connection, clock=SystemClock(), settings=settings, dark_triggers=3)
        # Nothing of this laser is used.
        receiver = metered(keys, None, plain, full_scale=2047)  # type: ignore[arg-type]
        receiver.arm(permit(pulses=3))
        for number in range(3):
            server.send_image(DEVICE, 1e-3 * number, PulseEnergy="2.5")
        if highest == 2:
            assert receiver.acquire(permit(pulses=3)).header.energy == 1.25
        else:
            with pytest.raises(AcquisitionError, match=r"header version 1, which has no fields; version 2 was asked"):
                receiver.acquire(permit(pulses=3))
        plain.close()
