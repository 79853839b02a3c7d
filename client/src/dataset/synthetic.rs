//! The synthetic room as a data set: frames are rendered when they are asked for.

use super::{
    Color, ColorFormat, Dataset, DatasetError, Depth, DepthFormat, Instance, Intrinsics, Mask,
    RgbdFrame, Truth, counted_nanos,
};
use crate::synthetic::write::{DEPTH_SCALE, depth_png, jpeg};
use crate::synthetic::{Camera, Room, View};
use nalgebra::Isometry3;

/// Length of the walk.
const FRAMES: usize = 150;
/// Pixels.
const SIZE: (u32, u32) = (320, 240);

/// A room and a walk through it.
pub(super) struct Synthetic {
    name: String,
    room: Room,
    camera: Camera,
    walk: Vec<Isometry3<f64>>,
    instances: Vec<Instance>,
}

impl Synthetic {
    pub(super) fn new(seed: u64) -> Self {
        let room = Room::new(seed);
        let instances = room
            .instances()
            .iter()
            .map(|instance| Instance {
                id: instance.id.into(),
                name: instance.name.clone(),
                class: instance.class.into(),
                aabb_min: instance.aabb_min,
                aabb_max: instance.aabb_max,
            })
            .collect();
        let (name, walk) = (format!("synthetic-{seed}"), room.path(FRAMES));
        Self { name, walk, instances, camera: Camera::new(SIZE.0, SIZE.1), room }
    }

    fn view(&self, index: usize) -> View {
        self.room.render(&self.camera, &self.walk[index])
    }
}

impl Dataset for Synthetic {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.walk.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        let Camera { width, height, fx, fy, cx, cy } = self.camera;
        Intrinsics { width, height, fx, fy, cx, cy }
    }

    fn depth_unit_metres(&self) -> f64 {
        1.0 / DEPTH_SCALE
    }

    fn sequence(&self, index: usize) -> u64 {
        index as u64
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let (view, sequence) = (self.view(index), index as u64);
        let failed = |source| DatasetError::Encode { sequence, source };
        Ok(RgbdFrame {
            sequence,
            timestamp_nanos: counted_nanos(sequence),
            color: Color { format: ColorFormat::Jpeg, bytes: jpeg(&view).map_err(failed)? },
            depth: Depth { format: DepthFormat::Png16, bytes: depth_png(&view).map_err(failed)? },
            world_from_camera: Some(self.walk[index]),
        })
    }

    fn truth(&self) -> Option<&dyn Truth> {
        Some(self)
    }
}

impl Truth for Synthetic {
    fn instances(&self) -> &[Instance] {
        &self.instances
    }

    fn mask(&self, index: usize) -> Result<Mask, DatasetError> {
        let View { width, height, instances, .. } = self.view(index);
        Ok(Mask { width, height, ids: instances.into_iter().map(u16::from).collect() })
    }
}
