//! LPIPS, the perceptual distance of two images (R. Zhang et al., "The Unreasonable Effectiveness
//! of Deep Features as a Perceptual Metric", 2018), computed by a network from an ONNX file: two
//! inputs `[1, 3, height, width]` in -1..1 of any size, one output of one number, 0 for equal
//! images. No network is shipped.

use crate::runtime::{self, RUNTIME_VARIABLE};
use image::RgbImage;
use ort::session::Session;
use ort::value::{TensorElementType, TensorRef};
use std::path::{Path, PathBuf};

/// LPIPS cannot be computed.
#[derive(Debug, thiserror::Error)]
pub enum LpipsError {
    /// ONNX Runtime was not found.
    #[error(
        "LPIPS runs on ONNX Runtime: set {RUNTIME_VARIABLE} to a libonnxruntime.so (`make deps` puts one \
         below .deps/onnxruntime)"
    )]
    NoRuntime,
    /// ONNX Runtime reported an error.
    #[error("LPIPS, {path}: {reason}")]
    Runtime {
        /// Path of the network or the library.
        path: PathBuf,
        /// Its message.
        reason: String,
    },
    /// The network has other inputs or outputs.
    #[error(
        "LPIPS, {path}: expected two inputs f32[1, 3, height, width] and one number out, found {found}"
    )]
    Shape {
        /// Path of the network.
        path: PathBuf,
        /// Its inputs and outputs.
        found: String,
    },
}

/// A loaded network.
pub struct Lpips {
    path: PathBuf,
    session: Session,
}

impl std::fmt::Debug for Lpips {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Lpips").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Lpips {
    /// Loads a network with the library that `ORT_DYLIB_PATH` names, else the one of `make deps`.
    ///
    /// # Errors
    /// [`LpipsError`] says what is missing or wrong.
    pub fn load(path: &Path) -> Result<Self, LpipsError> {
        Self::load_with(path, &runtime::library().ok_or(LpipsError::NoRuntime)?)
    }

    fn load_with(path: &Path, library: &Path) -> Result<Self, LpipsError> {
        let of_library = |reason: String| LpipsError::Runtime { path: library.to_owned(), reason };
        let environment = runtime::environment(library).map_err(of_library)?;
        let session = Session::builder(&environment)
            .map_err(|error| of_library(error.to_string()))?
            .commit_from_file(path)
            .map_err(|error| LpipsError::Runtime {
                path: path.to_owned(),
                reason: error.to_string(),
            })?;
        let lpips = Self { path: path.to_owned(), session };
        lpips.check()?;
        Ok(lpips)
    }

    fn check(&self) -> Result<(), LpipsError> {
        let inputs = self.session.inputs();
        let is_picture = |outlet: &ort::value::Outlet| {
            let kind = outlet.dtype();
            kind.tensor_type() == Some(TensorElementType::Float32)
                && kind.tensor_shape().is_some_and(|shape| shape.len() == 4)
        };
        if inputs.len() == 2 && inputs.iter().all(is_picture) && self.session.outputs().len() == 1 {
            return Ok(());
        }
        let kinds: Vec<String> = inputs.iter().map(|outlet| outlet.dtype().to_string()).collect();
        let outputs = self.session.outputs().len();
        Err(self.shape(format!("{} and {outputs} outputs", kinds.join(", "))))
    }

    fn shape(&self, found: String) -> LpipsError {
        LpipsError::Shape { path: self.path.clone(), found }
    }

