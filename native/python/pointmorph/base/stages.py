"""The stages of a computation, in words to show while they run."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], bool | None]
"""Called with the name of a stage and the fraction of it that is done; returns False to cancel.
`pointmorph.stage_label` gives the stage in words."""

_LABELS = {
    "alignment": "Aligning features",
    "boundary": "Finding boundaries",
    "carrying": "Transferring",
    "cloud": "Preparing points",
    "coarse shapes": "Simplifying shapes",
    "confidence": "Finding doubtful places",
    "covariance": "Estimating normals",
    "cracks": "Measuring cracks",
    "decomposition": "Cutting shapes",
    "frames": "Making frames",
    "handles": "Counting handles",
    "landing": "Projecting points",
    "lift": "Refining all points",
    "mesh quality": "Measuring the mesh",
    "missing parts": "Finding missing parts",
    "motion": "Finding paths",
    "neighborhoods": "Finding neighbors",
    "network": "Tracing curves",
    "pairing": "Pairing points",
    "parameterization": "Flattening patches",
    "pieces": "Matching components",
    "pose": "Finding the pose",
    "product space": "Matching points",
    "quality": "Measuring quality",
    "registration": "Fitting shapes",
    "resampled frame": "Filling cracks",
    "resampling": "Finding cracks",
    "samples": "Sampling",
    "sampling": "Sampling",
    "spherical alignment": "Aligning features",
    "spherical parameterization": "Mapping onto the sphere",
    "topology": "Analyzing topology",
    "transfer": "Smoothing the map",
    "vertices": "Moving the vertices",
    "wrapping": "Wrapping the mesh",
    "writing": "Writing frames",
}


def stage_label(stage: str) -> str:
    """A stage in words to show to a user.

    Parameters
    ----------
    stage : str
        What a progress function gets, or a key of `report["stages"]`.

    Examples
    --------
    >>> from pointmorph import stage_label
    >>> stage_label("coarse shapes")
    'Simplifying shapes'
    """
    return _LABELS.get(stage, stage.replace("_", " ").capitalize())
