//! A window of a picture shows what the whole picture shows there, also if its axis lies outside.

use crate::support;
use crate::training::map;

use lexsplat_gpu::{Camera, Gpu, HostGaussians, Renderer};

const CHANNELS: usize = 15;
/// Largest difference of a color, 0 to 1: 0.0021 on llvmpipe. Places in a window are other numbers, so that a
/// splat whose opacity at a pixel is just at the least one that is drawn may be drawn in one of the two only.
const TOLERANCE: f32 = 4e-3;

/// Splats that are long, thin and slanted: each one's bounding box has thousands of tiles, of which it
/// touches few.
fn needles() -> HostGaussians {
    let mut scene = support::scene(95, 600, CHANNELS, 0.1);
    scene.color.log_scales.fill([-0.7, -5.0, -5.0]);
    scene.color.opacity_logits.fill(-1.0);
    scene
}

fn whole() -> Camera {
    Camera { cx: 599.5, cy: 339.5, ..support::camera(1200, 680) }
}

fn window(left: u32, top: u32, width: u32, height: u32) -> Camera {
    let whole = whole();
    let (cx, cy) = (whole.cx - left as f32, whole.cy - top as f32);
    Camera { width, height, cx, cy, ..whole }
}

/// The largest difference between a window and that part of the whole picture.
fn difference(gpu: &Gpu, scene: &HostGaussians, [left, top, right, bottom]: [u32; 4]) -> f32 {
    let map = map(gpu, scene);
    let mut renderer = Renderer::new(gpu, CHANNELS).expect("compiles");
    let picture = renderer.render_color(&map, &whole()).expect("renders");
    let part = window(left, top, right - left, bottom - top);
    let part = renderer.render_color(&map, &part).expect("renders");
    let line = 3 * (right - left) as usize;
    let rows = part.rgb.chunks_exact(line).enumerate();
    let differences = rows.flat_map(|(row, shown)| {
        let first = 3 * ((top as usize + row) * 1200 + left as usize);
        shown.iter().zip(&picture.rgb[first..first + line]).map(|(a, b)| (a - b).abs())
    });
    differences.fold(0.0, f32::max)
}

#[test]
fn a_window_shows_what_the_whole_picture_shows() {
    let gpu = support::gpu();
    let needles = needles();
    // A window in the middle has narrower limits of the Jacobian: needles far beside it look different.
    for corners in [[0, 0, 600, 340], [600, 340, 1200, 680]] {
        let found = difference(&gpu, &needles, corners);
        assert!(found < TOLERANCE, "{corners:?}: {found}");
    }
    // Negative control: the other half of the picture.
    let map = map(&gpu, &needles);
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let [left, right] = [0, 600]
        .map(|left| renderer.render_color(&map, &window(left, 0, 600, 340)).expect("renders").rgb);
    let difference = left.iter().zip(&right).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(difference > 25.0 * TOLERANCE, "{difference}");
}
