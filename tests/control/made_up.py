"""Scores and errors that no robot had to earn."""

from plat.control import KeyframeScore, Outcome, PoseErrors


def errors(joint: float = 0.0, keypoint: float = 0.0, *, down: bool = False) -> PoseErrors:
    """Errors with the root as far off as the keypoints."""
    return PoseErrors(
        joint,
        keypoint,
        root=keypoint,
        bodies=0.0,
        height=0.0,
        turn=0.0,
        near=not down,
        off_pose=False,
        fallen=down,
        down=down,
    )


def score(
    index: int,
    name: str | None,
    time: float,
    outcome: Outcome = "reached",
    joint: float = 0.1,
    keypoint: float = 0.02,
    *,
    faults: tuple[str, ...] = (),
    fell_afterwards: bool = False,
) -> KeyframeScore:
    """Score with the same errors in the window and at its end."""
    return KeyframeScore(
        index,
        name,
        time,
        outcome,
        faults,
        late=None,
        fell_afterwards=fell_afterwards,
        arrival=errors(joint, keypoint, down=outcome == "fell"),
        success=outcome == "reached",
        root_off=outcome == "fell",
        joint_error=joint,
        keypoint_error=keypoint,
    )
