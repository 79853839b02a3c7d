//! Options of an exported mesh.

use super::question::about;
use super::refusal::Refusal;
use crate::export::MeshOptions;

/// Checks the text; the mesh shows its relevancy. The voxel size is checked where the mesh is
/// made.
///
/// # Errors
/// [`Refusal`] names `text`.
pub(crate) fn mesh_options(
    voxel_metres: Option<f32>,
    text: Option<&str>,
) -> Result<MeshOptions, Refusal> {
    Ok(MeshOptions { voxel_metres, question: text.map(about).transpose()? })
}
