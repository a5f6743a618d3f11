"""Morphing of point-sampled geometry.

Takes two clouds of any size, with no mesh in common, and returns matching points and in-between
clouds::

    import pointmorph

    source = pointmorph.Cloud(source_positions, name="Venus")
    target = pointmorph.Cloud(target_positions, name="Mannequin")
    morph = pointmorph.morph(source, target, {"nose": (17, 403), "chin": (90, 511)})
    half_way = morph.frame(0.5).positions

Needs only numpy. File formats and the command line also need plyfile, trimesh and tqdm.
"""

import sys as _sys

from pointmorph._moved_modules import keep_old_names as _keep_old_names
from pointmorph._wait_policy import passive_wait_policy

with passive_wait_policy():
    from pointmorph._pointmorph import __version__
from pointmorph.base.errors import (
    Cancelled,
    CloudError,
    ConvergenceError,
    FeatureError,
    FileError,
    OptionError,
    PointmorphError,
    TopologyError,
)
from pointmorph.base.option_table import Option, options
from pointmorph.base.stages import Progress, stage_label
from pointmorph.morphs.carrying import Carrier
from pointmorph.morphs.confidence import Confidence, DoubtfulPlace
from pointmorph.morphs.cuts import Cut, decompose, propose_loop
from pointmorph.morphs.denser_meshes import DenserMesh
from pointmorph.morphs.frames import Frame, ResampledFrame
from pointmorph.morphs.morphing import LiveMorph, Morph, Proposal, morph, propose_features, restore
from pointmorph.morphs.motion import Motion
from pointmorph.morphs.networks import Network, NetworkCurve, trace_network
from pointmorph.morphs.quality import (
    FeatureResidual,
    MapFigures,
    MeshPlace,
    MeshQuality,
    Place,
    PointQuality,
    Quality,
    feature_summary,
    quality_summary,
)
from pointmorph.morphs.stored_morphs import StoredMorph, open_morph
from pointmorph.shapes.clouds import Cloud
from pointmorph.shapes.features import Feature

__all__ = [
    "Cancelled",
    "Carrier",
    "Cloud",
    "CloudError",
    "Confidence",
    "ConvergenceError",
    "Cut",
    "DenserMesh",
    "DoubtfulPlace",
    "Feature",
    "FeatureError",
    "FeatureResidual",
    "FileError",
    "Frame",
    "LiveMorph",
    "MapFigures",
    "MeshPlace",
    "MeshQuality",
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
    "StoredMorph",
    "TopologyError",
    "__version__",
    "decompose",
    "feature_summary",
    "morph",
    "open_morph",
    "options",
    "propose_features",
    "propose_loop",
    "quality_summary",
    "restore",
    "stage_label",
    "trace_network",
]

_keep_old_names(_sys.modules[__name__])
