//! Composing WGSL: header from [`crate::shader::layout`], then constants of the pipeline, then
//! shared parts, then the kernel. Plain concatenation at run time; nothing here needs a device.
//!
//! Besides concatenation there is one rule: the lines between `//repeat NAME COUNT` and `//end` are
//! repeated for NAME = 0, 1, ... COUNT - 1, every `$NAME` being replaced by the number; COUNT is a
//! constant of the pipeline. Arrays in registers need indices that are known to the compiler, and
//! drivers do not unroll the loops that the bounds checks have touched.
//!
//! `LEXSPLAT_DUMP_WGSL=<folder>` writes every composed text there.

use crate::shader::layout;

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
