//! The frames of a data set that have a pose, for maps whose poses are given.

use super::error::DatasetError;
use super::part::Part;
use super::source::Dataset;

/// The frames that have a pose. The others are in [`Dataset::skipped`], each with its reason.
///
/// # Errors
/// [`DatasetError::NoPoses`] if none has one.
pub fn with_poses(dataset: Box<dyn Dataset>) -> Result<Box<dyn Dataset>, DatasetError> {
    let reasons: Vec<Option<String>> =
        (0..dataset.len()).map(|index| dataset.no_pose(index).map(str::to_owned)).collect();
    let Some(reason) = reasons.iter().flatten().next() else { return Ok(dataset) };
    let indices: Vec<usize> = (0..reasons.len()).filter(|&at| reasons[at].is_none()).collect();
    if indices.is_empty() {
        let (name, reason) = (dataset.name().to_owned(), reason.clone());
        return Err(DatasetError::NoPoses { name, reason });
    }
    let skipped = dataset.skipped().iter().cloned().chain(reasons.into_iter().flatten()).collect();
    Ok(Box::new(Part { dataset, indices, renumbered: false, skipped }))
}
