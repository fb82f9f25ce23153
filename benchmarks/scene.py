"""What following a scene costs: ``python -m benchmarks.scene``.

One pair of 1,280 × 1,024 pixels is followed, in turns with OpenCV's ORB on one of its images (a detector made for
speed, which finds 500 keypoints and describes them, and matches nothing), both on one core. The picture is noise of
several scales, moved across by a few pixels.
"""

from __future__ import annotations

import numpy as np

from benchmarks import machine, timing

TARGET_MS = 40.0
SIZE_PX = (1280, 1024)
FOCAL_PX = 1100.0
BASE_M = 5e-3
DISTANCE_M = 80e-3


def main() -> None:
    """Measure, and print one line."""
    machine.hold_to_cores(1)
    import cv2

    from markerseek.core import StereoPair
    from markerseek.geometry import Camera, RigidTransform, StereoCameras
    from markerseek.vision import NotKnown, SceneFollower, scene_texture

    cv2.setNumThreads(1)
    for name, value in machine.describe(cores=1).items():
        print(f"- {name}: {value}")
    lens = Camera(
        focal_px=(FOCAL_PX, FOCAL_PX), centre_px=((SIZE_PX[0] - 1) / 2, (SIZE_PX[1] - 1) / 2), size_px=SIZE_PX
    )
    cameras = StereoCameras(
        left=lens,
        right=lens,
        left_to_right=RigidTransform(
            source="Left", target="Right", rotation=np.eye(3), translation_m=np.array([-BASE_M, 0.0, 0.0])
        ),
    )
    rng = np.random.default_rng(1)
    wide = _texture((SIZE_PX[0] + 400, SIZE_PX[1] + 100), rng)

    def pair(across_px: int, down_px: int) -> StereoPair:
        images = []
        # A wall before the cameras: each point lies that much further to the left in the right image.
        for beside_px in (0, round(FOCAL_PX * BASE_M / DISTANCE_M)):
            left = 150 + beside_px - across_px
            top = 50 - down_px
            seen = wide[top : top + SIZE_PX[1], left : left + SIZE_PX[0]]
            noisy = seen + 2 * rng.standard_normal(seen.shape, dtype=np.float32)
            images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
        return StereoPair(left=images[0], right=images[1], at_s=0.0)

    texture = scene_texture(pair(0, 0), cameras)
    if isinstance(texture, NotKnown):
        raise SystemExit(texture.reason)
    follower = SceneFollower(texture, rng=rng)
    pairs = [pair(4, 0), pair(8, 3), pair(4, 6), pair(0, 3)]
    number = 0

    def ours() -> None:
        nonlocal number
        number += 1
        seen = follower.follow(pairs[number % len(pairs)])
        if isinstance(seen, NotKnown) or isinstance(seen.motion, NotKnown):
            raise SystemExit(f"the scene was lost: {seen}")

    orb = cv2.ORB_create(500)
    measured = timing.in_turn(
        "follow a pair",
        ours,
        "OpenCV's ORB on one image",
        lambda: orb.detectAndCompute(pairs[0].left, None),
        agreement="",
        effort=timing.FULL,
    )
    print(
        f"\n{len(texture.parts)} patches: {measured.ours_ms:.1f} ms a pair; "
        f"{measured.peer}: {measured.peer_ms:.1f} ms; "
        f"ratio {measured.ours_ms / measured.peer_ms:.2f}, {measured.rounds} rounds"
    )
    print(f"target: {TARGET_MS:g} ms of one core: {'met' if measured.ours_ms <= TARGET_MS else 'missed'}")


def _texture(size_px: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    import cv2

    total = np.zeros(size_px[::-1], dtype=np.float32)
    for scale_px in (4, 10, 30, 100):
        rough = rng.standard_normal((size_px[1] // scale_px + 2, size_px[0] // scale_px + 2)).astype(np.float32)
        total += cv2.resize(rough, size_px, interpolation=cv2.INTER_CUBIC)
    return 110 + 18 * total


if __name__ == "__main__":
    main()
