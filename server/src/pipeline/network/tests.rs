//! Errors of an invalid bundle name the file and the tensor, with the expected and the found value.

use super::{Bundle, BundleError, BundleOptions, Provider, find};
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// The bundle that ships with the project, on the CPU.
fn defaults() -> BundleOptions<'static> {
    let models = Path::new("models/tiny");
    BundleOptions { models, runtime: None, providers: &[Provider::Cpu], threads: 0 }
}

/// Folder of the shipped bundle.
fn shipped() -> PathBuf {
    find::bundle(defaults().models).expect("models/tiny is part of the project")
}

/// A copy of the shipped bundle whose manifest can be changed; gone when dropped.
struct Copy(PathBuf);

impl Copy {
    fn new(name: &str) -> Self {
        let folder =
            std::env::temp_dir().join(format!("lexsplat-bundle-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for entry in std::fs::read_dir(shipped()).unwrap().flatten() {
            if entry.path().is_file() {
                std::fs::copy(entry.path(), folder.join(entry.file_name())).unwrap();
            }
        }
        Self(folder)
    }

    fn manifest(&self) -> String {
        std::fs::read_to_string(self.0.join("manifest.toml")).unwrap()
    }

    fn rewrite(&self, from: &str, to: &str) {
        let text = self.manifest();
        assert!(text.contains(from), "{from:?} is in the manifest");
        std::fs::write(self.0.join("manifest.toml"), text.replacen(from, to, 1)).unwrap();
    }

    /// Replaces a file and its checksum in the manifest.
    fn replace(&self, file: &str, bytes: &[u8]) {
        let hex = |bytes: &[u8]| -> String {
            Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
        };
        let before = std::fs::read(self.0.join(file)).unwrap();
        std::fs::write(self.0.join(file), bytes).unwrap();
        self.rewrite(&hex(&before), &hex(bytes));
    }

    /// The error of loading it, empty if there is none.
    fn error(&self) -> String {
        let options = BundleOptions { models: &self.0, ..defaults() };
        let Err(error) = Bundle::load(options) else { return String::new() };
        error.to_string()
    }
}

impl Drop for Copy {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn assert_says(error: &str, parts: &[&str]) {
    for part in parts {
        assert!(error.contains(part), "expected {part:?} in {error:?}");
    }
}

/// The line of the copy's manifest that starts with `start`, white space ignored.
fn line(copy: &Copy, start: &str) -> String {
    let text = copy.manifest();
    let found = text.lines().find(|line| line.replace(' ', "").starts_with(start));
    found.unwrap_or_else(|| panic!("no line {start}")).to_owned()
}

#[test]
fn an_unchanged_copy_loads() {
    // Negative control of the tests below.
    assert_eq!(Copy::new("same").error(), "");
}

#[test]
fn an_unknown_key_is_named() {
    let copy = Copy::new("key");
    copy.rewrite("[image]", "[image]\nwidht = 3");
    assert_says(&copy.error(), &["manifest.toml", "widht", "width"]);
}

#[test]
fn a_missing_file_is_named() {
    let copy = Copy::new("missing");
    std::fs::remove_file(copy.0.join("decompress.onnx")).unwrap();
    assert_says(&copy.error(), &["decompress.onnx", "cannot be read"]);
}

#[test]
fn a_changed_file_is_refused_by_its_checksum() {
    let copy = Copy::new("sha");
    let path = copy.0.join("compress.onnx");
    let mut bytes = std::fs::read(&path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    assert_says(&copy.error(), &["compress.onnx", "sha256", "expected", "found"]);
}

#[test]
fn a_file_without_a_checksum_is_refused() {
    let copy = Copy::new("nosha");
    let entry = line(&copy, "\"srd.onnx\"=");
    copy.rewrite(&entry, "");
    assert_says(&copy.error(), &["sha256", "srd.onnx", "none"]);
}

#[test]
fn a_truncated_graph_is_refused() {
    let copy = Copy::new("truncated");
    let bytes = std::fs::read(copy.0.join("srd.onnx")).unwrap();
    copy.replace("srd.onnx", &bytes[..bytes.len() / 2]);
    assert_says(&copy.error(), &["srd.onnx", "ONNX Runtime"]);
}

#[test]
fn a_wrong_shape_names_file_tensor_expected_and_found() {
    let copy = Copy::new("shape");
    let entry = line(&copy, "grid=");
    copy.rewrite(&entry, "grid = [71, 95]");
    let error = copy.error();
    assert_says(&error, &["srd.onnx", "features", "71, 95]", "72, 96]", "expected", "found"]);
}

#[test]
fn an_unknown_tensor_is_named_with_the_known_ones() {
    let copy = Copy::new("tensor");
    copy.rewrite("\"skip4\"]", "\"skip5\"]");
    assert_says(&copy.error(), &["encoder.onnx", "skip5", "skip4"]);
}

#[test]
fn values_out_of_range_are_named() {
    let cases = [
        ("code_size=", "code_size = 31", ["code_size", "32", "31"]),
        ("std=", "std = [1.0, 0.0, 1.0]", ["image.std", "above 0", "0.0"]),
        ("temperature=", "temperature = -1.0", ["relevancy.temperature", "more than 0", "-1"]),
        ("bias=", "bias = nan", ["relevancy.bias", "finite", "NaN"]),
        (
            "confidence_steepness=",
            "confidence_steepness = 0.0",
            ["relevancy.confidence_steepness", "more than 0", "0"],
        ),
        ("negatives=", "negatives = []", ["relevancy.negatives", "at least 1", "0"]),
        ("tokenizer=", "tokenizer = \"../tokenizer.json\"", ["file", "below", "../tokenizer.json"]),
    ];
    let copy = Copy::new("value");
    for (start, wrong, says) in cases {
        let right = line(&copy, start);
        copy.rewrite(&right, wrong);
        assert_says(&copy.error(), &says);
        copy.rewrite(wrong, &right);
    }
}

#[test]
fn exactly_one_form_of_the_vision_graphs_is_required() {
    let end_to_end = "[vision]\nfile = \"vision.onnx\"\ninput = \"image\"\noutput = \"codes\"\n\
                  grid = [72, 96]\n\n";
    let copy = Copy::new("ways");
    let original = copy.manifest();
    let section = |name: &str| -> String {
        let start = original.find(&format!("[{name}]")).expect("it has this section");
        let length = original[start..].find("\n\n").expect("another one follows");
        original[start..start + length + 2].to_owned()
    };
    let (encoder, srd) = (section("encoder"), section("srd"));
    let compress = line(&copy, "encoder={");
    let cases = [
        (original.replace("[encoder]", &format!("{end_to_end}[encoder]")), "vision", "both"),
        (original.replace(&encoder, ""), "encoder", "none"),
        (original.replace(&srd, ""), "srd", "none"),
        (original.replace(&compress, ""), "compressor.encoder", "none"),
    ];
    for (manifest, key, found) in cases {
        std::fs::write(copy.0.join("manifest.toml"), manifest).unwrap();
        let found = format!("found {found}");
        assert_says(&copy.error(), &[&format!("{key}: expected [vision], or [encoder]"), &found]);
    }
    // Negative control: with one form alone, only its file is missing.
    let alone = original.replace(&encoder, end_to_end).replace(&srd, "").replace(&compress, "");
    std::fs::write(copy.0.join("manifest.toml"), alone).unwrap();
    assert_says(&copy.error(), &["sha256", "vision.onnx", "none"]);
    std::fs::write(copy.0.join("manifest.toml"), &original).unwrap();
    assert_eq!(copy.error(), "");
}

#[test]
fn networks_of_another_feature_size_are_refused() {
    let copy = Copy::new("size");
    let entry = line(&copy, "feature_size=");
    copy.rewrite(&entry, "feature_size = 768");
    assert_says(&copy.error(), &["srd.onnx", "features", "768, 72, 96]", "384, 72, 96]"]);
}

/// The shipped bundle with these providers and the library of `make deps`.
fn loaded(providers: &[Provider]) -> Result<Bundle, BundleError> {
    Bundle::load(BundleOptions { providers, ..defaults() })
}

#[test]
fn a_missing_provider_is_an_error_unless_the_cpu_is_listed() {
    for missing in [Provider::Cuda, Provider::TensorRt, Provider::WebGpu] {
        let Err(error) = loaded(&[missing]) else {
            panic!("the library of `make deps` has no {missing:?}");
        };
        assert_says(&error.to_string(), &["language.providers", missing.name(), "built without"]);
        assert!(loaded(&[missing, Provider::Cpu]).is_ok());
    }
    let Err(error) = loaded(&[]) else { panic!("nothing to run on") };
    assert_says(&error.to_string(), &["language.providers", "at least one", "webgpu"]);
}

#[test]
fn provider_names_are_read_from_settings() {
    #[derive(Debug, Deserialize)]
    struct Config {
        providers: Vec<Provider>,
    }
    let read = |text: &str| toml::from_str::<Config>(text);
    let all = read("providers = [\"tensorrt\", \"cuda\", \"webgpu\", \"cpu\"]").unwrap();
    let names: Vec<&str> = all.providers.iter().map(|provider| provider.name()).collect();
    assert_eq!(names, ["tensorrt", "cuda", "webgpu", "cpu"]);
    let error = read("providers = [\"gpu\"]").unwrap_err().to_string();
    assert_says(&error, &["gpu", "cuda", "webgpu"]);
}

#[test]
fn synonyms_have_near_embeddings() {
    let (_, mut text) = Bundle::load(defaults()).expect("it loads").split();
    let mut embed = |word: &str| text.tower.embed(word).expect("it runs");
    let (couch, sofa, banana) = (embed("couch"), embed("sofa"), embed("banana"));
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    assert!((dot(&couch, &couch) - 1.0).abs() < 1e-3);
    let (near, far) = (dot(&couch, &sofa), dot(&couch, &banana));
    assert!(near > far + 0.2, "couch-sofa {near}, couch-banana {far}");
    // More words than max_tokens: still an embedding.
    let long = embed(&"word ".repeat(200));
    assert!((dot(&long, &long) - 1.0).abs() < 1e-3);
}
