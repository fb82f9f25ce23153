"""Configuration of a run: the plan, the rig and the versions of libraries, enough to repeat the search."""

from __future__ import annotations

import platform

import msgspec
import numpy as np
import scipy

from markerseek._version import __version__
from markerseek.core import RigFacts, SearchPlan


def versions() -> dict[str, str]:
    """Versions of the libraries on which the last bit of a result depends."""
    return {
        "markerseek": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "machine": platform.machine(),
    }


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """Search and rig of a run."""

    plan: SearchPlan
    """What was asked of the search."""
    facts: RigFacts
    """What was known of the rig."""
    # Raw JSON, not decoded here: records may not import the settings of rigs and drivers.
    recipe: msgspec.Raw
    """All settings of the rig, as JSON; null for a rig that was not assembled from settings."""
    imaging: msgspec.Raw = msgspec.Raw(b"null")
    """Preset of the rig's imaging chain, as JSON; null where there are intensities only."""
    bank: msgspec.Raw = msgspec.Raw(b"null")
    """Facts of the bank that a scan becomes, as JSON; null for a search."""
    versions: dict[str, str] = msgspec.field(default_factory=versions)

    def flat(self) -> dict[str, object]:
        """Plan and facts as one flat table for JSON output; ``rig`` is the kind of the rig."""
        plan: dict[str, object] = msgspec.to_builtins(self.plan)
        facts: dict[str, object] = msgspec.to_builtins(self.facts)
        # Beside the keys of the plan, "kind" alone would not say of what.
        facts["rig"] = facts.pop("kind")
        return plan | facts | {"recipe": self.recipe, "imaging": self.imaging, "versions": self.versions}
