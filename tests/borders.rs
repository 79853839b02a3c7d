//! The borders that ARCHITECTURE.md draws, held by reading the sources: who may name whom, what every
//! file begins with, and how long it may get.

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the root").to_path_buf()
}

/// Every file below `folder` with this extension, relative to the root, with its text.
fn sources(folder: &str, extension: &str) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of the project can be read") {
            let path = entry.expect("an entry can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|found| found == extension) {
                let text = fs::read_to_string(&path).expect("a source is UTF-8");
                let shown = path.strip_prefix(root()).expect("it lies in the root").to_path_buf();
                found.push((shown, text));
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "no .{extension} files in {folder}: is the path right?");
    found
}

/// The lines of code that name `module` in a path (`module::x`) or import it (`use module`).
fn naming(text: &str, module: &str) -> Vec<String> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let names = |line: &str| {
        line.match_indices(module).any(|(at, _)| {
            let before = line[..at].chars().next_back();
            let after = &line[at + module.len()..];
            let starts = !before.is_some_and(is_word);
            let is_path = after.starts_with("::");
            let is_use = line[..at].trim_end().ends_with("use")
                && !after.chars().next().is_some_and(is_word);
            starts && (is_path || is_use)
        })
    };
    text.lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .filter(|line| names(line))
        .map(str::to_owned)
        .collect()
}

fn assert_never_names(folder: &str, modules: &[&str], except: &[&str]) {
    for (path, text) in sources(folder, "rs") {
        if except.iter().any(|except| path.starts_with(except)) {
            continue;
        }
        for module in modules {
            let lines = naming(&text, module);
            assert!(lines.is_empty(), "{} must not name {module}: {lines:?}", path.display());
        }
    }
}

#[test]
fn the_finder_finds() {
    assert_eq!(naming("use tonic::Status;\nlet a = tonic::b();", "tonic").len(), 2);
    assert_eq!(naming("use ort;", "ort").len(), 1);
    assert_eq!(naming("// tonic::x\nuse report::x; sort::y(); let tonic = 1;", "tonic").len(), 0);
    assert_eq!(naming("use report::x; sort::y();", "ort").len(), 0);
    assert_eq!(naming("use crate::http::x;", "http").len(), 1);
}

#[test]
fn kernels_know_no_network_and_no_service() {
    assert_never_names("gpu/src", &["tokio", "tonic", "axum", "ort", "serde"], &[]);
}

#[test]
fn the_pipeline_knows_no_wire() {
    let wire = ["tonic", "axum", "prost", "serde_json", "ingest", "http", "lexsplat_proto"];
    assert_never_names("server/src/pipeline", &wire, &[]);
}

#[test]
fn one_place_knows_onnx_runtime() {
    assert_never_names("server/src", &["ort"], &["server/src/pipeline/network"]);
    let network: Vec<_> = sources("server/src/pipeline", "rs")
        .into_iter()
        .filter(|(path, _)| path.to_string_lossy().contains("/network"))
        .collect();
    let named = network.iter().any(|(_, text)| !naming(text, "ort").is_empty());
    assert!(named, "the exception is for a place that does name ort");
}

#[test]
fn client_and_server_meet_in_proto_only() {
    assert_never_names("client/src", &["lexsplat_server", "lexsplat_gpu", "lexsplat_tests"], &[]);
    assert_never_names("server/src", &["lexsplat_client", "lexsplat_tests"], &[]);
    let server = ["lexsplat_server", "lexsplat_client", "lexsplat_gpu", "lexsplat_tests"];
    assert_never_names("proto/src", &server, &[]);
    assert_never_names("gpu/src", &server[..2], &[]);
    for (package, forbidden) in [
        ("client", "lexsplat-server"),
        ("client", "lexsplat-gpu"),
        ("server", "lexsplat-client"),
        ("gpu", "lexsplat-server"),
    ] {
        let manifest = fs::read_to_string(root().join(package).join("Cargo.toml"))
            .expect("every package has a manifest");
        assert!(!manifest.contains(forbidden), "{package} must not depend on {forbidden}");
    }
}

#[test]
fn every_file_says_what_it_is_and_stays_short() {
    for folder in ["proto/src", "gpu/src", "server/src", "client/src", "tests"] {
        for (path, text) in sources(folder, "rs") {
            let path = path.display();
            assert!(
                text.starts_with("//!") || text.starts_with("#![doc"),
                "{path} does not begin with a module doc"
            );
            let lines = text.lines().count();
            assert!(lines <= 500, "{path} has {lines} lines: at most 500, is it still one noun?");
            for unfinished in [concat!("todo", "!("), concat!("unimplemented", "!(")] {
                assert!(!text.contains(unfinished), "{path} has {unfinished}");
            }
        }
    }
    for (path, text) in sources("gpu/src", "wgsl") {
        let lines = text.lines().count();
        assert!(lines <= 300, "{} has {lines} lines: at most 300", path.display());
        assert!(text.starts_with("//"), "{} does not begin with a comment", path.display());
    }
}
