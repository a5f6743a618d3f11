"""Names of the point attributes that morph objects and frames show."""

# Not in small letters: Cycles renders an attribute "color" black.
COLOR = "Color"
NORMAL = "Normal"
RADIUS = "Radius"  # in small letters it would be a point cloud's own, which a mesh hasn't
VELOCITY = "velocity"  # to the next frame; by second in renders and files, as Cycles blurs by it
FILE_ID = "point_id"  # in files that don't keep "id"
# How bad the map is at a pair: 0 is perfect, over 1 is bad.
DISTORTION = "distortion"
