//! Prints imports, circles among them, or lengths of files and functions, of source folders.

use lexsplat_borders::source::{Crate, Sources, read};
use lexsplat_borders::{graph, imports, lengths};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::ExitCode;

const USAGE: &str = "usage: lexsplat-borders (circles | imports | lengths) FOLDER...  (each with lib.rs or main.rs)";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let result = match arguments.split_first() {
        Some((command, folders)) if command == "circles" && !folders.is_empty() => {
            folders.iter().try_for_each(|folder| print_circles(folder))
        }
        Some((command, folders)) if command == "imports" && !folders.is_empty() => {
            folders.iter().try_for_each(|folder| print_imports(folder))
        }
        Some((command, folders)) if command == "lengths" && !folders.is_empty() => {
            print_lengths(folders)
        }
        _ => Err(USAGE.to_owned()),
    };
    if let Err(error) = result {
        eprintln!("{error}");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// The crates of a source folder: a library, a program, or both.
fn crates(folder: &str) -> Result<(Sources, Vec<Crate>), String> {
    let sources = read(Path::new(folder))?;
    let roots =
        ["lib.rs", "main.rs"].into_iter().filter(|root| sources.contains_key(Path::new(root)));
    let parsed: Vec<Crate> =
        roots.map(|root| Crate::parse(&sources, root)).collect::<Result<_, _>>()?;
    if parsed.is_empty() {
        return Err(format!("{folder} has neither lib.rs nor main.rs"));
    }
    Ok((sources, parsed))
}

fn print_circles(folder: &str) -> Result<(), String> {
    for parsed in crates(folder)?.1 {
        let imports = imports::imports(&parsed);
        let circles = graph::circles(&imports);
        let files: usize = circles.iter().map(|circle| circle.files.len()).sum();
        println!(
            "{folder} ({}): {} circles with {files} of {} files",
            parsed.files[0].display(),
            circles.len(),
            parsed.files.len()
        );
        let name = |file: usize| parsed.files[file].display().to_string();
        for circle in &circles {
            let way: Vec<String> = circle.way.iter().map(|&file| name(file)).collect();
            println!("  circle of {}: {}", circle.files.len(), way.join(" -> "));
            for (from, to, paths) in pairs(circle, &imports) {
                println!("    {} -> {}  ({})", name(from), name(to), paths.join(", "));
            }
        }
    }
    Ok(())
}

/// Each pair of files of which the first imports the second.
fn print_imports(folder: &str) -> Result<(), String> {
    for parsed in crates(folder)?.1 {
        let pairs: BTreeSet<_> =
            imports::imports(&parsed).iter().map(|import| (import.from, import.to)).collect();
        for (from, to) in pairs {
            println!("{} -> {}", parsed.files[from].display(), parsed.files[to].display());
        }
    }
    Ok(())
}

/// For each pair of files in a circle, the paths that the first names of the second.
fn pairs(circle: &graph::Circle, imports: &[imports::Import]) -> Vec<(usize, usize, Vec<String>)> {
    let mut found: BTreeMap<(usize, usize), BTreeSet<String>> = BTreeMap::new();
    for import in imports {
        if circle.files.contains(&import.from) && circle.files.contains(&import.to) {
            let path = format!("{} in line {}", import.path, import.line);
            found.entry((import.from, import.to)).or_default().insert(path);
        }
    }
    found.into_iter().map(|((from, to), paths)| (from, to, paths.into_iter().collect())).collect()
}

fn print_lengths(folders: &[String]) -> Result<(), String> {
    let (mut files, mut functions) = (Vec::new(), Vec::new());
    for folder in folders {
        let (sources, crates) = crates(folder)?;
        for parsed in &crates {
            let name = |file: usize| format!("{folder}/{}", parsed.files[file].display());
            let lines = lengths::files(parsed, &sources);
            files.extend(lines.into_iter().enumerate().map(|(file, lines)| (lines, name(file))));
            functions.extend(lengths::functions(parsed).into_iter().map(|function| {
                (
                    function.lines,
                    format!("{}:{} {}", name(function.file), function.line, function.name),
                )
            }));
        }
    }
    for (kind, mut found) in [("files", files), ("functions", functions)] {
        found.sort_unstable();
        let median = lengths::median(found.iter().map(|(lines, _)| *lines));
        println!("{} {kind}, median {median} lines; the longest:", found.len());
        for (lines, name) in found.iter().rev().take(10) {
            println!("  {lines:4} {name}");
        }
    }
    Ok(())
}
