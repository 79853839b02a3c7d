//! Moves a map to corrected poses: keyframes, with them the frames that were tracked relative to them, the
//! Gaussians that they inserted, and what the tracker expects.

use super::super::keyframes::Keyframe;
use super::parts::MapParts;
use lexsplat_gpu::GpuError;
use nalgebra::Isometry3;

/// Whether some pose is corrected by more than a distance, metres.
pub(super) fn is_worth_it(
    before: &[Isometry3<f64>],
    after: &[Isometry3<f64>],
    correction_metres: f64,
) -> bool {
    let moved = before.iter().zip(after).map(|(before, after)| {
        (after.translation.vector - before.translation.vector).norm()
            + before.rotation.angle_to(&after.rotation)
    });
    moved.fold(0.0, f64::max) > correction_metres
}

/// Moves everything from the poses `before` of all nodes to `after`. `newest` is the last node, which is not
/// in the store yet.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(super) fn apply(
    map: &mut MapParts<'_>,
    newest: &mut Keyframe,
    before: &[Isometry3<f64>],
    after: &[Isometry3<f64>],
) -> Result<(), GpuError> {
    let live = &mut *map.live;
    let motions: Vec<Isometry3<f64>> =
        before.iter().zip(after).map(|(before, after)| after * before.inverse()).collect();
    map.trainer.settle(&mut live.gaussians)?;
    live.gaussians.move_with_owners(|owner| motions.get(owner as usize).copied())?;
    let sequences: Vec<u64> = live.graph.sequences().collect();
    for (sequence, pose) in sequences.into_iter().zip(after) {
        live.keyframes.set_pose(sequence, pose);
    }
    if let (Some(pose), Some(motion)) = (after.last(), motions.last()) {
        newest.set_pose(pose);
        map.tracker.move_with_map(motion);
    }
    // The order in space is that of before.
    live.sorted_len = 0;
    // Seams need a few steps to heal.
    live.steps.earn();
    Ok(())
}
