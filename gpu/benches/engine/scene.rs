//! What a trained map looks like to a camera: most Gaussians lie on the surface that is seen, flat
//! and spaced as densely as their number allows, the others on what it hides.

use lexsplat_gpu::{Camera, HostGaussians, HostHead};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Share of the Gaussians on the surface that is seen.
const IN_FRONT: f32 = 0.7;
/// The picture and a tenth more on each side: not all are in view.
const MARGIN: f32 = 0.1;
/// Standard deviation along the surface in units of the spacing, and across it.
const SPREAD: [f32; 2] = [0.6, 0.15];

/// A camera with the field of view of the Replica sequences.
pub fn camera(width: u32, height: u32) -> Camera {
    let focal = width as f32 / 2.0;
    Camera {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: 0.5 * (width - 1) as f32,
        cy: 0.5 * (height - 1) as f32,
        camera_from_world: Isometry3::identity(),
    }
}

/// `count` Gaussians before [`camera`].
pub fn scene(count: usize, channels: usize) -> HostGaussians {
    let camera = camera(1200, 680);
    let (width, height) = (camera.width as f32, camera.height as f32);
    let rng = &mut ChaCha8Rng::seed_from_u64(count as u64);
    let side = 1.0 + 2.0 * MARGIN;
    let spacing = (width * height * side * side / (IN_FRONT * count as f32)).sqrt();
    let mut scene = HostGaussians {
        color: HostHead { channels: 3, ..HostHead::default() },
        language: HostHead { channels, ..HostHead::default() },
        ..HostGaussians::default()
    };
    for _ in 0..count {
        let mut along = |size: f32| size * (rng.random_range(0.0..side) - MARGIN);
        let (u, v) = (along(width), along(height));
        let wave = (u / width * 9.0).sin() * (v / height * 7.0).cos();
        let hidden = rng.random_range(0.0..1.0f32) > IN_FRONT;
        let behind = if hidden { rng.random_range(0.2..1.5f32) } else { 0.0 };
        let depth = 2.5 + 0.8 * wave + behind;
        scene.means.push(camera.unproject(u, v, depth).into());
        let rotation = std::array::from_fn(|i| f32::from(i == 0) + rng.random_range(-0.3..0.3f32));
        let unit = spacing * depth / camera.fx;
        let [wide, thin] = SPREAD;
        let log_scale =
            [wide, wide, thin].map(|share| (unit * share * rng.random_range(0.6f32..1.6)).ln());
        for head in [&mut scene.color, &mut scene.language] {
            head.rotations.push(rotation);
            head.log_scales.push(log_scale);
            head.opacity_logits.push(rng.random_range(-1.5f32..4.0));
            head.features.extend((0..head.channels).map(|_| rng.random_range(0.0f32..1.0)));
        }
    }
    scene
}
