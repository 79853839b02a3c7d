//! One scene for two renderers: draws it, takes it back, and writes it where `gsplat.py` finds it,
//! with the picture, so that the other can show that it draws the same. `deploy/gpu-bench.sh` runs
//! both.

use std::path::Path;

use lexsplat_gpu::{Gaussians, Gpu, HostGaussians, Renderer};

use crate::{best, ms, scene};

/// Length of a code: as short as possible, since the other renderer has none.
const CHANNELS: usize = 1;

/// Prints times of forward and backward pass, on the host and, from timestamps, on the device.
/// Writes the scene of `count` Gaussians to `folder`.
pub fn print(
    gpu: &Gpu,
    folder: &Path,
    count: usize,
    size: (u32, u32),
) -> Result<(), Box<dyn std::error::Error>> {
    let camera = scene::camera(size.0, size.1);
    let host = scene::scene(count, CHANNELS);
    let mut gaussians = Gaussians::new(gpu, CHANNELS);
    gaussians.append(&host)?;
    let mut renderer = Renderer::new(gpu, CHANNELS)?;
    let image = renderer.render_color(&gaussians, &camera)?;
    let work = renderer.workload(&gaussians, &camera)?;
    // The gradient of the mean of all channels, as `gsplat.py` takes it.
    let ones = vec![[1.0 / (4 * camera.pixels()) as f32; 4]; camera.pixels()];
    println!("\none scene, {count} Gaussians at {} x {}; ms", size.0, size.1);
    println!("{:>28} {:>9} visible, {} hits", "", work.visible, work.hits);
    let forward = best(5, || renderer.draw_color(&gaussians, &camera).map(drop))?;
    println!("{:>28} {:>9.2}", "forward, host", ms(forward));
    renderer.color_gradients(&gaussians, &camera, &ones)?;
    gpu.start_profile();
    renderer.color_gradients(&gaussians, &camera, &ones)?;
    let profile = gpu.take_profile()?;
    let back = |label: &str| label.contains("back") || label.starts_with("collect");
    let time = |backward: bool| -> f64 {
        let kernels = profile.iter().filter(|kernel| back(kernel.label) == backward);
        kernels.map(|kernel| ms(kernel.time)).sum()
    };
    println!("{:>28} {:>9.2}", "forward, device", time(false));
    println!("{:>28} {:>9.2}", "backward, device", time(true));
    write(folder, &host, &camera, &image)?;
    Ok(())
}

fn write(
    folder: &Path,
    host: &HostGaussians,
    camera: &lexsplat_gpu::Camera,
    image: &lexsplat_gpu::ColorImage,
) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let file = |name: &str, values: &[f32]| {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        std::fs::write(folder.join(name), bytes)
    };
    file("means.f32", host.means.as_flattened())?;
    file("rotations.f32", host.color.rotations.as_flattened())?;
    file("log_scales.f32", host.color.log_scales.as_flattened())?;
    file("opacity_logits.f32", &host.color.opacity_logits)?;
    file("colors.f32", &host.color.features)?;
    file("rgb.f32", &image.rgb)?;
    file("depth.f32", &image.depth)?;
    let size = [camera.width as f32, camera.height as f32];
    file("camera.f32", &[size[0], size[1], camera.fx, camera.fy, camera.cx, camera.cy])
}
