"""What a run was begun with: enough to repeat the same search on the same rig."""

from __future__ import annotations

import platform

import msgspec
import numpy as np
import scipy

from markerseek._version import __version__
from markerseek.core import RigFacts, SearchPlan


def versions() -> dict[str, str]:
    """Versions of what a result depends on, bit for bit."""
    return {
        "markerseek": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "machine": platform.machine(),
    }


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """Search and rig of a run.

    Attributes
    ----------
    plan
        What was asked of the search.
    facts
        What was known of the rig.
    recipe
        Settings of the rig in full, as JSON; null for a rig that was not put together from settings.
    imaging
        Preset of the rig's imaging chain in full, as JSON; null where there are intensities only.
    versions
        See `versions`.
    """

    plan: SearchPlan
    facts: RigFacts
    recipe: msgspec.Raw
    imaging: msgspec.Raw = msgspec.Raw(b"null")
    versions: dict[str, str] = msgspec.field(default_factory=versions)

    def flat(self) -> dict[str, object]:
        """Plan and facts beside one another in one table, as programs read it; ``rig`` is the kind of the rig."""
        plan: dict[str, object] = msgspec.to_builtins(self.plan)
        facts: dict[str, object] = msgspec.to_builtins(self.facts)
        facts["rig"] = facts.pop("kind")
        return plan | facts | {"recipe": self.recipe, "imaging": self.imaging, "versions": self.versions}
