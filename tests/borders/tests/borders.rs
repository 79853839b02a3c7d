//! The borders that ARCHITECTURE.md draws, held by reading the sources: the order of modules, who may
//! name an outside crate, what every file begins with, and how long files and functions may get.

mod orders;

use lexsplat_borders::source::{Crate, Sources};
use lexsplat_borders::{graph, imports, lengths, order};
use orders::{CRATES, Circles, Declared};
use std::fs;
use std::path::{Path, PathBuf};

/// Lines of a file of product code.
const MAX_FILE_LINES: usize = 400;
/// Lines of a function of product code, from `fn` to the closing brace.
const MAX_FUNCTION_LINES: usize = 60;
/// Files that may hold `impl` blocks of one type.
const MAX_IMPL_FILES: usize = 2;

fn root() -> PathBuf {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("borders/ lies in tests/");
    tests.parent().expect("tests/ lies in the root").to_path_buf()
}

/// The sources and the parsed crate of a declaration.
fn parse(declared: &Declared) -> (Sources, Crate) {
    let read = || {
        let sources = lexsplat_borders::source::read(&root().join(declared.folder))?;
        let parsed = Crate::parse(&sources, declared.root)?;
        Ok((sources, parsed))
    };
    read().unwrap_or_else(|error: String| panic!("{}: {error}", declared.folder))
}

/// A tree of files that exists only in a test.
fn planted(files: &[(&str, &str)]) -> (Sources, Crate) {
    let sources: Sources =
        files.iter().map(|(path, text)| (PathBuf::from(path), (*text).to_owned())).collect();
    let parsed = Crate::parse(&sources, "lib.rs").expect("the planted tree is Rust");
    (sources, parsed)
}

/// Circles that are not allowed, each as its shortest way round.
fn forbidden_circles(parsed: &Crate, allowed: Circles) -> Vec<String> {
    let imports = imports::imports(parsed);
    let is_one_folder = |circle: &graph::Circle| {
        let mut folders = circle.files.iter().map(|&file| parsed.files[file].parent());
        let first = folders.next().flatten();
        first.is_some_and(|first| first != Path::new("") && folders.all(|one| one == Some(first)))
    };
    let is_forbidden = |circle: &graph::Circle| match allowed {
        Circles::Never => true,
        Circles::InsideOneFolder => !is_one_folder(circle),
    };
    let way = |circle: &graph::Circle| {
        let files: Vec<String> =
            circle.way.iter().map(|&file| parsed.files[file].display().to_string()).collect();
        files.join(" -> ")
    };
    let circles = graph::circles(&imports);
    circles.iter().filter(|circle| is_forbidden(circle)).map(way).collect()
}

/// What is too long or too scattered, each in words.
fn too_long(sources: &Sources, parsed: &Crate) -> Vec<String> {
    let name = |file: usize| parsed.files[file].display();
    let mut found = Vec::new();
    for (file, lines) in lengths::files(parsed, sources).into_iter().enumerate() {
        if lines > MAX_FILE_LINES {
            found.push(format!("{} has {lines} lines: at most {MAX_FILE_LINES}", name(file)));
        }
    }
    for lengths::Function { file, name: function, line, lines } in lengths::functions(parsed) {
        if lines > MAX_FUNCTION_LINES {
            let file = name(file);
            found.push(format!(
                "{file}:{line}: {function} has {lines} lines: at most {MAX_FUNCTION_LINES}"
            ));
        }
    }
    for ((_, type_name), files) in lengths::impls(parsed) {
        if files.len() > MAX_IMPL_FILES {
            let files: Vec<String> = files.iter().map(|&file| name(file).to_string()).collect();
            found.push(format!("{type_name} has impl blocks in {}", files.join(", ")));
        }
    }
    found
}

