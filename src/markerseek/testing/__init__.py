"""Contract tests for policies and devices: inherit a class and return your part from ``make``.

::

    from markerseek.testing import PolicyContract

    class TestMyPolicy(PolicyContract):
        def make(self, limits):
            return MyPolicy(limits=limits)

pytest then runs every test. A test fails by `AssertionError`; pytest itself is not needed to run one.
"""

from markerseek.testing.devices import LaserContract, ReceiverContract, StageContract
from markerseek.testing.policies import PolicyContract

__all__ = ["LaserContract", "PolicyContract", "ReceiverContract", "StageContract"]
