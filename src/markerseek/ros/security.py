"""Whether this process takes part in ROS 2 with keys (SROS 2)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from markerseek.core import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Security:
    """Whether this process takes part in ROS 2 with keys (SROS 2), from its environment.

    Attributes
    ----------
    enforced
        Whether a node without keys is refused.
    keystore
        Folder of the keys; None if none is named.
    """

    enforced: bool
    keystore: Path | None

    @classmethod
    def of_environment(cls) -> Security:
        """As ROS 2 reads it."""
        enabled = os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true"
        keystore = os.environ.get("ROS_SECURITY_KEYSTORE")
        return cls(
            enforced=enabled and os.environ.get("ROS_SECURITY_STRATEGY", "").lower() == "enforce",
            keystore=None if keystore is None else Path(keystore),
        )

    def require(self, enclave: str) -> None:
        """Refuse to start without keys.

        Parameters
        ----------
        enclave
            Name of the keys of this node, such as ``/markerseek/stage``.

        Raises
        ------
        ConfigError
            If security is not enforced, or there are no keys.
        """
        if not self.enforced:
            raise ConfigError(
                "--require-security: ROS 2 would start without keys; set ROS_SECURITY_ENABLE=true, "
                "ROS_SECURITY_STRATEGY=Enforce and ROS_SECURITY_KEYSTORE"
            )
        folder = None if self.keystore is None else self.keystore / "enclaves" / enclave.strip("/")
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
