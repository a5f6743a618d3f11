from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

__version__: str

class MorphOptions:
    def set(self, name: str, value: int | float | str | None) -> None: ...
    def propose_features(self) -> None: ...
    def is_straight(self) -> bool: ...

def option_table() -> list[dict[str, Any]]: ...
def nearest_neighbors(positions: npt.NDArray[Any], k: int) -> npt.NDArray[np.int32]: ...
def nearest_rows(
    positions: npt.NDArray[Any], places: npt.NDArray[Any], k: int
) -> npt.NDArray[np.int32]: ...

class ClosestPlaces:
    def __init__(
        self, positions: npt.NDArray[Any], triangles: npt.NDArray[np.integer[Any]]
    ) -> None: ...
    def of(
        self, places: npt.NDArray[Any], progress: Any
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]: ...

def blue_noise(
    positions: npt.NDArray[Any],
    normals: npt.NDArray[Any] | None,
    count: int,
    keep: npt.NDArray[np.int64],
    progress: Any,
) -> npt.NDArray[np.int64]: ...
def propose_loop(
    source: dict[str, Any],
    target: dict[str, Any],
    features: Any,
    options: MorphOptions,
    progress: Any,
) -> list[str]: ...
def decompose(
    cloud: dict[str, Any],
    loop: list[int],
    names: list[str],
    options: MorphOptions,
    progress: Any,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], list[int], npt.NDArray[np.int8]]: ...
def trace_network(
    source: dict[str, Any],
    target: dict[str, Any],
    features: Any,
    loops: list[list[str]],
    options: MorphOptions,
    progress: Any,
) -> tuple[
    list[tuple[str, str, npt.NDArray[np.float64], npt.NDArray[np.float64]]],
    list[list[int]],
    npt.NDArray[np.int64],
    npt.NDArray[np.int64],
]: ...

class Motion:
    def __init__(
        self,
        positions: npt.NDArray[np.float64],
        normals: npt.NDArray[np.float64],
        images: npt.NDArray[np.float64],
        path: str,
        progress: Any,
    ) -> None: ...
    def at(self, t: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...

class PointwisePath:
    def __init__(
        self,
        start: npt.NDArray[np.float64],
        end: npt.NDArray[np.float64],
        at: Callable[[float], npt.NDArray[np.float64]],
    ) -> None: ...
    def at(self, times: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...

class MeshMotion:
    def __init__(
        self,
        positions: npt.NDArray[np.float64],
        images: npt.NDArray[np.float64],
        faces: tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]],
        path: str,
        progress: Any,
    ) -> None: ...
    def at(self, t: float, progress: Any) -> npt.NDArray[np.float64]: ...

class LiveMorph:
    def __init__(
        self,
        source: dict[str, Any],
        target: dict[str, Any],
        features: list[dict[str, Any]],
        options: MorphOptions,
        maps: tuple[npt.NDArray[Any] | None, npt.NDArray[Any] | None],
        progress: Any,
    ) -> None: ...
    @staticmethod
    def of(morph: Morph, progress: Any) -> LiveMorph: ...
    def source_to_target(
        self, features: list[dict[str, Any]], progress: Any
    ) -> npt.NDArray[np.float64]: ...
    def updated(self, features: list[dict[str, Any]], progress: Any) -> Morph: ...

class Morph:
    def __init__(
        self,
        source: dict[str, Any],
        target: dict[str, Any],
        features: list[dict[str, Any]],
        loops: list[list[str]],
        options: MorphOptions,
        source_start: npt.NDArray[Any] | None,
        target_start: npt.NDArray[Any] | None,
        progress: Any,
    ) -> None: ...
    @staticmethod
    def restore(
        source: dict[str, Any],
        target: dict[str, Any],
        pairs: npt.NDArray[np.int64],
        source_images: npt.NDArray[Any] | None,
        target_images: npt.NDArray[Any] | None,
        options: MorphOptions,
    ) -> Morph: ...
    @staticmethod
    def chained(legs: list[Morph], options: MorphOptions, delays: Any) -> Morph: ...
    def vertex_times(self, of_source: bool, t: float) -> npt.NDArray[np.float64]: ...
    def pairs(self) -> npt.NDArray[np.int64]: ...
    def source_domain(self) -> npt.NDArray[np.float64]: ...
    def target_domain(self) -> npt.NDArray[np.float64]: ...
    def source_boundary(self) -> npt.NDArray[np.int64]: ...
    def target_boundary(self) -> npt.NDArray[np.int64]: ...
    def report(self) -> dict[str, Any]: ...
    def has_mesh(self) -> bool: ...
    def wrapped(self, t: float, progress: Any) -> npt.NDArray[np.float64]: ...
    def denser(
        self, of_source: bool, tolerance: float, most_vertices: int, progress: Any
    ) -> tuple[
        npt.NDArray[np.int32],
        npt.NDArray[np.int64],
        npt.NDArray[np.int64],
        npt.NDArray[np.float64],
    ]: ...
    def has_target_mesh(self) -> bool: ...
    def wrapped_target(self, t: float, progress: Any) -> npt.NDArray[np.float64]: ...
    def source_to_target(self, progress: Any) -> npt.NDArray[np.float64]: ...
    def target_to_source(self, progress: Any) -> npt.NDArray[np.float64]: ...
    def cracks(self, times: list[float], progress: Any) -> list[tuple[float, float]]: ...
    def quality(self, progress: Any) -> dict[str, Any]: ...
    def mesh_quality(self, progress: Any) -> dict[str, Any]: ...
    def inserted(self, progress: Any) -> int: ...
    def resampled_frame_float32(self, t: float, progress: Any) -> dict[str, Any]: ...
    def resampled_frame_float64(self, t: float, progress: Any) -> dict[str, Any]: ...
    def lay_out_paths(self, progress: Any) -> None: ...
    def frame_float32(self, t: float, *arrays: npt.NDArray[Any]) -> None: ...
    def frame_float64(self, t: float, *arrays: npt.NDArray[Any]) -> None: ...
