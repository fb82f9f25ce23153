"""Which nodes a process sees: its middleware, its transport, and the environment variables that choose them."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from markerseek.core import ConfigError

_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
_MIDDLEWARE, _RANGE = "RMW_IMPLEMENTATION", "ROS_AUTOMATIC_DISCOVERY_RANGE"


def reach() -> str:
    """Keep to this computer, unless the user chose a transport; returns where nodes are looked for.

    Where the user has no profiles of the middleware, ours notices soon that a process is gone.
    """
    local, lease = (str(Path(__file__).with_name(name)) for name in ("local.xml", "participant.xml"))
    chosen = os.environ.get(_TRANSPORTS)
    foreign = next((name for name in _PROFILES if os.environ.get(name) not in (None, "", local, lease)), None)
    if foreign is None:
        os.environ[_PROFILES[0]] = lease if chosen else local
    middleware = os.environ.get(_MIDDLEWARE) or "rmw_fastrtps_cpp"
    if not middleware.startswith("rmw_fastrtps"):
        where = f"as {middleware} is set up ({_MIDDLEWARE})"
    elif foreign is not None:
        where = f"as {os.environ[foreign]} says ({foreign})"
    elif chosen == "SHM":
        where = f"in shared memory only ({_TRANSPORTS}=SHM), where nodes of default settings are not; unset it"
    elif chosen:
        where = f"by {_TRANSPORTS}={chosen}"
    else:
        where = f"on this computer only (127.0.0.1 and shared memory); {_TRANSPORTS}=DEFAULT opens the network"
    limit = f", {_RANGE}={os.environ[_RANGE]}" if os.environ.get(_RANGE) else ""
    return f"ROS 2 domain {os.environ.get('ROS_DOMAIN_ID') or 0} (ROS_DOMAIN_ID){limit}, {where}"


def require_middleware() -> None:
    """Refuse a middleware that is not installed: rclpy ends the process as it is imported."""
    wanted = os.environ.get(_MIDDLEWARE)
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    index = "share/ament_index/resource_index/rmw_typesupport"
    found = {file.name for prefix in prefixes if prefix for file in Path(prefix, index).glob("rmw_*")}
    installed = sorted(found - {"rmw_implementation"})
    if wanted and installed and wanted not in installed:
        raise ConfigError(
            f"{_MIDDLEWARE} is {wanted}, which is not installed here ({', '.join(installed)} is); unset {_MIDDLEWARE}, "
            "or install that package"
        )
