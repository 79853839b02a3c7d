//! The adapter's ceiling: a loop that only evaluates and blends.

use lexsplat_gpu::shader::layout::{ArrayArguments, Row, Splat};
use lexsplat_gpu::shader::{Access, Constant, GRID, Shader, TILE, Tiling};
use lexsplat_gpu::{Buffer, Gpu, GpuError, Kernel, Recorder};

use crate::best;

/// Pixels of the picture.
const PIXELS: usize = 600 * 340;
/// Gaussians per pixel.
const DEPTH: usize = 256;

/// Gaussians evaluated and blended at pixels, per second.
pub fn rate(gpu: &Gpu) -> Result<f64, GpuError> {
    let tiling = Tiling::of(gpu.tier());
    let [width, height] = tiling.size();
    let tile_pixels = (width * height) as usize;
    let tiles = PIXELS / tile_pixels;
    // Faint, so that no pixel fills up.
    let splat = |i: usize| Splat {
        place: [(i % 16) as f32, (i / 16) as f32, 0.05, 0.01],
        form: [0.05, -7.0, 1.0 + i as f32, 1.0],
        ..Splat::default()
    };
    let splats: Vec<Splat> = (0..DEPTH).map(splat).collect();
    let features: Vec<Row> = (0..DEPTH).map(|i| [i as f32, 1.0, 0.5, 2.0]).collect();
    let splats = Buffer::from_slice(gpu, "splats", &splats)?;
    let features = Buffer::from_slice(gpu, "features", &features)?;
    let image = Buffer::<Row>::new(gpu, "image", tiles * tiling.lanes as usize)?;
    let shader = Shader {
        label: "ceiling",
        entry: "main",
        parts: vec![GRID, tiling.part(), TILE, include_str!("ceiling.wgsl")],
        constants: [&tiling.constants(3, 0)[..], &[("DESCENDING", Constant::Bool(false))]].concat(),
        bindings: vec![Access::Read, Access::Read, Access::Write],
    };
    let kernel = Kernel::new(gpu, &shader)?;
    let arguments = ArrayArguments { count: DEPTH as u32, detail: tiles as u32 };
    let time = best(8, || {
        let mut recorder = Recorder::new(gpu)?;
        recorder.dispatch(&kernel, &arguments, &[&splats, &features, &image], tiles as u32);
        recorder.submit();
        image.read(gpu, 1).map(drop)
    })?;
    Ok((tiles * tile_pixels * DEPTH) as f64 / time.as_secs_f64())
}
