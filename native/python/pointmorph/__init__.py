"""Morphing of point-sampled geometry.

Two clouds in, of any size and without a common mesh; matching points and in-between clouds out::

    import pointmorph

    source = pointmorph.Cloud(source_positions, name="Venus")
    target = pointmorph.Cloud(target_positions, name="Mannequin")
    morph = pointmorph.morph(source, target, {"nose": (17, 403), "chin": (90, 511)})
    half_way = morph.frame(0.5).positions

Needs numpy only; the file formats and the command line need plyfile, trimesh and tqdm.
"""

from pointmorph._waiting import giving_way

with giving_way():
    from pointmorph._pointmorph import __version__
from pointmorph.clouds import Cloud
from pointmorph.cuts import Cut, decompose, propose_loop
from pointmorph.errors import (
    Cancelled,
    CloudError,
    ConvergenceError,
    FeatureError,
    FileError,
    OptionError,
    PointmorphError,
    TopologyError,
)
from pointmorph.features import Feature
from pointmorph.morphing import (
    Frame,
    Morph,
    Option,
    Progress,
    Proposal,
    ResampledFrame,
    morph,
    options,
    propose_features,
    restore,
)
from pointmorph.motions import Motion
from pointmorph.networks import Network, NetworkCurve, trace_network
from pointmorph.quality import (
    FeatureResidual,
    MapFigures,
    Place,
    PointQuality,
    Quality,
    feature_summary,
    quality_summary,
)

__all__ = [
    "Cancelled",
    "Cloud",
    "CloudError",
    "ConvergenceError",
    "Cut",
    "Feature",
    "FeatureError",
    "FeatureResidual",
    "FileError",
    "Frame",
    "MapFigures",
    "Morph",
    "Motion",
    "Network",
    "NetworkCurve",
    "Option",
    "OptionError",
    "Place",
    "PointQuality",
    "PointmorphError",
    "Progress",
    "Proposal",
    "Quality",
    "ResampledFrame",
    "TopologyError",
    "__version__",
    "decompose",
    "feature_summary",
    "morph",
    "options",
    "propose_features",
    "propose_loop",
    "quality_summary",
    "restore",
    "trace_network",
]
