//! Gaussians that move with their owners: the picture from the moved camera stays, and owners follow
//! their Gaussians through training, pruning and sorting.

use super::map;
use crate::support;
use crate::training::{DATA, Targets};

use lexsplat_gpu::{Camera, Gaussians, HostGaussians, LearningRates, Renderer, Trainer};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

const CHANNELS: usize = 6;

fn motion() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.5, 0.2));
    Isometry3::from_parts(Translation3::new(0.4, -0.7, 0.2), turn)
}

fn pictures(renderer: &mut Renderer, map: &Gaussians, camera: &Camera) -> Vec<f32> {
    let color = renderer.render_color(map, camera).expect("renders");
    let language = renderer.render_language(map, camera).expect("renders");
    [color.rgb, color.depth, color.opacity, language.codes, language.opacity].concat()
}

fn worst(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_map_moved_with_its_camera_looks_the_same() {
    let gpu = support::gpu();
    let mut gaussians = map(&gpu, &support::scene(5, 400, CHANNELS, 0.06));
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = support::camera(61, 47);
    let camera_from_world = camera.camera_from_world * motion().inverse().cast::<f32>();
    let moved_camera = Camera { camera_from_world, ..camera.clone() };
    let before = pictures(&mut renderer, &gaussians, &camera);
    let left_behind = pictures(&mut renderer, &gaussians, &moved_camera);
    gaussians.move_with_owners(|_| Some(motion())).expect("moves");
    let after = pictures(&mut renderer, &gaussians, &moved_camera);
    // Measured 4e-5 (llvmpipe); depths reach 4 m.
    assert!(worst(&before, &after) < 5e-4, "{}", worst(&before, &after));
    assert!(worst(&before, &left_behind) > 0.1, "Gaussians that stay behind must show");
}

/// Two owners' Gaussians; those of the second have a language feature of 1, the others of 0.
fn two_owners(gpu: &lexsplat_gpu::Gpu) -> Gaussians {
    let mut gaussians = Gaussians::new(gpu, CHANNELS);
    for owner in [1, 2] {
        let mut scene = support::scene(7 + u64::from(owner), 150, CHANNELS, 0.05);
        scene.language.features.fill(owner as f32 - 1.0);
        scene.color.opacity_logits.iter_mut().step_by(3).for_each(|logit| *logit = -9.0);
        scene.language.opacity_logits.iter_mut().step_by(3).for_each(|logit| *logit = -9.0);
        gaussians.set_owner(owner).expect("a small number");
        gaussians.append(&scene).expect("fits");
    }
    gaussians
}

#[test]
fn an_owner_stays_with_its_gaussians() {
    let gpu = support::gpu();
    let mut gaussians = two_owners(&gpu);
    let targets = Targets::new(&gpu, &support::scene(8, 150, CHANNELS, 0.05));
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    for _ in 0..5 {
        let view = targets.view(true, false);
        trainer.step(&mut gaussians, &view, &DATA, &LearningRates::default()).expect("steps");
    }
    trainer.settle(&mut gaussians).expect("settles");
    assert_eq!(gaussians.prune(0.01).expect("prunes"), 100);
    gaussians.reorder_morton().expect("sorts");
    let before = gaussians.to_host().expect("reads");
    gaussians.move_with_owners(|owner| (owner == 2).then(motion)).expect("moves");
    let after = gaussians.to_host().expect("reads");
    let is_second = |host: &HostGaussians, i: usize| host.language.features[i * CHANNELS] == 1.0;
    let mut moved = 0;
    for i in 0..after.len() {
        let changed = [
            before.means[i] != after.means[i],
            before.color.rotations[i] != after.color.rotations[i],
            before.language.rotations[i] != after.language.rotations[i],
        ];
        assert_eq!(changed, [is_second(&before, i); 3], "Gaussian {i}");
        moved += usize::from(changed[0]);
    }
    assert_eq!((moved, after.len()), (100, 200));
    assert_eq!(before.color.log_scales, after.color.log_scales, "sizes stay");
}

#[test]
fn an_owner_that_a_float_cannot_hold_is_refused() {
    let gpu = support::gpu();
    let mut gaussians = Gaussians::new(&gpu, CHANNELS);
    assert!(gaussians.set_owner(1 << 24).is_ok());
    assert!(gaussians.set_owner((1 << 24) + 1).is_err());
}
