//! Rendered images of a map: color, depth, opacity, codes as colors, and their spread.

use super::color::to_byte;
use super::palette::PaletteCache;
use super::scene::Scene;
use crate::pipeline::query::answer::RenderedImage;
use crate::pipeline::query::camera;
use crate::pipeline::query::error::QueryError;
use crate::pipeline::query::request::{Channel, RenderRequest, View};
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{Camera, ColorImage, GpuError};

/// Opacity below which a pixel has no depth.
const MIN_OPACITY: f32 = 0.5;

/// Renders the requested image.
pub(crate) fn render(
    scene: &mut Scene,
    palettes: &mut PaletteCache,
    snapshot: &MapSnapshot,
    request: &RenderRequest,
) -> Result<RenderedImage, QueryError> {
    let camera = camera::resized(camera::of_view(snapshot, &request.view)?, request.size)?;
    draw(scene, palettes, snapshot, request, &camera).map_err(|error| match error {
        GpuError::Limit { .. } => {
            QueryError::PictureTooLarge { width: camera.width, height: camera.height }
        }
        error => error.into(),
    })
}

fn draw(
    scene: &mut Scene,
    palettes: &mut PaletteCache,
    snapshot: &MapSnapshot,
    request: &RenderRequest,
    camera: &Camera,
) -> Result<RenderedImage, GpuError> {
    let rgb =
        |data: Vec<u8>| RenderedImage::Rgb { width: camera.width, height: camera.height, data };
    Ok(match request.channel {
        Channel::Color => {
            let image = scene.color(snapshot, camera)?;
            let [a, b] = exposure(snapshot, &request.view);
            rgb(image.rgb.iter().map(|&value| to_byte(a.exp() * value + b)).collect())
        }
        Channel::Opacity => {
            let image = scene.color(snapshot, camera)?;
            rgb(image.opacity.iter().flat_map(|&value| [to_byte(value); 3]).collect())
        }
        Channel::Depth => {
            let metres = depth(&scene.color(snapshot, camera)?, MIN_OPACITY);
            RenderedImage::Depth { width: camera.width, height: camera.height, metres }
        }
        Channel::Spread => {
            let values = scene.spreads(snapshot, camera)?;
            RenderedImage::Spread { width: camera.width, height: camera.height, values }
        }
        Channel::Language => rgb(language(scene, palettes, snapshot, camera)?),
    })
}

/// Exposure (a, b) of a tracked frame, so that its image is rendered as bright as the frame was;
/// (0, 0) for other views.
fn exposure(snapshot: &MapSnapshot, view: &View) -> [f32; 2] {
    match view {
        View::Frame(sequence) => {
            snapshot.tracked(*sequence).map_or([0.0; 2], |frame| frame.exposure)
        }
        View::Camera { .. } => [0.0; 2],
    }
}

/// Mean depth of each pixel, metres; 0 where the opacity is below `min_opacity`.
pub(crate) fn depth(image: &ColorImage, min_opacity: f32) -> Vec<f32> {
    let pixel = |(&depth, &opacity): (&f32, &f32)| {
        if opacity > min_opacity { depth / opacity } else { 0.0 }
    };
    image.depth.iter().zip(&image.opacity).map(pixel).collect()
}

fn language(
    scene: &mut Scene,
    palettes: &mut PaletteCache,
    snapshot: &MapSnapshot,
    camera: &Camera,
) -> Result<Vec<u8>, GpuError> {
    let palette = palettes.palette(snapshot);
    let image = scene.language(snapshot, camera)?;
    let channels = snapshot.online.code_size();
    let pixels = image.codes.chunks_exact(channels).zip(&image.opacity);
    Ok(pixels.flat_map(|(code, &opacity)| palette.color(code, opacity)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_divided_by_opacity() {
        let image = ColorImage {
            width: 3,
            height: 1,
            rgb: vec![0.0; 9],
            depth: vec![1.6, 0.2, 0.0],
            opacity: vec![0.8, 0.4, 0.0],
        };
        assert_eq!(depth(&image, 0.5), [2.0, 0.0, 0.0]);
    }
}
