"""The numbers that the paper prints, as data, each with its place; and which of them cannot be had, and why.

Nothing here is ours. What a reproduction finds stands in its own tables; `section.beside` puts the two next to each
other.
"""

from __future__ import annotations

from markerseek.studies.paper.number import MATERIALS, Reported

_CURVES = (
    "It depends on intensity curves that are not public: ours come from simulated stand-ins, so that the two columns "
    "can be compared and not made equal."
)
_BRACKET = (
    "0.29° to 0.34° on every material is what eight iterations leave of the bracket without any noise: those curves "
    "were nearly free of noise and unimodal."
)
_NINE = "It comes from nine positions whose angles are not public."
_TWO = (
    "It does not replay for markers spread evenly over the range: one iteration leaves more, whatever the curve "
    "(fig5_without_noise.csv). The paper's nine positions are not public."
)
_TRAVEL = (
    "It does not replay: the order of acquisitions that section 2.3 prints, two fresh ones in each iteration and the "
    "left one first, turns the probe several times as far."
)

_SPEED = (
    "It is the paper's own travel at the stage's largest speed, without a stop. A stage that comes to rest at each of "
    "16 angles takes many times as long."
)

_TABLE_1 = {
    "WA": ((0.51, 0.36), (0.93, 0.83), (0.35, 0.23), (0.54, 0.41), (1.28, None)),
    "TS": ((0.34, 0.27), (0.29, 0.22), (0.34, 0.20), (0.32, 0.22), (0.32, None)),
    "GSS": ((0.20, 0.19), (0.52, 0.61), (0.30, 0.24), (0.45, 0.40), (1.12, None)),
}


def _table_1() -> list[Reported]:
    return [
        Reported(
            key=f"table1/{method}/{material}",
            what=f"{method} on {material} after 16 acquisitions, mean error",
            place="Table 1",
            mean=mean,
            spread=spread,
            limits=_BRACKET if method == "TS" else _CURVES,
        )
        for method, cells in _TABLE_1.items()
        for material, (mean, spread) in zip(MATERIALS, cells, strict=True)
    ]


NUMBERS = [
    Reported(
        key="fig5/WA",
        what="WA, mean error over N = 8 to 28 and its scatter over N",
        place="Section 3.1, Fig. 5",
        mean=0.47,
        spread=0.11,
        note="Markers near ±35°, whose curve the range cuts off, make most of it.",
    ),
    Reported(
        key="fig5/TS",
        what="TS after 28 acquisitions, mean error",
        place="Section 3.1, Fig. 5",
        mean=0.06,
        limits=(
            "It is exactly 70°·(2/3)^14/4, the mean error of a marker that lies anywhere in the last bracket with "
            "equal chance. A replay without noise gives less, because the marker does not."
        ),
    ),
    Reported(
        key="fig5/GSS",
        what="GSS after 28 acquisitions, mean error",
        place="Section 3.1, Fig. 5",
        mean=0.01,
        note="A replay without noise agrees, with two fresh acquisitions in each iteration.",
    ),
    *_table_1(),
    Reported(
        key="fig6/28",
        what="TS and GSS on every material after 28 acquisitions, mean error: below",
        place="Section 5",
        mean=0.5,
        limits=_CURVES,
    ),
    Reported(key="table2/WA", what="WA online, mean error", place="Table 2", mean=0.53, spread=0.30, limits=_NINE),
    Reported(
        key="table2/WA/N",
        what="WA online, acquisitions until the peak was recorded and passed",
        place="Table 2",
        mean=8.7,
        unit="acquisitions",
        limits="It depends on where the nine markers lay: the sweep begins at −35°. " + _NINE,
    ),
    Reported(
        key="table2/TS",
        what="TS online after 16 acquisitions, mean error",
        place="Table 2",
        mean=1.05,
        spread=1.04,
        limits="Noise made it: eight iterations without noise leave far less. " + _NINE,
    ),
    Reported(
        key="table2/GSS",
        what="GSS online after 16 acquisitions, mean error",
        place="Table 2",
        mean=0.74,
        spread=0.58,
        limits="Noise made it. " + _NINE,
    ),
    Reported(
        key="fig7/TS/28",
        what="TS online after 28 acquisitions, mean error",
        place="Section 3.3, Fig. 7",
        mean=0.29,
        spread=0.30,
        limits=_NINE,
        note="The abstract and the conclusion have ± 0.31°.",
    ),
    Reported(
        key="fig7/GSS/28",
        what="GSS online after 28 acquisitions, mean error",
        place="Section 3.3, Fig. 7",
        mean=0.48,
        spread=0.30,
        limits=_NINE,
        note="The abstract and the conclusion have ± 0.32°.",
    ),
    Reported(
        key="fig7/TS/2",
        what="TS online after 2 acquisitions, mean error",
        place="Section 4",
        mean=4.20,
        limits=_TWO,
    ),
    Reported(
        key="fig7/GSS/2",
        what="GSS online after 2 acquisitions, mean error",
        place="Section 4",
        mean=5.89,
        limits=_TWO,
    ),
    Reported(
        key="travel/TS", what="TS, rotation travel of 16 acquisitions", place="Section 4", mean=36.0, limits=_TRAVEL
    ),
    Reported(
        key="travel/GSS", what="GSS, rotation travel of 16 acquisitions", place="Section 4", mean=24.0, limits=_TRAVEL
    ),
    Reported(
        key="travel/low",
        what="TS and GSS, time of rotation for 16 acquisitions: from",
        place="Section 4",
        mean=1.0,
        unit="s",
        limits=_SPEED,
    ),
    Reported(
        key="travel/high",
        what="TS and GSS, time of rotation for 16 acquisitions: to",
        place="Section 4",
        mean=2.0,
        unit="s",
        limits=_SPEED,
    ),
    Reported(
        key="manual/low",
        what="manual search: from",
        place="Section 4",
        mean=120.0,
        unit="s",
        limits="Reported of another system [30]; no data of it are public.",
    ),
    Reported(
        key="manual/high",
        what="manual search: to",
        place="Section 4",
        mean=180.0,
        unit="s",
        limits="Reported of another system [30]; no data of it are public.",
    ),
    Reported(
        key="manual/registration",
        what="registration with manual search: as much as",
        place="Section 1",
        mean=420.0,
        unit="s",
        limits="Of a whole registration of several markers, reported in [19]; no data of it are public.",
    ),
    Reported(
        key="acquisition",
        what="reading one acquisition from SonixDAQ files: about",
        place="Section 4",
        mean=10.0,
        unit="s",
    ),
    Reported(
        key="sensitive",
        what="half of the sensitive range of the tool tip",
        place="Section 3.4, Fig. 9",
        mean=4.33,
        spread=0.58,
        limits="Fig. 9 needs the tool tip in B-mode images, which is not part of this version.",
    ),
]
