//! The synthetic room as a data set: frames are rendered when they are read.

use crate::camera::{Camera, View};
use crate::encode::{DEPTH_SCALE, depth_png, jpeg};
use crate::room::Room;
use crate::shake::shaken;
use lexsplat_client::dataset::{
    Color, ColorFormat, Dataset, DatasetError, Depth, DepthFormat, FrameExtras, Instance,
    Intrinsics, Mask, Moment, RgbdFrame, Truth, counted_nanos,
};
use nalgebra::Isometry3;
use std::sync::{Arc, Mutex};

/// Number of frames of the walk.
const FRAMES: usize = 150;
/// Columns and rows, pixels.
const SIZE: (u32, u32) = (320, 240);

/// Which room, and how the camera goes through it.
#[derive(Clone, Copy, Debug)]
pub struct Walk {
    /// Seed of the room.
    pub seed: u64,
    /// Number of frames.
    pub frames: usize,
    /// The camera of every frame.
    pub camera: Camera,
    /// Root mean square of the camera's shaking about each of its axes, radians; 0: none.
    pub shake_radians: f64,
}

impl Walk {
    /// A walk of 150 frames, 320x240 pixels, without shaking.
    pub fn new(seed: u64) -> Self {
        let camera = Camera::new(SIZE.0, SIZE.1);
        Self { seed, frames: FRAMES, camera, shake_radians: 0.0 }
    }
}

/// A room and a walk through it.
#[derive(Debug)]
pub struct SyntheticDataset {
    name: String,
    room: Room,
    camera: Camera,
    walk: Vec<Isometry3<f64>>,
    instances: Vec<Instance>,
    shake_radians: f64,
    /// The view that was rendered last: picture and mask of a frame are read one after the other.
    last: Mutex<Option<(usize, Arc<View>)>>,
}

impl SyntheticDataset {
    /// The room of this seed and a walk of 150 frames, 320x240 pixels.
    pub fn new(seed: u64) -> Self {
        Self::of(&Walk::new(seed))
    }

    /// The room and the walk.
    pub fn of(walk: &Walk) -> Self {
        let Walk { seed, frames, camera, shake_radians } = *walk;
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
        let name = format!("synthetic-{seed}");
        let walk = shaken(room.path(frames), seed, shake_radians);
        Self { name, walk, instances, camera, room, shake_radians, last: Mutex::default() }
    }

    fn view(&self, index: usize) -> Arc<View> {
        let mut last = self.last.lock().expect("no thread panics while it holds this");
        match &*last {
            Some((at, view)) if *at == index => view.clone(),
            _ => {
                let view = Arc::new(self.room.render(&self.camera, &self.walk[index]));
                *last = Some((index, view.clone()));
                view
            }
        }
    }
}

impl Dataset for SyntheticDataset {
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
            extras: FrameExtras::default(),
        })
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let timestamp_nanos = counted_nanos(index as u64);
        Ok(Moment { timestamp_nanos, world_from_camera: Some(self.walk[index]) })
    }

    fn simulated(&self) -> Option<String> {
        let degrees = self.shake_radians.to_degrees();
        (degrees > 0.0).then(|| format!("camera shaken by {degrees:.2} degrees"))
    }

    fn truth(&self) -> Option<&dyn Truth> {
        Some(self)
    }
}

impl Truth for SyntheticDataset {
    fn instances(&self) -> &[Instance] {
        &self.instances
    }

    fn mask(&self, index: usize) -> Result<Mask, DatasetError> {
        let view = self.view(index);
        let ids = view.instances.iter().copied().map(u16::from).collect();
        Ok(Mask { width: view.width, height: view.height, ids })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use image::{DynamicImage, ImageBuffer, Luma};

    /// The depth image, in its units.
    pub fn units(depth: &Depth) -> ImageBuffer<Luma<u16>, Vec<u16>> {
        match image::load_from_memory(&depth.bytes).unwrap() {
            DynamicImage::ImageLuma16(units) => units,
            other => panic!("expected 16-bit grey, found {:?}", other.color()),
        }
    }

    #[test]
    fn the_data_set_is_rendered_when_it_is_read() {
        let dataset = SyntheticDataset::new(5);
        assert_eq!(
            (dataset.name(), dataset.len(), dataset.sequence(149)),
            ("synthetic-5", 150, 149)
        );
        let frame = dataset.frame(149).unwrap();
        assert_eq!(units(&frame.depth).dimensions(), (320, 240));
        let truth = dataset.truth().unwrap();
        let mask = truth.mask(149).unwrap();
        let known = |id: &u16| *id == 0 || truth.instances().iter().any(|i| i.id == *id);
        assert!(mask.ids.iter().all(known) && mask.ids.iter().any(|id| *id > 0));
    }
}
