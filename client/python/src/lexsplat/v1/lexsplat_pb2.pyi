from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class DistortionModel(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DISTORTION_MODEL_UNSPECIFIED: _ClassVar[DistortionModel]
    DISTORTION_MODEL_BROWN_CONRADY: _ClassVar[DistortionModel]
    DISTORTION_MODEL_KANNALA_BRANDT: _ClassVar[DistortionModel]

class PoseSource(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POSE_SOURCE_UNSPECIFIED: _ClassVar[PoseSource]
    POSE_SOURCE_GIVEN: _ClassVar[PoseSource]
    POSE_SOURCE_ESTIMATED: _ClassVar[PoseSource]

class ColorFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    COLOR_FORMAT_UNSPECIFIED: _ClassVar[ColorFormat]
    COLOR_FORMAT_JPEG: _ClassVar[ColorFormat]
    COLOR_FORMAT_PNG: _ClassVar[ColorFormat]
    COLOR_FORMAT_RGB8: _ClassVar[ColorFormat]

class DepthFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DEPTH_FORMAT_UNSPECIFIED: _ClassVar[DepthFormat]
    DEPTH_FORMAT_PNG16: _ClassVar[DepthFormat]
    DEPTH_FORMAT_U16: _ClassVar[DepthFormat]
    DEPTH_FORMAT_F32_METRES: _ClassVar[DepthFormat]
    DEPTH_FORMAT_U16_ZSTD: _ClassVar[DepthFormat]

class LabelFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LABEL_FORMAT_UNSPECIFIED: _ClassVar[LabelFormat]
    LABEL_FORMAT_PNG: _ClassVar[LabelFormat]
    LABEL_FORMAT_U16: _ClassVar[LabelFormat]
    LABEL_FORMAT_U16_ZSTD: _ClassVar[LabelFormat]

class FrameStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FRAME_STATUS_UNSPECIFIED: _ClassVar[FrameStatus]
    FRAME_STATUS_OPENED: _ClassVar[FrameStatus]
    FRAME_STATUS_TRACKED: _ClassVar[FrameStatus]
    FRAME_STATUS_LOST: _ClassVar[FrameStatus]
    FRAME_STATUS_RELOCALISED: _ClassVar[FrameStatus]
    FRAME_STATUS_REFUSED: _ClassVar[FrameStatus]

class InputProblem(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    INPUT_PROBLEM_UNSPECIFIED: _ClassVar[InputProblem]
    INPUT_PROBLEM_DEPTH_UNIT: _ClassVar[InputProblem]
    INPUT_PROBLEM_INVERTED_POSES: _ClassVar[InputProblem]
    INPUT_PROBLEM_CAMERA_AXES: _ClassVar[InputProblem]
    INPUT_PROBLEM_UNREGISTERED_DEPTH: _ClassVar[InputProblem]
    INPUT_PROBLEM_REPEATED_DEPTH: _ClassVar[InputProblem]
    INPUT_PROBLEM_BAD_BEGINNING: _ClassVar[InputProblem]
    INPUT_PROBLEM_NO_DEPTH: _ClassVar[InputProblem]
DISTORTION_MODEL_UNSPECIFIED: DistortionModel
DISTORTION_MODEL_BROWN_CONRADY: DistortionModel
DISTORTION_MODEL_KANNALA_BRANDT: DistortionModel
POSE_SOURCE_UNSPECIFIED: PoseSource
POSE_SOURCE_GIVEN: PoseSource
POSE_SOURCE_ESTIMATED: PoseSource
COLOR_FORMAT_UNSPECIFIED: ColorFormat
COLOR_FORMAT_JPEG: ColorFormat
COLOR_FORMAT_PNG: ColorFormat
COLOR_FORMAT_RGB8: ColorFormat
DEPTH_FORMAT_UNSPECIFIED: DepthFormat
DEPTH_FORMAT_PNG16: DepthFormat
DEPTH_FORMAT_U16: DepthFormat
DEPTH_FORMAT_F32_METRES: DepthFormat
DEPTH_FORMAT_U16_ZSTD: DepthFormat
LABEL_FORMAT_UNSPECIFIED: LabelFormat
LABEL_FORMAT_PNG: LabelFormat
LABEL_FORMAT_U16: LabelFormat
LABEL_FORMAT_U16_ZSTD: LabelFormat
FRAME_STATUS_UNSPECIFIED: FrameStatus
FRAME_STATUS_OPENED: FrameStatus
FRAME_STATUS_TRACKED: FrameStatus
FRAME_STATUS_LOST: FrameStatus
FRAME_STATUS_RELOCALISED: FrameStatus
FRAME_STATUS_REFUSED: FrameStatus
INPUT_PROBLEM_UNSPECIFIED: InputProblem
INPUT_PROBLEM_DEPTH_UNIT: InputProblem
INPUT_PROBLEM_INVERTED_POSES: InputProblem
INPUT_PROBLEM_CAMERA_AXES: InputProblem
INPUT_PROBLEM_UNREGISTERED_DEPTH: InputProblem
INPUT_PROBLEM_REPEATED_DEPTH: InputProblem
INPUT_PROBLEM_BAD_BEGINNING: InputProblem
INPUT_PROBLEM_NO_DEPTH: InputProblem

class Intrinsics(_message.Message):
    __slots__ = ("width", "height", "fx", "fy", "cx", "cy")
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    FX_FIELD_NUMBER: _ClassVar[int]
    FY_FIELD_NUMBER: _ClassVar[int]
    CX_FIELD_NUMBER: _ClassVar[int]
    CY_FIELD_NUMBER: _ClassVar[int]
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    def __init__(self, width: _Optional[int] = ..., height: _Optional[int] = ..., fx: _Optional[float] = ..., fy: _Optional[float] = ..., cx: _Optional[float] = ..., cy: _Optional[float] = ...) -> None: ...

class Pose(_message.Message):
    __slots__ = ("rotation", "translation_metres")
    ROTATION_FIELD_NUMBER: _ClassVar[int]
    TRANSLATION_METRES_FIELD_NUMBER: _ClassVar[int]
    rotation: Quaternion
    translation_metres: Vector3
    def __init__(self, rotation: _Optional[_Union[Quaternion, _Mapping]] = ..., translation_metres: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class Quaternion(_message.Message):
    __slots__ = ("w", "x", "y", "z")
    W_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    w: float
    x: float
    y: float
    z: float
    def __init__(self, w: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Vector3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Distortion(_message.Message):
    __slots__ = ("model", "coefficients")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    COEFFICIENTS_FIELD_NUMBER: _ClassVar[int]
    model: DistortionModel
    coefficients: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, model: _Optional[_Union[DistortionModel, str]] = ..., coefficients: _Optional[_Iterable[float]] = ...) -> None: ...

class DepthCamera(_message.Message):
    __slots__ = ("intrinsics", "distortion", "color_from_depth")
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    DISTORTION_FIELD_NUMBER: _ClassVar[int]
    COLOR_FROM_DEPTH_FIELD_NUMBER: _ClassVar[int]
    intrinsics: Intrinsics
    distortion: Distortion
    color_from_depth: Pose
    def __init__(self, intrinsics: _Optional[_Union[Intrinsics, _Mapping]] = ..., distortion: _Optional[_Union[Distortion, _Mapping]] = ..., color_from_depth: _Optional[_Union[Pose, _Mapping]] = ...) -> None: ...

class FrameMessage(_message.Message):
    __slots__ = ("open", "frame")
    OPEN_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    open: OpenMap
    frame: Frame
    def __init__(self, open: _Optional[_Union[OpenMap, _Mapping]] = ..., frame: _Optional[_Union[Frame, _Mapping]] = ...) -> None: ...

class OpenMap(_message.Message):
    __slots__ = ("map", "intrinsics", "depth_unit_metres", "pose_source", "label_texts", "distortion", "depth_camera", "min_depth_metres", "max_depth_metres", "no_depth", "up")
    MAP_FIELD_NUMBER: _ClassVar[int]
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_UNIT_METRES_FIELD_NUMBER: _ClassVar[int]
    POSE_SOURCE_FIELD_NUMBER: _ClassVar[int]
    LABEL_TEXTS_FIELD_NUMBER: _ClassVar[int]
    DISTORTION_FIELD_NUMBER: _ClassVar[int]
    DEPTH_CAMERA_FIELD_NUMBER: _ClassVar[int]
    MIN_DEPTH_METRES_FIELD_NUMBER: _ClassVar[int]
    MAX_DEPTH_METRES_FIELD_NUMBER: _ClassVar[int]
    NO_DEPTH_FIELD_NUMBER: _ClassVar[int]
    UP_FIELD_NUMBER: _ClassVar[int]
    map: str
    intrinsics: Intrinsics
    depth_unit_metres: float
    pose_source: PoseSource
    label_texts: _containers.RepeatedScalarFieldContainer[str]
    distortion: Distortion
    depth_camera: DepthCamera
    min_depth_metres: float
    max_depth_metres: float
    no_depth: _containers.RepeatedScalarFieldContainer[int]
    up: Vector3
    def __init__(self, map: _Optional[str] = ..., intrinsics: _Optional[_Union[Intrinsics, _Mapping]] = ..., depth_unit_metres: _Optional[float] = ..., pose_source: _Optional[_Union[PoseSource, str]] = ..., label_texts: _Optional[_Iterable[str]] = ..., distortion: _Optional[_Union[Distortion, _Mapping]] = ..., depth_camera: _Optional[_Union[DepthCamera, _Mapping]] = ..., min_depth_metres: _Optional[float] = ..., max_depth_metres: _Optional[float] = ..., no_depth: _Optional[_Iterable[int]] = ..., up: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class Frame(_message.Message):
    __slots__ = ("sequence", "timestamp_nanos", "color_format", "color", "depth_format", "depth", "world_from_camera", "pose_covariance", "label_format", "labels", "held_out", "intrinsics", "depth_timestamp_nanos", "up")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    TIMESTAMP_NANOS_FIELD_NUMBER: _ClassVar[int]
    COLOR_FORMAT_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FORMAT_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    POSE_COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    LABEL_FORMAT_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    HELD_OUT_FIELD_NUMBER: _ClassVar[int]
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_TIMESTAMP_NANOS_FIELD_NUMBER: _ClassVar[int]
    UP_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    timestamp_nanos: int
    color_format: ColorFormat
    color: bytes
    depth_format: DepthFormat
    depth: bytes
    world_from_camera: Pose
    pose_covariance: _containers.RepeatedScalarFieldContainer[float]
    label_format: LabelFormat
    labels: bytes
    held_out: bool
    intrinsics: Intrinsics
    depth_timestamp_nanos: int
    up: Vector3
    def __init__(self, sequence: _Optional[int] = ..., timestamp_nanos: _Optional[int] = ..., color_format: _Optional[_Union[ColorFormat, str]] = ..., color: _Optional[bytes] = ..., depth_format: _Optional[_Union[DepthFormat, str]] = ..., depth: _Optional[bytes] = ..., world_from_camera: _Optional[_Union[Pose, _Mapping]] = ..., pose_covariance: _Optional[_Iterable[float]] = ..., label_format: _Optional[_Union[LabelFormat, str]] = ..., labels: _Optional[bytes] = ..., held_out: bool = ..., intrinsics: _Optional[_Union[Intrinsics, _Mapping]] = ..., depth_timestamp_nanos: _Optional[int] = ..., up: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class InputWarning(_message.Message):
    __slots__ = ("problem", "message")
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    problem: InputProblem
    message: str
    def __init__(self, problem: _Optional[_Union[InputProblem, str]] = ..., message: _Optional[str] = ...) -> None: ...

class FrameAck(_message.Message):
    __slots__ = ("sequence", "status", "refused_field", "refused_reason", "durable_through", "world_from_camera", "keyframe", "map_revision", "queue_depth", "queue_capacity", "received_through", "input_warnings", "pose_covariance", "camera")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FIELD_FIELD_NUMBER: _ClassVar[int]
    REFUSED_REASON_FIELD_NUMBER: _ClassVar[int]
    DURABLE_THROUGH_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    MAP_REVISION_FIELD_NUMBER: _ClassVar[int]
    QUEUE_DEPTH_FIELD_NUMBER: _ClassVar[int]
    QUEUE_CAPACITY_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_THROUGH_FIELD_NUMBER: _ClassVar[int]
    INPUT_WARNINGS_FIELD_NUMBER: _ClassVar[int]
    POSE_COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    status: FrameStatus
    refused_field: str
    refused_reason: str
    durable_through: int
    world_from_camera: Pose
    keyframe: bool
    map_revision: int
    queue_depth: int
    queue_capacity: int
    received_through: int
    input_warnings: _containers.RepeatedCompositeFieldContainer[InputWarning]
    pose_covariance: _containers.RepeatedScalarFieldContainer[float]
    camera: Intrinsics
    def __init__(self, sequence: _Optional[int] = ..., status: _Optional[_Union[FrameStatus, str]] = ..., refused_field: _Optional[str] = ..., refused_reason: _Optional[str] = ..., durable_through: _Optional[int] = ..., world_from_camera: _Optional[_Union[Pose, _Mapping]] = ..., keyframe: bool = ..., map_revision: _Optional[int] = ..., queue_depth: _Optional[int] = ..., queue_capacity: _Optional[int] = ..., received_through: _Optional[int] = ..., input_warnings: _Optional[_Iterable[_Union[InputWarning, _Mapping]]] = ..., pose_covariance: _Optional[_Iterable[float]] = ..., camera: _Optional[_Union[Intrinsics, _Mapping]] = ...) -> None: ...

class CreateMapRequest(_message.Message):
    __slots__ = ("name",)
    NAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    def __init__(self, name: _Optional[str] = ...) -> None: ...

class GetMapRequest(_message.Message):
    __slots__ = ("name",)
    NAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    def __init__(self, name: _Optional[str] = ...) -> None: ...

class ListMapsRequest(_message.Message):
    __slots__ = ("limit", "after")
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    limit: int
    after: str
    def __init__(self, limit: _Optional[int] = ..., after: _Optional[str] = ...) -> None: ...

class ListMapsResponse(_message.Message):
    __slots__ = ("maps", "next")
    MAPS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    maps: _containers.RepeatedCompositeFieldContainer[MapStatus]
    next: str
    def __init__(self, maps: _Optional[_Iterable[_Union[MapStatus, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...

class RenameMapRequest(_message.Message):
    __slots__ = ("name", "new_name")
    NAME_FIELD_NUMBER: _ClassVar[int]
    NEW_NAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    new_name: str
    def __init__(self, name: _Optional[str] = ..., new_name: _Optional[str] = ...) -> None: ...

class RenameMapResponse(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class DeleteMapRequest(_message.Message):
    __slots__ = ("name",)
    NAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    def __init__(self, name: _Optional[str] = ...) -> None: ...

class DeleteMapResponse(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class MapStatus(_message.Message):
    __slots__ = ("name", "revision", "frames_received", "frames_tracked", "frames_lost", "frames_dropped", "frames_refused", "keyframes", "gaussians", "gpu_bytes", "tracking_state", "olae_version", "queue_depth", "settled", "failure", "keyframe_bytes", "recording_damage", "input_warnings", "loading", "up", "refinement")
    NAME_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    FRAMES_RECEIVED_FIELD_NUMBER: _ClassVar[int]
    FRAMES_TRACKED_FIELD_NUMBER: _ClassVar[int]
    FRAMES_LOST_FIELD_NUMBER: _ClassVar[int]
    FRAMES_DROPPED_FIELD_NUMBER: _ClassVar[int]
    FRAMES_REFUSED_FIELD_NUMBER: _ClassVar[int]
    KEYFRAMES_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    GPU_BYTES_FIELD_NUMBER: _ClassVar[int]
    TRACKING_STATE_FIELD_NUMBER: _ClassVar[int]
    OLAE_VERSION_FIELD_NUMBER: _ClassVar[int]
    QUEUE_DEPTH_FIELD_NUMBER: _ClassVar[int]
    SETTLED_FIELD_NUMBER: _ClassVar[int]
    FAILURE_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_BYTES_FIELD_NUMBER: _ClassVar[int]
    RECORDING_DAMAGE_FIELD_NUMBER: _ClassVar[int]
    INPUT_WARNINGS_FIELD_NUMBER: _ClassVar[int]
    LOADING_FIELD_NUMBER: _ClassVar[int]
    UP_FIELD_NUMBER: _ClassVar[int]
    REFINEMENT_FIELD_NUMBER: _ClassVar[int]
    name: str
    revision: int
    frames_received: int
    frames_tracked: int
    frames_lost: int
    frames_dropped: int
    frames_refused: int
    keyframes: int
    gaussians: int
    gpu_bytes: int
    tracking_state: str
    olae_version: int
    queue_depth: int
    settled: bool
    failure: str
    keyframe_bytes: int
    recording_damage: str
    input_warnings: _containers.RepeatedCompositeFieldContainer[InputWarning]
    loading: LoadProgress
    up: MapUp
    refinement: str
    def __init__(self, name: _Optional[str] = ..., revision: _Optional[int] = ..., frames_received: _Optional[int] = ..., frames_tracked: _Optional[int] = ..., frames_lost: _Optional[int] = ..., frames_dropped: _Optional[int] = ..., frames_refused: _Optional[int] = ..., keyframes: _Optional[int] = ..., gaussians: _Optional[int] = ..., gpu_bytes: _Optional[int] = ..., tracking_state: _Optional[str] = ..., olae_version: _Optional[int] = ..., queue_depth: _Optional[int] = ..., settled: bool = ..., failure: _Optional[str] = ..., keyframe_bytes: _Optional[int] = ..., recording_damage: _Optional[str] = ..., input_warnings: _Optional[_Iterable[_Union[InputWarning, _Mapping]]] = ..., loading: _Optional[_Union[LoadProgress, _Mapping]] = ..., up: _Optional[_Union[MapUp, _Mapping]] = ..., refinement: _Optional[str] = ...) -> None: ...

class MapUp(_message.Message):
    __slots__ = ("direction", "source", "confidence")
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    direction: Vector3
    source: str
    confidence: float
    def __init__(self, direction: _Optional[_Union[Vector3, _Mapping]] = ..., source: _Optional[str] = ..., confidence: _Optional[float] = ...) -> None: ...

class LoadProgress(_message.Message):
    __slots__ = ("frames_done", "frames_total")
    FRAMES_DONE_FIELD_NUMBER: _ClassVar[int]
    FRAMES_TOTAL_FIELD_NUMBER: _ClassVar[int]
    frames_done: int
    frames_total: int
    def __init__(self, frames_done: _Optional[int] = ..., frames_total: _Optional[int] = ...) -> None: ...

class View(_message.Message):
    __slots__ = ("frame", "camera")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    frame: int
    camera: CameraView
    def __init__(self, frame: _Optional[int] = ..., camera: _Optional[_Union[CameraView, _Mapping]] = ...) -> None: ...

class CameraView(_message.Message):
    __slots__ = ("intrinsics", "world_from_camera")
    INTRINSICS_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    intrinsics: Intrinsics
    world_from_camera: Pose
    def __init__(self, intrinsics: _Optional[_Union[Intrinsics, _Mapping]] = ..., world_from_camera: _Optional[_Union[Pose, _Mapping]] = ...) -> None: ...

class QueryRequest(_message.Message):
    __slots__ = ("map", "text", "negatives", "view", "outputs", "threshold", "smoothing_pixels", "max_objects", "texts", "near_metres", "within", "wait", "min_sequence", "wait_seconds")
    MAP_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    NEGATIVES_FIELD_NUMBER: _ClassVar[int]
    VIEW_FIELD_NUMBER: _ClassVar[int]
    OUTPUTS_FIELD_NUMBER: _ClassVar[int]
    THRESHOLD_FIELD_NUMBER: _ClassVar[int]
    SMOOTHING_PIXELS_FIELD_NUMBER: _ClassVar[int]
    MAX_OBJECTS_FIELD_NUMBER: _ClassVar[int]
    TEXTS_FIELD_NUMBER: _ClassVar[int]
    NEAR_METRES_FIELD_NUMBER: _ClassVar[int]
    WITHIN_FIELD_NUMBER: _ClassVar[int]
    WAIT_FIELD_NUMBER: _ClassVar[int]
    MIN_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    WAIT_SECONDS_FIELD_NUMBER: _ClassVar[int]
    map: str
    text: str
    negatives: _containers.RepeatedScalarFieldContainer[str]
    view: View
    outputs: _containers.RepeatedScalarFieldContainer[str]
    threshold: float
    smoothing_pixels: int
    max_objects: int
    texts: _containers.RepeatedScalarFieldContainer[str]
    near_metres: Vector3
    within: Bounds
    wait: str
    min_sequence: int
    wait_seconds: float
    def __init__(self, map: _Optional[str] = ..., text: _Optional[str] = ..., negatives: _Optional[_Iterable[str]] = ..., view: _Optional[_Union[View, _Mapping]] = ..., outputs: _Optional[_Iterable[str]] = ..., threshold: _Optional[float] = ..., smoothing_pixels: _Optional[int] = ..., max_objects: _Optional[int] = ..., texts: _Optional[_Iterable[str]] = ..., near_metres: _Optional[_Union[Vector3, _Mapping]] = ..., within: _Optional[_Union[Bounds, _Mapping]] = ..., wait: _Optional[str] = ..., min_sequence: _Optional[int] = ..., wait_seconds: _Optional[float] = ...) -> None: ...

class Bounds(_message.Message):
    __slots__ = ("min_metres", "max_metres")
    MIN_METRES_FIELD_NUMBER: _ClassVar[int]
    MAX_METRES_FIELD_NUMBER: _ClassVar[int]
    min_metres: Vector3
    max_metres: Vector3
    def __init__(self, min_metres: _Optional[_Union[Vector3, _Mapping]] = ..., max_metres: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class QueryResponse(_message.Message):
    __slots__ = ("query_id", "text", "map", "revision", "present", "confidence", "coverage", "threshold", "heatmap", "mask", "boxes", "peak", "points", "objects", "timing", "segmentation", "through", "settled", "converged", "left_out", "understood", "reason", "uncertainty")
    QUERY_ID_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    MAP_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    PRESENT_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    COVERAGE_FIELD_NUMBER: _ClassVar[int]
    THRESHOLD_FIELD_NUMBER: _ClassVar[int]
    HEATMAP_FIELD_NUMBER: _ClassVar[int]
    MASK_FIELD_NUMBER: _ClassVar[int]
    BOXES_FIELD_NUMBER: _ClassVar[int]
    PEAK_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    TIMING_FIELD_NUMBER: _ClassVar[int]
    SEGMENTATION_FIELD_NUMBER: _ClassVar[int]
    THROUGH_FIELD_NUMBER: _ClassVar[int]
    SETTLED_FIELD_NUMBER: _ClassVar[int]
    CONVERGED_FIELD_NUMBER: _ClassVar[int]
    LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    UNDERSTOOD_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_FIELD_NUMBER: _ClassVar[int]
    query_id: str
    text: str
    map: str
    revision: int
    present: bool
    confidence: float
    coverage: float
    threshold: float
    heatmap: Heatmap
    mask: Mask
    boxes: _containers.RepeatedCompositeFieldContainer[Box]
    peak: Peak
    points: PointSet
    objects: _containers.RepeatedCompositeFieldContainer[Object]
    timing: Timing
    segmentation: Segmentation
    through: int
    settled: bool
    converged: bool
    left_out: _containers.RepeatedScalarFieldContainer[str]
    understood: Understood
    reason: str
    uncertainty: Heatmap
    def __init__(self, query_id: _Optional[str] = ..., text: _Optional[str] = ..., map: _Optional[str] = ..., revision: _Optional[int] = ..., present: bool = ..., confidence: _Optional[float] = ..., coverage: _Optional[float] = ..., threshold: _Optional[float] = ..., heatmap: _Optional[_Union[Heatmap, _Mapping]] = ..., mask: _Optional[_Union[Mask, _Mapping]] = ..., boxes: _Optional[_Iterable[_Union[Box, _Mapping]]] = ..., peak: _Optional[_Union[Peak, _Mapping]] = ..., points: _Optional[_Union[PointSet, _Mapping]] = ..., objects: _Optional[_Iterable[_Union[Object, _Mapping]]] = ..., timing: _Optional[_Union[Timing, _Mapping]] = ..., segmentation: _Optional[_Union[Segmentation, _Mapping]] = ..., through: _Optional[int] = ..., settled: bool = ..., converged: bool = ..., left_out: _Optional[_Iterable[str]] = ..., understood: _Optional[_Union[Understood, _Mapping]] = ..., reason: _Optional[str] = ..., uncertainty: _Optional[_Union[Heatmap, _Mapping]] = ...) -> None: ...

class Understood(_message.Message):
    __slots__ = ("object", "attributes", "relation", "others")
    OBJECT_FIELD_NUMBER: _ClassVar[int]
    ATTRIBUTES_FIELD_NUMBER: _ClassVar[int]
    RELATION_FIELD_NUMBER: _ClassVar[int]
    OTHERS_FIELD_NUMBER: _ClassVar[int]
    object: str
    attributes: _containers.RepeatedScalarFieldContainer[str]
    relation: str
    others: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, object: _Optional[str] = ..., attributes: _Optional[_Iterable[str]] = ..., relation: _Optional[str] = ..., others: _Optional[_Iterable[str]] = ...) -> None: ...

class Segmentation(_message.Message):
    __slots__ = ("legend", "image", "points")
    LEGEND_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    legend: _containers.RepeatedCompositeFieldContainer[LegendEntry]
    image: LabelImage
    points: LabelledPoints
    def __init__(self, legend: _Optional[_Iterable[_Union[LegendEntry, _Mapping]]] = ..., image: _Optional[_Union[LabelImage, _Mapping]] = ..., points: _Optional[_Union[LabelledPoints, _Mapping]] = ...) -> None: ...

class LegendEntry(_message.Message):
    __slots__ = ("label", "text", "share")
    LABEL_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    SHARE_FIELD_NUMBER: _ClassVar[int]
    label: int
    text: str
    share: float
    def __init__(self, label: _Optional[int] = ..., text: _Optional[str] = ..., share: _Optional[float] = ...) -> None: ...

class LabelImage(_message.Message):
    __slots__ = ("width", "height", "labels")
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    width: int
    height: int
    labels: bytes
    def __init__(self, width: _Optional[int] = ..., height: _Optional[int] = ..., labels: _Optional[bytes] = ...) -> None: ...

class LabelledPoints(_message.Message):
    __slots__ = ("count", "rows", "labels")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    count: int
    rows: _containers.RepeatedScalarFieldContainer[float]
    labels: bytes
    def __init__(self, count: _Optional[int] = ..., rows: _Optional[_Iterable[float]] = ..., labels: _Optional[bytes] = ...) -> None: ...

class Heatmap(_message.Message):
    __slots__ = ("width", "height", "min", "max", "values")
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    MAX_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    width: int
    height: int
    min: float
    max: float
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, width: _Optional[int] = ..., height: _Optional[int] = ..., min: _Optional[float] = ..., max: _Optional[float] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class Mask(_message.Message):
    __slots__ = ("height", "width", "counts")
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    height: int
    width: int
    counts: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, height: _Optional[int] = ..., width: _Optional[int] = ..., counts: _Optional[_Iterable[int]] = ...) -> None: ...

class Box(_message.Message):
    __slots__ = ("x", "y", "width", "height", "score")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    width: float
    height: float
    score: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., width: _Optional[float] = ..., height: _Optional[float] = ..., score: _Optional[float] = ...) -> None: ...

class Peak(_message.Message):
    __slots__ = ("x", "y", "score")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    score: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., score: _Optional[float] = ...) -> None: ...

class PointSet(_message.Message):
    __slots__ = ("count", "rows")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    count: int
    rows: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, count: _Optional[int] = ..., rows: _Optional[_Iterable[float]] = ...) -> None: ...

class Object(_message.Message):
    __slots__ = ("score", "center_metres", "size_metres", "rotation", "aabb_min_metres", "aabb_max_metres", "points", "distance_metres", "confidence")
    SCORE_FIELD_NUMBER: _ClassVar[int]
    CENTER_METRES_FIELD_NUMBER: _ClassVar[int]
    SIZE_METRES_FIELD_NUMBER: _ClassVar[int]
    ROTATION_FIELD_NUMBER: _ClassVar[int]
    AABB_MIN_METRES_FIELD_NUMBER: _ClassVar[int]
    AABB_MAX_METRES_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_METRES_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    score: float
    center_metres: Vector3
    size_metres: Vector3
    rotation: Quaternion
    aabb_min_metres: Vector3
    aabb_max_metres: Vector3
    points: int
    distance_metres: float
    confidence: float
    def __init__(self, score: _Optional[float] = ..., center_metres: _Optional[_Union[Vector3, _Mapping]] = ..., size_metres: _Optional[_Union[Vector3, _Mapping]] = ..., rotation: _Optional[_Union[Quaternion, _Mapping]] = ..., aabb_min_metres: _Optional[_Union[Vector3, _Mapping]] = ..., aabb_max_metres: _Optional[_Union[Vector3, _Mapping]] = ..., points: _Optional[int] = ..., distance_metres: _Optional[float] = ..., confidence: _Optional[float] = ...) -> None: ...

class Timing(_message.Message):
    __slots__ = ("text_ms", "render_ms", "decode_ms", "score_ms", "total_ms")
    TEXT_MS_FIELD_NUMBER: _ClassVar[int]
    RENDER_MS_FIELD_NUMBER: _ClassVar[int]
    DECODE_MS_FIELD_NUMBER: _ClassVar[int]
    SCORE_MS_FIELD_NUMBER: _ClassVar[int]
    TOTAL_MS_FIELD_NUMBER: _ClassVar[int]
    text_ms: float
    render_ms: float
    decode_ms: float
    score_ms: float
    total_ms: float
    def __init__(self, text_ms: _Optional[float] = ..., render_ms: _Optional[float] = ..., decode_ms: _Optional[float] = ..., score_ms: _Optional[float] = ..., total_ms: _Optional[float] = ...) -> None: ...

class ExportRequest(_message.Message):
    __slots__ = ("map", "format", "voxel_metres", "text", "up", "wait", "min_sequence", "wait_seconds")
    MAP_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    VOXEL_METRES_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    UP_FIELD_NUMBER: _ClassVar[int]
    WAIT_FIELD_NUMBER: _ClassVar[int]
    MIN_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    WAIT_SECONDS_FIELD_NUMBER: _ClassVar[int]
    map: str
    format: str
    voxel_metres: float
    text: str
    up: str
    wait: str
    min_sequence: int
    wait_seconds: float
    def __init__(self, map: _Optional[str] = ..., format: _Optional[str] = ..., voxel_metres: _Optional[float] = ..., text: _Optional[str] = ..., up: _Optional[str] = ..., wait: _Optional[str] = ..., min_sequence: _Optional[int] = ..., wait_seconds: _Optional[float] = ...) -> None: ...

class Chunk(_message.Message):
    __slots__ = ("data",)
    DATA_FIELD_NUMBER: _ClassVar[int]
    data: bytes
    def __init__(self, data: _Optional[bytes] = ...) -> None: ...
