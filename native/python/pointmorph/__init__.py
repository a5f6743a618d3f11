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

from pointmorph._wait_policy import passive_wait_policy

with passive_wait_policy():
    from pointmorph._pointmorph import __version__
from pointmorph.carrying import Carrier
from pointmorph.clouds import Cloud
from pointmorph.cuts import Cut, decompose, propose_loop
from pointmorph.denser_meshes import DenserMesh
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
from pointmorph.frames import Frame, ResampledFrame
from pointmorph.live import LiveMorph
from pointmorph.morphing import Morph, Proposal, morph, propose_features, restore
from pointmorph.motion import Motion
from pointmorph.networks import Network, NetworkCurve, trace_network
from pointmorph.option_table import Option, options
from pointmorph.quality import (
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
from pointmorph.stages import Progress, stage_label
from pointmorph.stored_morphs import StoredMorph, open_morph

__all__ = [
    "Cancelled",
    "Carrier",
    "Cloud",
    "CloudError",
    "ConvergenceError",
    "Cut",
    "DenserMesh",
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
