"""The rules of the parts as classes of tests: inherit one and name your part to prove it.

::

    from markerseek.testing import PolicyContract

    class TestMyPolicy(PolicyContract):
        def make(self, limits):
            return MyPolicy(limits=limits)

pytest then runs every rule. A test fails by `AssertionError`; pytest itself is not needed to run one.
"""

from markerseek.testing.devices import LaserContract, ReceiverContract, StageContract
from markerseek.testing.policies import PolicyContract

__all__ = ["LaserContract", "PolicyContract", "ReceiverContract", "StageContract"]