    /// The distance of two images of equal size.
    ///
    /// # Errors
    /// [`LpipsError`] if the network rejects the images or returns more than one number.
    ///
    /// # Panics
    /// If the images differ in size.
    pub fn distance(&mut self, truth: &RgbImage, found: &RgbImage) -> Result<f64, LpipsError> {
        assert_eq!(truth.dimensions(), found.dimensions(), "pictures of one size");
        let failed = |path: &Path, error: &ort::Error| LpipsError::Runtime {
            path: path.to_owned(),
            reason: error.to_string(),
        };
        let shape = [1, 3, truth.height() as usize, truth.width() as usize];
        let (truth, found) = (planes(truth), planes(found));
        let tensor = |planes| TensorRef::from_array_view((shape, planes));
        let first = tensor(&truth[..]).map_err(|error| failed(&self.path, &error))?;
        let second = tensor(&found[..]).map_err(|error| failed(&self.path, &error))?;
        let outputs = self
            .session
            .run(ort::inputs![first, second])
            .map_err(|error| failed(&self.path, &error))?;
        let (_, numbers) =
            outputs[0].try_extract_tensor::<f32>().map_err(|error| failed(&self.path, &error))?;
        match numbers {
            [distance] => Ok(f64::from(*distance)),
            several => {
                let found = format!("{} numbers", several.len());
                Err(LpipsError::Shape { path: self.path.clone(), found })
            }
        }
    }
}

/// Channel by channel, 0..255 to -1..1.
fn planes(picture: &RgbImage) -> Vec<f32> {
    let channel = |at: usize| picture.as_raw().iter().skip(at).step_by(3);
    (0..3).flat_map(channel).map(|value| f32::from(*value) / 127.5 - 1.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `make deps` got.
    fn library() -> PathBuf {
        let folder =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../.deps/onnxruntime/onnxruntime/capi");
        let files = std::fs::read_dir(&folder).expect("`make deps` was run");
        let mut paths = files.map(|file| file.expect("it can be read").path());
        let is_library = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with("libonnxruntime.so")
        };
        paths.find(is_library).expect("`make deps` gets it")
    }

    /// A network of `src/lpips/`: means over channels and pixels of |a - b|, weighed
    /// 1, 2, 3 by channel; or the same that keeps a number per channel.
    fn network(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lpips").join(name)
    }

    #[test]
    fn a_network_gives_the_distance_of_two_images() {
        let mut lpips = Lpips::load_with(&network("weighed.onnx"), &library()).unwrap();
        let flat = |rgb| RgbImage::from_pixel(20, 12, image::Rgb(rgb));
        let (black, other) = (flat([0; 3]), flat([51, 0, 102]));
        assert_eq!(lpips.distance(&other, &other).unwrap(), 0.0);
        // 51 of 255 is 0.4 of -1..1; channels in the order red, green, blue.
        let by_hand = (1.0 * 0.4 + 2.0 * 0.0 + 3.0 * 0.8) / 3.0;
        let found = lpips.distance(&black, &other).unwrap();
        assert!((found - by_hand).abs() < 1e-6, "{found} {by_hand}");
        let exchanged = lpips.distance(&black, &flat([102, 0, 51])).unwrap();
        assert!((exchanged - by_hand).abs() > 0.1, "channels are told apart: {exchanged}");
        // Where pixels are matters: one row that differs counts as one of twelve.
        let row = RgbImage::from_fn(20, 12, |_, y| image::Rgb([if y == 3 { 255 } else { 0 }; 3]));
        let found = lpips.distance(&black, &row).unwrap();
        assert!((found - 4.0 / 12.0).abs() < 1e-6, "{found}");
    }

    #[test]
    fn other_networks_and_no_network_are_refused() {
        let refused = |name| Lpips::load_with(&network(name), &library()).unwrap_err().to_string();
        assert!(refused("nowhere.onnx").contains("nowhere.onnx"));
        let error = refused("one_input.onnx");
        assert!(error.contains("expected two inputs"), "{error}");
        let mut several = Lpips::load_with(&network("per_channel.onnx"), &library()).unwrap();
        let grey = RgbImage::from_pixel(8, 8, image::Rgb([9; 3]));
        let error = several.distance(&grey, &grey).unwrap_err().to_string();
        assert!(error.contains("found 3 numbers"), "{error}");
    }
}
