"""Names of the point attributes that morph objects and frames show."""

# Not in small letters: Cycles renders an attribute "color" black.
COLOR = "Color"
NORMAL = "Normal"
RADIUS = "Radius"  # in small letters it would be a point cloud's own, which a mesh hasn't
VELOCITY = "velocity"  # to the next frame; by second in renders and files, as Cycles blurs by it
FILE_ID = "point_id"  # in files that don't keep "id"
# Made by the nodes of a morph that is staggered: how late each point goes, and the share of its
# way that it has gone; both 0 to 1.
DELAY = "morph_delay"
TIME = "morph_t"
AHEAD = "morph_ahead"  # that share less what the whole has gone
TURN = "morph_normal"  # what the path adds to the normals of points
# How bad the map is at a pair: 0 is perfect, over 1 is bad.
DISTORTION = "distortion"
CONFIDENCE = "confidence"  # how likely it is right: 0 to 1


def on_way(way, number):
    """On the way to the shape after shape `way`: the whole straight way (0), and how far it lies
    off that at the times of `path_stages` (1 and so on)."""
    return f"path{way}_{number}"


def normal_on_way(way, number):
    return f"path{way}_normal{number}"


def vertex_on_way(way, number):
    """Of the source's own vertices, kept with the pairs."""
    return f"landing_path{way}_{number}"
