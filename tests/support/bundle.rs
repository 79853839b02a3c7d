//! Bundles of networks that are made on the spot: random weights, but they know colors.
//!
//! A pixel's 32-D code is the direction of Q (r, g, b, 1/2) and its 768-D feature that of P times the
//! code, with random orthonormal Q and P; a word is P Q of the color that it names. Everything that
//! lies between a frame and an answer must hold for "red" to be found.

use crate::onnx::{Kind, Node, Weight, model, node, value, weight};
use nalgebra::DMatrix;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest, Sha256};
use std::path::Path;

/// D.
pub const FEATURE: usize = 768;
const CODE: usize = 32;
/// Columns and rows of the image.
const IMAGE: [usize; 2] = [128, 96];
/// Pixels along one side of a cell.
const STRIDE: usize = 4;
const GRID: [usize; 2] = [IMAGE[1] / STRIDE, IMAGE[0] / STRIDE];
/// What keeps black from having no direction.
const GREY: f64 = 0.5;
/// The words that the bundle knows, each with its color on the scale -1..1.
pub const WORDS: [(&str, [f64; 3]); 7] = [
    ("red", [1.0, -1.0, -1.0]),
    ("green", [-1.0, 1.0, -1.0]),
    ("blue", [-1.0, -1.0, 1.0]),
    ("object", [0.0, 0.0, 0.0]),
    ("things", [0.2, 0.2, 0.2]),
    ("stuff", [-0.2, -0.2, -0.2]),
    ("texture", [0.4, 0.4, 0.4]),
];

/// How much a color is like another, as the networks see it: the cosine of (r, g, b, 1/2).
pub fn likeness(a: [f64; 3], b: [f64; 3]) -> f64 {
    let dot =
        |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() + GREY * GREY;
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
}

/// The bundle's form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// One graph from image to codes, with inputs and outputs of this type.
    Folded(Kind),
    /// Encoder, SRD and compressor.
    Stages,
}

/// A bundle that can be spoilt before it is written.
pub struct Made {
    /// File names with their bytes.
    pub files: Vec<(&'static str, Vec<u8>)>,
    /// The manifest without its checksums.
    pub manifest: String,
}

/// Orthonormal columns `[rows, columns]`.
fn orthonormal(random: &mut ChaCha8Rng, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| random.random_range(-1.0..1.0)).qr().q()
}

/// Row-major f32.
fn rows(matrix: &DMatrix<f64>) -> Vec<f32> {
    matrix.transpose().iter().map(|&value| value as f32).collect()
}

/// A 1x1 convolution's two weights: `[outputs, inputs, 1, 1]` and a bias.
fn pointwise(names: [&str; 2], kind: Kind, matrix: &DMatrix<f64>, bias: &[f64]) -> [Weight; 2] {
    let bias: Vec<f32> = bias.iter().map(|&value| value as f32).collect();
    let shape = [matrix.nrows(), matrix.ncols(), 1, 1];
    [weight(names[0], kind, &shape, &rows(matrix)), weight(names[1], kind, &[bias.len()], &bias)]
}

/// Means over cells of 4x4 pixels, as a convolution of one channel each.
fn means(kind: Kind, output: &str) -> (Node, Weight) {
    let share = 1.0 / (STRIDE * STRIDE) as f32;
    let size = STRIDE * STRIDE;
    let values: Vec<f32> =
        (0..9 * size).map(|at| if (at / size).is_multiple_of(4) { share } else { 0.0 }).collect();
    let kernel = weight("means", kind, &[3, 3, STRIDE, STRIDE], &values);
    (node("Conv", &["image", "means"], output, &[("strides", &[STRIDE as i64; 2])]), kernel)
}

fn unit(input: &str, output: &str) -> Node {
    node("LpNormalization", &[input], output, &[("axis", &[1]), ("p", &[2])])
}

fn map(name: &str, kind: Kind, channels: usize, [rows, columns]: [usize; 2]) -> crate::onnx::Value {
    value(name, kind, &[1, channels, rows, columns].map(Some))
}

impl Made {
    /// With random weights of a fixed seed: the same function in every form.
    pub fn new(form: Form) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let to_code = orthonormal(&mut random, CODE, 4);
        let to_feature = orthonormal(&mut random, FEATURE, CODE);
        let (colors, grey) = (to_code.columns(0, 3).clone_owned(), to_code.column(3) * GREY);
        let mut files = match form {
            Form::Folded(kind) => vec![("vision.onnx", vision(kind, &colors, grey.as_slice()))],
            Form::Stages => stages(&to_feature, &colors, grey.as_slice()),
        };
        files.push(("decompress.onnx", decompress(&to_feature)));
        files.push(("text.onnx", text(&(&to_feature * &to_code))));
        files.push(("tokenizer.json", tokenizer().into_bytes()));
        Self { files, manifest: manifest(form) }
    }

    /// Writes the bundle's folder.
    pub fn write(&self, folder: &Path) {
        let mut manifest = format!("{}\n[sha256]\n", self.manifest);
        for (name, bytes) in &self.files {
            std::fs::write(folder.join(name), bytes).expect("the folder can be written to");
            let sum: String = Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect();
            manifest += &format!("\"{name}\" = \"{sum}\"\n");
        }
        std::fs::write(folder.join("manifest.toml"), manifest).expect("as above");
    }

    /// Another file under a name that there is.
    pub fn replace(&mut self, name: &str, bytes: Vec<u8>) {
        let file = self.files.iter_mut().find(|(file, _)| *file == name);
        file.expect("the bundle has it").1 = bytes;
    }
}

