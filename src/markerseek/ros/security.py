"""Whether this process takes part in ROS 2 with keys (SROS 2)."""

from __future__ import annotations

import os
from pathlib import Path

from markerseek.core import ConfigError


def require_keys(enclave: str) -> None:
    """Refuse to start unless ROS 2 enforces security, by the environment of this process, and has the keys of a node.

    ``enclave``: name of the keys of this node, such as ``/markerseek/stage``.
    """
    enabled = os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true"
    if not (enabled and os.environ.get("ROS_SECURITY_STRATEGY", "").lower() == "enforce"):
        raise ConfigError(
            "--require-security: ROS 2 would start without keys; set ROS_SECURITY_ENABLE=true, "
            "ROS_SECURITY_STRATEGY=Enforce and ROS_SECURITY_KEYSTORE"
        )
    keystore = os.environ.get("ROS_SECURITY_KEYSTORE")
    folder = None if keystore is None else Path(keystore) / "enclaves" / enclave.strip("/")
    missing = [
        name
        for name in ("cert.pem", "key.pem", "governance.p7s", "permissions.p7s")
        if folder is None or not (folder / name).is_file()
    ]
    if missing:
        raise ConfigError(
            f"--require-security: there are no keys for {enclave} in {folder}: {', '.join(missing)} missing; "
            "make them with: ros2 security create_enclave KEYSTORE ENCLAVE"
        )
