//! Writes a keyframe's language into the map (paper §4.2).
//!
//! In: the 32-D code map that the networks made of a keyframe. The online stage learns from it. When its
//! version advances, every code in the map is carried over to the new version, so that old codes stay
//! readable. Gaussians without language that the keyframe shows get the code of their pixel. The keyframe
//! keeps the 32-D codes.

use super::super::compressor::carry_over;
use super::super::encoder::LanguageMap;
use super::super::keyframes::{Keyframe, KeyframeLanguage};
use super::super::live_map::LiveMap;
use lexsplat_gpu::{Camera, GpuError, Trainer};
use nalgebra::Point3;

/// Learns from a keyframe's codes and writes them into the map. Returns whether the map changed: it does not
/// if the keyframe was forgotten meanwhile.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(in super::super) fn write(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    sequence: u64,
    map: &LanguageMap,
) -> Result<bool, GpuError> {
    let Some(keyframe) = live.keyframes.find_mut(sequence) else { return Ok(false) };
    let before = live.online.boxed_clone();
    let advanced = live.online.observe(&map.codes);
    trainer.settle(&mut live.gaussians)?;
    let means = live.gaussians.read_means()?;
    let mut codes = live.gaussians.read_language_features()?;
    if advanced {
        carry_over(before.as_ref(), live.online.as_ref(), &mut codes);
    }
    let online_codes = live.online.encode(&map.codes);
    let camera = keyframe.training.camera.resized(map.width, map.height);
    let channels = live.online.code_size();
    let image = CodeImage { camera: &camera, codes: &online_codes, channels };
    let initialised = initialise_codes(&means, &mut codes, keyframe, &image);
    if advanced || initialised > 0 {
        live.gaussians.set_language_features(&codes)?;
    }
    keyframe.language = Some(KeyframeLanguage::new(map, camera));
    live.steps.earn_language();
    Ok(true)
}

/// The online codes of a view.
struct CodeImage<'a> {
    camera: &'a Camera,
    /// `[height * width * channels]`, row-major.
    codes: &'a [f32],
    channels: usize,
}

/// Gives every Gaussian that has no language yet and lies on the keyframe's surface the code of its pixel.
/// Returns how many there were. `means`: `[n * 3]`, metres; `codes`: `[n * channels]`, zeros without
/// language.
fn initialise_codes(
    means: &[[f32; 3]],
    codes: &mut [f32],
    keyframe: &Keyframe,
    image: &CodeImage<'_>,
) -> usize {
    let mut initialised = 0;
    for (mean, code) in means.iter().zip(codes.chunks_exact_mut(image.channels)) {
        if code.iter().any(|value| *value != 0.0) {
            continue;
        }
        let point = Point3::from(*mean);
        if !keyframe.training.shows(&point) {
            continue;
        }
        let Some((u, v, _)) = image.camera.project(&point) else { continue };
        let Some(pixel) = pixel_of(image.camera, u, v) else { continue };
        code.copy_from_slice(&image.codes[pixel * image.channels..(pixel + 1) * image.channels]);
        initialised += 1;
    }
    initialised
}

/// Index of the pixel that contains (u, v); `None` outside of the image.
fn pixel_of(camera: &Camera, u: f32, v: f32) -> Option<usize> {
    let (column, row) = (u.round(), v.round());
    let inside =
        column >= 0.0 && row >= 0.0 && column < camera.width as f32 && row < camera.height as f32;
    inside.then(|| row as usize * camera.width as usize + column as usize)
}