fn vision(kind: Kind, colors: &DMatrix<f64>, grey: &[f64]) -> Vec<u8> {
    let (mean, kernel) = means(kind, "cells");
    let [matrix, bias] = pointwise(["q", "grey"], kind, colors, grey);
    model(
        vec![mean, node("Conv", &["cells", "q", "grey"], "raw", &[]), unit("raw", "codes")],
        vec![kernel, matrix, bias],
        map("image", kind, 3, [IMAGE[1], IMAGE[0]]),
        map("codes", kind, CODE, GRID),
    )
}

fn stages(
    to_feature: &DMatrix<f64>,
    colors: &DMatrix<f64>,
    grey: &[f64],
) -> Vec<(&'static str, Vec<u8>)> {
    let kind = Kind::F32;
    let (mean, kernel) = means(kind, "coarse");
    let [up, up_bias] = pointwise(
        ["up", "grey"],
        kind,
        &(to_feature * colors),
        (to_feature * DMatrix::from_column_slice(CODE, 1, grey)).as_slice(),
    );
    let [down, none] = pointwise(["down", "none"], kind, &to_feature.transpose(), &[0.0; CODE]);
    let encoder = model(
        vec![mean],
        vec![kernel],
        map("image", kind, 3, [IMAGE[1], IMAGE[0]]),
        map("coarse", kind, 3, GRID),
    );
    let srd = model(
        vec![node("Conv", &["coarse", "up", "grey"], "raw", &[]), unit("raw", "features")],
        vec![up, up_bias],
        map("coarse", kind, 3, GRID),
        map("features", kind, FEATURE, GRID),
    );
    let compress = model(
        vec![node("Conv", &["features", "down", "none"], "raw", &[]), unit("raw", "codes")],
        vec![down, none],
        map("features", kind, FEATURE, GRID),
        map("codes", kind, CODE, GRID),
    );
    vec![("encoder.onnx", encoder), ("srd.onnx", srd), ("compress.onnx", compress)]
}

/// Codes -> features, for a P of any number of rows.
pub fn decompress(to_feature: &DMatrix<f64>) -> Vec<u8> {
    let size = to_feature.nrows();
    let matrix = weight("p", Kind::F32, &[CODE, size], &rows(&to_feature.transpose()));
    model(
        vec![node("MatMul", &["codes", "p"], "raw", &[]), unit("raw", "features")],
        vec![matrix],
        value("codes", Kind::F32, &[None, Some(CODE)]),
        value("features", Kind::F32, &[None, Some(size)]),
    )
}

/// Tokens -> the mean of their colors' features.
fn text(feature_from_color: &DMatrix<f64>) -> Vec<u8> {
    let mut table = Vec::new();
    for (_, [r, g, b]) in WORDS {
        let feature = feature_from_color * DMatrix::from_column_slice(4, 1, &[r, g, b, GREY]);
        table.extend(feature.normalize().iter().map(|&value| value as f32));
    }
    let table = weight("table", Kind::F32, &[WORDS.len(), FEATURE], &table);
    model(
        vec![
            node("Gather", &["table", "input_ids"], "words", &[]),
            node("ReduceMean", &["words"], "mean", &[("axes", &[1]), ("keepdims", &[0])]),
            unit("mean", "embedding"),
        ],
        vec![table],
        value("input_ids", Kind::I64, &[Some(1), None]),
        value("embedding", Kind::F32, &[Some(1), Some(FEATURE)]),
    )
}

/// One token for each word; others are "object".
fn tokenizer() -> String {
    let vocabulary: Vec<String> =
        WORDS.iter().enumerate().map(|(at, (word, _))| format!("\"{word}\": {at}")).collect();
    format!(
        r#"{{"version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": {{"type": "Lowercase"}}, "pre_tokenizer": {{"type": "Whitespace"}},
            "post_processor": null, "decoder": null,
            "model": {{"type": "WordLevel", "vocab": {{{}}}, "unk_token": "object"}}}}"#,
        vocabulary.join(", ")
    )
}

fn manifest(form: Form) -> String {
    let [columns, rows] = IMAGE;
    let vision = match form {
        Form::Folded(_) => format!(
            "[vision]\nfile = \"vision.onnx\"\ninput = \"image\"\noutput = \"codes\"\n\
             grid = {GRID:?}\n\n[compressor]\n"
        ),
        Form::Stages => format!(
            "[encoder]\nfile = \"encoder.onnx\"\ninput = \"image\"\noutputs = [\"coarse\"]\n\n\
             [srd]\nfile = \"srd.onnx\"\ninputs = [\"coarse\"]\noutput = \"features\"\n\
             grid = {GRID:?}\n\n[compressor]\n\
             encoder = {{ file = \"compress.onnx\", input = \"features\", output = \"codes\" }}\n"
        ),
    };
    format!(
        "name = \"colors\"\nversion = \"1\"\nlicence = \"MIT\"\nfeature_size = {FEATURE}\n\
         code_size = {CODE}\n\n[image]\nwidth = {columns}\nheight = {rows}\nfit = \"squash\"\n\
         channel_order = \"rgb\"\nmean = [127.5, 127.5, 127.5]\nstd = [127.5, 127.5, 127.5]\n\n\
         {vision}decoder = {{ file = \"decompress.onnx\", input = \"codes\", \
         output = \"features\" }}\n\n[text]\nfile = \"text.onnx\"\n\
         tokenizer = \"tokenizer.json\"\ninputs = [\"input_ids\"]\noutput = \"embedding\"\n\
         max_tokens = 16\n\n[relevancy]\ntemperature = 10.0\nthreshold = 0.5\n\
         negatives = [\"object\", \"things\", \"stuff\", \"texture\"]\n"
    )
}
