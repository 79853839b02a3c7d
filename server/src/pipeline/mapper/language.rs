//! Writes a keyframe's language into the map.
//!
//! In: the networks' 32-D code map of a keyframe. The online stage learns from it; when its version
//! advances, every code in the map is carried over, so that old codes stay readable. Gaussians
//! without language that the keyframe shows are born with the code of their pixel. The 32-D map is
//! kept as the truth; 15-D targets are derived from it whenever their version is out of date.

use super::super::compressor::carry_over;
use super::super::encoder::LanguageMap;
use super::Mapper;
use super::keyframe::{GenericCodes, Keyframe};
use half::f16;
use lexsplat_gpu::{Camera, GpuError, LanguageTarget};
use nalgebra::Point3;

impl Mapper {
    /// Learns from the keyframe's codes and writes them into the map.
    pub(super) fn write_language(
        &mut self,
        sequence: u64,
        map: LanguageMap,
    ) -> Result<(), GpuError> {
        let Some(at) = self.keyframes.iter().position(|kf| kf.frame.sequence == sequence) else {
            return Ok(());
        };
        let old = self.online.boxed_clone();
        let advanced = self.online.observe(&map.codes);
        self.trainer.settle(&mut self.gaussians)?;
        let (means, mut codes) =
            (self.gaussians.read_means()?, self.gaussians.read_language_features()?);
        if advanced {
            carry_over(old.as_ref(), self.online.as_ref(), &mut codes);
        }
        let online_codes = self.online.encode(&map.codes);
        let camera = self.keyframes[at].working.camera.resized(map.width, map.height);
        let born = give_birth(
            (&means, &mut codes),
            &self.keyframes[at],
            &CodeMap { camera: &camera, codes: &online_codes, channels: self.online.code_size() },
        );
        if advanced || born > 0 {
            self.gaussians.set_language_features(&codes)?;
        }
        let target = LanguageTarget::new(
            &self.gpu,
            map.width,
            map.height,
            self.online.code_size(),
            &online_codes,
        )?;
        self.keyframes[at].generic = Some(GenericCodes {
            width: map.width,
            height: map.height,
            codes: map.codes.iter().copied().map(f16::from_f32).collect(),
            camera,
            target,
            version: self.online.version(),
        });
        self.steps.earn_language();
        self.keep_to_budget();
        self.changed = true;
        Ok(())
    }

    /// Makes the keyframe's 15-D target anew if the online stage has moved on since.
    pub(super) fn refresh_target(&mut self, at: usize) -> Result<(), GpuError> {
        let version = self.online.version();
        let Some(generic) = &mut self.keyframes[at].generic else { return Ok(()) };
        if generic.version != version {
            let wide: Vec<f32> = generic.codes.iter().copied().map(f16::to_f32).collect();
            let codes = self.online.encode(&wide);
            let channels = self.online.code_size();
            generic.target =
                LanguageTarget::new(&self.gpu, generic.width, generic.height, channels, &codes)?;
            generic.version = version;
        }
        Ok(())
    }
}

/// A view's online codes, `[height * width * channels]`.
struct CodeMap<'a> {
    camera: &'a Camera,
    codes: &'a [f32],
    channels: usize,
}

/// Gives every Gaussian without language that the keyframe shows the code of its pixel; returns how
/// many there were.
fn give_birth(
    (means, codes): (&[[f32; 3]], &mut [f32]),
    keyframe: &Keyframe,
    map: &CodeMap<'_>,
) -> usize {
    let working = &keyframe.working;
    let mut born = 0;
    for (mean, code) in means.iter().zip(codes.chunks_exact_mut(map.channels)) {
        if code.iter().any(|value| *value != 0.0) {
            continue;
        }
        let point = Point3::from(*mean);
        if !working.shows(&point) {
            continue;
        }
        let Some((u, v, _)) = map.camera.project(&point) else { continue };
        let Some(label) = pixel_of(map.camera, u, v) else { continue };
        code.copy_from_slice(&map.codes[label * map.channels..(label + 1) * map.channels]);
        born += 1;
    }
    born
}

/// The index of the pixel that (u, v) lies in.
fn pixel_of(camera: &Camera, u: f32, v: f32) -> Option<usize> {
    let (column, row) = (u.round(), v.round());
    let inside =
        column >= 0.0 && row >= 0.0 && column < camera.width as f32 && row < camera.height as f32;
    inside.then(|| row as usize * camera.width as usize + column as usize)
}
