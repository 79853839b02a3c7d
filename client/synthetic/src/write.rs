//! Writes a data set as a folder in Replica layout: `results/frame%06d.jpg`,
//! `results/depth%06d.png` (16 bit, 6553.5 per metre for rooms), `semantic/%06d.png` (instance ids),
//! `instances.json`, `traj.txt` (world_from_camera, 4x4 row-major per line), `cam_params.json`.

use crate::camera::Camera;
use crate::dataset::{SyntheticDataset, Walk};
use crate::encode::ids_png;
use image::ImageError;
use lexsplat_client::dataset::{Dataset, DatasetError, FrameRange, Instance};
use nalgebra::Isometry3;
use serde_json::json;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// The folder to write.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Seed of the room.
    pub seed: u64,
    /// Number of frames of the walk.
    pub frames: usize,
    /// Every N-th frame of the walk is rendered.
    pub every: usize,
    /// The camera of every frame.
    pub camera: Camera,
}

/// A folder that could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A file cannot be written.
    #[error("cannot write {path}", path = path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// An image cannot be encoded.
    #[error("cannot encode a frame")]
    Encode(#[from] ImageError),
    /// A frame cannot be made.
    #[error(transparent)]
    Frame(#[from] DatasetError),
}

/// Renders and writes the walk; calls `progress` with the number of frames written so far.
///
/// # Errors
/// [`WriteError`] if a file cannot be written or an image cannot be encoded.
pub fn write(dir: &Path, plan: &Plan, progress: impl FnMut(usize)) -> Result<(), WriteError> {
    let Plan { seed, frames, every, camera } = *plan;
    let walk = Walk { seed, frames, camera, shake_radians: 0.0 };
    let stride = NonZeroUsize::new(every).unwrap_or(NonZeroUsize::MIN);
    let range = FrameRange { stride, ..FrameRange::default() };
    write_dataset(dir, &*range.of(Box::new(SyntheticDataset::of(&walk)))?, progress)
}

/// Writes the frames of a data set with poses and at most 255 objects; frames are numbered from 0.
///
/// # Errors
/// [`WriteError`] if a frame cannot be made or a file cannot be written.
pub fn write_dataset(
    dir: &Path,
    dataset: &dyn Dataset,
    mut progress: impl FnMut(usize),
) -> Result<(), WriteError> {
    for folder in ["results", "semantic"] {
        let path = dir.join(folder);
        std::fs::create_dir_all(&path).map_err(|source| WriteError::File { path, source })?;
    }
    let instances = dataset.truth().map_or(&[][..], |truth| truth.instances());
    put(&dir.join("instances.json"), instances_json(instances).to_string().as_bytes())?;
    let c = dataset.intrinsics();
    let camera = json!({"camera": {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy,
        "cx": c.cx, "cy": c.cy, "scale": 1.0 / dataset.depth_unit_metres()}});
    put(&dir.join("cam_params.json"), camera.to_string().as_bytes())?;
    let mut trajectory = String::new();
    for i in 0..dataset.len() {
        let frame = dataset.frame(i)?;
        let pose = frame.world_from_camera.unwrap_or_default();
        trajectory += &(matrix_line(&pose) + "\n");
        put(&dir.join(format!("results/frame{i:06}.jpg")), &frame.color.bytes)?;
        put(&dir.join(format!("results/depth{i:06}.png")), &frame.depth.bytes)?;
        if let Some(truth) = dataset.truth() {
            let mask = truth.mask(i)?;
            let ids: Vec<u8> = mask.ids.iter().map(|id| *id as u8).collect();
            let bytes = ids_png(mask.width, mask.height, &ids)?;
            put(&dir.join(format!("semantic/{i:06}.png")), &bytes)?;
        }
        progress(i + 1);
    }
    put(&dir.join("traj.txt"), trajectory.as_bytes())
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    std::fs::write(path, bytes)
        .map_err(|source| WriteError::File { path: path.to_path_buf(), source })
}

/// `world_from_camera` as sixteen numbers, row by row.
fn matrix_line(pose: &Isometry3<f64>) -> String {
    let m = pose.to_homogeneous();
    let numbers: Vec<String> = (0..16).map(|i| format!("{:.9}", m[(i / 4, i % 4)])).collect();
    numbers.join(" ")
}

fn instances_json(instances: &[Instance]) -> serde_json::Value {
    instances
        .iter()
        .map(|i| {
            json!({"id": i.id, "name": i.name, "class": i.class,
                "aabb_min": i.aabb_min, "aabb_max": i.aabb_max})
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::tests::units;
    use crate::room::Room;
    use lexsplat_client::dataset::{ColorFormat, Replica};

    #[test]
    fn a_written_room_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let camera = Camera::new(24, 16);
        write(folder.path(), &Plan { seed: 3, frames: 12, every: 4, camera }, |_| ()).unwrap();
        let dataset = Replica::open(folder.path()).unwrap();
        assert_eq!((dataset.len(), dataset.is_empty(), dataset.skipped().len()), (3, false, 0));
        assert_eq!((dataset.intrinsics().fx, dataset.intrinsics().width), (camera.fx, 24));
        let name = folder.path().file_name().unwrap().to_str().unwrap();
        assert_eq!(dataset.name(), name.trim_start_matches('.'));
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
}
