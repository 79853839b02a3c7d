//! ONNX Runtime, loaded at run time: where its library is, and the environment of this process.

use ort::environment::Environment;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// The environment variable with the path of ONNX Runtime's library, as in all programs that use
/// `ort`.
pub(crate) const RUNTIME_VARIABLE: &str = "ORT_DYLIB_PATH";
/// Where `make deps` puts the library.
const RUNTIME_FOLDER: &str = ".deps/onnxruntime/onnxruntime/capi";
/// Prefix of the library's file name; a version follows.
const RUNTIME_PREFIX: &str = "libonnxruntime.so";

/// The library that `ORT_DYLIB_PATH` names, else the one of `make deps`, in the working directory or
/// in a folder above this program.
pub(crate) fn library() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(RUNTIME_VARIABLE).filter(|value| !value.is_empty()) {
        return Some(named.into());
    }
    let program = std::env::current_exe().unwrap_or_default();
    let above = program.ancestors().skip(1).map(|folder| folder.join(RUNTIME_FOLDER));
    std::iter::once(RUNTIME_FOLDER.into()).chain(above).find_map(|folder| library_in(&folder))
}

fn library_in(folder: &Path) -> Option<PathBuf> {
    let files = std::fs::read_dir(folder).ok()?;
    let is_library = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(RUNTIME_PREFIX)
    };
    files.filter_map(|file| Some(file.ok()?.path())).filter(is_library).min()
}

/// The environment of the process; ONNX Runtime allows only one.
pub(crate) fn environment(library: &Path) -> Result<Environment, String> {
    static OPENED: Mutex<Option<Environment>> = Mutex::new(None);
    let mut opened = OPENED.lock().expect("opening the environment does not panic");
    if let Some(environment) = &*opened {
        return Ok(environment.clone());
    }
    let builder = ort::init_from(library).map_err(|error| error.to_string())?;
    let environment = builder.with_telemetry(false).build().map_err(|error| error.to_string())?;
    Ok(opened.insert(environment).clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_of_make_deps_is_found_above_the_program() {
        let found = library().expect("`make deps` was run");
        let name = found.file_name().unwrap_or_default().to_string_lossy();
        assert!(name.starts_with(RUNTIME_PREFIX), "{}", found.display());
        assert_eq!(library_in(Path::new(env!("CARGO_MANIFEST_DIR"))), None);
    }
}
