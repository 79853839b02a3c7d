"""Cameras, as their makers and OpenCV describe them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from lexsplat._errors import CameraError
from lexsplat._geometry import Array, numbers, rigid, wire_pose
from lexsplat.v1 import lexsplat_pb2 as v1

DistortionName: TypeAlias = Literal[
    "brown_conrady", "plumb_bob", "rational_polynomial", "kannala_brandt", "equidistant", "fisheye"
]

_BROWN_CONRADY = v1.DISTORTION_MODEL_BROWN_CONRADY
_KANNALA_BRANDT = v1.DISTORTION_MODEL_KANNALA_BRANDT
_MODELS: dict[str, v1.DistortionModel] = {
    "brown_conrady": _BROWN_CONRADY,
    "plumb_bob": _BROWN_CONRADY,
    "rational_polynomial": _BROWN_CONRADY,
    "kannala_brandt": _KANNALA_BRANDT,
    "equidistant": _KANNALA_BRANDT,
    "fisheye": _KANNALA_BRANDT,
}


@dataclass(frozen=True)
class Camera:
    """A camera, in pixels; the centre of the top-left pixel is (0, 0).

    The server removes distortion and registers depth, so images are sent as they are.

    Attributes:
        width: Columns.
        height: Rows.
        fx: Horizontal focal length.
        fy: Vertical focal length.
        cx: Column of the principal point.
        cy: Row of the principal point.
        distortion: How the lens bends: "plumb_bob" (also "rational_polynomial", "brown_conrady") or
            "equidistant" (also "fisheye", "kannala_brandt"). None: not at all.
        coefficients: In OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6, of which there are 4, 5, 8 or more
            whose rest is 0; for a fisheye k1 k2 k3 k4. Without any, the lens is straight.

    Raises:
        CameraError: A value is impossible.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: DistortionName | None = None
    coefficients: Sequence[float] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if not isinstance(size, int | np.integer) or size <= 0:
                raise CameraError(f"{name}: expected a number of pixels above 0, found {size!r}")
        for name in ("fx", "fy"):
            focal = getattr(self, name)
            if not 0 < focal < math.inf:
                raise CameraError(f"{name}: expected pixels above 0, found {focal!r}")
        for name in ("cx", "cy"):
            if not math.isfinite(getattr(self, name)):
                raise CameraError(f"{name}: expected pixels, found {getattr(self, name)!r}")
        self._check_distortion()

    def _check_distortion(self) -> None:
        coefficients = np.ravel(np.asarray(self.coefficients, dtype=np.float64))
        if self.distortion is None:
            if coefficients.any():
                raise CameraError(
                    "coefficients without a model: say distortion='plumb_bob' for OpenCV's usual "
                    "ones, or 'fisheye'"
                )
        elif self.distortion not in _MODELS:
            known = ", ".join(_MODELS)
            raise CameraError(f"distortion: {self.distortion!r} is not one of {known}")
        if not np.isfinite(coefficients).all():
            raise CameraError(f"coefficients: expected numbers, found {coefficients.tolist()}")
        object.__setattr__(self, "coefficients", tuple(map(float, coefficients)))

    @classmethod
    def from_matrix(
        cls,
        matrix: npt.ArrayLike,
        width: int,
        height: int,
        distortion: DistortionName | None = None,
        *,
        coefficients: Sequence[float] = (),
    ) -> Camera:
        """A camera with a 3x3 matrix, as OpenCV and ROS have it.

        Raises:
            CameraError: The matrix has another shape, or skew.
        """
        try:
            k = numbers(matrix, (3, 3), "matrix")
        except ValueError as error:
            raise CameraError(str(error)) from None
        if abs(k[0, 1]) > 1e-6 * abs(k[0, 0]) or k[1, 0] != 0:
            raise CameraError(f"matrix: cameras with skew are not supported, found {k[0, 1]}")
        fx, fy, cx, cy = (float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return cls(width, height, fx, fy, cx, cy, distortion, coefficients=coefficients)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as of a numpy image."""
        return int(self.height), int(self.width)

    def _wire(self) -> v1.Intrinsics:
        return v1.Intrinsics(
            width=int(self.width),
            height=int(self.height),
            fx=self.fx,
            fy=self.fy,
            cx=self.cx,
            cy=self.cy,
        )

    def _wire_distortion(self) -> v1.Distortion | None:
        if self.distortion is None or not self.coefficients:
            return None
        return v1.Distortion(model=_MODELS[self.distortion], coefficients=self.coefficients)


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """The camera of depth images that are not registered to color. The server registers them.

    Attributes:
        camera: Size, intrinsics and distortion of depth images.
        color_from_depth: 4x4 pose of the depth camera in the coordinates of the color camera,
            metres: x_color = color_from_depth @ x_depth.

    Raises:
        CameraError: The matrix is no pose.
    """

    camera: Camera
    color_from_depth: npt.ArrayLike = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        try:
            pose = rigid(self.color_from_depth, "color_from_depth")
        except ValueError as error:
            raise CameraError(str(error)) from None
        object.__setattr__(self, "color_from_depth", pose)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of depth images."""
        return self.camera.shape

    def _wire(self) -> v1.DepthCamera:
        pose: Array = np.asarray(self.color_from_depth)
        return v1.DepthCamera(
            intrinsics=self.camera._wire(),
            distortion=self.camera._wire_distortion(),
            color_from_depth=wire_pose(pose),
        )


@dataclass(frozen=True)
class SameLens:
    """Depth that is taken through color's own lens at another resolution, as phones do.

    Attributes:
        width: Columns of depth images.
        height: Rows.

    Raises:
        CameraError: A size is not above 0.
    """

    width: int
    height: int

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise CameraError(f"expected sizes above 0, found {self.width}x{self.height}")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of depth images."""
        return int(self.height), int(self.width)

    def _wire(self) -> v1.DepthCamera:
        return v1.DepthCamera(
            intrinsics=v1.Intrinsics(width=int(self.width), height=int(self.height))
        )
