//! Scenes for the tests: seeded, small, and the same on every machine.

use lexsplat_gpu::{Camera, Gpu, GpuError, HostGaussians, HostHead};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The adapter that the tests run on: the best one, or the one whose name contains `PROOF_ADAPTER` of
/// the environment. A machine without it must not look tested.
pub fn gpu() -> Gpu {
    opened(Gpu::new(adapter().as_deref()))
}

/// As [`gpu`], with a tier by name.
pub fn gpu_of_tier(tier: &str) -> Gpu {
    opened(Gpu::with_tier(adapter().as_deref(), tier))
}

fn adapter() -> Option<String> {
    std::env::var("PROOF_ADAPTER").ok()
}

fn opened(gpu: Result<Gpu, GpuError>) -> Gpu {
    gpu.unwrap_or_else(|error| panic!("these tests need a vulkan adapter: {error}"))
}

/// A camera a little off the origin that looks along +z.
pub fn camera(width: u32, height: u32) -> Camera {
    let focal = 0.9 * width as f32;
    Camera {
        width,
        height,
        fx: focal,
        fy: 1.05 * focal,
        cx: 0.49 * width as f32,
        cy: 0.52 * height as f32,
        camera_from_world: Isometry3::from_parts(
            Translation3::new(0.05, -0.03, 0.1),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.06, -0.04, 0.1)),
        ),
    }
}

/// `count` Gaussians before [`camera`]; `size` is their typical standard deviation, metres.
pub fn scene(seed: u64, count: usize, channels: usize, size: f32) -> HostGaussians {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let mut gaussians = HostGaussians {
        color: HostHead { channels: 3, ..HostHead::default() },
        language: HostHead { channels, ..HostHead::default() },
        ..HostGaussians::default()
    };
    for _ in 0..count {
        let z: f32 = rng.random_range(1.0..4.0);
        let mut side = || 0.6 * z * rng.random_range(-1.0f32..1.0);
        gaussians.means.push([side(), side(), z]);
        for head in [&mut gaussians.color, &mut gaussians.language] {
            head.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
            head.log_scales
                .push(std::array::from_fn(|_| (size * rng.random_range(0.4f32..2.0)).ln()));
            head.opacity_logits.push(rng.random_range(-2.0..3.0));
            head.features.extend((0..head.channels).map(|_| rng.random_range(0.0f32..1.0)));
        }
    }
    gaussians
}

/// The chosen Gaussians of a map, in the order of `index`.
pub fn pick(host: &HostGaussians, index: &[u32]) -> HostGaussians {
    let head = |head: &HostHead| HostHead {
        rotations: index.iter().map(|i| head.rotations[*i as usize]).collect(),
        log_scales: index.iter().map(|i| head.log_scales[*i as usize]).collect(),
        opacity_logits: index.iter().map(|i| head.opacity_logits[*i as usize]).collect(),
        features: index
            .iter()
            .flat_map(|i| &head.features[*i as usize * head.channels..][..head.channels])
            .copied()
            .collect(),
        channels: head.channels,
    };
    HostGaussians {
        means: index.iter().map(|i| host.means[*i as usize]).collect(),
        color: head(&host.color),
        language: head(&host.language),
    }
}
