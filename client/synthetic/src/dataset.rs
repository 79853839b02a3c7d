//! The synthetic room as a data set: frames are rendered when they are read.

use crate::camera::{Camera, View};
use crate::room::Room;
use crate::write::{DEPTH_SCALE, depth_png, jpeg};
use lexsplat_client::dataset::{
    Color, ColorFormat, Dataset, DatasetError, Depth, DepthFormat, Instance, Intrinsics, Mask,
    RgbdFrame, Truth, counted_nanos,
};
use nalgebra::Isometry3;

/// Number of frames of the walk.
const FRAMES: usize = 150;
/// Columns and rows, pixels.
const SIZE: (u32, u32) = (320, 240);

/// A room and a walk of 150 frames through it, 320x240 pixels.
#[derive(Debug)]
pub struct SyntheticDataset {
    name: String,
    room: Room,
    camera: Camera,
    walk: Vec<Isometry3<f64>>,
    instances: Vec<Instance>,
}

impl SyntheticDataset {
    /// The room of this seed.
    pub fn new(seed: u64) -> Self {
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
        })
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
        let View { width, height, instances, .. } = self.view(index);
        Ok(Mask { width, height, ids: instances.into_iter().map(u16::from).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::{Plan, write};
    use image::{DynamicImage, ImageBuffer, Luma};
    use lexsplat_client::dataset::Replica;

    fn units(depth: &Depth) -> ImageBuffer<Luma<u16>, Vec<u16>> {
        match image::load_from_memory(&depth.bytes).unwrap() {
            DynamicImage::ImageLuma16(units) => units,
            other => panic!("expected 16-bit grey, found {:?}", other.color()),
        }
    }

    #[test]
    fn a_written_room_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let camera = Camera::new(24, 16);
        write(folder.path(), &Plan { seed: 3, frames: 12, every: 4, camera }, |_| ()).unwrap();
        let dataset = Replica::open(folder.path()).unwrap();
        assert_eq!((dataset.len(), dataset.is_empty(), dataset.skipped().len()), (3, false, 0));
        assert_eq!((dataset.intrinsics().fx, dataset.intrinsics().width), (camera.fx, 24));
        assert_eq!(dataset.name(), folder.path().file_name().unwrap().to_str().unwrap());
        let room = Room::new(3);
        let pose = room.path(12)[8];
        let view = room.render(&camera, &pose);
        let frame = dataset.frame(2).unwrap();
        assert_eq!((frame.sequence, frame.timestamp_nanos), (2, 66_666_666));
        assert_eq!(frame.color.format, ColorFormat::Jpeg);
        let found = frame.world_from_camera.unwrap();
        assert!((found.translation.vector - pose.translation.vector).norm() < 1e-8);
        assert!(found.rotation.angle_to(&pose.rotation) < 1e-7);
        let unit = dataset.depth_unit_metres();
        for (units, metres) in units(&frame.depth).iter().zip(&view.depth) {
            assert!((f64::from(*units) * unit - f64::from(*metres)).abs() < unit);
        }
        let truth = dataset.truth().unwrap();
        let mask = truth.mask(2).unwrap();
        assert_eq!(mask.ids, view.instances.iter().map(|&id| id.into()).collect::<Vec<u16>>());
        assert_ne!(mask.ids, truth.mask(0).unwrap().ids);
        assert_eq!(truth.instances().len(), room.instances().len());
        let classes = truth.classes();
        assert!(classes.len() > 3 && !classes.contains(&"wall".into()), "{classes:?}");
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
