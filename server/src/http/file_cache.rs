//! The last exported file.

use super::range::Tagged;
use crate::export::Format;
use crate::pipeline::snapshot::MapSnapshot;
use std::sync::{Arc, Mutex, Weak};
use utoipa::IntoParams;

/// The options of a file in the query string.
#[derive(Clone, Debug, Default, PartialEq, IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct ExportOptions {
    /// mesh.ply: side of a voxel, 0.002 to 1 metre; 0.02 if absent.
    pub(super) voxel_metres: Option<f32>,
    /// mesh.ply: a text; its relevancy becomes a property of the vertices.
    pub(super) text: Option<String>,
    /// The axis of the file that points up: x, y, z, -x, -y or -z. The map is turned about its origin.
    /// "map": its own coordinates. If absent, y for splats.glb, as glTF demands, and "map" for all others.
    pub(super) up: Option<String>,
}

/// The last exported file: a client that fetches a file in parts gets all parts from one export.
#[derive(Default)]
pub(super) struct FileCache(Mutex<Option<Exported>>);

/// An exported file with its snapshot and options.
pub(super) struct Exported {
    pub(super) snapshot: Weak<MapSnapshot>,
    pub(super) format: Format,
    pub(super) options: ExportOptions,
    pub(super) file: Tagged,
}

impl FileCache {
    /// The file if it was exported from this snapshot with the same options.
    pub(super) fn get(
        &self,
        snapshot: &Arc<MapSnapshot>,
        format: Format,
        options: &ExportOptions,
    ) -> Option<Tagged> {
        let last = self.0.lock().expect("no thread panics while it holds the file");
        last.as_ref()
            .filter(|last| last.format == format && last.options == *options)
            .filter(|last| last.snapshot.ptr_eq(&Arc::downgrade(snapshot)))
            .map(|last| last.file.clone())
    }

    pub(super) fn put(&self, last: Exported) {
        *self.0.lock().expect("no thread panics while it holds the file") = Some(last);
    }
}
