//! Frames and cameras as messages of the protocol.

use crate::dataset::{Camera, DepthCamera, Distortion, Intrinsics, RgbdFrame};
use lexsplat_proto::v1;
use nalgebra::Isometry3;

/// A frame without labels.
pub(super) fn frame(frame: RgbdFrame) -> v1::Frame {
    let extras = frame.extras;
    v1::Frame {
        sequence: frame.sequence,
        timestamp_nanos: frame.timestamp_nanos,
        color_format: frame.color.format.into(),
        color: frame.color.bytes.into(),
        depth_format: frame.depth.format.into(),
        depth: frame.depth.bytes.into(),
        world_from_camera: frame.world_from_camera.as_ref().map(pose),
        intrinsics: extras.intrinsics.as_ref().map(intrinsics),
        depth_timestamp_nanos: extras.depth_timestamp_nanos.unwrap_or_default(),
        up: extras.up.map(vector),
        ..v1::Frame::default()
    }
}

pub(super) fn intrinsics(camera: &Intrinsics) -> v1::Intrinsics {
    let Intrinsics { width, height, fx, fy, cx, cy } = *camera;
    v1::Intrinsics { width, height, fx, fy, cx, cy }
}

pub(super) fn distortion(distortion: Distortion) -> Option<v1::Distortion> {
    let (model, coefficients) = match distortion {
        Distortion::None => return None,
        Distortion::BrownConrady(coefficients) => (v1::DistortionModel::BrownConrady, coefficients),
        Distortion::KannalaBrandt(coefficients) => {
            (v1::DistortionModel::KannalaBrandt, coefficients.to_vec())
        }
    };
    Some(v1::Distortion { model: model.into(), coefficients })
}

pub(super) fn depth_camera(camera: DepthCamera) -> v1::DepthCamera {
    match camera {
        DepthCamera::SameLens { width, height } => v1::DepthCamera {
            intrinsics: Some(v1::Intrinsics { width, height, ..v1::Intrinsics::default() }),
            ..v1::DepthCamera::default()
        },
        DepthCamera::Own {
            camera: Camera { intrinsics: own, distortion: lens },
            color_from_depth,
        } => v1::DepthCamera {
            intrinsics: Some(intrinsics(&own)),
            distortion: distortion(lens),
            color_from_depth: Some(pose(&color_from_depth)),
        },
    }
}

pub(super) fn vector([x, y, z]: [f64; 3]) -> v1::Vector3 {
    v1::Vector3 { x, y, z }
}

fn pose(target_from_source: &Isometry3<f64>) -> v1::Pose {
    let (q, t) = (target_from_source.rotation, target_from_source.translation);
    v1::Pose {
        rotation: Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k }),
        translation_metres: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
    }
}
