//! Finds the bundle and ONNX Runtime's library on disk.
//!
//! In: configured paths. Out: existing paths. Relative paths are looked up in the working
//! directory, then beside the executable and in each folder above it. Nothing is loaded here.

use std::path::{Path, PathBuf};

/// The environment variable with the path of ONNX Runtime's library; the convention of `ort`.
const RUNTIME_VARIABLE: &str = "ORT_DYLIB_PATH";
/// Folder in which `make deps` installs ONNX Runtime.
const RUNTIME_FOLDER: &str = ".deps/onnxruntime";
/// Prefix of the library's file name; a version may follow.
const RUNTIME_PREFIX: &str = "libonnxruntime.so";
/// Depth of the search below [`RUNTIME_FOLDER`].
const RUNTIME_DEPTH: usize = 8;

/// A required file is missing.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// ONNX Runtime's library was not found.
    #[error(
        "ONNX Runtime's library was not found: looked for {looked_for}; run `make deps`, or set \
         language.runtime or {RUNTIME_VARIABLE} to a libonnxruntime.so"
    )]
    Runtime {
        /// The paths that were searched.
        looked_for: String,
    },
    /// The bundle's folder was not found.
    #[error(
        "language.models: no folder with a manifest.toml at {models:?}, neither beside the working \
         directory nor beside the executable or a folder above it"
    )]
    Models {
        /// The configured folder.
        models: PathBuf,
    },
}

/// The bundle's folder, which holds a `manifest.toml`.
pub(super) fn bundle(models: &Path) -> Result<PathBuf, FindError> {
    candidates(models)
        .find(|folder| folder.join("manifest.toml").is_file())
        .ok_or_else(|| FindError::Models { models: models.to_owned() })
}

/// ONNX Runtime's shared library: the configured one, else the one of the environment, else the one
/// of `make deps`.
pub(super) fn runtime(configured: Option<&Path>) -> Result<PathBuf, FindError> {
    let named = configured
        .map(Path::to_owned)
        .or_else(|| std::env::var_os(RUNTIME_VARIABLE).filter(|v| !v.is_empty()).map(Into::into));
    let found = match &named {
        Some(path) => candidates(path).find(|path| path.is_file()),
        None => candidates(Path::new(RUNTIME_FOLDER))
            .find_map(|folder| library_below(&folder, RUNTIME_DEPTH)),
    };
    found.ok_or_else(|| FindError::Runtime {
        looked_for: match named {
            Some(path) => path.display().to_string(),
            None => format!("{RUNTIME_FOLDER}/**/{RUNTIME_PREFIX}*"),
        },
    })
}

/// The path itself, then, if it is relative, the same path in each folder above the executable.
fn candidates(path: &Path) -> impl Iterator<Item = PathBuf> {
    let executable = std::env::current_exe().unwrap_or_default();
    let above: Vec<PathBuf> = executable.ancestors().skip(1).map(|dir| dir.join(path)).collect();
    std::iter::once(path.to_owned()).chain(above)
}

/// The first library in or below `folder`, in alphabetical order.
fn library_below(folder: &Path, depth: usize) -> Option<PathBuf> {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).collect();
    entries.sort();
    let is_library = |path: &&PathBuf| {
        path.is_file()
            && path
                .file_name()
                .is_some_and(|name| name.to_string_lossy().starts_with(RUNTIME_PREFIX))
    };
    if let Some(library) = entries.iter().find(is_library) {
        return Some(library.clone());
    }
    let deeper = depth.checked_sub(1)?;
    entries.iter().filter(|path| path.is_dir()).find_map(|dir| library_below(dir, deeper))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_is_found_below_the_folder_and_no_other_file_is() {
        let folder = std::env::temp_dir().join(format!("lexsplat-find-{}", std::process::id()));
        let deep = folder.join("lib/python3/site-packages/onnxruntime/capi");
        std::fs::create_dir_all(&deep).unwrap();
        std::fs::write(deep.join("libonnxruntime_providers_shared.so"), b"").unwrap();
        assert_eq!(library_below(&folder, RUNTIME_DEPTH), None);
        let library = deep.join("libonnxruntime.so.1.31.0");
        std::fs::write(&library, b"").unwrap();
        assert_eq!(library_below(&folder, RUNTIME_DEPTH), Some(library));
        assert_eq!(library_below(&folder, 2), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn errors_name_the_missing_path() {
        let missing = Path::new("no/such/place");
        let error = runtime(Some(missing)).unwrap_err().to_string();
        assert!(error.contains("no/such/place") && error.contains("make deps"), "{error}");
        let error = bundle(missing).unwrap_err().to_string();
        assert!(error.contains("no/such/place") && error.contains("manifest.toml"), "{error}");
    }
}
