//! Composing WGSL: header from [`crate::layout`], then constants of the pipeline, then shared
//! parts, then the kernel. Plain concatenation at run time; nothing here needs a device.
//!
//! Besides concatenation there is one rule: the lines between `//repeat NAME COUNT` and `//end` are
//! repeated for NAME = 0, 1, ... COUNT - 1, every `$NAME` being replaced by the number; COUNT is a
//! constant of the pipeline. Arrays in registers need indices that are known to the compiler, and
//! drivers do not unroll the loops that the bounds checks have touched.
//!
//! `LEXSPLAT_DUMP_WGSL=<folder>` writes every composed text there.

use crate::layout;
use crate::sort::SortShape;
use crate::tiling::Tiling;

/// How a kernel uses a storage buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Only reads it.
    Read,
    /// Reads and writes it.
    Write,
}

/// Everything that makes up one kernel.
#[derive(Clone, Debug)]
pub struct Shader {
    /// Name, for errors and dumps.
    pub label: &'static str,
    /// Entry point.
    pub entry: &'static str,
    /// WGSL, in order.
    pub parts: Vec<&'static str>,
    /// Constants of this pipeline, as `(name, value)`; a boolean is given as its own kind.
    pub constants: Vec<(&'static str, Constant)>,
    /// Storage buffers, from binding 1 on.
    pub bindings: Vec<Access>,
}

/// Value of a constant that is known when a pipeline is made.
#[derive(Clone, Copy, Debug)]
pub enum Constant {
    /// A count.
    U32(u32),
    /// A switch.
    Bool(bool),
}

impl Shader {
    /// The whole WGSL text.
    pub fn compose(&self) -> String {
        let mut text = layout::wgsl_header();
        for (name, value) in &self.constants {
            text += &match value {
                Constant::U32(value) => format!("const {name}: u32 = {value};\n"),
                Constant::Bool(value) => format!("const {name}: bool = {value};\n"),
            };
        }
        for part in &self.parts {
            self.repeat(&mut part.lines(), &mut text, &[]);
        }
        if let Some(folder) = std::env::var_os("LEXSPLAT_DUMP_WGSL") {
            let path = std::path::Path::new(&folder).join(format!("{}.wgsl", self.label));
            if let Err(error) = std::fs::write(&path, &text) {
                tracing::warn!(path = %path.display(), %error, "shader not dumped");
            }
        }
        text
    }

    /// Copies lines up to an `//end` into `text`, with `names` replaced and repetitions expanded.
    fn repeat(&self, lines: &mut std::str::Lines<'_>, text: &mut String, names: &[(&str, u32)]) {
        while let Some(line) = lines.next() {
            let trimmed = line.trim();
            if trimmed == "//end" {
                return;
            }
            let Some((name, count)) =
                trimmed.strip_prefix("//repeat ").and_then(|rule| rule.split_once(' '))
            else {
                let line = names.iter().fold(line.to_owned(), |line, (name, value)| {
                    line.replace(&format!("${name}"), &format!("{value}u"))
                });
                text.push_str(&line);
                text.push('\n');
                continue;
            };
            let body = lines.clone();
            self.repeat(lines, &mut String::new(), names);
            for value in 0..self.count(count) {
                let names = [names, &[(name, value)]].concat();
                *lines = body.clone();
                self.repeat(lines, text, &names);
            }
        }
    }

    /// Value of a counting constant.
    fn count(&self, name: &str) -> u32 {
        self.constants
            .iter()
            .find_map(|(constant, value)| match value {
                Constant::U32(value) if *constant == name => Some(*value),
                _ => None,
            })
            .expect("a repetition names a constant of its pipeline")
    }
}

/// Shared WGSL: the index of a thread in a grid that was split over two axes.
pub const GRID: &str = include_str!("shared/grid.wgsl");
/// Shared WGSL: pixels of a lane, and one Gaussian at four pixels.
pub const TILE: &str = include_str!("shared/tile.wgsl");
/// Shared WGSL: how a batch of hits is loaded and handed round.
pub const HITS: &str = include_str!("shared/hits.wgsl");
/// Shared WGSL: how lanes talk where a tile is one subgroup.
pub const LANES_SUBGROUP: &str = include_str!("shared/lanes_subgroup.wgsl");
/// Shared WGSL: how lanes talk through workgroup memory.
pub const LANES_WORKGROUP: &str = include_str!("shared/lanes_workgroup.wgsl");
/// Shared WGSL: the conic of a splat.
pub const CONIC: &str = include_str!("shared/conic.wgsl");
/// Shared WGSL: which tiles a splat meets; needs [`CONIC`].
pub const EXTENT: &str = include_str!("shared/extent.wgsl");
/// Shared WGSL: log scales to scales.
pub const SCALES: &str = include_str!("shared/scales.wgsl");
/// Shared WGSL: quaternion to matrix, and covariance in the image.
pub const GEOMETRY: &str = include_str!("shared/geometry.wgsl");

/// Every shader of this package, for a language head of `channels` channels, with tiles and sorts
/// spread over threads in one of the ways there are.
pub fn catalogue(channels: usize, tiling: Tiling, sort: SortShape) -> Vec<Shader> {
    let mut shaders = Vec::new();
    shaders.extend(crate::scan::shaders());
    shaders.extend(crate::sort::shaders(sort));
    shaders.extend(crate::reduce::shaders());
    shaders.extend(crate::order::shaders());
    shaders.extend(crate::tiles::shaders(tiling, sort));
    shaders.extend(crate::gather::shaders());
    shaders.extend(crate::densify::shaders());
    shaders.extend(crate::morton::shaders());
    shaders.extend(crate::loss::shaders());
    shaders.extend(crate::adam::shaders());
    shaders.extend(crate::ties::shaders());
    shaders.extend(crate::tally::shaders());
    shaders.extend(crate::pyramid::shaders());
    shaders.extend(crate::align::shaders());
    for (rows, color) in [(1, true), (layout::rows_for(channels), false)] {
        shaders.extend(crate::project::shaders(tiling, rows, color));
        shaders.extend(crate::blend::shaders(tiling, rows, color));
    }
    shaders
}

/// The shaders with which a device is tested when it is opened on a tier.
pub fn self_tests(tier: crate::device::Tier) -> Vec<Shader> {
    crate::device::selftest_shaders(tier)
}