#[test]
fn imports_run_down_and_never_round() {
    let mut failures = Vec::new();
    for declared in CRATES {
        let (_, parsed) = parse(declared);
        let name = format!("{}/{}", declared.folder, declared.root);
        for way in forbidden_circles(&parsed, declared.circles) {
            failures.push(format!("{name}: circle {way}"));
        }
        for what in order::violations(declared.levels, &parsed.files, &imports::imports(&parsed)) {
            failures.push(format!("{name}: {what}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn product_code_stays_short() {
    let mut failures = Vec::new();
    let (mut files, mut functions) = (Vec::new(), Vec::new());
    for declared in CRATES {
        let (sources, parsed) = parse(declared);
        let found = too_long(&sources, &parsed);
        failures.extend(found.into_iter().map(|what| format!("{}/{what}", declared.folder)));
        files.extend(lengths::files(&parsed, &sources));
        functions.extend(lengths::functions(&parsed).into_iter().map(|function| function.lines));
    }
    assert!(files.len() > 50 && functions.len() > 500, "the sources were not read");
    println!("{} files, longest {:?}", files.len(), files.iter().max());
    println!("{} functions, longest {:?}", functions.len(), functions.iter().max());
    println!("median file {} lines", lengths::median(files));
    println!("median function {} lines", lengths::median(functions));
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Negative control: imports that run up, sideways or round are found in a small tree.
#[test]
fn planted_faults_are_found() {
    let levels: &order::Levels<'_> = &[&["low"], &["left", "right"], &["lib"]];
    let good: &[(&str, &str)] = &[
        ("lib.rs", "mod low; mod left; mod right; pub use left::Left;"),
        ("low.rs", "pub(crate) struct Low; #[cfg(test)] mod tests { use crate::left::Left; }"),
        ("left/mod.rs", "mod part; use crate::low::Low; pub use part::Part; pub struct Left(Low);"),
        ("left/part.rs", "pub(in crate::left) fn f() {} pub struct Part;"),
        ("new.rs", ""),
        ("right.rs", "use crate::low; fn f() -> low::Low { low::Low }"),
    ];
    let check = |change: Option<(&str, &str)>| {
        let with_change = |&(path, text): &(&'static str, &'static str)| {
            (path, change.filter(|(changed, _)| *changed == path).map_or(text, |(_, text)| text))
        };
        let (_, parsed) = planted(&good.iter().map(with_change).collect::<Vec<_>>());
        let mut found = order::violations(levels, &parsed.files, &imports::imports(&parsed));
        found.extend(forbidden_circles(&parsed, Circles::Never));
        found.join("\n")
    };
    assert_eq!(check(None), "");
    let faults = [
        ("low.rs", "pub struct Low; use super::right;", "low must not import right"),
        ("low.rs", "pub struct Low; fn f() { crate::left::Part; }", "low must not import left"),
        (
            "low.rs",
            "pub struct Low; fn f() { g!(1, [crate::left::Part]) }",
            "low.rs:1: low must not",
        ),
        ("low.rs", "pub struct Low; use crate::Left;", "low must not import lib"),
        ("low.rs", "pub struct Low; use crate::Left;", "lib.rs -> left/mod.rs -> low.rs -> lib.rs"),
        ("right.rs", "use crate::left as l; fn f() { l::Left }", "right must not import left"),
        (
            "left/part.rs",
            "use super::Left; pub struct Part;",
            "left/mod.rs -> left/part.rs -> left/mod.rs",
        ),
        ("left/part.rs", "use super::*; pub struct Part;", "left/mod.rs -> left/part.rs"),
        ("lib.rs", "mod low; mod left; mod right; mod odd { } mod new;", "new.rs has no place"),
        ("lib.rs", "mod low; mod left;", "names right, which has no file"),
    ];
    for (path, text, says) in faults {
        let found = check(Some((path, text)));
        assert!(found.contains(says), "{path} with {text:?}: no {says:?} in {found:?}");
    }
}

/// Negative control: where circles are allowed inside one folder, others are still found.
#[test]
fn circles_are_allowed_inside_one_folder_only() {
    let inside: &[(&str, &str)] = &[
        ("lib.rs", "mod kernel;"),
        ("kernel/mod.rs", "mod oracle; use oracle::f; pub struct K;"),
        ("kernel/oracle.rs", "use super::K; pub fn f() {}"),
    ];
    let (_, parsed) = planted(inside);
    assert!(forbidden_circles(&parsed, Circles::InsideOneFolder).is_empty());
    assert_eq!(forbidden_circles(&parsed, Circles::Never).len(), 1);
    let across: &[(&str, &str)] = &[
        ("lib.rs", "mod kernel; mod other;"),
        ("kernel/mod.rs", "use crate::other::O; pub struct K;"),
        ("other/mod.rs", "use crate::kernel::K; pub struct O;"),
    ];
    let (_, parsed) = planted(across);
    assert_eq!(forbidden_circles(&parsed, Circles::InsideOneFolder).len(), 1);
    let at_the_root: &[(&str, &str)] = &[
        ("lib.rs", "mod a; mod b;"),
        ("a.rs", "use crate::b::B; pub struct A;"),
        ("b.rs", "use crate::a::A; pub struct B;"),
    ];
    let (_, parsed) = planted(at_the_root);
    assert_eq!(forbidden_circles(&parsed, Circles::InsideOneFolder).len(), 1);
}

/// Negative control: one line more than allowed, and one file more than allowed, are found.
#[test]
fn planted_lengths_are_found() {
    let function = |lines: usize| format!("fn f() {{\n{}}}\n", "g();\n".repeat(lines - 2));
    let found = |text: &str| {
        let (sources, parsed) = planted(&[("lib.rs", text)]);
        too_long(&sources, &parsed).join("\n")
    };
    assert_eq!(found(&function(MAX_FUNCTION_LINES)), "");
    assert!(found(&function(MAX_FUNCTION_LINES + 1)).contains("lib.rs:1: f has 61 lines"));
    let method = format!("struct S;\nimpl S {{\n{}}}\n", function(MAX_FUNCTION_LINES + 1));
    assert!(found(&method).contains("lib.rs:3: f has 61 lines"));
    assert_eq!(found(&format!("#[cfg(test)]\nmod tests {{ {} }}", function(99))), "");
    assert_eq!(found(&"\n".repeat(MAX_FILE_LINES)), "");
    assert!(found(&"\n".repeat(MAX_FILE_LINES + 1)).contains("lib.rs has 401 lines"));

    let scattered = |third: &str| {
        let (sources, parsed) = planted(&[
            ("lib.rs", "mod a; mod b; pub use a::T;"),
            ("a.rs", "pub struct T; impl T { fn a() {} } impl Clone for T {}"),
            ("b.rs", third),
        ]);
        let both: Vec<_> = lengths::impls(&parsed).into_values().map(|files| files.len()).collect();
        (too_long(&sources, &parsed), both)
    };
    assert_eq!(scattered("use crate::T; impl T { fn b() {} }").1, [2], "through a re-export");
    assert_eq!(scattered("struct T; impl T { fn b() {} }").1, [1, 1], "another type of that name");
    let (sources, parsed) = planted(&[
        ("lib.rs", "mod a; mod b; mod c;"),
        ("a.rs", "pub struct T; impl T { fn a() {} }"),
        ("b.rs", "impl super::a::T { fn b() {} }"),
        ("c.rs", "use super::a::T; impl T { fn c() {} }"),
    ]);
    assert_eq!(too_long(&sources, &parsed), ["T has impl blocks in a.rs, b.rs, c.rs"]);
}

/// A median of an even number is the higher of the two in the middle.
#[test]
fn medians_are_right() {
    assert_eq!(lengths::median([3, 1, 2]), 2);
    assert_eq!(lengths::median([4, 1, 2, 3]), 3);
    assert_eq!(lengths::median([]), 0);
}

/// The sources of the client's packages.
const CLIENT_FOLDERS: [&str; 4] =
    ["client/src", "client/synthetic/src", "client/evaluate/src", "client/cli/src"];

/// Files below `folder` with this extension: path relative to the root, and text.
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
fn names_of_crates_are_found() {
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
fn registration_and_features_know_pictures_only() {
    let others = ["tokio", "lexsplat_server", "lexsplat_gpu", "lexsplat_proto", "wgpu"];
    assert_never_names("server/registration/src", &others, &[]);
    assert_never_names("server/pictures/src", &others, &[]);
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
fn client_and_server_meet_in_proto_and_uploaded_recordings_only() {
    for folder in CLIENT_FOLDERS {
        assert_never_names(folder, &["lexsplat_server", "lexsplat_gpu", "lexsplat_tests"], &[]);
    }
    let clients = ["lexsplat_client", "lexsplat_synthetic", "lexsplat_evaluate"];
    assert_never_names("client/src", &clients[1..], &[]);
    assert_never_names("client/synthetic/src", &clients[2..], &[]);
    // Uploaded recordings are read and streamed as on the command line.
    assert_never_names("server/src", &clients, &["server/src/import"]);
    assert_never_names("server/src/import", &clients[1..], &[]);
    assert_never_names("server/src", &["lexsplat_tests"], &[]);
    let server = ["lexsplat_server", "lexsplat_client", "lexsplat_gpu", "lexsplat_tests"];
    assert_never_names("proto/src", &server, &[]);
    assert_never_names("gpu/src", &server[..2], &[]);
    for (package, forbidden) in [
        ("client", "lexsplat-server"),
        ("client", "lexsplat-gpu"),
        ("client/synthetic", "lexsplat-server"),
        ("client/synthetic", "lexsplat-gpu"),
        ("client/evaluate", "lexsplat-server"),
        ("client/evaluate", "lexsplat-gpu"),
        ("client/cli", "lexsplat-server"),
        ("client/cli", "lexsplat-gpu"),
        ("server", "lexsplat-synthetic"),
        ("server", "lexsplat-evaluate"),
        ("gpu", "lexsplat-server"),
    ] {
        let manifest = fs::read_to_string(root().join(package).join("Cargo.toml"))
            .expect("every package has a manifest");
        assert!(!manifest.contains(forbidden), "{package} must not depend on {forbidden}");
    }
}

/// `rust-toolchain.toml`, `rust-version` and continuous integration name the same compiler, so that the
/// oldest compiler that is promised is the one that runs the tests.
#[test]
fn the_tests_run_on_the_oldest_compiler_that_is_promised() {
    let read = |path: &str| fs::read_to_string(root().join(path)).expect("it is there");
    let manifest = read("Cargo.toml");
    let promised = manifest.lines().find_map(|line| line.strip_prefix("rust-version = "));
    let promised = promised.expect("a rust-version").trim_matches('"');
    for (path, says) in [
        ("rust-toolchain.toml", format!("channel = \"{promised}.0\"")),
        (".github/workflows/ci.yaml", format!("rust-toolchain@{promised}.0")),
    ] {
        assert!(read(path).contains(&says), "{path} does not say {says:?}");
    }
}

#[test]
fn every_file_says_what_it_is_and_stays_short() {
    let server = ["server/src", "server/pictures/src", "server/registration/src"];
    for folder in server.into_iter().chain(["proto/src", "gpu/src", "tests"]).chain(CLIENT_FOLDERS)
    {
        for (path, text) in sources(folder, "rs") {
            let path = path.display();
            assert!(
                text.starts_with("//!") || text.starts_with("#![doc"),
                "{path} does not begin with a module doc"
            );
            let lines = text.lines().count();
            assert!(lines <= 500, "{path} has {lines} lines: at most 500, tests too");
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
