"""Contract tests for policies and devices: inherit a class and return your part from ``make``.

::

    from markerseek.contract import PolicyContract

    class TestMyPolicy(PolicyContract):
        def make(self, limits):
            return MyPolicy(limits=limits)

pytest then runs every test. A test fails by `AssertionError`; pytest itself is not needed to run one. `check_stage`,
`check_laser` and `check_receiver` try a device that is open by those rules that need no light and no move.
"""

from markerseek.contract.devices import (
    LaserContract,
    ReceiverContract,
    RuleCheck,
    StageContract,
    check_laser,
    check_receiver,
    check_stage,
)
from markerseek.contract.policies import PolicyContract

__all__ = [
    "LaserContract",
    "PolicyContract",
    "ReceiverContract",
    "RuleCheck",
    "StageContract",
    "check_laser",
    "check_receiver",
    "check_stage",
]
