//! A robot links what the library depends on, so its dependency tree stays small: no network
//! runtime, no plots, no command line, no thread pool.

use std::collections::BTreeSet;
use std::process::Command;

/// Packages that a robot's program must not need.
const FORBIDDEN: [&str; 14] = [
    "clap",
    "comfy-table",
    "dejavu",
    "indicatif",
    "lexsplat-evaluate",
    "lexsplat-gpu",
    "lexsplat-server",
    "lexsplat-synthetic",
    "ort",
    "plotters",
    "rand_chacha",
    "rayon",
    "rstar",
    "wgpu",
];

/// Names of the packages that a package of this workspace links, itself included.
fn linked(package: &str) -> BTreeSet<String> {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--edges", "normal", "--prefix", "none"])
        .args(["--package", package])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    let lines = String::from_utf8(tree.stdout).expect("names are UTF-8");
    lines.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

fn forbidden(package: &str) -> Vec<&'static str> {
    let linked = linked(package);
    assert!(linked.contains("lexsplat-proto"), "{package}: the tree was not read");
    FORBIDDEN.into_iter().filter(|name| linked.contains(*name)).collect()
}

#[test]
fn a_robot_links_no_heavy_crate() {
    assert_eq!(forbidden("lexsplat-client"), [] as [&str; 0]);
}

/// Negative control: the crates that do need them are found to do so.
#[test]
fn heavy_crates_are_found_where_they_are() {
    let evaluate = forbidden("lexsplat-evaluate");
    for name in ["comfy-table", "dejavu", "ort", "plotters", "rand_chacha", "rayon", "rstar"] {
        assert!(evaluate.contains(&name), "{name} is missing in {evaluate:?}");
    }
    let cli = forbidden("lexsplat-cli");
    for name in ["clap", "indicatif", "lexsplat-evaluate", "lexsplat-synthetic", "ort"] {
        assert!(cli.contains(&name), "{name} is missing in {cli:?}");
    }
}
